"""A check that vehicles stand where the mission puts them, as far as distances tell: before anybody takes off.

Distances do not see a formation that is turned or mirrored as a whole: see `find_mismatch`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Level

NEARER_M: Final = 3.0  # positions are right to 0.5 m on each axis: four standard deviations of a distance
FARTHER_M: Final = 4.0  # the same, and what comes round a trunk is up to a metre too long
FROM_COUNT: Final = 10  # ranges of a pair: a second's
FOLLOWS: Final = 0.1  # share by which one range more changes what a distance is taken for


@final
class StartPlacementCheck:
    """Feed it with level distances while all stand on the ground, and ask for `find_mismatch`."""

    __slots__ = ("_apart_m", "_counts", "_named", "_positions", "_text")

    def __init__(self, positions: Sequence[Level]) -> None:
        """The mission's: of vehicle 1, 2, ..."""
        self._positions = positions
        self._apart_m: dict[tuple[int, int], float] = {}
        self._counts: dict[tuple[int, int], int] = {}
        self._named: tuple[int, int] | None = None
        self._text = ""

    def add_range(self, one: int, other: int, level_m: float) -> None:
        """The level distance between two of the mission's vehicles."""
        pair = (one, other) if one < other else (other, one)
        count = self._counts.get(pair, 0) + 1
        before = self._apart_m.get(pair, level_m)
        self._counts[pair] = count
        self._apart_m[pair] = before + max(FOLLOWS, 1.0 / count) * (level_m - before)

    def find_mismatch(self) -> str:
        """Two vehicles that are not as far apart as their positions, in words, the same while they are; empty: none."""
        if self._named is None or self._off(self._named) <= 1.0:
            worst = max(self._apart_m, key=self._off, default=None)
            self._named, self._text = None, ""
            if worst is not None and self._off(worst) > 1.0:
                one, other = self._named = worst
                apart_m, expected_m = self._apart_m[worst], self._distance_m(worst)
                self._text = f"{one}-{other} start {apart_m:.1f} m apart, not {expected_m:.1f} m"
        return self._text

    def _off(self, pair: tuple[int, int]) -> float:
        """The error of a pair's distance; 1: as much as is borne."""
        if self._counts[pair] < FROM_COUNT:
            return 0.0
        off_m = self._apart_m[pair] - self._distance_m(pair)
        return max(off_m / FARTHER_M, -off_m / NEARER_M)

    def _distance_m(self, pair: tuple[int, int]) -> float:
        return math.dist(self._positions[pair[0] - 1], self._positions[pair[1] - 1])
