"""Round a wall by the search over all that was seen, before a side is taken."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.search.detour import LONGER_M, SEARCH_S, Detour
from companion.core.guidance.search.known_places import NOTHING
from companion.core.guidance.search.path_search import find_way
from companion.core.guidance.sensing_planner import SensingPlanner
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, scale
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, Obstacle, ObstacleKind
from companion.core.perception.obstacle_memory import ObstacleMemory, SeenBefore
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from tests.unit.core.core_kit import mission

CLEAR_M = 0.65
NORTH = (3.0, 0.0)
HERE = (0.0, 0.0)
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


def wall(left_m: float, right_m: float, north_m: float = 8.0) -> SeenBefore:
    """Across the way, from so far left to so far right."""
    easts = [-left_m + 0.25 * k for k in range(round((left_m + right_m) / 0.25) + 1)]
    return SeenBefore([north_m] * len(easts), easts, HERE, CLEAR_M)


def lead(detour: Detour, seen: SeenBefore, reach_m: float = 40.0) -> tuple[float, float]:
    return detour.lead(NORTH, HERE, reach_m, SEARCH_S, seen, NOTHING)


def test_it_flies_as_desired_where_nothing_or_a_trunk_is_in_the_way() -> None:
    detour = Detour(0.25)
    for seen in (SeenBefore([], [], HERE, CLEAR_M), wall(0.2, 0.2)):
        assert lead(detour, seen) == NORTH


def test_a_leader_that_is_there_and_pushed_looks_for_no_way() -> None:
    """By what it has gone too far: to a place behind it."""
    assert lead(Detour(0.25), wall(12.0, 6.0, -3.0), reach_m=-6.0) == NORTH


@pytest.mark.parametrize(("left_m", "right_m", "side"), [(12.0, 6.0, 1.0), (6.0, 12.0, -1.0)])
def test_before_a_wall_it_goes_to_the_end_that_is_nearer_as_fast_as_desired(
    left_m: float, right_m: float, side: float
) -> None:
    detour = Detour(0.25)
    north, east = lead(detour, wall(left_m, right_m))
    assert side * east > 1.0
    assert math.hypot(north, east) == pytest.approx(3.0)


def test_it_keeps_its_side_unless_the_other_is_clearly_shorter() -> None:
    detour = Detour(0.25)
    assert lead(detour, wall(7.0, 6.0))[1] > 1.0
    assert lead(detour, wall(7.0, 7.5))[1] > 1.0  # another metre of it was seen
    assert lead(detour, wall(7.0, 16.0))[1] < -1.0
    assert lead(detour, wall(7.0, 6.5))[1] < -1.0


def test_it_ends_behind_the_wall_and_with_the_desire() -> None:
    detour = Detour(0.25)
    lead(detour, wall(12.0, 6.0))
    assert lead(detour, wall(12.0, 6.0, north_m=-3.0)) == NORTH
    lead(detour, wall(12.0, 6.0))
    assert detour.lead((0.1, 0.0), HERE, 40.0, 0.1, wall(12.0, 6.0), NOTHING) == (0.1, 0.0)


def test_a_target_beyond_the_grid_counts_for_the_way() -> None:
    """The end that is nearer on the way to 20 m is not the one on the way to 60 m, farther off the line."""
    way = find_way(wall(9.0, 9.0), (0.0, 60.0), ahead_m=12.0)
    assert way is not None
    assert way.longer_m == pytest.approx(0.0, abs=1e-9)
    across = find_way(wall(20.0, 9.0), (60.0, 0.0), ahead_m=12.0)
    assert across is not None
    assert across.longer_m > LONGER_M
    assert across.aim[1] > 0.0


def test_those_that_hover_are_no_detour() -> None:
    """Four side by side, 20 m wide: courses pass them, at the speed that they lead by; trunks there are one."""
    flown = mission(sensing={"range_m": 12.0})
    assert flown.sensing is not None
    for kind, is_flown in ((ObstacleKind.HOVERING, False), (ObstacleKind.TRUNK, True)):
        planner = SensingPlanner(flown, flown.sensing, SafetyFilter.of(flown))
        barring = [Obstacle(kind, (12.0, -8.0 + 5.0 * k, 0.0), 5.0) for k in range(4)]
        known = {"trunks" if kind is ObstacleKind.TRUNK else "hovering": barring}
        seen = SeenBefore([], [], HERE, CLEAR_M)
        cloud = LocalObstacleCloud(11.35, [False] * 72, sensor_m=12.0, seen_before=seen, **known)
        around = Surroundings(Position((0.0, 0.0, -8.0), ZERO), (), {}, cloud, commanded_ned_mps=ZERO)
        planner._reach_m = 40.0
        planner.plan(GuidanceInput(around, **LEADING), (3.0, 0.0, 0.0), 0.05)
        assert (planner._detour._aim is not None) is is_flown


def test_point_mass_goes_round_a_wall_without_turning_back_along_it() -> None:
    """A wall of 21 m, 5 m from whose nearer end it comes: courses took the other side first, and flew 33 % too far."""
    flown = mission(sensing={"range_m": 12.0})
    assert flown.sensing is not None
    trunks = [(15.0, -5.0 + 0.25 * k) for k in range(85)]
    safety_filter, memory = SafetyFilter.of(flown), ObstacleMemory()
    planner, pos, vel, last = SensingPlanner(flown, flown.sensing, safety_filter), (0.0, 0.0, -8.0), ZERO, ZERO
    goal_n, goal_e, flown_m = 45.0, 3.0, 0.0
    for k in range(1200):
        near = [(n - pos[0], e - pos[1]) for n, e in trunks if math.hypot(n - pos[0], e - pos[1]) < 12.0]
        norths, easts = [n for n, _ in near], [e for _, e in near]
        memory.note_points(norths, easts, pos, [False] * 72, 12.0, 0.05 * k)
        cloud = LocalObstacleCloud(11.35, [False] * 72, sensor_m=12.0, seen_before=memory.seen_before(pos, CLEAR_M))
        cloud.add_points(norths, easts, CLEAR_M)
        to_n, to_e = goal_n - pos[0], goal_e - pos[1]
        away_m = math.hypot(to_n, to_e)
        if away_m < 3.5:
            break
        around = Surroundings(Position(pos, vel), (), {}, cloud, commanded_ned_mps=last)
        planner._reach_m = away_m
        course = planner.plan(GuidanceInput(around, **LEADING), scale((to_n, to_e, 0.0), 3.0 / away_m), 0.05)
        last = safety_filter.apply(course, around, dt_s=0.05).vel_ned_mps
        vel = add(vel, scale(add(last, scale(vel, -1.0)), -math.expm1(-0.05 / 0.3)))
        pos = add(pos, scale(vel, 0.05))
        flown_m += 0.05 * math.hypot(vel[0], vel[1])
    shortest_m = math.hypot(15.0, 5.0 + CLEAR_M) + math.hypot(30.0, 8.0 + CLEAR_M) - 3.5
    assert math.hypot(goal_n - pos[0], goal_e - pos[1]) < 3.5
    assert flown_m < 1.2 * shortest_m
