"""Stems in a level scan: rays side by side that hit one thing as wide and as round as a stem, with its axis.

A cluster ends where ranges part by CLOSE_M and three sigmas, and where a ray went on; one ray that was not measured is
bridged. Two clusters within LEAVES_M are taken for leaves, not for stems. A stem at the seam of a turn, where its first
rays are beside its last, is seen from where the vehicle was at both ends, and has moved meanwhile, if it is a vehicle:
it is fitted as it was last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.level_scan import LevelScan, ScanClass

CLOSE_M: Final = 0.25  # between rays side by side on one stem
HALF_MAX_RAD: Final = 0.35  # half of the width: what is wider is near, a wall, or a thicket
RADIUS_MAX_M: Final = 0.7
RADIUS_M: Final = 0.14  # of a stem whose width is not told
ROUND_SIGMAS: Final = 2.2  # of the residuals about a circle
ROUND_M: Final = 0.02  # and bark
RANGE_SD_M: Final = 0.01  # more of the axis' range: bark, and the radius
LEAVES_M: Final = 1.0
LEAVES_SECTORS: Final = 1.5  # their width, where that is more: the corner of a wall far off is no two stems
HIDDEN_M: Final = 0.3  # a neighbouring ray that ends so much nearer hides an edge
SEAM_M: Final = 0.35  # of a vehicle at 3 m/s while its lidar turns once
STEMS_MAX: Final = 96  # the nearest; of 600 trees/ha a lidar of 20 m sees up to 69


@final
class Stem:
    """A cluster: where its surface is from the eye, and how thick it is."""

    __slots__ = (
        "across_sd_m",
        "along_sd_m",
        "bearing_rad",
        "eye_east_m",
        "eye_north_m",
        "is_hidden",
        "radius_m",
        "rays",
        "surface_m",
    )

    def __init__(
        self,
        bearing_rad: float,
        surface_m: float,
        radius_m: float,
        eye: tuple[float, float],
        sd_m: tuple[float, float],
        rays: int,
        *,
        is_hidden: bool,
    ) -> None:
        """`sd_m`: along the bearing and across it. `is_hidden`: an edge of it, by what is nearer or unseen."""
        self.bearing_rad: Final = bearing_rad
        self.surface_m: Final = surface_m  # to the nearest of it
        self.radius_m: Final = radius_m
        self.eye_north_m: Final = eye[0]
        self.eye_east_m: Final = eye[1]
        self.along_sd_m: Final = sd_m[0]
        self.across_sd_m: Final = sd_m[1]
        self.rays: Final = rays
        self.is_hidden: Final = is_hidden


def find_stems(scan: LevelScan, kind: ScanClass, walls: Sequence[bool] = ()) -> list[Stem]:
    """The nearest stems of a scan, in its order, without leaves; `walls`: which rays end on a wall, none: empty."""
    stems: list[Stem] = []
    for first, last in _find_runs(scan, kind):
        if walls and walls[(first + last) // 2 % len(walls)]:
            continue
        stem = _fit_stem(scan, kind, first, last)
        if stem is not None:
            stems.append(stem)
    return _leave_out_leaves(_keep_nearest(stems), 0.0 if kind.has_widths else LEAVES_SECTORS * scan.step_rad)


def sector_edge_rad(scan: LevelScan, kind: ScanClass, k: int) -> float:
    """Bearing of a sector's nearest hit less its middle's, of a wall: towards where that is nearer.

    At the wall's end too: beyond it the neighbour has nothing.
    """
    if kind.has_widths:
        return 0.0
    before_m, after_m = scan.ranges_m[k - 1], scan.ranges_m[(k + 1) % len(scan.ranges_m)]
    step_rad = math.remainder(scan.bearings_rad[k] - scan.bearings_rad[k - 1], math.tau)
    here_m = scan.ranges_m[k]
    if before_m < here_m < after_m:
        return -0.5 * step_rad
    return 0.5 * step_rad if before_m > here_m > after_m else 0.0


def _find_runs(scan: LevelScan, kind: ScanClass) -> list[tuple[int, int]]:
    """First and last ray of each cluster; the last may lie beyond the end of the list, where a run goes on round."""
    ranges, count = scan.ranges_m, len(scan.ranges_m)
    begin = _find_break(scan, kind)
    if begin < 0:
        return []
    runs: list[tuple[int, int]] = []
    first = last = -1
    for k in range(begin, begin + count):
        range_m = ranges[k % count]
        if range_m != range_m:
            continue  # not measured: bridged, once
        goes_on = False
        if range_m < math.inf and last >= 0 and k - last <= 2:
            seam_m = _seam_m(scan, k) if last < count <= k else 0.0
            close_m = _close_m(kind) + (SEAM_M if kind.has_widths and last < count <= k else 0.0)
            goes_on = abs(range_m + seam_m - ranges[last % count]) <= close_m
        if first >= 0 and not goes_on:
            runs.append((first, last))
            first = -1
        if range_m < math.inf:
            if first < 0:
                first = k
            last = k
        else:
            last = -1
    if first >= 0:
        runs.append((first, last))
    return runs


def _find_break(scan: LevelScan, kind: ScanClass) -> int:
    """Index of a ray with which no cluster can go on from the one before it; -1: there is none, and no cluster."""
    ranges = scan.ranges_m
    if not scan.is_whole:
        return 0 if ranges else -1
    for k in range(len(ranges)):
        here_m, before_m, close_m = ranges[k], ranges[k - 1], _close_m(kind)
        if k == 0 and kind.has_widths:
            here_m, close_m = here_m + _seam_m(scan, 0), close_m + SEAM_M
        if here_m < math.inf and (before_m == math.inf or abs(here_m - before_m) > close_m):
            return k
    return -1


def _close_m(kind: ScanClass) -> float:
    return CLOSE_M + 3.0 * kind.range_sd_m


def _fit_stem(scan: LevelScan, kind: ScanClass, first: int, last: int) -> Stem | None:
    """A run as the circle that it may be of; None: too wide, too thick, or not round."""
    count, rays = len(scan.ranges_m), last - first + 1
    half_rad = 0.5 * rays * scan.step_rad
    if half_rad > HALF_MAX_RAD:
        return None
    ranges = [_range_m(scan, k, first) for k in range(first, last + 1)]
    middle = (first + last) // 2
    middle = min(middle, count - 1) if first < count else middle - count  # a run over the seam: from before it
    from_rad = scan.bearings_rad[first % count]
    turned_rad = math.remainder(scan.bearings_rad[last % count] - from_rad, math.tau)
    bearing_rad = from_rad + 0.5 * turned_rad
    near_m = min([range_m for range_m in ranges if range_m == range_m])
    radius_m = RADIUS_M
    if kind.has_widths:
        sine = math.sin(max(0.0, half_rad - 0.5 * kind.beam_rad))
        radius_m = near_m * sine / (1.0 - sine)
        if radius_m > RADIUS_MAX_M:
            return None
    elif (rays - 2) * scan.step_rad * near_m > 2.0 * RADIUS_MAX_M:  # what fills the sectors between its outermost ones
        return None
    axis_m, off_m, seen = _fit_axis(scan, ranges, first, bearing_rad, near_m + radius_m, radius_m)
    if off_m > ROUND_SIGMAS * kind.range_sd_m + ROUND_M + (0.0 if kind.has_widths else CLOSE_M):
        return None
    before_m, after_m = scan.ranges_m[(first - 1) % count], scan.ranges_m[(last + 1) % count]
    is_hidden = before_m < near_m - HIDDEN_M or after_m < near_m - HIDDEN_M or scan.is_cut_off(first, last)
    along_sd_m = kind.range_sd_m / math.sqrt(seen) + RANGE_SD_M
    across_sd_m = axis_m * kind.bearing_sd_rad + (radius_m if is_hidden else 0.0)
    eye = (scan.eyes_north_m[middle], scan.eyes_east_m[middle])
    return Stem(bearing_rad, axis_m - radius_m, radius_m, eye, (along_sd_m, across_sd_m), rays, is_hidden=is_hidden)


def _range_m(scan: LevelScan, k: int, first: int) -> float:
    """Of a ray of the run that begins with `first`, from where its rays before the seam were seen."""
    count = len(scan.ranges_m)
    return scan.ranges_m[k % count] + (_seam_m(scan, k) if first < count <= k else 0.0)


def _seam_m(scan: LevelScan, k: int) -> float:
    """By how much more a turn's last ray would have measured than its first, along the bearing of ray `k`."""
    bearing_rad = scan.bearings_rad[k % len(scan.ranges_m)]
    gone_n = scan.eyes_north_m[-1] - scan.eyes_north_m[0]
    gone_e = scan.eyes_east_m[-1] - scan.eyes_east_m[0]
    return -gone_n * math.cos(bearing_rad) - gone_e * math.sin(bearing_rad)


def _fit_axis(
    scan: LevelScan, ranges: Sequence[float], first: int, bearing_rad: float, axis_m: float, radius_m: float
) -> tuple[float, float, int]:
    """Range of a circle's axis, the residuals about it, rms, and of how many rays; by a first guess of the range.

    `ranges`: of the run that begins with ray `first`. Its rays beyond the seam, which are older, may be of elsewhere.
    """
    count = len(scan.ranges_m)
    seam = count - first if first < count else 0
    late_m, late_m2, late = _sum_axis(scan, ranges[:seam], first, bearing_rad, axis_m, radius_m)
    early_m, early_m2, early = _sum_axis(scan, ranges[seam:], first + seam, bearing_rad, axis_m, radius_m)
    squares = early_m2 - (early_m * early_m / early if early else 0.0)
    squares += late_m2 - (late_m * late_m / late if late else 0.0)
    mean_m = late_m / late if late else early_m / early
    return mean_m, math.sqrt(max(0.0, squares / (late + early))), late + early


def _sum_axis(
    scan: LevelScan, ranges: Sequence[float], first: int, bearing_rad: float, axis_m: float, radius_m: float
) -> tuple[float, float, int]:
    """Sum of the ranges of the axis by each ray, of their squares, and of how many rays."""
    count = len(scan.ranges_m)
    total = squares = 0.0
    seen = 0
    for k in range(len(ranges)):
        range_m = ranges[k]
        if range_m != range_m:
            continue
        off_rad = math.remainder(scan.bearings_rad[(first + k) % count] - bearing_rad, math.tau)
        aside_m = axis_m * math.sin(off_rad)
        beside = radius_m * radius_m - aside_m * aside_m
        deeper_m = axis_m - (axis_m * math.cos(off_rad) - (math.sqrt(beside) if beside > 0.0 else 0.0))
        total += range_m + deeper_m
        squares += (range_m + deeper_m) * (range_m + deeper_m)
        seen += 1
    return total, squares, seen


def _keep_nearest(stems: list[Stem]) -> list[Stem]:
    if len(stems) <= STEMS_MAX:
        return stems
    beyond_m = sorted([stem.surface_m for stem in stems])[STEMS_MAX]
    return [stem for stem in stems if stem.surface_m < beyond_m]


def _leave_out_leaves(stems: list[Stem], apart_rad: float) -> list[Stem]:
    """`apart_rad`: two that are seen under less are too near to each other, too."""
    if len(stems) < 2:
        return stems
    places = [
        (
            s.eye_north_m + math.cos(s.bearing_rad) * (s.surface_m + s.radius_m),
            s.eye_east_m + math.sin(s.bearing_rad) * (s.surface_m + s.radius_m),
        )
        for s in stems
    ]
    left: list[Stem] = []
    for k in range(len(stems)):
        n, e = places[k]
        leaves_m = max(LEAVES_M, apart_rad * stems[k].surface_m)
        alone = True
        for j in range(len(stems)):
            dn, de = places[j][0] - n, places[j][1] - e
            if j != k and dn * dn + de * de < leaves_m * leaves_m:
                alone = False
                break
        if alone:
            left.append(stems[k])
    return left
