"""Where the simulator puts the vehicles before take-off."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3
from mission.document.model import Mission, Placement
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot.vehicle import PROFILES
from sim_bridge.world.world import World, spawn_points
from tests.unit.core.core_kit import mission

SIZES = [1, 2, 3, 4, 7, 12, 50]
D1 = (30.0, -20.0, 8.0)  # east, north, up


def placed_mission(placement: Placement, n: int, spacing_m: float = 6.0) -> Mission:
    return mission(
        route={"d1_enu_m": D1},
        swarm={"size": n},
        coverage={"radius_m": 60.0},
        radio={"transit_range_m": 60.0, "full_range_m": 200.0},
        sim={"placement": placement.value, "placement_spacing_m": spacing_m},
    )


def places(placement: Placement, n: int, seed: int = 1, spacing_m: float = 6.0) -> list[Vec3]:
    return spawn_points(placed_mission(placement, n, spacing_m), np.random.default_rng(seed))


@pytest.mark.parametrize("placement", list(Placement))
@pytest.mark.parametrize("n", SIZES)
def test_everyone_gets_a_place_on_the_ground_apart_from_the_others(placement: Placement, n: int) -> None:
    found = places(placement, n)
    assert len(found) == n
    assert {down for _, _, down in found} == {0.0}
    for a, b in itertools.combinations(found, 2):
        assert math.dist(a, b) >= 6.0 - 1e-9


@pytest.mark.parametrize("placement", list(Placement))
@pytest.mark.parametrize("n", SIZES)
def test_places_lie_within_the_radius_that_the_mission_was_checked_with(placement: Placement, n: int) -> None:
    radius_m = placed_mission(placement, n).placement_radius_m
    for north, east, _ in places(placement, n):
        assert math.hypot(north - D1[1], east - D1[0]) <= radius_m + 1e-9


@pytest.mark.parametrize("placement", [Placement.GRID, Placement.RING])
@pytest.mark.parametrize("n", [2, 4, 9])
def test_regular_places_are_no_farther_apart_than_asked_for(placement: Placement, n: int) -> None:
    found = places(placement, n, spacing_m=7.5)
    assert min(math.dist(a, b) for a, b in itertools.combinations(found, 2)) == pytest.approx(7.5)


@pytest.mark.parametrize("placement", [Placement.GRID, Placement.RING])
def test_full_regular_places_are_about_d1(placement: Placement) -> None:
    found = places(placement, 9)
    assert (sum(p[0] for p in found) / 9, sum(p[1] for p in found) / 9) == pytest.approx((D1[1], D1[0]))


def test_single_vehicle_starts_at_d1() -> None:
    for placement in Placement:
        assert places(placement, 1) == [pytest.approx((D1[1], D1[0], 0.0))]


def test_seed_decides_random_places() -> None:
    assert places(Placement.RANDOM, 8, seed=3) == places(Placement.RANDOM, 8, seed=3)
    assert places(Placement.RANDOM, 8, seed=3) != places(Placement.RANDOM, 8, seed=4)


@pytest.mark.parametrize("placement", [Placement.GRID, Placement.RING])
def test_regular_places_need_no_luck(placement: Placement) -> None:
    assert places(placement, 8, seed=3) == places(placement, 8, seed=4)


@pytest.mark.parametrize("seed", range(5))
def test_random_places_are_found_for_many_even_after_an_unlucky_start(seed: int) -> None:
    assert len(places(Placement.RANDOM, 40, seed=seed)) == 40


@pytest.mark.parametrize("n", [2, 3, 8])
def test_random_places_leave_nobody_out_of_range(n: int) -> None:
    """So wide that some draws fall apart: those are drawn again."""
    sparse = mission(
        swarm={"size": n},
        coverage={"radius_m": 20.0},
        radio={"transit_range_m": 32.0},
        sim={"placement_spacing_m": 15.0},
    )
    for seed in range(200):
        rest = spawn_points(sparse, np.random.default_rng(seed))
        joined = [rest.pop()]
        for here in joined:
            near = [other for other in rest if math.dist(here, other) <= 30.0]
            joined += near
            rest = [other for other in rest if other not in near]
        assert not rest, f"seed {seed}"


@pytest.mark.parametrize("range_finder", [True, False])
def test_what_preflight_asks_for_layers_of_height_is_set_where_range_finders_are(range_finder: bool) -> None:
    flown = mission(swarm={"size": 2}, sim={"range_finder": range_finder, "personalities": {1: "ardupilot"}})
    vehicles = World(flown, lambda _frame, place, _seed: PointMass(place, 0.0), links=PROFILES).vehicles
    for vehicle_id, make in ((1, ARDUPILOT), (2, PX4)):
        held = vehicles[vehicle_id].autopilot.parameters
        (aid,) = make.height_aids
        assert aid.is_on({name: float(held[name]) for name in aid.names}) is range_finder
