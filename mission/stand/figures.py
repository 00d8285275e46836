"""A stand in a forester's figures, and which of its gaps a vehicle passes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mission.common.plane import Point, area_m2
from mission.document.model import Mission, Sensing
from mission.rules.forest_rules import stand_area
from mission.schema.forest import M2_PER_HA
from mission.stand.stand import Stand, StandTree

CLASS_M = 0.1  # of diameters
AREA_TREES = 10
NARROWEST = 5  # gaps that are named
GAP_MAX_M = 12.0  # what is farther apart is no gap


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
    needed_m = passes_m(sensing)
    narrow = [gap for gap in gaps if gap[0] < needed_m]
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
        passes_m=needed_m,
        gaps_passed=len(gaps) - len(narrow),
        too_narrow=tuple(narrow[:NARROWEST]),
    )


def passes_m(sensing: Sensing) -> float:
    """Width of a gap that a vehicle passes with its margin; m."""
    return round(2.0 * (sensing.vehicle_radius_m + sensing.margin_m), 6)


def area_of(mission: Mission) -> Sequence[Point] | None:
    """Area in which the stand of `mission` grows; None for a measured one."""
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
            while len(hull) >= start + 2 and _orientation(hull[-2], hull[-1], p) <= 0.0:
                hull.pop()
            hull.append(p)
        hull.pop()
    return hull


def _orientation(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
