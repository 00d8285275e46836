"""Grows the stand of `[forest.stand]`: the same mission and seed give the same trees on every machine.

Places: one after another, uniform over the area, each at least `spacing_min_m` from all before it (a hard-core process
by random sequential adsorption). Diameters: a Weibull distribution that begins at dbh_min_m, as foresters use it
(Bailey & Dell 1973, "Quantifying diameter distributions with the Weibull function", Forest Science 19, 97-104: of shape
1 an exponential, of 3.6 nearly a normal one), cut off at dbh_max_m. All is rounded, places to 1 cm and diameters to
1 mm, so that another machine's last bit of a logarithm changes nothing, and a stem map holds the stand without loss.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from random import Random
from typing import NamedTuple

from mission.common.plane import Point, area_m2, clearance_m
from mission.document.model import CoverageShape, Mission
from mission.rules.flight_rules import placement_radius_m
from mission.rules.forest_rules import BOX_SHARE, PACKED_SHARE, stand_area, wanted_trees
from mission.schema.forest import M2_PER_HA, StandSpec
from mission.schema.trees import UNDERGROWTH, StandTree

TRIES_PER_TREE = round(10.0 / (BOX_SHARE * (1.0 - PACKED_SHARE)))  # many times what the densest stand takes
BUSH_RADII_M = (0.2, 0.6)
BUSH_HEIGHT_MIN_M = 0.3


class Grown(NamedTuple):
    """Trees and bushes generated for a stand."""

    trees: tuple[StandTree, ...]
    bushes: tuple[StandTree, ...]


def generate_stand(mission: Mission, spec: StandSpec, standing: Sequence[StandTree]) -> Grown:
    """The stand of `mission` besides the trees that are `standing`, with one at d2 and each stop where rings are flown.

    Around d1 nothing grows within `clearing_m` of the disc of the starting points.
    """
    rng = Random(mission.sim.seed if spec.seed is None else spec.seed)
    area = stand_area(mission, spec)
    spots = _Spots(spec.spacing_min_m, [(tree.east_m, tree.north_m) for tree in standing])
    planted = [] if mission.coverage.shape is not CoverageShape.RING else _planted(mission, standing)
    for pos_enu_m in planted:
        spots.take_spot(pos_enu_m)
    positions_enu_m = _draw_positions(wanted_trees(mission, spec) - len(planted), area, spots, rng)
    trees = [_tree(pos_enu_m, spec, rng) for pos_enu_m in (*planted, *positions_enu_m)]
    bushes = [_bush(pos_enu_m, spec, rng) for pos_enu_m in _scattered(spec, area, rng)]
    d1, clear_m = mission.route.d1_enu_m, placement_radius_m(mission) + spec.clearing_m
    return Grown(*(tuple(t for t in grown if _off_m(t, d1) >= clear_m) for grown in (trees, bushes)))


def _planted(mission: Mission, standing: Sequence[StandTree]) -> list[Point]:
    """d2 and the stops before it, except where the mission has a trunk already."""
    keep_out_m = mission.coverage.keep_out_m
    planted: list[Point] = []
    for visit in mission.trees:
        pos_enu_m = visit.pos_enu_m[:2]
        taken = (*((tree.east_m, tree.north_m) for tree in standing), *planted)
        if all(math.dist(other, pos_enu_m) >= keep_out_m for other in taken):
            planted.append(pos_enu_m)
    return planted


def _draw_positions(n: int, area: Sequence[Point], spots: _Spots, rng: Random) -> list[Point]:
    """`n` places, or as many as are found in TRIES_PER_TREE * n tries: explicit trees may have taken the room."""
    found: list[Point] = []
    for _ in range(TRIES_PER_TREE * max(0, n)):
        pos_enu_m = _drawn(area, rng)
        if spots.is_free(pos_enu_m) and _inside(pos_enu_m, area):
            spots.take_spot(pos_enu_m)
            found.append(pos_enu_m)
            if len(found) == n:
                break
    return found


def _scattered(spec: StandSpec, area: Sequence[Point], rng: Random) -> list[Point]:
    """Places of bushes: they may stand in each other."""
    n = round(spec.undergrowth_per_ha * area_m2(area) / M2_PER_HA)
    positions_enu_m: list[Point] = []
    while len(positions_enu_m) < n:
        pos_enu_m = _drawn(area, rng)
        if _inside(pos_enu_m, area):
            positions_enu_m.append(pos_enu_m)
    return positions_enu_m


def _drawn(area: Sequence[Point], rng: Random) -> Point:
    """Uniform over the area's bounding box, to 1 cm."""
    west, east = min(p[0] for p in area), max(p[0] for p in area)
    south, north = min(p[1] for p in area), max(p[1] for p in area)
    return round(west + (east - west) * rng.random(), 2), round(south + (north - south) * rng.random(), 2)


def _inside(pos_enu_m: Point, area: Sequence[Point]) -> bool:
    return clearance_m(pos_enu_m, area) >= 0.0


def _tree(pos_enu_m: Point, spec: StandSpec, rng: Random) -> StandTree:
    species = spec.species[int(rng.random() * len(spec.species))]
    dbh_m = _diameter_m(spec, rng.random())
    return spec.tree(*pos_enu_m, dbh_m, species)


def _diameter_m(spec: StandSpec, share: float) -> float:
    """The diameter that this share of the trees is below."""
    scale_m = (spec.dbh_mean_m - spec.dbh_min_m) / math.gamma(1.0 + 1.0 / spec.dbh_shape)
    cut = -math.expm1(-(((spec.dbh_max_m - spec.dbh_min_m) / scale_m) ** spec.dbh_shape))
    beyond_m = scale_m * math.pow(-math.log1p(-share * cut), 1.0 / spec.dbh_shape)
    return round(spec.dbh_min_m + beyond_m, 3)


def _bush(pos_enu_m: Point, spec: StandSpec, rng: Random) -> StandTree:
    low_m, high_m = BUSH_RADII_M
    radius_m = round(low_m + (high_m - low_m) * rng.random(), 2)
    height_m = round(BUSH_HEIGHT_MIN_M + (spec.undergrowth_height_m - BUSH_HEIGHT_MIN_M) * rng.random(), 2)
    return StandTree(*pos_enu_m, radius_m, height_m, height_m, radius_m, UNDERGROWTH)


def _off_m(tree: StandTree, pos_enu_m: Sequence[float]) -> float:
    """From the trunk's surface."""
    return math.dist((tree.east_m, tree.north_m), pos_enu_m[:2]) - tree.radius_m


class _Spots:
    """The places taken so far, in squares as wide as the least spacing."""

    def __init__(self, spacing_m: float, taken: Sequence[Point]) -> None:
        self._spacing_m = spacing_m
        self._cells: dict[tuple[int, int], list[Point]] = {}
        for pos_enu_m in taken:
            self.take_spot(pos_enu_m)

    def take_spot(self, pos_enu_m: Point) -> None:
        """`pos_enu_m` is taken."""
        self._cells.setdefault(self._cell(pos_enu_m), []).append(pos_enu_m)

    def is_free(self, pos_enu_m: Point) -> bool:
        """No place that is taken is nearer than the spacing."""
        x, y = self._cell(pos_enu_m)
        square_m2 = self._spacing_m * self._spacing_m
        for i in (x - 1, x, x + 1):
            for j in (y - 1, y, y + 1):
                for other in self._cells.get((i, j), ()):
                    east_m, north_m = other[0] - pos_enu_m[0], other[1] - pos_enu_m[1]
                    if east_m * east_m + north_m * north_m < square_m2:
                        return False
        return True

    def _cell(self, pos_enu_m: Point) -> tuple[int, int]:
        return math.floor(pos_enu_m[0] / self._spacing_m), math.floor(pos_enu_m[1] / self._spacing_m)
