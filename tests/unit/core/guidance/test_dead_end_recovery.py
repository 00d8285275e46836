"""Out of dead ends: to one side, then back the own way and to the other."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.guidance.dead_end_recovery import (
    ASIDE_S,
    CRUMB_M,
    CRUMBS_MAX,
    FORGET_M,
    PATIENCE_S,
    DeadEndRecovery,
)
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.sensing_planner import SensingPlanner
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, scale
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.obstacle_memory import ObstacleMemory
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import surroundings

WISH = (3.0, 0.0)
LEADING: dict[str, Any] = {
    "state": FlightState.TRANSIT,
    "phase": SwarmPhase.TRANSIT,
    "route": formation.LEADER_ROUTE,
    "range_m": 30.0,
    "role": Role.LEADER,
    "governor": 1.0,
    "lease_freshness": 1.0,
    "goal": None,
    "size": 8,
}
HERE = (10.0, -4.0)


def wait(
    recovery: DeadEndRecovery, s: float, *, ahead_m: float = 1.0, wish: tuple[float, float] = WISH
) -> tuple[float, float]:
    said = wish
    for _ in range(round(s / 0.1)):
        said = recovery.redirect(wish, HERE, -1, ahead_m, 0.1)
    return said


def test_vehicle_that_is_held_up_before_trunks_commits_itself_to_the_side_it_was_on() -> None:
    recovery = DeadEndRecovery()
    assert wait(recovery, PATIENCE_S - 0.2) == WISH
    north, east = wait(recovery, 0.6)
    assert east < -2.0
    assert math.hypot(north, east) == pytest.approx(3.0)


@pytest.mark.parametrize("changes", [{"ahead_m": 7.0}, {"wish": (0.2, 0.0)}])
def test_one_that_waits_for_others_or_wants_nothing_is_not_stuck(changes: dict[str, float]) -> None:
    recovery = DeadEndRecovery()
    assert wait(recovery, 10.0, **changes) == changes.get("wish", WISH)  # type: ignore[arg-type]


def test_second_time_it_goes_back_the_way_it_came_and_takes_the_other_side() -> None:
    recovery = DeadEndRecovery()
    for k in range(40):  # a bent way to the place
        recovery.redirect(WISH, (HERE[0] - 8.0 + 0.2 * k, HERE[1] + 0.04 * (40 - k)), -1, 9.0, 0.1)
    wait(recovery, PATIENCE_S + 0.2 + ASIDE_S)
    north, _ = wait(recovery, PATIENCE_S + 0.4)
    assert north < 0.0  # back
    pos, east_mps = HERE, 0.0
    for _ in range(100):
        said = recovery.redirect(WISH, pos, -1, 1.0, 0.1)
        if said[0] > 0.0:
            east_mps = said[1]
            break
        pos = (pos[0] + 0.1 * said[0], pos[1] + 0.1 * said[1])
    assert pos[0] < HERE[0] - 3.0
    assert east_mps > 2.0


def test_dead_end_some_metres_on_is_another_one() -> None:
    """It is left to the side that the vehicle is on then, without going back first."""
    recovery = DeadEndRecovery()
    wait(recovery, PATIENCE_S + 0.2 + ASIDE_S)
    for k in range(100):
        recovery.redirect(WISH, (HERE[0] + (FORGET_M + 1.0) * k / 99, HERE[1]), -1, 9.0, 0.1)
    there = (HERE[0] + FORGET_M + 1.0, HERE[1])
    said = WISH
    for _ in range(round((PATIENCE_S + 0.4) / 0.1)):
        said = recovery.redirect(WISH, there, 1, 1.0, 0.1)
    assert said[0] > 0.0
    assert said[1] > 2.0


def test_way_back_is_bounded() -> None:
    recovery = DeadEndRecovery()
    for k in range(3 * CRUMBS_MAX):
        recovery.redirect(WISH, (CRUMB_M * k, 0.0), -1, 9.0, 0.1)
    assert recovery._trail.count == CRUMBS_MAX


def test_point_mass_finds_its_way_out_of_a_dead_end() -> None:
    """A U of trunks, open towards the vehicle, 6 m wide and 5 m deep, which forgets nothing."""
    flown = mission(sensing={"range_m": 8.0})
    assert flown.sensing is not None
    trunks = [(10.0, -3.0 + 0.5 * k) for k in range(13)]
    trunks += [(5.0 + 0.5 * k, side) for k in range(10) for side in (-3.0, 3.0)]
    safety_filter = SafetyFilter.of(flown)
    planner, pos, vel, last = SensingPlanner(flown, flown.sensing, safety_filter), (0.0, 0.0, -8.0), ZERO, ZERO
    nearest_m = math.inf
    for _ in range(1200):
        own = Position(pos, vel)
        near = [(n - pos[0], e - pos[1]) for n, e in trunks if math.hypot(n - pos[0], e - pos[1]) < 9.0]
        points = LocalObstacleCloud(7.35, [False] * 72)
        points.add_points([n for n, _ in near], [e for _, e in near], 0.65)
        goal: Vec3 = (30.0 - pos[0], -pos[1], 0.0)
        away_m = math.hypot(goal[0], goal[1])
        if away_m < 3.0:
            break
        around = surroundings(own, last=last, points=points)
        course = planner.plan(GuidanceInput(around, **LEADING), scale(goal, 3.0 / away_m), 0.05)
        last = safety_filter.apply(course, around, dt_s=0.05).vel_ned_mps
        change = scale(add(last, scale(vel, -1.0)), -math.expm1(-0.05 / 0.3))
        vel = add(vel, change)
        pos = add(pos, scale(vel, 0.05))
        nearest_m = min([nearest_m, *[math.hypot(n - pos[0], e - pos[1]) for n, e in trunks]])
    assert math.hypot(30.0 - pos[0], pos[1]) < 3.5
    assert nearest_m > 0.5


def test_vehicle_does_not_waver_before_a_gap_that_the_search_takes_for_a_way() -> None:
    """A wall 20 m wide, with a gap of 1.7 m: the search has it for a way, the planner passed it by for minutes."""
    flown = mission(sensing={"range_m": 8.0})
    assert flown.sensing is not None
    trunks = [(10.0, side * (0.85 + 0.4 * k)) for k in range(23) for side in (-1.0, 1.0)]
    safety_filter, memory = SafetyFilter.of(flown), ObstacleMemory()
    planner, pos, vel, last = SensingPlanner(flown, flown.sensing, safety_filter), (0.0, 0.0, -8.0), ZERO, ZERO
    for k in range(600):
        near = [(n - pos[0], e - pos[1]) for n, e in trunks if math.hypot(n - pos[0], e - pos[1]) < 8.0]
        norths, easts = [n for n, _ in near], [e for _, e in near]
        memory.note_points(norths, easts, pos, [False] * 72, 8.0, 0.05 * k)
        cloud = LocalObstacleCloud(7.35, [False] * 72, sensor_m=8.0, seen_before=memory.seen_before(pos, 0.65))
        cloud.add_points(norths, easts, 0.65)
        away_m = math.hypot(25.0 - pos[0], pos[1])
        if away_m < 3.5:
            break
        around = Surroundings(Position(pos, vel), (), {}, cloud, commanded_ned_mps=last)
        desired = scale((25.0 - pos[0], -pos[1], 0.0), 3.0 / away_m)
        course = planner.plan(GuidanceInput(around, **LEADING), desired, 0.05)
        last = safety_filter.apply(course, around, dt_s=0.05).vel_ned_mps
        vel = add(vel, scale(add(last, scale(vel, -1.0)), -math.expm1(-0.05 / 0.3)))
        pos = add(pos, scale(vel, 0.05))
    assert math.hypot(25.0 - pos[0], pos[1]) < 3.5  # within half a minute
