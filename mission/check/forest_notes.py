"""Notes for a pilot about a mission in its stand that no rule refuses."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence

from mission.common.frames import Vec3
from mission.common.plane import clearance_m, distance_to_segment_m
from mission.document.model import CoverageShape, Mission, Sensing
from mission.rules.flight_rules import placement_radius_m
from mission.rules.forest_rules import TAKEOFF_CLEAR_M
from mission.stand.figures import passes_m
from mission.stand.stand import Stand

CELL_M = 0.5  # of the grid that a way is sought on
CELLS_MAX = 250_000
CLEAR_MAX_M = 3.0  # half of the widest way that is told apart
CORRIDOR_M = 40.0  # beside the route: a swarm does not go round farther


def notes_of(stand: Stand, mission: Mission) -> Iterator[str]:
    """Each a line."""
    if mission.sensing is None and stand.boxes:
        yield "no [sensing]: companions do not know the boxes"
    if mission.sensing is None and stand.trees:
        yield "no [sensing]: companions know the trunks at d2 and the stops alone"
    points_enu_m, names = mission.route.points_enu_m, _names(mission)
    yield from bare_notes(stand, mission)
    yield from fence_notes(stand, mission)
    yield from _ground_notes(stand, mission, names)
    between = "trunks and boxes" if stand.boxes else "trunks"
    for k in range(len(points_enu_m) - 1):
        way = f"from {names[k]} to {names[k + 1]}"
        yield from _crown_notes(stand, points_enu_m[k], points_enu_m[k + 1], way)
        needed_m = passes_m(mission.sensing or Sensing())
        width_m = widest_way_m(
            stand, points_enu_m[k], points_enu_m[k + 1], arrival_distance_m=mission.route.arrival_distance_m
        )
        if width_m < needed_m:
            found = f": the widest is about {width_m:.1f} m at its narrowest" if width_m > 0.0 else ""
            yield f"no way {way} is {needed_m:.2f} m wide between {between}{found}"
        elif width_m < 2.0 * CLEAR_MAX_M:
            yield f"the widest way {way} is about {width_m:.1f} m between {between} at its narrowest"


def _names(mission: Mission) -> list[str]:
    return ["d1", *(f"stops[{k}]" for k in range(len(mission.route.stops))), "d2"]


def bare_notes(stand: Stand, mission: Mission) -> Iterator[str]:
    """Places to cover, d2 among them, where no tree stands in the ring's middle."""
    if mission.coverage.shape is not CoverageShape.RING:
        return
    keep_out_m = mission.coverage.keep_out_m
    for name, (east_m, north_m, _) in zip(_names(mission)[1:], mission.route.points_enu_m[1:], strict=True):
        if stand.near(east_m, north_m, keep_out_m):
            continue
        ways_m = [math.hypot(tree.east_m - east_m, tree.north_m - north_m) - tree.radius_m for tree in stand.trees]
        nearest = f": the nearest is {min(ways_m):.1f} m away" if ways_m else ""
        yield f"no trunk stands within coverage.keep_out_m = {keep_out_m:g} m of {name}{nearest}"


def fence_notes(stand: Stand, mission: Mission) -> Iterator[str]:
    """The altitudes between which vehicles may fly, against the crowns inside the fence."""
    fence = mission.fence
    bases_m = []
    for tree in stand.trees:
        ground_m = stand.ground_up_m(tree.east_m, tree.north_m)
        base_m, top_m = ground_m + tree.crown_base_m, ground_m + tree.height_m
        if base_m < min(top_m, fence.altitude_max_m) and top_m > fence.altitude_min_m:
            pos_enu_m = tree.east_m, tree.north_m
            if fence.polygon_enu_m is None or clearance_m(pos_enu_m, fence.polygon_enu_m) > -tree.crown_radius_m:
                bases_m.append(base_m)
    if bases_m:
        crowns = "1 crown" if len(bases_m) == 1 else f"{len(bases_m)} crowns"
        yield (
            f"the fence, {fence.altitude_min_m:g} to {fence.altitude_max_m:g} m up, reaches into {crowns}: the lowest "
            f"from {min(bases_m):.1f} m up"
        )


def _ground_notes(stand: Stand, mission: Mission, names: Sequence[str]) -> Iterator[str]:
    """Sloping ground where vehicles spread out: about d1, the stops and d2. Between these it is no nearer to them."""
    slope = math.hypot(*stand.grade)
    if slope == 0.0:
        return
    floor_m = mission.fence.altitude_min_m
    spread = (placement_radius_m(mission), *(mission.coverage.radius_m for _ in names[1:]))
    for name, pos_enu_m, radius_m in zip(names, mission.route.points_enu_m, spread, strict=True):
        ground_m = stand.ground_up_m(pos_enu_m[0], pos_enu_m[1])
        is_sphere = mission.coverage.shape is CoverageShape.SPHERE and name != "d1"
        lowest_m = pos_enu_m[2] - ground_m - radius_m * (math.hypot(1.0, slope) if is_sphere else slope)
        rises_to_m = ground_m + radius_m * slope
        rises = f"the ground rises to {rises_to_m:.1f} m within {radius_m:.1f} m of {name}"
        if rises_to_m > floor_m:
            yield f"{rises}, above the fence's floor: fence.altitude_min_m = {floor_m:g} counts from the origin"
        if lowest_m < TAKEOFF_CLEAR_M:
            least = f"{lowest_m:.1f} m above it" if lowest_m > 0.0 else f"{-lowest_m:.1f} m below it"
            yield f"{rises}: the lowest of the places about {name} is {least}"


def _crown_notes(stand: Stand, here: Vec3, there: Vec3, way: str) -> Iterator[str]:
    low = []
    for tree in stand.trees:
        off_m = distance_to_segment_m((tree.east_m, tree.north_m), here[:2], there[:2])
        up_m = min(here[2], there[2]) - stand.ground_up_m(tree.east_m, tree.north_m)
        high_m = max(here[2], there[2]) - stand.ground_up_m(tree.east_m, tree.north_m)
        if off_m < tree.crown_radius_m and high_m > tree.crown_base_m and up_m < tree.height_m:
            low.append(tree.crown_base_m)
    if low:
        crowns = "1 crown hangs" if len(low) == 1 else f"{len(low)} crowns hang"
        yield f"{crowns} into the straight way {way}: the lowest from {min(low):g} m up"


def widest_way_m(stand: Stand, here: Sequence[float], there: Sequence[float], *, arrival_distance_m: float) -> float:
    """Width of the widest way between trunks and boxes at its narrowest, within CORRIDOR_M of the route.

    0: there is none. On a grid of half a metre, so to about that; at most 2 * CLEAR_MAX_M. It begins and ends
    `arrival_distance_m` from `here` and `there`: what stands closer to these, the tree that is visited first of all,
    does not narrow it.
    """
    west, east = min(here[0], there[0]) - CORRIDOR_M, max(here[0], there[0]) + CORRIDOR_M
    south, north = min(here[1], there[1]) - CORRIDOR_M, max(here[1], there[1]) + CORRIDOR_M
    cell_m = max(CELL_M, math.sqrt((east - west) * (north - south) / CELLS_MAX))
    columns, rows = int((east - west) / cell_m) + 1, int((north - south) / cell_m) + 1

    def clear_m(cell: tuple[int, int]) -> float:
        x, y = west + cell[0] * cell_m, south + cell[1] * cell_m
        trunks_m = [
            math.hypot(tree.east_m - x, tree.north_m - y) - tree.radius_m for tree in stand.near(x, y, CLEAR_MAX_M)
        ]
        boxes_m = [box.clearance_m(x, y) for box in stand.boxes_near(x, y, CLEAR_MAX_M)]
        return min([CLEAR_MAX_M, *trunks_m, *boxes_m])

    start = round((here[0] - west) / cell_m), round((here[1] - south) / cell_m)
    goal = round((there[0] - west) / cell_m), round((there[1] - south) / cell_m)
    ends = arrival_distance_m / cell_m
    reach = range(-int(ends), int(ends) + 1)
    seen = {(start[0] + i, start[1] + j) for i in reach for j in reach if math.hypot(i, j) <= ends}
    widths = ((clear_m(cell), cell) for cell in seen if 0 <= cell[0] < columns and 0 <= cell[1] < rows)
    waiting = [(-width, math.dist(cell, goal), cell) for width, cell in widths if width > 0.0]
    heapq.heapify(waiting)  # the widest first, of those the nearest to the goal
    while waiting:
        clear, off, cell = heapq.heappop(waiting)
        if off <= ends:
            return -2.0 * clear
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            following = cell[0] + step[0], cell[1] + step[1]
            if not (0 <= following[0] < columns and 0 <= following[1] < rows) or following in seen:
                continue
            seen.add(following)
            width = min(-clear, clear_m(following))
            if width > 0.0:
                heapq.heappush(waiting, (-width, math.dist(following, goal), following))
    return 0.0
