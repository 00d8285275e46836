"""The leader among trees: what the others' nearness does to its course."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.guidance.sensing_planner import LEADER_GIVES
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import surroundings

HERE = (0.0, 50.0, -8.0)


def wish(*others_ned_m: Vec3, layer_m: float | None = None) -> Vec3:
    """Of a leader bound east at 3 m/s, with the others there."""
    return Guidance(mission(sensing={}), 1).find_desired(
        GuidanceInput(
            surroundings(Position(HERE, ZERO), [neighbour(k, rel) for k, rel in enumerate(others_ned_m, start=2)]),
            state=FlightState.TRANSIT,
            phase=SwarmPhase.TRANSIT,
            route=formation.LEADER_ROUTE,
            range_m=30.0,
            role=Role.LEADER,
            governor=1.0,
            lease_freshness=1.0,
            goal=((0.0, 130.0, -8.0 if layer_m is None else -20.0), 4.0),
            size=3,
            layer_m=layer_m,
        )
    )


def test_goal_gives_way_to_each_place_where_a_silent_vehicle_may_hover() -> None:
    """Places of which words differ: at the goal it is only the second."""
    guidance, goal = Guidance(mission(), 1), ((0.0, 80.0, -8.0), 0.0)
    silent = PeerReport(2, (40.0, 0.0, 0.0), 20.0, silent=True)
    assert guidance.to_goal_m(HERE, goal, {2: silent}) == pytest.approx(30.0)
    silent = replace(silent, elsewhere=((0.0, 30.0, 0.0),))
    assert abs(guidance.to_goal_m(HERE, goal, {2: silent}) - 30.0) > 1.0


def test_leader_is_not_slowed_by_those_that_fly_ahead_of_it() -> None:
    """All of its swarm may be ahead: what pushes it back then would slow everybody for the whole way."""
    assert wish((0.0, 8.0, 0.0)) == pytest.approx((0.0, 3.0, 0.0))
    assert wish((5.0, 7.0, 0.0))[1] == pytest.approx(3.0)


def test_leader_gives_way_sideways_and_forward() -> None:
    give_mps = LEADER_GIVES * 0.6 * (10.0 - 8.0)
    assert wish((8.0, 0.0, 0.0)) == pytest.approx((-give_mps, 3.0, 0.0))
    assert wish((0.0, -8.0, 0.0)) == pytest.approx((0.0, 3.0 + give_mps, 0.0))


def test_leader_in_a_layer_goes_level_to_a_goal_at_another_height() -> None:
    assert wish(layer_m=8.0) == pytest.approx((0.0, 3.0, 0.0))
