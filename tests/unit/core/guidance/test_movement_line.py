"""The leader's line: where nothing else brings it back."""

from __future__ import annotations

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.leader_line import LINE_LIMIT_MPS
from companion.core.guidance.movement import Guidance
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, norm
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import surroundings

GOAL = (0.0, 130.0, -8.0)


def leading(pos_ned_m: Vec3, *, phase: SwarmPhase = SwarmPhase.TRANSIT) -> GuidanceInput:
    return GuidanceInput(
        surroundings(Position(pos_ned_m, ZERO)),
        state=FlightState.TRANSIT,
        phase=phase,
        route=formation.LEADER_ROUTE,
        range_m=30.0,
        role=Role.LEADER,
        governor=1.0,
        lease_freshness=1.0,
        goal=(GOAL, 4.0),
        size=3,
    )


@pytest.mark.parametrize(("off_ned_m", "back"), [((0.5, 0.0, 0.0), 0), ((0.0, 0.0, 0.6), 2)])
def test_leader_comes_back_to_its_line_sideways_and_in_height(off_ned_m: Vec3, back: int) -> None:
    movement = Guidance(mission(), 1)
    movement.find_desired(leading((0.0, 0.0, -8.0)))
    straight = movement.find_desired(leading((0.0, 50.0, -8.0)))
    wanted = movement.find_desired(leading((off_ned_m[0], 50.0, -8.0 + off_ned_m[2])))
    assert straight[back] == pytest.approx(0.0, abs=1e-9)
    assert wanted[back] == pytest.approx(-0.8 * off_ned_m[back], abs=0.05)


def test_way_back_is_limited_and_followers_are_not_told_of_it() -> None:
    movement = Guidance(mission(), 1)
    movement.find_desired(leading((0.0, 0.0, -8.0)))
    wanted = movement.find_desired(leading((6.0, 50.0, -8.0)))
    assert norm((wanted[0] - movement.ref_ned_mps[0], wanted[1] - movement.ref_ned_mps[1], 0.0)) == pytest.approx(
        LINE_LIMIT_MPS, abs=1e-6
    )
    assert abs(movement.ref_ned_mps[0]) < 0.3


def test_heir_flies_its_own_line_from_where_it_takes_over() -> None:
    wanted = Guidance(mission(), 1).find_desired(leading((9.0, 50.0, -8.0)))
    assert wanted[0] == pytest.approx(-9.0 / 80.5 * 3.0, abs=0.05)  # straight at d2, and no further aside


@pytest.mark.parametrize("off_m", [0.6, -0.6])
def test_leader_among_trees_comes_back_to_the_height_of_its_line_alone(off_m: float) -> None:
    """It held none: climbing by 0.3 m/s that its autopilot did not tell, a swarm came from 4 m to 6.8, into a crown."""
    movement = Guidance(mission(sensing={}), 1)
    movement.find_desired(leading((0.0, 0.0, -8.0)))
    wanted = movement.find_desired(leading((2.0, 50.0, -8.0 + off_m)))
    assert wanted[2] == pytest.approx(-0.8 * off_m, abs=0.05)
    assert wanted[0] == pytest.approx(-2.0 / 80.0 * 3.0, abs=0.01)  # straight at d2: dodges lead it off the line
    assert abs(movement.ref_ned_mps[2]) < 0.05  # followers keep the height of those that they follow


def test_leader_among_trees_comes_back_to_its_height_no_faster_than_others_can_follow() -> None:
    movement = Guidance(mission(sensing={}), 1)
    movement.find_desired(leading((0.0, 0.0, -8.0)))
    wanted = movement.find_desired(leading((0.0, 50.0, -3.0)))
    assert -LINE_LIMIT_MPS - 0.2 <= wanted[2] <= -LINE_LIMIT_MPS


def test_leader_among_trees_that_leads_anew_has_another_line() -> None:
    movement = Guidance(mission(sensing={}), 1)
    movement.find_desired(leading((0.0, 0.0, -8.0)))
    movement.reset()
    wanted = movement.find_desired(leading((0.0, 50.0, -7.0)))
    assert wanted[2] == pytest.approx(-1.0 / 80.0 * 3.0, abs=0.01)
