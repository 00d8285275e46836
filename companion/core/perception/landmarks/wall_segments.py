"""Walls in a level scan: rays side by side that end on one straight line, long enough to tell its direction.

A run of rays is split where it leaves its chord most (iterative end-point fit), and each piece is fitted by total least
squares. Trunks in a row are no wall: the gaps between them are as long as the pieces.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.perception.landmarks.stem_clusters import sector_edge_rad
from companion.core.perception.level_scan import LevelScan, ScanClass

LEAST_RAYS: Final = 5
PIECE_RAYS: Final = 3  # of sectors: a piece that tells nothing, but is no stems
LEAST_M: Final = 1.5  # long: wider than a stem
GAP_SHARE: Final = 0.4  # of its length: a longer gap between two rays is no wall's
PIECE_GAP_SHARE: Final = 0.75  # nor one of a piece: a thing before a wall is not joined to it
SPLIT_M: Final = 0.12  # off the chord, and three sigmas of a range
RMS_M: Final = 0.04  # off the line, and a sigma
BESIDE: Final = 2  # rays
BEFORE_M: Final = 0.5  # nearer than its line: another thing, as a vehicle
GRAZING: Final = 0.2  # cosine: rays along a wall tell little of where it is
SURFACE_SD_M: Final = 0.02  # plaster, rock, hedges


@final
class WallSegment:
    """A piece of a wall, placed as its scan is: its middle, its normal towards the eye, and half its length."""

    __slots__ = (
        "east_m",
        "eye_east_m",
        "eye_north_m",
        "first",
        "half_m",
        "last",
        "normal_rad",
        "north_m",
        "offset_sd_m",
        "tells",
    )

    def __init__(
        self,
        middle: tuple[float, float],
        normal_rad: float,
        half_m: float,
        eye: tuple[float, float],
        rays: tuple[int, int],
        offset_sd_m: float,
        *,
        tells: bool,
    ) -> None:
        """`rays`: the first and the last of the scan, which may lie beyond its end. `offset_sd_m`: along the normal.

        `tells`: where it is; else it is too short or too rough for that, and all that is known is that it is no stems.
        """
        self.north_m: Final = middle[0]
        self.east_m: Final = middle[1]
        self.normal_rad: Final = normal_rad
        self.half_m: Final = half_m
        self.eye_north_m: Final = eye[0]
        self.eye_east_m: Final = eye[1]
        self.first: Final = rays[0]
        self.last: Final = rays[1]
        self.offset_sd_m: Final = offset_sd_m
        self.tells: Final = tells

    @property
    def normal_sd_rad(self) -> float:
        """Of the direction: two ends that are off against each other."""
        return math.sqrt(3.0) * self.offset_sd_m / self.half_m


def find_walls(scan: LevelScan, kind: ScanClass) -> list[WallSegment]:
    """The walls of a scan."""
    norths, easts, rays = _hits(scan, kind)
    found: list[WallSegment] = []
    begin = 0
    for k in range(1, len(rays) + 1):
        if k == len(rays) or rays[k] - rays[k - 1] > 2:  # a ray went on between them: one unmeasured is bridged
            if k - begin >= _least_rays(kind):
                _split(scan, kind, (norths, easts, rays), begin, k - 1, found)
            begin = k
    return found


def mark_walls(walls: list[WallSegment], scan: LevelScan) -> list[bool]:
    """Of each ray of a scan, whether it ends on one, or just beside: what is left of a wall at its end is no stem.

    What stands before a wall is none of it.
    """
    count = len(scan.ranges_m)
    marked = [False] * count
    for wall in walls:
        normal_n, normal_e = math.cos(wall.normal_rad), math.sin(wall.normal_rad)
        for k in range(wall.first, wall.last + 1):
            marked[k % count] = True
        for k in (*range(wall.first - BESIDE, wall.first), *range(wall.last + 1, wall.last + BESIDE + 1)):
            at = k % count
            n = scan.eyes_north_m[at] + scan.ranges_m[at] * math.cos(scan.bearings_rad[at]) - wall.north_m
            e = scan.eyes_east_m[at] + scan.ranges_m[at] * math.sin(scan.bearings_rad[at]) - wall.east_m
            if n * normal_n + e * normal_e < BEFORE_M:
                marked[at] = True
    return marked


def _least_rays(kind: ScanClass) -> int:
    return LEAST_RAYS if kind.has_widths else PIECE_RAYS


def _hits(scan: LevelScan, kind: ScanClass) -> tuple[list[float], list[float], list[int]]:
    """Ends of rays, and the number of each; from behind a ray that went on, so that no wall is cut in two."""
    ranges, count = scan.ranges_m, len(scan.ranges_m)
    begin = 0
    for k in range(count):
        if scan.is_whole and ranges[k] == math.inf:
            begin = k + 1
            break
    norths: list[float] = []
    easts: list[float] = []
    rays: list[int] = []
    for k in range(begin, begin + count):
        at = k % count
        range_m = ranges[at]
        if not range_m < math.inf:
            continue
        bearing_rad = scan.bearings_rad[at] + sector_edge_rad(scan, kind, at)
        norths.append(scan.eyes_north_m[at] + range_m * math.cos(bearing_rad))
        easts.append(scan.eyes_east_m[at] + range_m * math.sin(bearing_rad))
        rays.append(k)
    return norths, easts, rays


def _split(
    scan: LevelScan,
    kind: ScanClass,
    hits: tuple[list[float], list[float], list[int]],
    first: int,
    last: int,
    found: list[WallSegment],
) -> None:
    todo = [(first, last)]
    while todo:
        a, b = todo.pop()
        if b - a + 1 < _least_rays(kind):
            continue
        at, most_m = _farthest(hits[0], hits[1], a, b)
        if most_m > SPLIT_M + 3.0 * kind.range_sd_m:
            todo += [(a, at), (at, b)]
            continue
        wall = _fit(scan, kind, hits, a, b)
        if wall is not None:
            found.append(wall)


def _farthest(norths: list[float], easts: list[float], a: int, b: int) -> tuple[int, float]:
    """The hit that is farthest from the chord, and how far."""
    dn, de = norths[b] - norths[a], easts[b] - easts[a]
    length_m = math.sqrt(dn * dn + de * de)
    at, most_m = a, 0.0
    for k in range(a + 1, b):
        n, e = norths[k] - norths[a], easts[k] - easts[a]
        off_m = abs(n * de - e * dn) / length_m if length_m > 1e-6 else math.sqrt(n * n + e * e)
        if off_m > most_m:
            at, most_m = k, off_m
    return at, most_m


def _fit(
    scan: LevelScan, kind: ScanClass, hits: tuple[list[float], list[float], list[int]], a: int, b: int
) -> WallSegment | None:
    norths, easts, rays = hits
    dn, de = norths[b] - norths[a], easts[b] - easts[a]
    length_m = math.sqrt(dn * dn + de * de)
    if length_m < LEAST_M:
        return None
    count = b - a + 1
    mean_n, mean_e = sum(norths[a : b + 1]) / count, sum(easts[a : b + 1]) / count
    nn = ne = ee = gap_m = 0.0
    for k in range(a, b + 1):
        n, e = norths[k] - mean_n, easts[k] - mean_e
        nn, ne, ee = nn + n * n, ne + n * e, ee + e * e
        if k > a:
            gap_m = max(gap_m, math.hypot(norths[k] - norths[k - 1], easts[k] - easts[k - 1]))
    if gap_m > PIECE_GAP_SHARE * length_m:
        return None
    tells = count >= LEAST_RAYS and gap_m <= GAP_SHARE * length_m
    along_rad = 0.5 * math.atan2(2.0 * ne, nn - ee)
    along_n, along_e = math.cos(along_rad), math.sin(along_rad)
    off_m2 = nn * along_e * along_e - 2.0 * ne * along_n * along_e + ee * along_n * along_n
    tells = tells and math.sqrt(max(0.0, off_m2) / count) <= RMS_M + kind.range_sd_m
    if not tells and kind.has_widths:
        return None
    middle = rays[(a + b) // 2] % len(scan.ranges_m)
    eye = (scan.eyes_north_m[middle], scan.eyes_east_m[middle])
    to_n, to_e = eye[0] - mean_n, eye[1] - mean_e
    away_m = math.sqrt(to_n * to_n + to_e * to_e)
    facing = (to_n * -along_e + to_e * along_n) / max(away_m, 1e-6)
    if abs(facing) < GRAZING:
        return None
    normal_rad = along_rad + math.copysign(math.pi / 2.0, facing)
    offset_sd_m = kind.range_sd_m / math.sqrt(count) + SURFACE_SD_M
    shown = rays[a], rays[b]
    return WallSegment((mean_n, mean_e), normal_rad, 0.5 * length_m, eye, shown, offset_sd_m, tells=tells)
