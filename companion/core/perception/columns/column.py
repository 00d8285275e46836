"""One upright column of cells: which of them own rays have passed, and which stopped them.

A cell is free by rays that went through it, and by nothing else: one that no ray has passed is not. What stopped a ray
in it bars it until that has grown old. Both are remembered for a while only, as the frame of the own position drifts.
"""

from __future__ import annotations

import math
from typing import Final, final

from mission.common.frames import Vec3

CELL_M: Final = 0.5  # level: a hull is wider
LEVEL_M: Final = 1.0  # upright: layers of 4.2 degrees are so far apart 14 m away
STEP_M: Final = 0.2  # along a ray, level: less than half a cell, and at 52 degrees a quarter of a level
LEAST_PASSES: Final = 2  # rays: one may have been taken by a gap between twigs
STALE_S: Final = 180.0  # a minute each for the way there, the ring, and the rise
SHORT_M: Final = 0.3  # of a hit: so far before it a ray tells nothing
NEVER: Final = -1e9


@final
class Column:
    """Cells about one axis, from `floor_up_m` in steps of LEVEL_M. Metres; north, east in the own odometry's frame."""

    __slots__ = (
        "_across",
        "_hit_s",
        "_passed_s",
        "_passes",
        "_touched",
        "_within",
        "east_m",
        "floor_up_m",
        "levels",
        "north_m",
    )

    def __init__(self, north_m: float, east_m: float, *, radius_m: float, floor_up_m: float, top_up_m: float) -> None:
        self.north_m: Final = north_m
        self.east_m: Final = east_m
        self.floor_up_m: Final = floor_up_m
        self.levels: Final = max(1, math.ceil((top_up_m - floor_up_m) / LEVEL_M - 1e-9))
        across = 2 * math.ceil(radius_m / CELL_M)
        middle = 0.5 * (across - 1)
        self._across: Final = across
        away_m = [math.hypot(i - middle, j - middle) * CELL_M for i in range(across) for j in range(across)]
        # Cells of a level: those of which half is within the radius have to be passed, and any that reaches in counts
        self._within: Final = [k for k, m in enumerate(away_m) if m <= radius_m]
        self._touched: Final = [k for k, m in enumerate(away_m) if m <= radius_m + CELL_M / math.sqrt(2.0)]
        count = across * across * self.levels
        self._passes: Final = [0] * count
        self._passed_s: Final = [NEVER] * count
        self._hit_s: Final = [NEVER] * count

    @property
    def half_m(self) -> float:
        """From the axis to a side of the square of cells."""
        return 0.5 * self._across * CELL_M

    def add_ray(self, eye_ned_m: Vec3, way_ned: Vec3, range_m: float, max_m: float, now_s: float) -> None:
        """A ray from there along a unit vector; `range_m` beyond `max_m`: nothing stopped it so far."""
        way_n, way_e, way_d = way_ned
        flat = math.sqrt(way_n * way_n + way_e * way_e)
        if flat < 1e-3:
            return
        n, e = self.north_m - eye_ned_m[0], self.east_m - eye_ned_m[1]
        along_m = (n * way_n + e * way_e) / flat
        beside_m2 = n * n + e * e - along_m * along_m
        half_m = self.half_m
        if beside_m2 > 2.0 * half_m * half_m:
            return
        chord_m = math.sqrt(2.0 * half_m * half_m - max(0.0, beside_m2))  # of the circle about the square
        is_hit = range_m <= max_m
        first_m = max(0.0, along_m - chord_m)
        last_m = min(along_m + chord_m, flat * (range_m - SHORT_M if is_hit else max_m))
        slope, unit_n, unit_e = -way_d / flat, way_n / flat, way_e / flat
        before, at_m = -1, first_m
        while at_m <= last_m:
            cell = self._cell(unit_n * at_m - n, unit_e * at_m - e, slope * at_m - eye_ned_m[2])
            if cell >= 0 and cell != before:
                if self._passes[cell] < LEAST_PASSES or now_s - self._passed_s[cell] <= STALE_S:
                    self._passes[cell] += 1
                else:
                    self._passes[cell] = 1
                self._passed_s[cell] = now_s
                before = cell
            at_m += STEP_M
        if is_hit:
            hit_m = flat * range_m
            cell = self._cell(unit_n * hit_m - n, unit_e * hit_m - e, slope * hit_m - eye_ned_m[2])
            if cell >= 0:
                self._hit_s[cell] = now_s

    def _cell(self, north_m: float, east_m: float, up_m: float) -> int:
        """Index of the cell there, level about the axis; -1: none of this column's."""
        across, half_m = self._across, self.half_m
        i, j = math.floor((north_m + half_m) / CELL_M), math.floor((east_m + half_m) / CELL_M)
        level = math.floor((up_m - self.floor_up_m) / LEVEL_M)
        if not (0 <= i < across and 0 <= j < across and 0 <= level < self.levels):
            return -1
        return (level * across + i) * across + j

    def is_free(self, now_s: float, *, from_up_m: float) -> bool:
        """All is known free from about that height up to the top."""
        return self.free_up_m(now_s, from_up_m=from_up_m) >= self.floor_up_m + self.levels * LEVEL_M - 1e-6

    def free_up_m(self, now_s: float, *, from_up_m: float) -> float:
        """Height up to which all is known free, from the cells about `from_up_m` on; the floor or less: nothing is."""
        square = self._across * self._across
        first = max(0, math.floor((from_up_m - self.floor_up_m) / LEVEL_M))
        for level in range(first, self.levels):
            base = level * square
            is_hit = any([now_s - self._hit_s[base + k] <= STALE_S for k in self._touched])
            if is_hit or not all([self._is_passed(base + k, now_s) for k in self._within]):
                return self.floor_up_m + level * LEVEL_M
        return self.floor_up_m + self.levels * LEVEL_M

    def _is_passed(self, cell: int, now_s: float) -> bool:
        return self._passes[cell] >= LEAST_PASSES and now_s - self._passed_s[cell] <= STALE_S
