"""A way out: A* over all that has been seen, on a grid about the vehicle; what was never seen counts as free.

The grid's cells stand still while the vehicle moves: a gap that was a way is one half a second later. With what is seen
on the way it is searched anew, so that in a finite stand a way that there is is found. It leads, and no more: each
setpoint on it is verified as any other. A target beyond the grid is reached at its border.
"""

from __future__ import annotations

import heapq
import math
from typing import Final, final

from companion.core.guidance.search.known_places import NOTHING, KnownPlaces
from companion.core.perception.obstacle_memory import SeenBefore

CELL_M: Final = 0.5
HALF_CELLS: Final = 48  # of the grid to either side: 24 m
SIDE: Final = 2 * HALF_CELLS + 1
# Than what the filter keeps: half of a cell's rounding. As much is a free course while the way is flown, or a gap that
# it leads to would not be one to the planner
WIDER_M: Final = 0.1
EXPANDED_MAX: Final = 6000  # cells; all of them are 9409
REACHED_CELLS: Final = 4.0  # of the target: a trunk may stand there
SLACK_M: Final = 0.05  # a vehicle that is too near to a point already may go where it comes no nearer than by this
AHEAD_M: Final = 3.0  # how far along it the vehicle aims
SIDE_PRICE: Final = 0.1  # more for each metre on the other side of the straight way than the one chosen
STEPS = (
    (-1, -1, math.sqrt(2.0)),
    (-1, 0, 1.0),
    (-1, 1, math.sqrt(2.0)),
    (0, -1, 1.0),
    (0, 1, 1.0),
    (1, -1, math.sqrt(2.0)),
    (1, 0, 1.0),
    (1, 1, math.sqrt(2.0)),
)


@final
class FoundWay:
    """The beginning of a way: a place (north, east, m from the vehicle) to which it is straight; how long it is."""

    __slots__ = ("aim", "longer_m")

    def __init__(self, aim: tuple[float, float], longer_m: float) -> None:
        self.aim: Final = aim
        self.longer_m: Final = longer_m  # than the straight one, both along the grid's axes and diagonals


def find_way(
    seen: SeenBefore,
    target: tuple[float, float],
    known: KnownPlaces = NOTHING,
    *,
    wider_m: float = WIDER_M,
    ahead_m: float = AHEAD_M,
    side: int = 0,
) -> FoundWay | None:
    """A way to `target`, of which a straight piece of `ahead_m` at most is told; None: there is none in the grid.

    `target`: metres north and east of the vehicle; beyond the fence it is before it. `wider_m`: more than what is kept.
    `side`: -1 left, 1 right of the straight way to the target, where it is to lead unless the other side is clearly
    shorter; 0: wherever.
    """
    off = off_n, off_e = seen.find_offset(CELL_M)
    blocked = _mark_blocked(seen, seen.clear_m + wider_m, off)
    for north_m, east_m, keep_m in known.find_discs(HALF_CELLS * CELL_M):
        away_m = math.hypot(north_m, east_m)
        # One that is too near already may go where it comes no nearer
        wide_m = keep_m + wider_m if away_m > keep_m else away_m - CELL_M
        _block_disc(blocked, north_m + off_n, east_m + off_e, wide_m)
    target = known.end_before(target)
    goal_n, goal_e = math.floor((target[0] + off_n) / CELL_M + 0.5), math.floor((target[1] + off_e) / CELL_M + 0.5)
    is_beyond = max(abs(goal_n), abs(goal_e)) > HALF_CELLS
    start = _index(0, 0)
    least_m = [math.inf] * (SIDE * SIDE)
    came = [-1] * (SIDE * SIDE)
    least_m[start] = 0.0
    queue: list[tuple[float, int]] = [(_left(0, 0, goal_n, goal_e), start)]
    expanded = 0
    while queue and expanded < EXPANDED_MAX:
        cost, here = heapq.heappop(queue)
        at_n, at_e = here // SIDE - HALF_CELLS, here % SIDE - HALF_CELLS
        left = _left(at_n, at_e, goal_n, goal_e)
        if cost > least_m[here] + left + 1e-9:
            continue  # it was reached by a shorter way since
        expanded += 1
        if left <= REACHED_CELLS or (is_beyond and max(abs(at_n), abs(at_e)) == HALF_CELLS):
            aim = _aim(here, came, blocked, off, ahead_m)
            longer_m = CELL_M * (least_m[here] + left - _left(0, 0, goal_n, goal_e))
            return None if aim is None else FoundWay(aim, longer_m)
        for d_n, d_e, length in STEPS:
            to_n, to_e = at_n + d_n, at_e + d_e
            if abs(to_n) > HALF_CELLS or abs(to_e) > HALF_CELLS:
                continue
            to = _index(to_n, to_e)
            is_aside = side * (goal_n * to_e - goal_e * to_n) < 0
            there_m = least_m[here] + length * (1.0 + SIDE_PRICE if is_aside else 1.0)
            if not blocked[to] and there_m < least_m[to]:
                least_m[to], came[to] = there_m, here
                heapq.heappush(queue, (there_m + _left(to_n, to_e, goal_n, goal_e), to))
    return None


def _mark_blocked(seen: SeenBefore, clear_m: float, off: tuple[float, float]) -> bytearray:
    """Cells whose middle is nearer to a point than `clear_m`; a vehicle that is itself may leave.

    `off`: where the vehicle is, from the middle of its cell.
    """
    blocked = bytearray(SIDE * SIDE)
    norths, easts = seen.find_near(HALF_CELLS * CELL_M + clear_m)
    norths, easts = [n + off[0] for n in norths], [e + off[1] for e in easts]
    for k in range(len(norths)):
        _block_disc(blocked, norths[k], easts[k], clear_m)
    own_m = _nearest_m(norths, easts, off[0], off[1])
    if own_m < clear_m:
        for at_n in (-2, -1, 0, 1, 2):
            for at_e in (-2, -1, 0, 1, 2):
                if _nearest_m(norths, easts, at_n * CELL_M, at_e * CELL_M) > own_m - SLACK_M:
                    blocked[_index(at_n, at_e)] = 0
    return blocked


def _block_disc(blocked: bytearray, north_m: float, east_m: float, keep_m: float) -> None:
    """Marks the cells whose middle is nearer to a place than `keep_m`."""
    wide = math.ceil(max(0.0, keep_m) / CELL_M)
    middle_n, middle_e = math.floor(north_m / CELL_M + 0.5), math.floor(east_m / CELL_M + 0.5)
    for at_n in range(max(-HALF_CELLS, middle_n - wide), min(HALF_CELLS, middle_n + wide) + 1):
        for at_e in range(max(-HALF_CELLS, middle_e - wide), min(HALF_CELLS, middle_e + wide) + 1):
            n, e = at_n * CELL_M - north_m, at_e * CELL_M - east_m
            if n * n + e * e < keep_m * keep_m:
                blocked[_index(at_n, at_e)] = 1


def _nearest_m(norths: list[float], easts: list[float], north_m: float, east_m: float) -> float:
    least_m2 = math.inf
    for k in range(len(norths)):
        n, e = norths[k] - north_m, easts[k] - east_m
        least_m2 = min(least_m2, n * n + e * e)
    return math.sqrt(least_m2)


def _aim(
    last: int, came: list[int], blocked: bytearray, off: tuple[float, float], ahead_m: float
) -> tuple[float, float] | None:
    """The farthest cell of the way, `ahead_m` at most, to which the straight line is free: from the vehicle."""
    way = [last]
    while came[way[-1]] >= 0:
        way.append(came[way[-1]])
    way.reverse()
    aim_n = aim_e = 0
    for k in range(1, len(way)):
        at_n, at_e = way[k] // SIDE - HALF_CELLS, way[k] % SIDE - HALF_CELLS
        is_far = math.hypot(at_n, at_e) * CELL_M > ahead_m
        if k > 1 and (is_far or not _is_line_free(at_n, at_e, blocked)):
            break
        aim_n, aim_e = at_n, at_e
    if aim_n == 0 and aim_e == 0:
        return None
    return aim_n * CELL_M - off[0], aim_e * CELL_M - off[1]


def _is_line_free(to_n: int, to_e: int, blocked: bytearray) -> bool:
    steps = 2 * max(abs(to_n), abs(to_e))
    for k in range(1, steps + 1):
        if blocked[_index(math.floor(to_n * k / steps + 0.5), math.floor(to_e * k / steps + 0.5))]:
            return False
    return True


def _left(at_n: int, at_e: int, goal_n: int, goal_e: int) -> float:
    """Cells that are left at least: along the axes and diagonals."""
    d_n, d_e = abs(goal_n - at_n), abs(goal_e - at_e)
    return max(d_n, d_e) + (math.sqrt(2.0) - 1.0) * min(d_n, d_e)


def _index(at_n: int, at_e: int) -> int:
    return (at_n + HALF_CELLS) * SIDE + at_e + HALF_CELLS
