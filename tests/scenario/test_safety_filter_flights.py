"""The safety filter in flight: whom it lets come how close, and how near to what is forbidden."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, limit, scale, sub
from companion.core.perception.obstacle_cloud import Trunk
from companion.core.safety.bounds import is_inside
from companion.core.safety.clearance import MARGIN_M, SILENT_STRAY_M
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from mission.common.plane import clearance_m
from tests.unit.core.core_kit import mission
from tests.unit.core.core_plant import Plant, Wish, fly, towards
from tests.unit.core.core_promises import POLYGONS

OPEN = SafetyFilter.of(mission())
HARD_M, KEEP_M = OPEN.hard_separation_m, mission().coverage.keep_out_m
OVERSHOOT_M = 0.06  # of two vehicles with the plant's lag and delay into the distance that they close to


@pytest.mark.parametrize("offset_m", [0.0, 0.3, 1.0, 2.5])
@pytest.mark.parametrize("height_m", [0.0, 2.0])
@pytest.mark.parametrize("start_m", [30.0])
def test_head_on_at_full_speed_no_one_comes_nearer_than_the_hard_distance(
    offset_m: float, height_m: float, start_m: float
) -> None:
    one = Plant(OPEN, (0.0, 0.0, -10.0), towards((5.0, 0.0, 0.0)))
    other = Plant(OPEN, (start_m, offset_m, -10.0 - height_m), towards((-5.0, 0.0, 0.0)))
    assert fly([one, other], 15.0) >= HARD_M - OVERSHOOT_M


def test_one_above_the_other_at_full_climb_and_descent_no_one_comes_nearer() -> None:
    low = Plant(OPEN, (0.0, 0.0, -8.0), towards((0.0, 0.0, -1.5)))
    high = Plant(OPEN, (0.5, 0.0, -20.0), towards((0.0, 0.0, 1.5)))
    assert fly([low, high], 15.0) >= HARD_M - OVERSHOOT_M


@pytest.mark.parametrize("n", [3, 5, 8])
def test_swarm_that_all_wants_to_the_same_point_keeps_apart(n: int) -> None:
    rng = random.Random(n)
    goal = (0.0, 0.0, -10.0)

    def home(pos: Vec3, _now_s: float) -> Vec3:
        return limit(sub(goal, pos), 5.0)

    turns = [math.tau * k / n for k in range(n)]
    swarm = [Plant(OPEN, (25 * math.cos(t), 25 * math.sin(t), -10.0 + rng.uniform(-2, 2)), home) for t in turns]
    assert fly(swarm, 12.0) >= HARD_M - OVERSHOOT_M


def test_vehicle_that_fell_silent_is_passed_at_the_hard_distance() -> None:
    one = Plant(OPEN, (0.0, 0.0, -10.0), towards((5.0, 0.0, 0.0)))
    one.hear(2, (20.0, 0.3, -10.0), ZERO, -1.0, -1.0)
    least_m = math.inf

    def note() -> None:
        nonlocal least_m
        least_m = min(least_m, math.dist(one.pos_ned_m, (20.0, 0.3, -10.0)))

    fly([one], 20.0, after=note)
    assert least_m == pytest.approx(HARD_M + MARGIN_M + SILENT_STRAY_M, abs=0.1)
    assert least_m >= HARD_M - OVERSHOOT_M


def restless(rng: random.Random) -> Wish:
    """Full speed in a direction that changes every three seconds."""
    turns = [math.tau * rng.random() for _ in range(20)]
    return lambda _pos, now_s: (5 * math.cos(turns[int(now_s // 3)]), 5 * math.sin(turns[int(now_s // 3)]), 0.0)


def always_inside(one: Plant, polygon: tuple[tuple[float, float], ...], seconds: float) -> bool:
    inside: list[bool] = []
    fly([one], seconds, after=lambda: inside.append(is_inside(one.pos_ned_m[0], one.pos_ned_m[1], polygon)))
    return all(inside)


@pytest.mark.parametrize("shape", ["square", "triangle", "hexagon", "L"])
@pytest.mark.parametrize("seed", range(2))
def test_vehicle_that_wants_out_of_the_fence_stops_before_it(shape: str, seed: int) -> None:
    safety_filter = replace(OPEN, polygon_m=POLYGONS[shape])
    one = Plant(safety_filter, (-12.0, 0.0, -10.0), restless(random.Random(seed)))
    assert always_inside(one, safety_filter.polygon_m, 24.0)


@pytest.mark.parametrize("half_deg", [10.0, 25.0, 45.0])
@pytest.mark.parametrize("aside_mps", [0.0, 1.0])
def test_vehicle_that_wants_out_at_a_sharp_corner_stops_before_it(half_deg: float, aside_mps: float) -> None:
    rise_m = 60.0 * math.tan(math.radians(half_deg))
    wedge = ((0.0, 0.0), (60.0, rise_m), (60.0, -rise_m))
    one = Plant(replace(OPEN, polygon_m=wedge), (50.0, 0.0, -8.0), towards((-4.8, aside_mps, 0.0)))
    assert always_inside(one, wedge, 30.0)


@pytest.mark.parametrize(("wanted_down", "limit_m"), [(-1.5, OPEN.altitude_max_m), (1.5, OPEN.altitude_min_m)])
def test_vehicle_that_wants_past_an_altitude_limit_stops_before_it(wanted_down: float, limit_m: float) -> None:
    one = Plant(OPEN, (0.0, 0.0, -10.0), towards((1.0, 0.0, wanted_down)))
    beyond: list[float] = []
    fly([one], 25.0, after=lambda: beyond.append((-one.pos_ned_m[2] - limit_m) * math.copysign(1.0, -wanted_down)))
    assert max(beyond) <= 0.0
    assert beyond[-1] == pytest.approx(-MARGIN_M, abs=0.05)


@pytest.mark.parametrize("offset_m", [0.0, 0.01, 0.7, 1.9])
def test_vehicle_that_wants_into_the_trunk_stops_before_it(offset_m: float) -> None:
    trunk = Trunk((30.0, 0.0, -3.0), KEEP_M, upright=True)
    one = Plant(OPEN, (0.0, offset_m, -10.0), towards((5.0, 0.0, 0.0)), trunks=[trunk])
    least_m = math.inf

    def note() -> None:
        nonlocal least_m
        least_m = min(least_m, math.hypot(one.pos_ned_m[0] - 30.0, one.pos_ned_m[1]))

    fly([one], 15.0, after=note)
    assert least_m >= KEEP_M


@pytest.mark.parametrize("start", [(60.0, 0.0), (31.0, -31.0), (-35.0, 90.0)])
def test_vehicle_outside_the_fence_comes_back_to_it(start: tuple[float, float]) -> None:
    safety_filter = replace(OPEN, polygon_m=POLYGONS["square"])
    one = Plant(safety_filter, (*start, -10.0), towards((start[0], start[1], 0.0)))
    fly([one], 40.0)
    assert is_inside(one.pos_ned_m[0], one.pos_ned_m[1], safety_filter.polygon_m)


def test_vehicle_below_the_least_altitude_climbs_into_the_fence() -> None:
    one = Plant(OPEN, (0.0, 0.0, -0.3), towards(ZERO))
    fly([one], 15.0)
    assert -one.pos_ned_m[2] == pytest.approx(OPEN.altitude_min_m + MARGIN_M, abs=0.05)


# --- members that push, lie or haunt ---


@pytest.mark.parametrize("bias_mps", [0.0, 0.4])
@pytest.mark.parametrize("shape", ["square", "triangle", "hexagon", "L"])
def test_member_that_pushes_beside_it_moves_nobody_out_of_the_fence(shape: str, bias_mps: float) -> None:
    """It claims to fly at full speed, three metres behind, whatever way the fence is."""
    safety_filter = replace(OPEN, polygon_m=POLYGONS[shape])
    for turn in range(8):
        n = (math.cos(math.tau * turn / 8), math.sin(math.tau * turn / 8), 0.0)
        one = Plant(safety_filter, (-12.0, 0.0, -10.0), towards(ZERO), bias_ned_mps=scale(n, -bias_mps))
        farthest_m = -math.inf
        for tick in range(600):
            now_s = 0.05 * tick
            if tick % 2 == 0:
                one.hear(2, sub(one.pos_ned_m, scale(n, 3.0)), scale(n, 5.0), now_s, now_s)
            one.step(now_s)
            out_m = -clearance_m(one.pos_ned_m[:2], safety_filter.polygon_m)
            farthest_m = max(farthest_m, out_m)
        assert farthest_m <= 0.1
        assert clearance_m(one.pos_ned_m[:2], safety_filter.polygon_m) < 3.0  # it was pushed there


@pytest.mark.parametrize("out_m", [0.01, 0.5])
def test_member_that_pushes_carries_nobody_further_out_who_is_outside(out_m: float) -> None:
    safety_filter = replace(OPEN, polygon_m=POLYGONS["square"])
    one = Plant(safety_filter, (30.0 + out_m, 0.0, -10.0), towards((5.0, 0.0, 0.0)))
    for tick in range(600):
        if tick % 2 == 0:
            one.hear(2, sub(one.pos_ned_m, (3.0, 0.0, 0.0)), (5.0, 0.0, 0.0), 0.05 * tick, 0.05 * tick)
        one.step(0.05 * tick)
        assert one.pos_ned_m[0] <= 30.0 + out_m + 0.05
    assert one.pos_ned_m[0] <= 30.0


@pytest.mark.parametrize("state", [FlightState.RELEASED, FlightState.WAITING])
def test_one_that_hovers_with_its_pilot_is_passed_at_the_hard_distance(state: FlightState) -> None:
    one = Plant(OPEN, (0.0, 0.0, -10.0), towards((5.0, 0.0, 0.0)))
    one.hears = state
    least_m = math.inf
    for tick in range(400):
        if tick % 2 == 0:
            one.hear(2, (25.0, 0.3, -10.0), ZERO, 0.05 * tick, 0.05 * tick)
        one.step(0.05 * tick)
        least_m = min(least_m, math.dist(one.pos_ned_m, (25.0, 0.3, -10.0)))
    assert least_m >= HARD_M


@pytest.mark.parametrize("bias_mps", [0.2, 0.4])
def test_pair_whose_velocities_lie_keeps_its_distance(bias_mps: float) -> None:
    """Each is told that it stands while it drifts towards the other."""
    one = Plant(OPEN, (0.0, 0.0, -10.0), towards(ZERO), bias_ned_mps=(-bias_mps, 0.0, 0.0))
    other = Plant(OPEN, (6.5, 0.0, -10.0), towards(ZERO), bias_ned_mps=(bias_mps, 0.0, 0.0))
    assert fly([one, other], 60.0) >= HARD_M


def test_pushing_down_moves_nobody_through_the_floor() -> None:
    one = Plant(OPEN, (0.0, 0.0, -4.0), towards(ZERO))
    lowest_m = math.inf
    for tick in range(600):
        if tick % 2 == 0:
            one.hear(2, sub(one.pos_ned_m, (0.0, 0.0, 2.0)), (0.0, 0.0, 1.5), 0.05 * tick, 0.05 * tick)
        one.step(0.05 * tick)
        lowest_m = min(lowest_m, -one.pos_ned_m[2])
    assert OPEN.altitude_min_m - 0.1 <= lowest_m < 3.0
