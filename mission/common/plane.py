"""Plane geometry of fences, ways and trees: points are east, north in metres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

Point = tuple[float, float]


def edges(polygon: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    """Its sides; the first ends in vertex 0."""
    return ((polygon[i - 1], polygon[i]) for i in range(len(polygon)))


def _orientation(a: Point, b: Point, c: Point) -> float:
    """> 0 if a, b, c turn left, 0 if they are in line."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _within_box(a: Point, b: Point, p: Point) -> bool:
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """True if the segments ab and cd share a point."""
    t1, t2, t3, t4 = _orientation(a, b, c), _orientation(a, b, d), _orientation(c, d, a), _orientation(c, d, b)
    if ((t1 > 0 > t2) or (t2 > 0 > t1)) and ((t3 > 0 > t4) or (t4 > 0 > t3)):
        return True
    return (
        (t1 == 0 and _within_box(a, b, c))
        or (t2 == 0 and _within_box(a, b, d))
        or (t3 == 0 and _within_box(c, d, a))
        or (t4 == 0 and _within_box(c, d, b))
    )


def distance_to_segment_m(p: Point, a: Point, b: Point) -> float:
    """From `p` to the nearest point of the segment ab; m."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    along = 0.0 if square == 0.0 else min(1.0, max(0.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square))
    return math.hypot(p[0] - a[0] - along * dx, p[1] - a[1] - along * dy)


def clearance_m(point: Point, polygon: Sequence[Point]) -> float:
    """Distance from `point` to the boundary, negative outside. Even-odd rule; m."""
    inside = False
    for a, b in edges(polygon):
        if (a[1] > point[1]) != (b[1] > point[1]) and (_orientation(a, b, point) > 0) == (b[1] > a[1]):
            inside = not inside
    distance_m = min(distance_to_segment_m(point, a, b) for a, b in edges(polygon))
    return distance_m if inside else -distance_m


def way_clearance_m(here: Point, there: Point, polygon: Sequence[Point]) -> float:
    """Distance from the straight way between two points to the boundary, 0 or less where it meets or leaves it; m."""
    ends_m = min(clearance_m(here, polygon), clearance_m(there, polygon))
    if any(meet(here, there, a, b) for a, b in edges(polygon)):
        return min(ends_m, 0.0)
    return min(ends_m, *(distance_to_segment_m(vertex, here, there) for vertex in polygon))


def polygon_fault(polygon: Sequence[Point]) -> str:
    """The reason why `polygon` is not a simple polygon; empty if it is one."""
    n = len(polygon)
    seen: dict[Point, int] = {}
    for index, vertex in enumerate(polygon):
        first = seen.setdefault(vertex, index)
        if first != index:
            return f"must not repeat a vertex: [{first}] and [{index}] are the same (it closes by itself)"
    sides = list(edges(polygon))  # edge i ends in vertex i
    for i in range(n):
        for j in range(i + 1, n):
            neighbours = j == i + 1 or (i == 0 and j == n - 1)
            (a, b), (c, d) = sides[i], sides[j]
            if neighbours:  # they share one vertex and may share no more: no folding back
                far, shared, other = (a, b, d) if j == i + 1 else (b, a, c)
                crossing = _orientation(far, shared, other) == 0 and _dot(far, shared, other) > 0
            else:
                crossing = meet(a, b, c, d)
            if crossing:
                return f"must be a simple polygon: the edges that end in vertices [{i}] and [{j}] cross or touch"
    return ""


def _dot(a: Point, corner: Point, b: Point) -> float:
    """> 0 if corner -> a and corner -> b point the same way."""
    return (a[0] - corner[0]) * (b[0] - corner[0]) + (a[1] - corner[1]) * (b[1] - corner[1])


def area_m2(polygon: Sequence[Point]) -> float:
    """Area of a simple polygon, either way round; m2."""
    return abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in edges(polygon))) / 2.0
