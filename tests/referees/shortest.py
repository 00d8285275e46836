"""The shortest level way round boxes, with a clearance kept: what a planner that knew them all would fly."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise

from mission.common.plane import Point
from mission.schema.boxes import StandBox

ARC = 12  # points round each corner: the way round it is at most 0.3 % too long
SLACK_M = 1e-6


def shortest_m(places: Sequence[Point], boxes: Sequence[StandBox], clear_m: float) -> float:
    """From the first place over all others, east and north, nowhere nearer than `clear_m` to a box; inf: no way."""
    return sum(_leg_m(here, there, boxes, clear_m) for here, there in pairwise(places))


def _leg_m(here: Point, there: Point, boxes: Sequence[StandBox], clear_m: float) -> float:
    """Along the edges of a visibility graph of points round the corners."""
    turns = [point for box in boxes for point in _round(box, clear_m)]
    points = [here, there, *(p for p in turns if all(box.clearance_m(*p) >= clear_m for box in boxes))]
    least_m = {0: 0.0}
    waiting = [(0.0, 0)]
    while waiting:
        way_m, at = heapq.heappop(waiting)
        if at == 1:
            return way_m
        if way_m > least_m[at]:
            continue
        for k, point in enumerate(points):
            further_m = way_m + math.dist(points[at], point)
            if further_m < least_m.get(k, math.inf) and all(
                box.beside_m(points[at], point) >= clear_m - SLACK_M for box in boxes
            ):
                least_m[k] = further_m
                heapq.heappush(waiting, (further_m, k))
    return math.inf


def _round(box: StandBox, clear_m: float) -> list[Point]:
    """Points about each corner, so far out that the straight way between two neighbours keeps `clear_m`."""
    out_m = clear_m / math.cos(math.pi / 2.0 / (2.0 * ARC)) + SLACK_M
    turns = [math.tau * k / (4 * ARC) for k in range(4 * ARC)]
    return [(e + out_m * math.cos(turn), n + out_m * math.sin(turn)) for e, n in box.corners() for turn in turns]
