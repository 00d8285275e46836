"""Places that a search for a way knows without having seen them: of those that hover, mission trunks, the fence.

From the vehicle, metres north and east. The sides of a fence are barred: no way leads over them, and a target beyond
one is taken to be before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.safety.bounds import is_inside

Level = tuple[float, float]
Disc = tuple[float, float, float]  # a place, and what is kept from it

STEP_M: Final = 0.6  # between two discs of a side
KEEP_M: Final = 0.5  # and so wide that no diagonal step of the search gets through between them
BEFORE_M: Final = 1.5  # a target that is beyond a side: before it


@final
class KnownPlaces:
    """At one moment."""

    __slots__ = ("_discs", "_fence")

    def __init__(self, discs: Sequence[Disc] = (), fence: Sequence[Level] = ()) -> None:
        """`fence`: its corners in order; none: there is no fence. One that is outside of it may come back."""
        self._discs: Final = discs
        self._fence: Final = fence if is_inside(0.0, 0.0, fence) else ()

    def find_discs(self, within_m: float) -> list[Disc]:
        """All of them, and along the sides of the fence those within that distance."""
        found = list(self._discs)
        for k in range(len(self._fence)):
            (n0, e0), (n1, e1) = self._fence[k - 1], self._fence[k]
            long_m = math.hypot(n1 - n0, e1 - e0)
            if long_m == 0.0:
                continue
            u_n, u_e = (n1 - n0) / long_m, (e1 - e0) / long_m
            nearest_m = -(n0 * u_n + e0 * u_e)  # along the side, from its first corner
            first_m, last_m = max(0.0, nearest_m - within_m), min(long_m, nearest_m + within_m)
            aside_m = abs(n0 * u_e - e0 * u_n)
            if aside_m > within_m or first_m > last_m:
                continue
            for step in range(math.ceil((last_m - first_m) / STEP_M) + 1):
                along_m = min(last_m, first_m + STEP_M * step)
                found.append((n0 + along_m * u_n, e0 + along_m * u_e, KEEP_M))
        return found

    def end_before(self, target: Level) -> Level:
        """A target, or a place on the straight way to it before the first side of the fence that this crosses."""
        share = 1.0
        for k in range(len(self._fence)):
            (n0, e0), (n1, e1) = self._fence[k - 1], self._fence[k]
            d_n, d_e = n1 - n0, e1 - e0
            across = target[0] * d_e - target[1] * d_n
            if across == 0.0:
                continue
            of_way, of_side = (n0 * d_e - e0 * d_n) / across, (n0 * target[1] - e0 * target[0]) / across
            if 0.0 <= of_side <= 1.0 and 0.0 <= of_way < share:
                share = of_way
        if share == 1.0:
            return target
        long_m = math.hypot(target[0], target[1])
        kept = max(0.0, share * long_m - BEFORE_M) / long_m
        return kept * target[0], kept * target[1]


NOTHING: Final = KnownPlaces()
