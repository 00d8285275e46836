"""Rays that ended on one trunk, pooled over many scans: bounded, thinned evenly when it is full."""

from __future__ import annotations

from array import array
from typing import Final, final

RAYS_MAX: Final = 1500  # of one stem: 9 columns of 4 bytes, 54 kB; thinned to half when they are reached
COLUMNS: Final = 9
LEFT: Final = 1
RIGHT: Final = 2


@final
class StemRays:
    """One trunk that is in sight. Metres; north and east in the frame of the own odometry, heights up."""

    __slots__ = (
        "_every",
        "_skipped",
        "born_s",
        "east_m",
        "frame_sd_m",
        "ground_up_m",
        "last_s",
        "north_m",
        "radius_m",
        "ray_s",
        "rays",
        "to_mission_ne_m",
    )

    def __init__(self, north_m: float, east_m: float, radius_m: float, now_s: float) -> None:
        self.north_m = north_m  # the axis, as it is tracked
        self.east_m = east_m
        self.radius_m = radius_m
        self.born_s: Final = now_s
        self.last_s = now_s  # when it was tracked last
        self.ray_s = now_s  # the last ray
        self.to_mission_ne_m = (0.0, 0.0)  # to be added, as of the last ray
        self.frame_sd_m = 0.0
        self.ground_up_m: float | None = None  # of the ground at it, by rays
        # Rows of COLUMNS: north, east, up of where a ray ended; its eye's north, east; LEFT and RIGHT where the ray
        # beside it went on; metres along it; its turn; elevation of its layer, rad
        self.rays: array[float] = array("f")
        self._every = 1  # of how many rays one is kept
        self._skipped = 0

    @property
    def count(self) -> int:
        """Rays that are kept."""
        return len(self.rays) // COLUMNS

    def add(self, row: tuple[float, ...], now_s: float) -> None:
        """A ray."""
        self.ray_s = now_s
        self._skipped += 1
        if self._skipped < self._every:
            return
        self._skipped = 0
        self.rays.extend(row)
        if self.count >= RAYS_MAX:
            kept: array[float] = array("f")
            for k in range(0, RAYS_MAX, 2):
                kept.extend(self.rays[COLUMNS * k : COLUMNS * k + COLUMNS])
            self.rays = kept
            self._every *= 2
