"""The gate of a relative filter: the share of its weight that a measurement keeps, by its innovation."""

from __future__ import annotations

import math
from typing import Final, final

SOFT: Final = 2.5  # sigmas: of an innovation that is larger the weight falls
HARD: Final = 6.0  # one that is larger says nothing
TRUST: Final = 2000.0  # measurements: where innovations are larger than is believed, so are the errors of ranges


@final
class InnovationGate:
    """`mean_square`: normalised innovation squared, lately; `used`, `dropped`: measurements."""

    __slots__ = ("_squares", "dropped", "mean_square", "used")

    def __init__(self) -> None:
        self.used = self.dropped = 0
        self.mean_square = 1.0
        self._squares = 0.0

    def weigh(self, off: float, expected: float) -> float:
        """The share of its weight that a measurement keeps; 0: dropped. `expected`: the innovation's variance."""
        ratio2 = off * off / expected
        if ratio2 > HARD * HARD:
            self.dropped += 1
            return 0.0
        self.used += 1
        counted = min(ratio2, SOFT * SOFT)
        self._squares += counted
        self.mean_square += (ratio2 - self.mean_square) / TRUST
        keep = counted / ratio2 if ratio2 > 0.0 else 1.0
        return keep * keep if off > 0.0 else keep  # what comes round a trunk comes late, never early

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared, each at most SOFT's: 0.98 if errors are normal and as believed."""
        return self._squares / self.used if self.used else math.nan
