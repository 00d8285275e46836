"""The shortest level way between discs, by a search on a fine grid that is then pulled straight (scipy)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mission.common.plane import Point, distance_to_segment_m

CELL_M: Final = 0.25
REACH: Final = 2  # cells of one step: it is along one of 16 directions
BAND_M: Final = 12.0  # to both sides of the straight line; widened where the shortest way may lie further out
WIDEST_M: Final = 100.0
ENOUGH_M: Final = 0.01
# A step between two free places may cut a disc by this much: the sagitta of the longest step on the smallest disc
SLACK_M: Final = 0.06
STEPS: Final = [
    (i, j) for i in range(-REACH, REACH + 1) for j in range(REACH + 1) if math.gcd(i, j) == 1 and (j, i) > (0, 0)
]


class Disc(NamedTuple):
    """What a centre must not come into: an obstacle with the clearance about it."""

    east_m: float
    north_m: float
    radius_m: float


def shortest_way_m(here: Point, there: Point, discs: Sequence[Disc]) -> float:
    """Between two places, east and north, outside of all discs but those that hold one of the places; inf: no way."""
    discs = [disc for disc in discs if min(math.dist(disc[:2], here), math.dist(disc[:2], there)) > disc.radius_m]
    straight_m = math.dist(here, there)
    if all(distance_to_segment_m(disc[:2], here, there) >= disc.radius_m for disc in discs):
        return straight_m
    band_m = BAND_M
    while True:
        way_m = _taut_m(_on_grid(here, there, discs, band_m), np.array(discs))
        # No way of this length goes further from the line than half the short axis of an ellipse about its ends
        needed_m = math.sqrt(way_m**2 - straight_m**2) / 2.0 if math.isfinite(way_m) else math.inf
        if needed_m <= band_m or band_m >= WIDEST_M:
            return way_m
        band_m = min(WIDEST_M, 2.0 * band_m)


def _on_grid(here: Point, there: Point, discs: Sequence[Disc], band_m: float) -> list[Point]:
    """Places along the shortest way on the grid; none: there is no way."""
    straight_m = math.dist(here, there)
    along = ((there[0] - here[0]) / straight_m, (there[1] - here[1]) / straight_m)
    ends = math.ceil(band_m / CELL_M)  # and as much behind each end
    columns, rows = round(straight_m / CELL_M) + 2 * ends + 1, 2 * ends + 1
    cell_m = straight_m / (columns - 2 * ends - 1)  # so that both ends are places of the grid
    x, y = np.meshgrid((np.arange(columns) - ends) * cell_m, (np.arange(rows) - ends) * cell_m, indexing="ij")
    east, north = here[0] + x * along[0] - y * along[1], here[1] + x * along[1] + y * along[0]
    free = np.ones((columns, rows), dtype=bool)
    for disc in discs:
        free &= np.hypot(east - disc.east_m, north - disc.north_m) >= disc.radius_m
    graph = _graph(free, cell_m)
    start, goal = ends * rows + ends, (columns - 1 - ends) * rows + ends
    lengths, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    if not math.isfinite(lengths[goal]):
        return []
    cells = [goal]
    while cells[-1] != start:
        cells.append(int(before[cells[-1]]))
    return [(float(east.flat[cell]), float(north.flat[cell])) for cell in reversed(cells)]


def _graph(free: NDArray[np.bool_], cell_m: float) -> csr_array:
    """An edge for each step between free places; of the steps there and back, one."""
    columns, rows = free.shape
    number = np.arange(free.size).reshape(free.shape)
    a, b, lengths = [], [], []
    for i, j in STEPS:
        first = (slice(max(0, -i), columns - max(0, i)), slice(0, rows - j))
        then = (slice(max(0, i), columns - max(0, -i)), slice(j, rows))
        open_ = free[first] & free[then]
        a.append(number[first][open_])
        b.append(number[then][open_])
        lengths.append(np.full(a[-1].size, cell_m * math.hypot(i, j)))
    places = (np.concatenate(a), np.concatenate(b))
    return csr_array((np.concatenate(lengths), places), shape=(free.size, free.size))


def _taut_m(way: Sequence[Point], discs: NDArray[np.float64]) -> float:
    """Its length, pulled straight from either end in turn until that gains nothing; inf: there is no way."""
    if not way:
        return math.inf
    length_m = math.inf
    while True:
        way = _pulled(way, discs)
        before_m, length_m = length_m, sum(math.dist(a, b) for a, b in pairwise(way))
        if length_m > before_m - ENOUGH_M:
            return length_m
        way = _dense(way)[::-1]


def _pulled(way: Sequence[Point], discs: NDArray[np.float64]) -> list[Point]:
    """Corners that no disc asks for cut off: on from each to the last place that it sees."""
    kept = [0]
    while kept[-1] < len(way) - 1:
        at = kept[-1]
        kept.append(next(k for k in range(len(way) - 1, at, -1) if k == at + 1 or _sees(way[at], way[k], discs)))
    return [way[k] for k in kept]


def _dense(way: Sequence[Point]) -> list[Point]:
    """The same way with a place every CELL_M at least."""
    found = [way[0]]
    for a, b in pairwise(way):
        parts = max(1, math.ceil(math.dist(a, b) / CELL_M))
        found += [(a[0] + (b[0] - a[0]) * k / parts, a[1] + (b[1] - a[1]) * k / parts) for k in range(1, parts + 1)]
    return found


def _sees(a: Point, b: Point, discs: NDArray[np.float64]) -> bool:
    """True where the straight way from a to b keeps out of all discs, but for SLACK_M."""
    way = np.subtract(b, a)
    from_a = discs[:, :2] - a
    share = np.clip(from_a @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    off_m = np.hypot(*(from_a - share[:, None] * way).T)
    return bool(np.all(off_m >= discs[:, 2] - SLACK_M))
