"""What a stand is like, in a forester's figures, and what of it a mission's vehicles pass."""

from __future__ import annotations

import heapq
import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mission.forest import M2_PER_HA
from mission.forest_rules import stand_area
from mission.frames import Vec3
from mission.model import CoverageShape, Mission, Sensing
from mission.plane import Point, area_m2, distance_to_segment_m
from mission.stand import Stand, StandTree

CLASS_M = 0.1  # of diameters
AREA_TREES = 10
NARROWEST = 5  # gaps that are named
GAP_MAX_M = 12.0  # what is farther apart is no gap
CELL_M = 0.5  # of the grid that a way is sought on
CELLS_MAX = 250_000
CLEAR_MAX_M = 3.0  # half of the widest way that is told apart
CORRIDOR_M = 40.0  # beside the route: a swarm does not go round farther


@dataclass(frozen=True, slots=True)
class Figures:
    """Of the trees; undergrowth is counted alone."""

    trees: int
    bushes: int
    area_ha: float | None  # None: of fewer than AREA_TREES it cannot be told
    density_per_ha: float | None
    basal_area_m2_per_ha: float | None
    dbh_cm: tuple[float, float, float]  # least, mean, greatest
    dbh_quadratic_mean_cm: float
    dbh_classes: tuple[tuple[int, int], ...]  # from so many cm: how many trees, for classes of 10 cm
    height_m: tuple[float, float]  # least, greatest
    crowns_from_m: float  # the lowest crown base above the ground
    gaps: int  # between trunks that are neighbours
    gap_least_m: float | None  # surface to surface
    gap_median_m: float | None
    passes_m: float  # what a vehicle needs
    gaps_passed: int
    too_narrow: tuple[tuple[float, float, float], ...]  # the narrowest: gap, and east, north of its middle, m


def figures_of(stand: Stand, *, area: Sequence[Point] | None, sensing: Sensing | None) -> Figures:
    """`area`: where the trees grow; None: as far as they stand. `sensing`: of the vehicles; None: the default ones.

    ValueError for a stand without trees.
    """
    if not stand.trees:
        raise ValueError("no trees")
    sensing = sensing or Sensing()
    size_m2 = _spread_m2(stand.trees) if area is None else area_m2(area)
    area_ha = size_m2 / M2_PER_HA if size_m2 > 0.0 else None
    dbh_m = [2.0 * tree.radius_m for tree in stand.trees]
    gaps = sorted(gaps_m(stand))
    narrow = [gap for gap in gaps if gap[0] < _passes_m(sensing)]
    passes_m = _passes_m(sensing)
    basal_m2 = sum(math.pi / 4.0 * d * d for d in dbh_m)
    return Figures(
        trees=len(stand.trees),
        bushes=len(stand.bushes),
        area_ha=area_ha,
        density_per_ha=None if area_ha is None else len(stand.trees) / area_ha,
        basal_area_m2_per_ha=None if area_ha is None else basal_m2 / area_ha,
        dbh_cm=(100.0 * min(dbh_m), 100.0 * statistics.fmean(dbh_m), 100.0 * max(dbh_m)),
        dbh_quadratic_mean_cm=100.0 * math.sqrt(statistics.fmean(d * d for d in dbh_m)),
        dbh_classes=tuple(_classes(dbh_m)),
        height_m=(min(tree.height_m for tree in stand.trees), max(tree.height_m for tree in stand.trees)),
        crowns_from_m=min(tree.crown_base_m for tree in stand.trees),
        gaps=len(gaps),
        gap_least_m=gaps[0][0] if gaps else None,
        gap_median_m=statistics.median(gap[0] for gap in gaps) if gaps else None,
        passes_m=passes_m,
        gaps_passed=len(gaps) - len(narrow),
        too_narrow=tuple(narrow[:NARROWEST]),
    )


def _passes_m(sensing: Sensing) -> float:
    return round(2.0 * (sensing.vehicle_radius_m + sensing.margin_m), 6)


def area_of(mission: Mission) -> Sequence[Point] | None:
    """Where the stand of `mission` grows; None for a measured one."""
    spec = mission.forest.stand
    return None if spec is None else stand_area(mission, spec)


def gaps_m(stand: Stand) -> Iterator[tuple[float, float, float]]:
    """Between the trunks of neighbours, surface to surface: pairs in whose circle no third trunk's axis stands.

    Each with east, north of its middle.

    That is Gabriel's graph (Gabriel & Sokal 1969, Systematic Zoology 18, 259-278).
    """
    for tree in stand.trees:
        for other in stand.near(tree.east_m, tree.north_m, GAP_MAX_M):
            if (tree.east_m, tree.north_m) >= (other.east_m, other.north_m):
                continue  # each pair once
            apart_m = math.hypot(other.east_m - tree.east_m, other.north_m - tree.north_m)
            if apart_m <= GAP_MAX_M and not _is_between(stand, tree, other, apart_m / 2.0):
                gap_m = apart_m - tree.radius_m - other.radius_m
                yield gap_m, (tree.east_m + other.east_m) / 2.0, (tree.north_m + other.north_m) / 2.0


def _is_between(stand: Stand, a: StandTree, b: StandTree, half_m: float) -> bool:
    east_m, north_m = (a.east_m + b.east_m) / 2.0, (a.north_m + b.north_m) / 2.0
    return any(
        third is not a and third is not b and math.hypot(third.east_m - east_m, third.north_m - north_m) < half_m - 1e-9
        for third in stand.near(east_m, north_m, half_m)
    )


def _classes(dbh_m: Sequence[float]) -> Iterator[tuple[int, int]]:
    found: dict[int, int] = {}
    for d in dbh_m:
        found[int(d / CLASS_M + 1e-9)] = found.get(int(d / CLASS_M + 1e-9), 0) + 1
    for k in range(min(found), max(found) + 1):
        yield round(100 * CLASS_M) * k, found.get(k, 0)


def _spread_m2(trees: Sequence[StandTree]) -> float:
    """Area that `trees` were drawn from: their convex hull, widened by its corners' share of them; 0 for too few.

    Ripley & Rasson 1977, "Finding the edge of a Poisson forest", Journal of Applied Probability 14, 483-491.
    """
    if len(trees) < AREA_TREES:
        return 0.0
    hull = _hull(sorted({(tree.east_m, tree.north_m) for tree in trees}))
    return area_m2(hull) * len(trees) / max(1, len(trees) - len(hull)) if len(hull) >= 3 else 0.0


def _hull(points: Sequence[Point]) -> list[Point]:
    """Andrew's monotone chain."""
    if len(points) < 3:
        return list(points)
    hull: list[Point] = []
    for half in (points, points[::-1]):
        start = len(hull)
        for p in half:
            while len(hull) >= start + 2 and _turn(hull[-2], hull[-1], p) <= 0.0:
                hull.pop()
            hull.append(p)
        hull.pop()
    return hull


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


# --- a mission in it --------------------------------------------------------------------------------------------------


def notes_of(stand: Stand, mission: Mission) -> Iterator[str]:
    """What a pilot should know of `mission` in its stand, and no rule refuses."""
    if mission.sensing is None and stand.trees:
        yield "no [sensing]: companions know the trunks at d2 and the stops alone"
    places = mission.route.places_enu_m
    names = ["d1", *(f"stops[{k}]" for k in range(len(mission.route.stops))), "d2"]
    if mission.coverage.shape is CoverageShape.RING:
        for name, place in zip(names[1:], places[1:], strict=True):
            if not stand.near(place[0], place[1], mission.coverage.keep_out_m):
                yield f"no trunk stands within coverage.keep_out_m = {mission.coverage.keep_out_m:g} m of {name}"
    for k in range(len(places) - 1):
        way = f"from {names[k]} to {names[k + 1]}"
        yield from _crown_notes(stand, places[k], places[k + 1], way)
        passes_m = _passes_m(mission.sensing or Sensing())
        width_m = widest_way_m(stand, places[k], places[k + 1], arrival_distance_m=mission.route.arrival_distance_m)
        if width_m < passes_m:
            found = f": the widest is about {width_m:.1f} m at its narrowest" if width_m > 0.0 else ""
            yield f"no way {way} is {passes_m:.2f} m wide between trunks{found}"
        elif width_m < 2.0 * CLEAR_MAX_M:
            yield f"the widest way {way} is about {width_m:.1f} m between trunks at its narrowest"


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
    """How wide the widest way between trunks is at its narrowest, within CORRIDOR_M of the route; 0: there is none.

    On a grid of half a metre, so to about that; at most 2 * CLEAR_MAX_M. It begins and ends `arrival_distance_m` from
    `here` and `there`: what stands closer to these, the tree that is visited first of all, does not narrow it.
    """
    west, east = min(here[0], there[0]) - CORRIDOR_M, max(here[0], there[0]) + CORRIDOR_M
    south, north = min(here[1], there[1]) - CORRIDOR_M, max(here[1], there[1]) + CORRIDOR_M
    cell_m = max(CELL_M, math.sqrt((east - west) * (north - south) / CELLS_MAX))
    columns, rows = int((east - west) / cell_m) + 1, int((north - south) / cell_m) + 1

    def clear_m(cell: tuple[int, int]) -> float:
        x, y = west + cell[0] * cell_m, south + cell[1] * cell_m
        near = stand.near(x, y, CLEAR_MAX_M)
        return min((math.hypot(tree.east_m - x, tree.north_m - y) - tree.radius_m for tree in near), default=CLEAR_MAX_M)

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
