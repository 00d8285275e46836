"""Lanes over a polygon, back and forth (boustrophedon), so that each point of it is passed on two sides.

The lanes are parallel to that side of the polygon across which it is narrowest: the fewest turns (Huang 2001, "Optimal
line-sweep-based decompositions for coverage algorithms", IEEE ICRA, 27-32). Where a polygon is concave a lane either
crosses the gap or is two, of two cells (Choset & Pignon 1998, "Coverage path planning: the boustrophedon cellular
decomposition"), whichever way is shorter and inside the fence.

Points are east, north in metres. Only + - * / and square roots, which IEEE 754 rounds alike: each vehicle of a swarm
lays the same lanes, whatever its processor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

from mission.common.plane import Point, edges, way_clearance_m

DIRECTIONS_MOST: Final = 4  # that are laid out in full: those with the fewest lanes
SMALL_M: Final = 1e-6
AXIS_SLACK: Final = 1e-3  # of a unit vector: ends of lanes are rounded
LANES_LAID: Final = 2_000  # more are counted, and not laid


@dataclass(frozen=True, slots=True)
class Swath:
    """Distances of lanes. lane_m: from one to the next at most. spread_m: how wide the swarm is, across its course.

    inset_m: how far inside its borders the first and the last lie. before_m, beyond_m: how far a lane goes beyond the
    polygon, where its axis comes from and where that leads to.
    """

    lane_m: float
    spread_m: float
    inset_m: float
    before_m: float
    beyond_m: float


@dataclass(frozen=True, slots=True)
class Lane:
    """The leader's way along one lane."""

    start: Point
    end: Point


def axis_of(lane: Lane) -> Point:
    """Unit vector along a lane, east, north; the same for all lanes of a survey, whichever way each is flown."""
    length_m = _dist_m(lane.start, lane.end)
    return _canonical(((lane.end[0] - lane.start[0]) / length_m, (lane.end[1] - lane.start[1]) / length_m))


_Span = tuple[float, float, float]  # a lane in the polygon's turned frame: its offset across, from, to
_Ends = tuple[Point, Point]


def count_lanes(width_m: float, swath: Swath) -> int:
    """Lanes across so much."""
    inner_m = width_m - 2.0 * swath.inset_m
    return 1 if inner_m <= SMALL_M else 1 + math.ceil(inner_m / swath.lane_m - SMALL_M)


@lru_cache(maxsize=64)
def lay_lanes(
    area: tuple[Point, ...], swath: Swath, ends: _Ends, fence: tuple[Point, ...] | None = None, slack_m: float = 0.0
) -> tuple[Lane, ...]:
    """Lanes over `area`, in the order in which they are flown from `ends[0]` to `ends[1]`.

    Of those that keep `slack_m` from the fence the fewest, and of as many the shortest way; where none does, of all.
    Empty where it would be more than LANES_LAID lanes.
    """
    best: tuple[bool, int, float] | None = None
    chosen: tuple[Lane, ...] = ()
    for count, along in _directions(area, swath):
        turned = [_turn(point, along) for point in area]
        for cells in _decompositions(turned, swath):
            for spans in _tours(cells, [_turn(end, along) for end in ends]):
                lanes = tuple(
                    Lane(_turn_back((a, across), along), _turn_back((b, across), along)) for across, a, b in spans
                )
                points = [ends[0], *(point for lane in lanes for point in (lane.start, lane.end)), ends[1]]
                leaves = fence is not None and any(
                    way_clearance_m(a, b, fence) < slack_m for a, b in pairwise(points[1:-1])
                )
                cost = (leaves, count, round(sum(_dist_m(a, b) for a, b in pairwise(points)), 2))
                if best is None or cost < best:
                    best, chosen = cost, lanes
    return chosen


def _directions(area: Sequence[Point], swath: Swath) -> list[tuple[int, Point]]:
    """Unit vectors along which the fewest lanes are laid, each with their number where no gap cuts one in two."""
    found: list[tuple[int, Point]] = []
    for a, b in edges(area):
        length_m = _dist_m(a, b)
        along = _canonical(((b[0] - a[0]) / length_m, (b[1] - a[1]) / length_m))
        if any(abs(along[0] * other[1] - along[1] * other[0]) < SMALL_M for _, other in found):
            continue
        across = [_turn(point, along)[1] for point in area]
        found.append((count_lanes(max(across) - min(across), swath), along))
    found.sort(key=lambda one: one[0])
    return [one for one in found[:DIRECTIONS_MOST] if one[0] <= LANES_LAID]


def _decompositions(turned: Sequence[Point], swath: Swath) -> Iterator[list[list[_Span]]]:
    """Cells of lanes: all in one, gaps crossed; and where there are gaps, cut at them."""
    low, high = min(across for _, across in turned), max(across for _, across in turned)
    count, inner_m = count_lanes(high - low, swath), high - low - 2.0 * swath.inset_m
    step_m = inner_m / (count - 1) if count > 1 else high - low
    first = low + swath.inset_m if count > 1 else (low + high) / 2.0
    half_m = max(step_m - swath.spread_m / 2.0, step_m / 2.0, swath.inset_m)  # to the nearest vehicle of the next lane
    rows: list[list[_Span]] = []
    for k in range(count):
        across = first + k * step_m
        spans = find_spans(turned, across - half_m, across + half_m)
        rows.append([(across, a - swath.before_m, b + swath.beyond_m) for a, b in spans])
    yield [[(row[0][0], row[0][1], row[-1][2]) for row in rows if row]]
    if any(len(row) > 1 for row in rows):
        yield _cells(rows)


def find_spans(turned: Sequence[Point], low: float, high: float) -> list[tuple[float, float]]:
    """From where to where, along, the polygon has a point between `low` and `high`, across."""
    stops = {along for along, across in turned if low <= across <= high}
    for here, there in edges(turned):
        for level in (low, high):
            if (here[1] - level) * (there[1] - level) < 0.0:
                stops.add(here[0] + (level - here[1]) / (there[1] - here[1]) * (there[0] - here[0]))
    spans: list[tuple[float, float]] = []
    for a, b in pairwise(sorted(stops)):
        if b - a < SMALL_M or not _has_point(turned, (a + b) / 2.0, low, high):
            continue
        if spans and a - spans[-1][1] < SMALL_M:
            spans[-1] = (spans[-1][0], b)
        else:
            spans.append((a, b))
    return spans


def _has_point(turned: Sequence[Point], along: float, low: float, high: float) -> bool:
    """The polygon has a point there between `low` and `high`."""
    crossed = sorted(
        a[1] + (along - a[0]) / (b[0] - a[0]) * (b[1] - a[1])
        for a, b in edges(turned)
        if (a[0] > along) != (b[0] > along)
    )
    return any(max(a, low) < min(b, high) for a, b in zip(crossed[::2], crossed[1::2], strict=False))


def _cells(rows: Sequence[Sequence[_Span]]) -> list[list[_Span]]:
    """A lane goes on a cell where each of both lies beside the other alone."""
    cells: list[list[_Span]] = []
    before: list[list[_Span]] = []  # those that the row before belongs to
    for row in rows:
        now: list[list[_Span]] = []
        for span in row:
            beside = [cell for cell in before if _overlap(cell[-1], span)]
            is_one = len(beside) == 1 and sum(_overlap(beside[0][-1], other) for other in row) == 1
            cell = beside[0] if is_one else []
            if not is_one:
                cells.append(cell)
            now.append(cell)
        for cell, span in zip(now, row, strict=True):
            cell.append(span)
        before = now
    return cells


def _overlap(one: _Span, other: _Span) -> bool:
    return max(one[1], other[1]) < min(one[2], other[2])


def _tours(cells: Sequence[Sequence[_Span]], ends: Sequence[Point]) -> Iterator[list[_Span]]:
    """All cells, one after the other: each way to begin, then always the nearest."""
    for first in range(len(cells)):
        for way in _ways(cells[first]):
            tour, left = list(way), [cell for k, cell in enumerate(cells) if k != first]
            while left:
                here = (tour[-1][2], tour[-1][0])
                then = [ends[1]] if len(left) == 1 else []
                tried = [(k, its_way) for k, cell in enumerate(left) for its_way in _ways(cell)]
                k, its_way = min(tried, key=lambda one: _added_m(here, one[1], then))
                tour += its_way
                del left[k]
            yield tour


def _added_m(here: Point, way: Sequence[_Span], then: Sequence[Point]) -> float:
    """From `here` to where a cell's lanes begin, and from where they end to what comes then; without the lanes."""
    first, last = way[0], way[-1]
    return _dist_m(here, (first[1], first[0])) + sum(_dist_m((last[2], last[0]), place) for place in then)


def _ways(cell: Sequence[_Span]) -> Iterator[list[_Span]]:
    """A cell's lanes, from each of its four corners; a lane that is flown backwards has its ends exchanged."""
    for lanes in (list(cell), list(reversed(cell))):
        for turned in (0, 1):
            yield [(across, b, a) if (k + turned) % 2 else (across, a, b) for k, (across, a, b) in enumerate(lanes)]


def _canonical(along: Point) -> Point:
    """The one of both ways that leads east, or north where neither does."""
    leads_back = along[0] < -AXIS_SLACK or (along[0] <= AXIS_SLACK and along[1] < 0.0)
    return (-along[0], -along[1]) if leads_back else along


def _turn(point: Point, along: Point) -> Point:
    """Along and across."""
    return (point[0] * along[0] + point[1] * along[1], point[1] * along[0] - point[0] * along[1])


def _turn_back(point: Point, along: Point) -> Point:
    """East and north, to 1 cm."""
    return (
        round(point[0] * along[0] - point[1] * along[1], 2),
        round(point[0] * along[1] + point[1] * along[0], 2),
    )


def _dist_m(a: Point, b: Point) -> float:
    return math.sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]))
