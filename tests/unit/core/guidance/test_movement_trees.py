"""A vehicle with an obstacle sensor: where it looks, what it goes round beside what it sees, and what gusts change."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.guidance.course_planner import HOLD_S, SPEED_WIDENS, SPEEDS, CoursePlanner
from companion.core.guidance.dead_end_recovery import DESIRED_LEAST_MPS
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.sensing_planner import HASTE, UNHEARD_MPS, SensingPlanner
from companion.core.model.beacon import PeerReport
from companion.core.model.events import ObstacleScan, Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, limit, scale, sub
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.disturbance import DisturbanceEstimator
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_steered import Steered

SECTORS, RANGE_M, CLEAR_M = 72, 8.0, 0.65
EAST = (0.0, 3.0, 0.0)
DT_S = 0.05


@pytest.fixture
def _gusty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DisturbanceEstimator, "change_mps", property(lambda _: 0.5))


def scan(hits: dict[int, float]) -> ObstacleScan:
    ranges = [hits.get(k, math.inf) for k in range(SECTORS)]
    return ObstacleScan(0, tuple(ranges), 0.0, math.tau / SECTORS, 0.2, RANGE_M)


def flown(
    *,
    at: Vec3 = (0.0, 40.0, -8.0),
    vel: Vec3 = EAST,
    hits: dict[int, float] | None = None,
    ticks: int = 20,
    sensing: dict[str, Any] | None = None,
    neighbours: Sequence[Neighbour] = (),
    standing: Mapping[int, PeerReport] | None = None,
    layers: bool = False,
    **changes: Any,
) -> Steered:
    """A leader bound east that stays where it is while it steers, and flies as it is told from `vel` on."""
    steered = Steered(mission(sensing=sensing or {}, separation={"height_layers": layers}), 1)
    steered.setpoint_ned_mps = vel
    for k in range(ticks):
        own = Position(at, vel)
        steered.integrate_scan(scan(hits or {}), own, DT_S * k)
        known: dict[str, Any] = {
            "state": FlightState.TRANSIT,
            "phase": SwarmPhase.TRANSIT,
            "route": formation.LEADER_ROUTE,
            "range_m": 30.0,
            "role": Role.LEADER,
            "governor": 1.0,
            "lease_freshness": 1.0,
            "goal": ((0.0, 130.0, -8.0), 4.0),
            "size": 8,
        }
        around = steered.observe(own, DT_S * k, neighbours, standing)
        commanded = steered.steer(around, **known | changes)
        vel = add(vel, limit(scale(sub(commanded, vel), -math.expm1(-DT_S / 0.3)), 3.0 * DT_S))
    return steered


@pytest.mark.parametrize(("view_deg", "yaw_rad"), [(120.0, math.pi), (360.0, 0.0)])
def test_with_a_narrow_view_it_faces_where_it_makes_room_to(view_deg: float, yaw_rad: float) -> None:
    pusher = neighbour(2, (3.0, 0.0, 0.0))
    movement = flown(vel=ZERO, state=FlightState.HOLD, neighbours=[pusher], sensing={"field_of_view_deg": view_deg})
    assert abs(movement.yaw_rad) == pytest.approx(yaw_rad, abs=0.05)


def test_plans_go_round_the_missions_trunk_and_those_that_hang_still_though_no_scan_shows_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planned: list[LocalObstacleCloud] = []
    plan = CoursePlanner.plan

    def watched(planner: CoursePlanner, wish: Any, vel: Any, last: Any, cloud: Any, *given: Any, **named: Any) -> Any:
        planned.append(cloud)
        return plan(planner, wish, vel, last, cloud, *given, **named)

    monkeypatch.setattr(CoursePlanner, "plan", watched)
    apart = mission().separation
    flown(standing={3: PeerReport(3, (1.0, 9.0, 0.3), 20.0, silent=True)}, ticks=1)
    (points,) = planned
    around = {(n, e): clear_m for n, e, clear_m in zip(points.norths, points.easts, points.clears_m, strict=True)}
    assert around[(1.0, 9.0)] > apart.hard_m + 0.5
    assert around[(0.0, 90.0)] > mission().coverage.keep_out_m  # d2 is at 130 m
    assert len(around) == 2


@pytest.mark.parametrize("received", [True, False])
def test_a_place_that_others_tell_pushes_nobody_who_stands(received: bool) -> None:
    """One word after the other would push it anywhere; what it lost itself it keeps clear of."""
    near = PeerReport(3, (1.0, 0.0, 0.0), 20.0, silent=True, received=received)
    orders = {"state": FlightState.HOLD, "role": Role.FOLLOWER, "route": formation.NOWHERE, "goal": None}
    north_mps, east_mps, _ = flown(vel=ZERO, standing={3: near}, **orders).setpoint_ned_mps
    if received:
        assert (north_mps, east_mps) == (0.0, 0.0)
    else:
        assert north_mps < -0.3


def test_one_that_has_just_fallen_silent_holds_nobody_among_trees() -> None:
    """Hidden for a moment: each of these would stop the swarm."""
    silent = PeerReport(3, (25.0, 0.0, 0.0), 1.0, silent=True)
    assert flown(standing={3: silent}).setpoint_ned_mps[1] > 2.5


@pytest.mark.parametrize(("age_s", "is_slower"), [(1.0, False), (5.0, True), (14.0, True), (20.0, False)])
def test_who_misses_one_that_may_be_on_its_way_flies_no_faster_than_two_see_one_another(
    age_s: float, is_slower: bool
) -> None:
    """At 3 m/s each they know of one another too late: `python -m tests.bench encounters`."""
    silent = PeerReport(3, (25.0, -20.0, 0.0), age_s, silent=True)
    speed_mps = flown(standing={3: silent}, ticks=40).setpoint_ned_mps[1]
    assert (speed_mps <= UNHEARD_MPS + 1e-6) is is_slower


@pytest.mark.parametrize("state", [FlightState.TRANSIT, FlightState.SEEKING])
def test_who_looks_for_others_in_a_layer_flies_no_faster_than_two_see_one_another(state: FlightState) -> None:
    """Another part without the majority may look for others there, too."""
    speed_mps = flown(layers=True, state=state, ticks=40).setpoint_ned_mps[1]
    assert (speed_mps <= UNHEARD_MPS + 1e-6) is (state is FlightState.SEEKING)


@pytest.mark.parametrize("away_m", [5.8, 6.5, 7.2, 7.9])
def test_a_follower_with_a_silent_vehicle_before_it_wishes_on_so_that_it_looks_for_a_way_round(
    away_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its leader waits for it, 29 m ahead."""
    wished: list[Vec3] = []
    plan = SensingPlanner.plan

    def watched(planner: SensingPlanner, now: GuidanceInput, desired: Vec3, dt_s: float) -> Vec3:
        wished.append(desired)
        return plan(planner, now, desired, dt_s)

    monkeypatch.setattr(SensingPlanner, "plan", watched)
    waiting = formation.Route(2.0, 2, 29.0, (neighbour(2, (0.0, 29.0, 0.0)),))
    silent = {3: PeerReport(3, (0.4, away_m, 0.0), 20.0, silent=True)}
    flown(vel=ZERO, role=Role.FOLLOWER, route=waiting, standing=silent, ticks=1)
    assert wished[0][1] > DESIRED_LEAST_MPS


def test_what_stands_behind_the_goal_is_not_in_the_way() -> None:
    # The goal is 5 m ahead, and the leader comes to rest 4 m before it; a trunk stands beside it.
    trunk = {18: 3.2}
    slow = (0.0, 0.8, 0.0)
    near = flown(vel=slow, hits=trunk, goal=((0.0, 45.0, -8.0), 4.0), ticks=6)
    assert near.setpoint_ned_mps[0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.usefixtures("_gusty")
def test_in_gusts_the_swarm_flies_slower() -> None:
    pulled = formation.Route(2.0, 2, 29.0, (neighbour(2, (0.0, 29.0, 0.0), ref_ned_mps=(0.0, 3.0, 0.0)),))
    follower = flown(role=Role.FOLLOWER, route=pulled, goal=None, ticks=60)
    assert follower.setpoint_ned_mps[1] <= (HASTE - 0.5) * 3.0 + 1e-6


@pytest.mark.usefixtures("_gusty")
def test_in_gusts_more_is_kept_clear_in_passing_in_staying_and_before_a_stop() -> None:
    gusty = mission(sensing={})
    assert gusty.sensing is not None
    planner = SensingPlanner(gusty, gusty.sensing, SafetyFilter.of(gusty))
    steered, own = Steered(gusty, 1), Position((0.0, 0.0, -8.0), ZERO)
    steered.integrate_scan(scan({0: 0.8}), own, 0.0)
    assert planner.clear_m == pytest.approx(CLEAR_M)
    around = steered.observe(own, 0.0)
    back = planner.plan(holding(around), ZERO, DT_S)
    assert planner.wider_m > 0.1
    assert planner.clear_m > CLEAR_M + 0.05
    assert around.disturbance.gust_mps > 0.1
    assert back[0] < -0.01  # away from what it is near enough to


def holding(around: Surroundings) -> GuidanceInput:
    return GuidanceInput(
        around,
        state=FlightState.HOLD,
        phase=SwarmPhase.TRANSIT,
        route=formation.NOWHERE,
        range_m=30.0,
        role=Role.FOLLOWER,
        governor=1.0,
        lease_freshness=1.0,
        goal=None,
        size=8,
    )


def test_course_is_planned_ten_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    planned = 0
    plan = CoursePlanner.plan

    def counted(*given: Any, **named: Any) -> Any:
        nonlocal planned
        planned += 1
        return plan(*given, **named)

    monkeypatch.setattr(CoursePlanner, "plan", counted)
    flown(ticks=40)
    assert planned == 20


def test_each_speed_is_planned_only_where_its_share_of_the_room_for_gusts_is_kept() -> None:
    rng, stopping, wider_m, planned = random.Random(0), SafetyFilter.of(mission()).response, 0.5, 0
    vel = (1.5, 0.0)
    for _ in range(60):
        trunks = [(rng.uniform(-2.0, 7.0), rng.uniform(-4.0, 4.0)) for _ in range(6)]
        trunks = [(n, e) for n, e in trunks if math.hypot(n, e) > CLEAR_M + wider_m]
        points = LocalObstacleCloud(7.35, [False] * SECTORS)
        points.add_points([n for n, _ in trunks], [e for _, e in trunks], CLEAR_M)
        course = CoursePlanner(stopping).plan((3.0, 0.0), vel, vel, points, [], wider_m=wider_m, reach_m=math.inf)
        if course is None:
            continue
        planned += 1
        widens = {round(3.0 * speed, 6): widens for speed, widens in zip(SPEEDS, SPEED_WIDENS, strict=True)}
        wide = points.widened(wider_m * widens[round(math.hypot(*course), 6)])
        assert stopping.is_clear(wide, vel, vel, course, HOLD_S, slews=True)
    assert planned > 40


def test_to_a_position_beside_one_that_is_stranded_no_course_leads_off_the_ring() -> None:
    """The position is 6.3 m from it, and 3 m ahead: it was led round that one as round what bars the way."""
    radius_m = 15.0

    def on_ring(bearing_deg: float) -> Vec3:
        bearing = math.radians(bearing_deg)
        return radius_m * math.cos(bearing), radius_m * math.sin(bearing), -8.0

    steered = Steered(mission(sensing={}, coverage={"radius_m": radius_m}, swarm={"size": 4}), 1)
    pos, vel, off_m = on_ring(0.0), ZERO, 0.0
    for k in range(400):
        own = Position(pos, vel)
        steered.integrate_scan(scan({}), own, DT_S * k)
        heard = neighbour(2, sub(on_ring(220.0), pos), state=FlightState.COVERAGE, airborne=True)
        stranded = PeerReport(3, sub(on_ring(36.0), pos), 20.0, silent=True)
        commanded = steered.steer(
            steered.observe(own, DT_S * k, [heard], {3: stranded}),
            state=FlightState.COVERAGE,
            phase=SwarmPhase.COVERAGE,
            route=formation.NOWHERE,
            range_m=55.0,
            role=Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=3,
            dest_ned_m=scale((pos[0], pos[1], 0.0), -1.0),
        )
        vel = add(vel, limit(scale(sub(commanded, vel), -math.expm1(-DT_S / 0.3)), 3.0 * DT_S))
        pos = add(pos, scale(vel, DT_S))
        off_m = max(off_m, abs(math.hypot(pos[0], pos[1]) - radius_m))
    assert math.degrees(math.atan2(pos[1], pos[0])) == pytest.approx(11.0, abs=2.0)
    assert off_m < 0.3
