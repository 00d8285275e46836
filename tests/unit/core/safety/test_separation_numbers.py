"""Bounds on closing in, number by number, where flights alone came by."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.model.events import Position
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, norm
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from companion.core.safety.bounds import Bound, find_nearest, step_towards
from companion.core.safety.clearance import MARGIN_M
from companion.core.safety.descent import LANDING_ROOM_M, LandingRoom
from companion.core.safety.rest import PULL_MAX_MPS, PULL_PER_S, SLACK_M, RestHold
from companion.core.safety.safety_filter import AGE_WIDENS_MPS, ERROR_COUNTS_M, UNSHARED_M, SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour

OPEN = SafetyFilter.of(mission())
SENSES = replace(OPEN, senses=True)
OWN = Position((0.0, 0.0, -8.0), (1.0, -0.5, 0.25), None)
DRIFT: Vec3 = (0.3, -0.2, 0.1)


def around(*, neighbours: tuple = (), seen: tuple = (), error_m: float = 0.0) -> Surroundings:  # type: ignore[type-arg]
    cloud = LocalObstacleCloud(math.inf, (False,))
    return Surroundings(OWN, neighbours, {}, cloud, seen=seen, error_m=error_m)


@pytest.mark.parametrize("rel", [(9.0, 4.0, 0.0), (-7.0, 6.0, 0.0), (3.0, -2.0, 0.0)])
@pytest.mark.parametrize("vel", [(1.0, 0.5, 0.0), (-2.0, 1.0, 0.0)])
def test_one_that_is_only_seen_is_closed_on_by_what_is_known_of_it(rel: Vec3, vel: Vec3) -> None:
    vehicle = SeenVehicle(rel, vel, 0.4, 0.7)
    (bound,) = OPEN.separations(around(seen=(vehicle,)), DRIFT)
    unit = tuple(k / norm(rel) for k in rel)
    assert bound.along == pytest.approx(unit)
    room_m = norm(rel) - OPEN.hard_separation_m - MARGIN_M - 0.7 * AGE_WIDENS_MPS - 0.4
    its_mps = sum(a * b for a, b in zip(vel, unit, strict=True))
    drift_mps = sum(a * b for a, b in zip(DRIFT, unit, strict=True))
    assert bound.most_mps == pytest.approx(OPEN.response.closing_mps(room_m) + its_mps - drift_mps)


@pytest.mark.parametrize("rel", [ZERO, (math.inf, 0.0, 0.0), (math.nan, 0.0, 0.0)])
def test_one_that_is_seen_nowhere_bounds_nothing(rel: Vec3) -> None:
    beside = SeenVehicle((9.0, 0.0, 0.0), ZERO, 0.1, 0.0)
    for seen in ((SeenVehicle(rel, ZERO, 0.1, 0.0), beside), (beside, SeenVehicle(rel, ZERO, 0.1, 0.0))):
        assert len(OPEN.separations(around(seen=seen))) == 1


@pytest.mark.parametrize("rel", [(7.0, 4.0, -2.0), (-8.0, 3.0, 1.0)])
@pytest.mark.parametrize("vel", [(1.5, 0.5, -0.3), (-1.0, 2.0, 0.2)])
@pytest.mark.parametrize("error_m", [0.0, 2.0])
def test_one_that_is_heard_is_closed_on_by_half_each_and_among_trees_no_faster_than_it_may_stop_behind_it(
    rel: Vec3, vel: Vec3, error_m: float
) -> None:
    other = neighbour(2, rel, vel_ned_mps=vel, age_s=0.2, late_s=0.4, position_error_m=error_m)
    assert other.gives_way
    n = tuple(k / norm(rel) for k in rel)
    its_mps, own_mps, drift_mps = (sum(a * b for a, b in zip(v, n, strict=True)) for v in (vel, OWN.vel_ned_mps, DRIFT))
    strayed_m = 0.2 * AGE_WIDENS_MPS + 0.5 * OPEN.acceleration_max_mps2 * 0.4**2 + error_m
    room_m = norm(rel) - OPEN.hard_separation_m - MARGIN_M - strayed_m
    response = OPEN.response
    shared_mps = response.closing_mps(room_m) / 2.0 + (own_mps + its_mps) / 2.0
    for one, extra_mps in ((OPEN, math.inf), (SENSES, response.behind_mps(room_m + UNSHARED_M, its_mps))):
        expected_mps = min(shared_mps, extra_mps)
        if error_m:  # its word frees nothing
            expected_mps = min(expected_mps, response.closing_mps(room_m) + min(0.0, its_mps))
        (bound,) = one.separations(around(neighbours=(other,)), DRIFT)
        assert bound.along == pytest.approx(n)
        assert bound.most_mps == pytest.approx(expected_mps - drift_mps)


def test_one_that_does_not_give_way_is_given_it_all() -> None:
    other = neighbour(2, (8.0, 0.0, 0.0), vel_ned_mps=(-9e9, 0.0, 0.0), state=FlightState.RELEASED, airborne=True)
    assert not other.gives_way
    (bound,) = OPEN.separations(around(neighbours=(other,)))
    room_m = 8.0 - OPEN.hard_separation_m - MARGIN_M
    assert bound.most_mps == pytest.approx(OPEN.response.closing_mps(room_m) - OPEN.speed_max_mps)  # none is faster


@pytest.mark.parametrize("gives_way", [True, False])
@pytest.mark.parametrize("error_m", [3.0, 50.0])
def test_one_that_may_be_off_itself_closes_on_others_by_as_much_less_and_is_pushed_by_none(
    gives_way: bool, error_m: float
) -> None:
    state = FlightState.TRANSIT if gives_way else FlightState.RELEASED
    counts_m = min(error_m, ERROR_COUNTS_M)
    for distance_m in (OPEN.hard_separation_m + 0.5, 9.0, 40.0):
        other = neighbour(2, (distance_m, 0.0, 0.0), state=state, airborne=True)
        (sure,) = OPEN.separations(around(neighbours=(other,)))
        (unsure,) = OPEN.separations(around(neighbours=(other,), error_m=error_m))
        room_m = distance_m - OPEN.hard_separation_m - MARGIN_M - counts_m
        assert unsure.most_mps == pytest.approx(min(sure.most_mps, max(0.0, OPEN.response.closing_mps(room_m))))
        if room_m < 0.0:
            assert unsure.most_mps == 0.0 < sure.most_mps


def test_one_that_may_be_off_itself_comes_no_nearer_to_the_fence_and_is_not_driven_from_it() -> None:
    fenced = replace(OPEN, polygon_m=((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)))
    for north_m, most_mps in ((12.0, fenced.response.closing_mps(8.0 - MARGIN_M - 3.0)), (18.0, 0.0)):
        bounds = fenced.limits((north_m, 0.0, -8.0), (), unsure_m=3.0)
        (ahead,) = [b for b in bounds if b.along == (1.0, 0.0, 0.0)]
        assert ahead.most_mps == pytest.approx(most_mps)
    outwards = fenced.apply((2.0, 0.0, 0.0), around_at((18.0, 0.0, -8.0), error_m=3.0), dt_s=0.05)
    assert outwards.vel_ned_mps[0] <= 1e-3
    assert fenced.apply((2.0, 0.0, 0.0), around_at((18.0, 0.0, -8.0)), dt_s=0.05).vel_ned_mps[0] > 0.05


def around_at(pos_ned_m: Vec3, error_m: float = 0.0) -> Surroundings:
    return Surroundings(Position(pos_ned_m, ZERO), (), {}, LocalObstacleCloud(math.inf, (False,)), error_m=error_m)


def test_a_velocity_that_is_no_number_is_taken_for_none() -> None:
    for vel in (math.nan, math.inf):
        other = neighbour(2, (8.0, 0.0, 0.0), vel_ned_mps=(vel, 0.0, 0.0), state=FlightState.RELEASED, airborne=True)
        (bound,) = OPEN.separations(around(neighbours=(other,)))
        room_m = 8.0 - OPEN.hard_separation_m - MARGIN_M
        assert bound.most_mps == pytest.approx(OPEN.response.closing_mps(room_m))


def test_setpoint_before_is_shortened_as_far_as_the_bounds_demand_and_then_goes_a_step() -> None:
    ahead = Bound((1.0, 0.0, 0.0), 1.5)
    assert step_towards(ZERO, (3.0, 0.0, 0.0), [ahead], 0.1) == pytest.approx((1.4, 0.0, 0.0))
    assert step_towards((3.0, 0.0, 0.0), (3.0, 0.0, 0.0), [ahead], 0.1) == pytest.approx((3.0, 0.0, 0.0))
    away = Bound((1.0, 0.0, 0.0), -1.0)
    assert step_towards((0.0, 1.0, 0.0), (3.0, 0.0, 0.0), [away], 0.1) == pytest.approx((0.0, 0.1, 0.0))
    both = [ahead, Bound((0.0, 1.0, 0.0), 0.5)]
    assert step_towards(ZERO, (3.0, 2.0, 0.0), both, 0.0) == pytest.approx((0.75, 0.5, 0.0))


def test_fence_and_trunks_go_by_where_the_mission_has_the_vehicle() -> None:
    cloud = LocalObstacleCloud(math.inf, (False,))
    off = Surroundings(OWN, (), {}, cloud, off_ned_m=(1.0, 2.0, 3.0))
    assert (off.placed.pos_ned_m, off.placed.vel_ned_mps) == ((1.0, 2.0, -5.0), OWN.vel_ned_mps)
    assert off.own is OWN
    assert Surroundings(OWN, (), {}, cloud).placed is OWN


def test_where_a_limit_pushes_all_separations_give_as_little_as_can_be() -> None:
    limits = [Bound((-1.0, 0.0, 0.0), -0.3)]
    separations = [Bound((1.0, 0.0, 0.0), 0.1), Bound((0.0, 1.0, 0.0), -1.0)]
    assert find_nearest(ZERO, limits, separations) == pytest.approx((0.3, -0.8, 0.0), abs=0.04)


def test_in_a_sharp_corner_without_anybody_it_rests() -> None:
    """No pass over the bounds gets out of it, and nobody is there to give way."""
    sharp = [Bound((1.0, 0.0, 0.0), 0.0), Bound((-math.cos(0.1), math.sin(0.1), 0.0), 0.0)]
    assert find_nearest((1.0, 10.0, 0.0), sharp, []) == ZERO


@pytest.mark.parametrize(("off_m", "pull_mps"), [(0.1, 0.0), (0.4, PULL_PER_S * (0.4 - SLACK_M)), (1.4, PULL_MAX_MPS)])
def test_rest_pulls_back_in_proportion_to_what_it_is_off(off_m: float, pull_mps: float) -> None:
    rest = RestHold()
    rest.hold(Position((5.0, 7.0, -8.0), ZERO, None), ZERO, 1.0)
    off = Position((5.0 + 0.6 * off_m, 7.0 - 0.8 * off_m, -8.0), ZERO, None)
    assert rest.hold(off, ZERO, 1.1) == pytest.approx((-0.6 * pull_mps, 0.8 * pull_mps, 0.0))


def test_room_to_land_is_what_it_says() -> None:
    for nearest_m, has in ((LANDING_ROOM_M, True), (LANDING_ROOM_M - 0.01, False)):
        assert LandingRoom(mission()).is_clear([], {}, nearest_m, 1.0) is has


@pytest.mark.parametrize(
    ("to_fence_m", "vel_north_mps", "stops"), [(12.8, 3.0, True), (13.0, 3.0, False), (13.0, 3.1, True)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_ahead_that_the_fence_stops_is_followed_as_one_that_may_stop_at_once(
    to_fence_m: float, vel_north_mps: float, stops: bool, sign: float
) -> None:
    """A usurper led a swarm at full speed against its fence: those behind came to 3.31 m of those that it stopped."""
    own = Position((0.0, 0.0, -8.0), (4.0, 0.0, 0.0), None)
    fenced = replace(OPEN, polygon_m=((to_fence_m, -300.0), (to_fence_m, 300.0), (-300.0, 300.0), (-300.0, -300.0)))
    other = neighbour(2, (8.0, 0.0, 0.0), vel_ned_mps=(sign * vel_north_mps, 0.0, 0.0))
    there = Surroundings(own, (other,), {}, LocalObstacleCloud(math.inf, (False,)))
    (bound,) = fenced.separations(there)
    (free,) = OPEN.separations(there)
    behind_mps = fenced.response.behind_mps(8.0 - fenced.hard_separation_m - MARGIN_M, vel_north_mps)
    assert behind_mps < free.most_mps or sign < 0.0
    assert bound.most_mps == pytest.approx(behind_mps if stops and sign > 0.0 else free.most_mps)
    outside = replace(fenced, polygon_m=tuple((n - 400.0, e) for n, e in fenced.polygon_m))
    (beyond,) = outside.separations(there)
    assert beyond.most_mps == free.most_mps


def test_speed_from_which_it_stops_within_a_way_is_stopped_in_that_way() -> None:
    for speed_mps in (0.0, 0.5, 3.0, 5.0):
        assert OPEN.response.closing_mps(OPEN.response.stopping_m(speed_mps)) == pytest.approx(speed_mps)
