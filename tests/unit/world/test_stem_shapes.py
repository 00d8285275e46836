"""Trunks with shapes: drawn from the seed tree by tree, met by rays on their bark, off where not asked for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mission.document.model import Mission
from mission.stand.stand import Stand, StandTree, stand_of
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.raw_lidar import MOUNTED_UP_M, raw_lidars_of
from sim_bridge.world.sensors.stems import shapes
from sim_bridge.world.sensors.stems.shapes import StemShapes, shapes_of

BARE = {"forks": 0.0, "stubs_per_tree": 0.0, "saplings_per_ha": 0.0, "litter_per_ha": 0.0}
PLAIN = {**BARE, "lean_deg": 0.0, "ellipse": 0.0, "bark_m": 0.0}


def flown(spec: dict[str, Any] | None, seed: int = 1, **forest: Any) -> Mission:
    route = {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [60.0, 0.0, 4.0], "vel_leader_mps": 2.0}
    sensing = {"sensor": "multi-layer", "upside_down": True, "range_m": 12.0}
    tables = {"schema": 1, "route": route, "sensing": sensing, "sim": {"seed": seed}, "swarm": {"size": 1}}
    if spec is not None:
        forest["shapes"] = spec
    return Mission.model_validate({**tables, "coverage": {"duration_s": 0.0}, "forest": forest})


def shapes_in(spec: dict[str, Any], trees: list[StandTree], seed: int = 1) -> StemShapes:
    found = shapes_of(flown(spec, seed), Stand(trees))
    assert found is not None
    return found


TREE = StandTree(4.0, 3.0, 0.15, 18.0, 12.0, 2.0)


def ranges_of(mission: Mission, stand: Stand) -> tuple[Any, Any]:
    """The exact ranges of a turn at the origin, and the lidar."""
    lidars = raw_lidars_of(mission, stand, [1])
    assert lidars is not None
    lidar = lidars._drivers[1].lidar
    at = AirframeState((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False, 0.0)
    return lidar.measure(at, ()), lidar


def test_without_the_table_trunks_are_cylinders() -> None:
    assert shapes_of(flown(None), Stand([TREE])) is None


def test_the_same_seed_draws_the_same_trunks_and_another_others() -> None:
    one, same, other = (shapes_in({}, [TREE] * 20, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.trunks, same.trunks)
    assert one.bits == same.bits
    assert one.trunks.shape != other.trunks.shape or not np.allclose(one.trunks, other.trunks)


def test_the_diameter_at_breast_height_is_the_trees() -> None:
    rows = shapes_in(BARE, [TREE] * 50).trunks
    around = np.linspace(0.0, math.tau, 720, endpoint=False)
    for row in rows:
        radii = shapes.radius_m(np.repeat(row[None], 720, axis=0), np.full(720, 1.3), around)
        assert radii.mean() == pytest.approx(0.15, abs=0.001)
        assert radii.std() > 0.002


def test_trunks_get_thinner_with_height() -> None:
    row = shapes_in({**PLAIN, "taper_exponent_sd": 0.0}, [TREE]).trunks
    low, high = (float(shapes.radius_m(row, np.array([up]), np.array([0.0]))[0]) for up in (1.3, 4.0))
    assert low == pytest.approx(0.15)
    assert high == pytest.approx(0.15 * (14.0 / 16.7) ** 0.7, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_rays_end_on_the_bark(seed: int) -> None:
    mission = flown({**BARE, "lean_deg": 3.0, "bark_m": 0.0}, seed)
    stand = Stand([TREE])
    told, lidar = ranges_of(mission, stand)
    drawn = shapes_of(mission, stand)
    assert drawn is not None
    (row,) = drawn.trunks
    bearings = np.radians(lidar.pattern.bearings_deg)
    half_beam = math.radians(0.1)
    met = 0
    for elevation, layer in zip(lidar.pattern.elevations_deg, told, strict=True):
        level, down = math.cos(math.radians(elevation)), -math.sin(math.radians(elevation))
        for range_m, bearing in zip(layer, bearings, strict=True):
            up = 4.0 + MOUNTED_UP_M - down * range_m
            if not math.isfinite(range_m) or not 0.2 < up < 10.0:
                continue
            axis_n = row[shapes.NORTH] + row[shapes.LEAN_N] * (up - 1.3)
            axis_e = row[shapes.EAST] + row[shapes.LEAN_E] * (up - 1.3)
            n, e = level * range_m * math.cos(bearing) - axis_n, level * range_m * math.sin(bearing) - axis_e
            at = math.atan2(e, n)
            radius = float(shapes.radius_m(row[None], np.array([up]), np.array([at]))[0])
            # On the bark, or beside it by half of a beam at most
            assert -0.003 < math.hypot(n, e) - radius < 1.05 * half_beam * range_m + 0.003
            met += 1
    assert met > 10


def test_what_lies_about_is_seen_and_where_nothing_is_asked_for_nothing_is() -> None:
    forest = {"stand": {"density_per_ha": 100.0, "crown_base_share": 0.7}}
    bare, full = (
        flown(spec, **forest) for spec in (BARE, {**BARE, "litter_per_ha": 3000.0, "saplings_per_ha": 3000.0})
    )
    seen, more = (ranges_of(mission, stand_of(mission))[0] for mission in (bare, full))
    assert (more < seen - 0.05).sum() > 20
    assert not (more > seen + 1e-9).any()


def test_a_fork_has_two_branches_above_it() -> None:
    rows = shapes_in({**BARE, "forks": 1.0}, [TREE]).trunks
    assert len(rows) == 3
    below, one, other = rows
    assert 1.8 <= below[shapes.HIGH] <= 7.0
    assert one[shapes.LOW] == other[shapes.LOW] == below[shapes.HIGH]
    assert one[shapes.RADIUS] < below[shapes.RADIUS]
