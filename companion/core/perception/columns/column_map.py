"""Columns above places on the ring, into which own rays are sorted: pure, in the 20 Hz loop, and bounded.

A lidar whose layers end at 52 degrees never sees what is straight above it. It sees the column above a place from
beside: the top of one that is 20 m high from 16 m away. So columns are laid about the tree before the vehicle comes to
it, all along the ring, and filled on the way; where the ring then has it rest, one near by may be known to be free.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.events import LidarScan, Position
from companion.core.perception.columns.column import Column
from companion.core.perception.level_scan import axes_ned
from mission.common.frames import Vec3

COLUMNS_MAX: Final = 24  # of 36 cells a level: 25 m high, 22,000 cells, half a megabyte
APART_M: Final = 2.5  # from one to the next along the ring: a hull, and what is kept from its neighbours' crowns
TURNS: Final = 3  # of so many turns one is taken: at 1.5 m/s each 0.45 m of the way
BINS: Final = 180  # of bearings, for the columns that a ray may meet
POSITION_ERROR_M: Final = 0.5  # by which a place is off since its column was seen


@final
class ColumnMap:
    """One vehicle's. `lay_ring` about a tree, `integrate` each piece of a scan, then `find_free`."""

    __slots__ = ("_bins", "_bins_of", "_clear_m", "_columns", "_top_up_m")

    def __init__(self, *, clear_m: float, top_up_m: float) -> None:
        """`clear_m`: what a vehicle takes from its centre, with its margin; `top_up_m`: height of the columns' tops."""
        self._clear_m: Final = clear_m + POSITION_ERROR_M
        self._top_up_m: Final = top_up_m
        self._columns: list[Column] = []
        self._bins: list[list[Column]] = []
        self._bins_of = -1  # the turn that they are of

    @property
    def columns(self) -> list[Column]:
        """The columns that are laid now."""
        return self._columns

    def lay_ring(self, tree_ne_m: tuple[float, float], *, radius_m: float, floor_up_m: float) -> None:
        """About a tree, evenly on its ring, in place of those before. `floor_up_m`: what is lower is not looked at."""
        count = max(1, min(COLUMNS_MAX, int(math.tau * radius_m / APART_M)))
        self._columns = []
        for k in range(count):
            bearing = math.tau * k / count
            north_m = tree_ne_m[0] + radius_m * math.cos(bearing)
            east_m = tree_ne_m[1] + radius_m * math.sin(bearing)
            self._columns.append(
                Column(north_m, east_m, radius_m=self._clear_m, floor_up_m=floor_up_m, top_up_m=self._top_up_m)
            )
        self._bins_of = -1

    def clear(self) -> None:
        """None is of interest any more."""
        self._columns = []

    def integrate(self, scan: LidarScan, own: Position, now_s: float) -> None:
        """A piece of a scan, as the pose by trunks has it: `own` is the position now."""
        if not self._columns or scan.turn % TURNS or not scan.can_be or not own.is_finite:
            return
        first, last, count = scan.first_attitude_rad, scan.last_attitude_rad, len(scan.ranges_m)
        if self._bins_of != scan.turn:
            self._bins_of = scan.turn
            self._sort(own.pos_ned_m, scan.max_m)
        yawed = math.remainder(last[2] - first[2], math.tau)
        x, y, z = axes_ned((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0, first[2] + yawed / 2.0)
        step = scan.step_rad + (yawed / (count - 1) if count > 1 else 0.0)
        bearing = scan.start_rad - (yawed / 2.0 if count > 1 else 0.0)
        level, down = math.cos(scan.elevation_rad), -math.sin(scan.elevation_rad)
        ahead, right = level * math.cos(bearing), level * math.sin(bearing)
        cos_step, sin_step = math.cos(step), math.sin(step)
        pos, vel = own.pos_ned_m, own.vel_ned_mps
        for k in range(count):
            range_m = scan.ranges_m[k]
            d = ahead * x[2] + right * y[2] + down * z[2]
            if range_m == range_m and d < 0.0:  # measured, and it looks up
                n = ahead * x[0] + right * y[0] + down * z[0]
                e = ahead * x[1] + right * y[1] + down * z[1]
                met = self._bins[_bin(math.atan2(e, n))]
                if met:
                    age_s = scan.age_s - k * scan.ray_time_s
                    eye = (pos[0] - vel[0] * age_s, pos[1] - vel[1] * age_s, pos[2] - vel[2] * age_s)
                    for column in met:
                        column.add_ray(eye, (n, e, d), range_m, scan.max_m, now_s)
            ahead, right = ahead * cos_step - right * sin_step, right * cos_step + ahead * sin_step

    def find_free(self, own_ned_m: Vec3, now_s: float, *, within_m: float) -> list[Column]:
        """Columns within so much, level, that are known free up to their tops; the nearest first."""
        near = [
            (math.hypot(column.north_m - own_ned_m[0], column.east_m - own_ned_m[1]), k)
            for k, column in enumerate(self._columns)
        ]
        found = [self._columns[k] for away_m, k in sorted(near) if away_m <= within_m]
        return [column for column in found if column.is_free(now_s, from_up_m=column.floor_up_m)]

    def _sort(self, eye_ned_m: Vec3, reach_m: float) -> None:
        """Columns by the bearings from which a ray may meet them."""
        self._bins = [[] for _ in range(BINS)]
        for column in self._columns:
            n, e = column.north_m - eye_ned_m[0], column.east_m - eye_ned_m[1]
            away_m, half_m = math.hypot(n, e), 1.5 * column.half_m + 0.5  # the corner, and what it moves in a turn
            if away_m - half_m > reach_m:
                continue
            if away_m <= half_m:
                for some in self._bins:
                    some.append(column)
                continue
            half, middle = math.asin(half_m / away_m), math.atan2(e, n)
            first = math.floor((middle - half) / math.tau * BINS + 0.5)
            last = math.floor((middle + half) / math.tau * BINS + 0.5)
            for k in range(first, last + 1):
                self._bins[k % BINS].append(column)


def _bin(bearing_rad: float) -> int:
    return math.floor(bearing_rad / math.tau * BINS + 0.5) % BINS
