"""Mounting of a lidar on the airframe: bearings from azimuths of the lidar, and sectors that are blocked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

SECTORS: Final = 72  # OBSTACLE_DISTANCE has no more
SECTOR_DEG: Final = 360 / SECTORS


@dataclass(frozen=True, slots=True)
class Mounting:
    """Bearings are degrees clockwise from the nose, seen from above the vehicle.

    `yaw_deg`: the bearing at which the lidar's zero looks. `upside_down`: turned over, about the axis through its zero.
    """

    yaw_deg: float = 0.0
    upside_down: bool = False
    mask: frozenset[int] = frozenset()  # sectors that the airframe blocks

    def sectors(self) -> tuple[int, ...]:
        """Sector of each azimuth of the lidar's, in 0.01 degree."""
        turn = -1 if self.upside_down else 1
        return tuple(sector_at(self.yaw_deg + turn * cdeg / 100.0) for cdeg in range(36000))

    def band_m(self, low_m: float, high_m: float) -> tuple[float, float]:
        """The band above the lidar's plane of one above the vehicle's."""
        return (-high_m, -low_m) if self.upside_down else (low_m, high_m)


def sector_at(bearing_deg: float) -> int:
    """Sector of a bearing: sector k is the 5 degrees about 5 k, so that number 0 looks ahead."""
    return math.floor(bearing_deg / SECTOR_DEG + 0.5) % SECTORS
