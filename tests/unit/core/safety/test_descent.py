"""Room to land: a vehicle beside a trunk first moves off it, and does not wait for ever."""

from __future__ import annotations

import math

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.sensing_planner import SensingPlanner
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, scale
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.descent import AGAIN_S, LANDING_ROOM_M, ROOM_LIMIT_S, TOLD_LIMIT_S, LandingRoom
from companion.core.safety.safety_filter import SafetyFilter
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import surroundings

DT_S = 0.05


def test_it_lands_at_once_where_there_is_room_and_else_after_a_while() -> None:
    room = LandingRoom(mission())
    assert room.is_clear((), {}, math.inf, 10.0)
    assert not room.is_clear((), {}, LANDING_ROOM_M - 0.1, 10.1)
    assert room.is_clear((), {}, LANDING_ROOM_M + 0.1, 10.2)
    for k in range(round((ROOM_LIMIT_S - 0.5) / DT_S)):
        assert not room.is_clear((), {}, 0.8, 10.2 + k * DT_S)
    assert room.is_clear((), {}, 0.8, 10.0 + ROOM_LIMIT_S)
    assert not room.is_clear((neighbour(2, (1.0, 0.0, -6.0)),), {}, 0.8, 10.05 + ROOM_LIMIT_S)
    assert not room.is_clear((), {}, 0.8, 10.1 + ROOM_LIMIT_S + AGAIN_S + DT_S)  # another landing


def test_a_place_that_others_tell_delays_a_landing_and_one_that_was_lost_here_bars_it() -> None:
    """In the open sky nothing shows that a told place is empty, and it pushes nobody off it."""
    told = {3: PeerReport(3, (1.0, 0.0, 0.0), 20.0, silent=True, received=True)}
    lost = {3: PeerReport(3, (1.0, 0.0, 0.0), 20.0, silent=True, elsewhere=((2.0, 0.0, 0.0),))}
    room = LandingRoom(mission())
    for k in range(round(TOLD_LIMIT_S / DT_S)):
        assert not room.is_clear((), told, math.inf, k * DT_S)
    assert room.is_clear((), told, math.inf, TOLD_LIMIT_S)
    assert not room.is_clear((), lost, math.inf, TOLD_LIMIT_S)


def test_one_that_is_to_land_moves_off_a_trunk_to_where_it_may() -> None:
    flown = mission(sensing={"range_m": 8.0})
    assert flown.sensing is not None
    safety_filter = SafetyFilter.of(flown)
    planner, pos, vel, last = SensingPlanner(flown, flown.sensing, safety_filter), (0.0, 0.0, -8.0), ZERO, ZERO
    trunk = (0.8, 0.0)
    for _ in range(round(ROOM_LIMIT_S / DT_S)):
        points = LocalObstacleCloud(7.35, [False] * 72)
        points.add_points([trunk[0] - pos[0]], [trunk[1] - pos[1]], 0.65)
        around = surroundings(Position(pos, vel), last=last, points=points)
        landing = GuidanceInput(
            around,
            state=FlightState.COVERAGE,
            phase=SwarmPhase.LAND,
            route=formation.LEADER_ROUTE,
            range_m=30.0,
            role=Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=8,
        )
        last = safety_filter.apply(planner.plan(landing, ZERO, DT_S), around, dt_s=DT_S).vel_ned_mps
        vel = add(vel, scale(add(last, scale(vel, -1.0)), -math.expm1(-DT_S / 0.3)))
        pos = add(pos, scale(vel, DT_S))
    assert LANDING_ROOM_M < math.dist(pos[:2], trunk) < LANDING_ROOM_M + 0.5
