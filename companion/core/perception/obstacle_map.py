"""The map of what an obstacle sensor has seen, from scans only: points on trunks, in the frame of the own odometry.

Trunks are upright, so the map is level: a point is north and east of where the first scan was taken, and only
differences of own reported positions are used (rule 5). It is bounded, oldest out first, and forgets: a point that no
scan has hit for MEMORY_S is gone, one that two scans in a row saw through is gone at once.

What was not seen is not free. A bearing counts as seen while a scan has measured it within the last `fresh_s`, and no
further than the sensor sees that sees least far.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.events import ObstacleScan, Position
from companion.core.perception.level_scan import GROUND_M, axes_ned
from mission.common.frames import Vec3

CELL_M: Final = 0.25  # one point in each
CELLS_MAX: Final = 1024  # at 600 trees/ha about 200 are alive
MEMORY_S: Final = 4.0  # of a point that no scan has hit since
BLEND: Final = 0.4  # of a new hit into its cell's point: noise of 0.05 m is smoothed
NEIGHBOUR_M: Final = 1.5  # a hit this near to where a neighbour is reported to be is that neighbour
NEIGHBOUR_LEVEL_M: Final = 2.5  # ... within this of its height
SEEN_THROUGH_M: Final = 0.5  # a scan that sees so far beyond a point has seen through it
BEAM: Final = 0.4  # of a sector, to either side of its middle: a sector reports the nearest of all that is in it
MISSES: Final = 2  # in a row, until it is believed
BEARINGS: Final = 72  # of the sight, over the full turn
NEVER_S: Final = -1e9


@final
class _Cell:
    """One point: metres from the map's anchor."""

    __slots__ = ("east_m", "misses", "north_m", "seen_s")

    def __init__(self, north_m: float, east_m: float, seen_s: float) -> None:
        self.north_m = north_m
        self.east_m = east_m
        self.seen_s = seen_s
        self.misses = 0


@final
class ObstacleMap:
    """One vehicle's. Feed it every scan with `integrate_scan`; `find_near` gives the points about a position."""

    __slots__ = ("_anchor", "_cells", "_falls", "_maxima_m", "_measured_s", "_near_m", "max_m")

    def __init__(self, near_m: float = 0.0) -> None:
        """`near_m`: a hit nearer than this is no neighbour, whatever is reported; separation keeps them farther."""
        self._near_m = near_m
        self.max_m = 0.0  # range of the sensor that sees least far
        self._maxima_m: dict[int, float] = {}  # by sensor, of its last scan; a MAVLink component: 255 at most
        self._anchor: tuple[float, float] | None = None  # own position, NED, at the first scan
        self._cells: dict[int, _Cell] = {}  # the longest unseen first
        self._measured_s: list[float] = [NEVER_S] * BEARINGS  # when each bearing was last measured
        self._falls: list[float] = [0.0] * BEARINGS  # how far that ray fell in a metre, level

    def __len__(self) -> int:
        return len(self._cells)

    def integrate_scan(self, scan: ObstacleScan, own: Position, now_s: float, ignore: Sequence[Vec3] = ()) -> None:
        """Take in a scan. `own`: position now; `ignore`: where neighbours are, relative (NED m).

        A scan that has its age is placed where the vehicle was then.
        """
        late_s = scan.age_s
        vel = own.vel_ned_mps
        north_m = own.pos_ned_m[0] - vel[0] * late_s
        east_m = own.pos_ned_m[1] - vel[1] * late_s
        down_m = own.pos_ned_m[2] - vel[2] * late_s
        turned = scan.roll_rad + scan.pitch_rad + scan.yaw_rad + scan.start_rad + scan.step_rad
        for number in (north_m, east_m, down_m, turned):
            if number - number != 0.0:  # not finite
                return
        here_n, here_e = self.place(north_m, east_m)
        self.note_sensor(scan.sensor, scan.max_m)
        self.forget(now_s)
        (fn, fe, fd), (rn, re, rd), _ = axes_ned(scan.roll_rad, scan.pitch_rad, scan.yaw_rad)
        ranges = scan.ranges_m
        free_m = [-1.0] * len(ranges)  # level, along each ray; below 0: not measured
        bearing = scan.start_rad
        step = scan.step_rad
        for k in range(len(ranges)):
            range_m = ranges[k]
            if range_m == range_m:  # measured
                ahead, right = math.cos(bearing), math.sin(bearing)
                n, e, d = ahead * fn + right * rn, ahead * fe + right * re, ahead * fd + right * rd
                level = math.sqrt(n * n + e * e)
                self.mark(math.atan2(e, n), d / level if level > 0.0 else math.inf, now_s - late_s)
                if range_m > scan.max_m:
                    free_m[k] = scan.max_m * level
                else:
                    free_m[k] = range_m * level
                    hit_n, hit_e, hit_d = n * range_m, e * range_m, d * range_m
                    if -(down_m + hit_d) > GROUND_M and not self.is_neighbour(hit_n, hit_e, hit_d, ignore):
                        self.hit(here_n + hit_n, here_e + hit_e, now_s)
            bearing += step
        self._see_through(here_n, here_e, scan, free_m, now_s)

    def find_near(self, pos_ned_m: Vec3, within_m: float) -> tuple[list[float], list[float]]:
        """North and east of the points within that level distance of a position, metres from it."""
        norths: list[float] = []
        easts: list[float] = []
        anchor = self._anchor
        if anchor is None:
            return norths, easts
        here_n, here_e = pos_ned_m[0] - anchor[0], pos_ned_m[1] - anchor[1]
        most_m2 = within_m * within_m
        for cell in self._cells.values():
            n, e = cell.north_m - here_n, cell.east_m - here_e
            if n * n + e * e <= most_m2:
                norths.append(n)
                easts.append(e)
        return norths, easts

    def find_blind(self, now_s: float, *, fresh_s: float) -> list[bool]:
        """For each of BEARINGS, from north clockwise, whether no scan has measured it (or both beside it) lately."""
        before_s = now_s - fresh_s - 1e-9
        old = [measured_s < before_s for measured_s in self._measured_s]
        return [old[k] and (old[k - 1] or old[(k + 1) % BEARINGS]) for k in range(BEARINGS)]

    def ray_fall(self, bearing_rad: float) -> float:
        """Fall in a metre of the ray that measured that bearing last: of a vehicle that leans none is level."""
        return self._falls[at_bearing(bearing_rad)]

    def place(self, north_m: float, east_m: float) -> tuple[float, float]:
        """A reported position -> metres north and east of the map's anchor, which the first one is."""
        if self._anchor is None:
            self._anchor = (north_m, east_m)
        return north_m - self._anchor[0], east_m - self._anchor[1]

    def note_sensor(self, sensor: int, max_m: float) -> None:
        """Notes how far a sensor sees."""
        self._maxima_m[sensor] = max_m
        self.max_m = min(self._maxima_m.values())

    def mark_flattest(self, bearing_rad: float, falls: float, measured_s: float, since_s: float) -> None:
        """A ray has measured that bearing; of those `since_s` the flattest is kept."""
        k = at_bearing(bearing_rad)
        if self._measured_s[k] < since_s or abs(falls) < abs(self._falls[k]):
            self._falls[k] = falls
        if measured_s > self._measured_s[k]:
            self._measured_s[k] = measured_s

    def mark(self, bearing_rad: float, falls: float, measured_s: float) -> None:
        """A sector has measured that bearing, along a ray that falls so far in a metre."""
        k = at_bearing(bearing_rad)
        if measured_s >= self._measured_s[k]:  # another sensor's scan may be newer than one that comes late
            self._measured_s[k], self._falls[k] = measured_s, falls

    def is_neighbour(self, north_m: float, east_m: float, down_m: float, ignore: Sequence[Vec3]) -> bool:
        """True for a hit, relative (NED m), that is near to where one of `ignore` is reported to be, and not near by.

        A report only leaves out what is far enough to be seen again: it never frees what a vehicle would run into.
        """
        if north_m * north_m + east_m * east_m < self._near_m * self._near_m:
            return False
        for rel in ignore:
            n, e = rel[0] - north_m, rel[1] - east_m
            if n * n + e * e <= NEIGHBOUR_M * NEIGHBOUR_M and abs(rel[2] - down_m) <= NEIGHBOUR_LEVEL_M:
                return True
        return False

    def hit(self, north_m: float, east_m: float, now_s: float) -> None:
        """Something stands there, metres from the anchor."""
        key = (math.floor(north_m / CELL_M) << 24) + math.floor(east_m / CELL_M)
        cell = self._cells.pop(key, None)
        if cell is None:
            if len(self._cells) >= CELLS_MAX:
                del self._cells[next(iter(self._cells))]
            cell = _Cell(north_m, east_m, now_s)
        else:
            cell.north_m += BLEND * (north_m - cell.north_m)
            cell.east_m += BLEND * (east_m - cell.east_m)
            cell.seen_s, cell.misses = now_s, 0
        self._cells[key] = cell  # last: the dict is in the order of the last sight

    def forget(self, now_s: float) -> None:
        """Drops points that no scan has hit for MEMORY_S."""
        cells = self._cells
        while cells:
            oldest = next(iter(cells))
            if now_s - cells[oldest].seen_s <= MEMORY_S:
                return
            del cells[oldest]

    def clear_passed(self, here_n: float, here_e: float, free_m: Sequence[float], before_s: float) -> None:
        """Drops points that were not hit since `before_s`, and beyond which rays went on, by a turn's `free_m`.

        `free_m`: level metres that were seen free about a place, by bearing, over the full turn from north clockwise.
        """
        gone: list[int] = []
        bins = len(free_m)
        for key, cell in self._cells.items():
            if cell.seen_s >= before_s:
                continue
            n, e = cell.north_m - here_n, cell.east_m - here_e
            beyond_m = math.sqrt(n * n + e * e) + SEEN_THROUGH_M
            k = math.floor(math.atan2(e, n) / math.tau * bins + 0.5) % bins
            if min(free_m[k - 1], free_m[k], free_m[(k + 1) % bins]) >= beyond_m:
                cell.misses += 1
                if cell.misses >= MISSES:
                    gone.append(key)
        for key in gone:
            del self._cells[key]

    def _see_through(self, here_n: float, here_e: float, scan: ObstacleScan, free_m: list[float], now_s: float) -> None:
        """Drop points that rays pass by. Bearings as of a level vehicle: exact enough for a tilt of 20 degrees."""
        gone: list[int] = []
        first, step, count = scan.start_rad + scan.yaw_rad, scan.step_rad, len(free_m)
        if step == 0.0:
            return
        for key, cell in self._cells.items():
            n, e = cell.north_m - here_n, cell.east_m - here_e
            away_m = math.sqrt(n * n + e * e)
            if away_m >= scan.max_m - SEEN_THROUGH_M or cell.seen_s == now_s:
                continue
            turns = (math.atan2(e, n) - first) / step
            turns -= math.floor(turns * step / math.tau) * (math.tau / step)
            k = math.floor(turns + 0.5)
            aside = abs(turns - k)
            k %= max(count, round(math.tau / abs(step)))
            if k < count and free_m[k] >= away_m + SEEN_THROUGH_M and aside <= BEAM:
                cell.misses += 1
                if cell.misses >= MISSES:
                    gone.append(key)
        for key in gone:
            del self._cells[key]


def at_bearing(bearing_rad: float) -> int:
    """Index of that bearing among BEARINGS."""
    return math.floor(bearing_rad / math.tau * BEARINGS + 0.5) % BEARINGS
