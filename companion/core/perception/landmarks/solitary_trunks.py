"""Trunks that may be told to others: solitary ones, seen often, that stand still; leaves and thickets look alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.beacon import ToldTrunk
from companion.core.perception.landmarks.trunk_tracks import Trunk

SIGHTINGS: Final = 6
CHI2_MAX: Final = 4.0  # of its sightings, lately
ALONE_M: Final = 1.5  # from any other track
FRESH_S: Final = 1.0  # since it was seen


@final
class SolitaryTrunks:
    """Trunks in sight, and the own place among them: metres north and east, in the frame of the own odometry."""

    __slots__ = ("frame", "place_ne_m", "trunks")

    def __init__(
        self, trunks: Sequence[ToldTrunk], place_ne_m: tuple[float, float], frame: tuple[float, float, float]
    ) -> None:
        """`trunks`: north, east and diameter of each; `frame`: as `ScanOdometry.frame`."""
        self.trunks: Final = trunks
        self.place_ne_m: Final = place_ne_m
        self.frame: Final = frame


def find_solitary(trunks: Sequence[Trunk], now_s: float) -> list[ToldTrunk]:
    """North, east and diameter of those that may be told."""
    found: list[ToldTrunk] = []
    for trunk in trunks:
        is_sure = trunk.is_good and trunk.sightings >= SIGHTINGS and trunk.chi2 < CHI2_MAX
        if is_sure and now_s - trunk.seen_s <= FRESH_S and _is_alone(trunk, trunks):
            found.append((trunk.north_m, trunk.east_m, 2.0 * trunk.radius_m))
    return found


def _is_alone(trunk: Trunk, trunks: Sequence[Trunk]) -> bool:
    for other in trunks:
        if other is not trunk and math.hypot(other.north_m - trunk.north_m, other.east_m - trunk.east_m) < ALONE_M:
            return False
    return True
