"""Room to climb: who is waited for on the ground, and who gives way to a climb or a landing in the air."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO
from companion.core.safety.ascent import AGAIN_S, STEERED_SHARE, TOLD_LIMIT_S, ClimbRoom
from companion.core.safety.clearance import MARGIN_M, SILENT_STRAY_M
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import applied

HARD_M = mission().separation.hard_m
S = FlightState


def is_clear(*neighbours: Any, silent: tuple[PeerReport, ...] = ()) -> bool:
    return ClimbRoom(mission()).is_clear(neighbours, {report.vehicle: report for report in silent}, None, 10.0)


# --- on the ground ---


@pytest.mark.parametrize("state", [S.RELEASED, S.WAITING, S.LANDING])
def test_one_above_that_does_not_give_way_is_waited_for(state: FlightState) -> None:
    near_m, far_m = HARD_M + MARGIN_M - 0.1, HARD_M + MARGIN_M + 0.1
    assert not is_clear(neighbour(2, (near_m, 0.0, -8.0), state=state, airborne=True))
    assert is_clear(neighbour(2, (far_m, 0.0, -8.0), state=state, airborne=True))
    assert is_clear(neighbour(2, (near_m, 0.0, 0.0), state=state, airborne=False))


def test_one_above_that_is_steered_is_waited_for_only_where_it_cannot_give_way_in_time() -> None:
    for level_m, clear in ((STEERED_SHARE * HARD_M - 0.1, False), (STEERED_SHARE * HARD_M + 0.1, True)):
        assert is_clear(neighbour(2, (level_m, 0.0, -4.0), state=S.GATHERING, airborne=True)) is clear


def test_those_that_climb_beside_it_are_not_waited_for() -> None:
    assert is_clear(neighbour(2, (3.0, 0.0, -2.0), state=S.TAKING_OFF, airborne=True))


def test_one_that_fell_silent_above_is_waited_for_without_end() -> None:
    room, keep_m = ClimbRoom(mission()), HARD_M + MARGIN_M + SILENT_STRAY_M
    silent = PeerReport(2, (keep_m - 0.1, 0.0, -8.0), 20.0, silent=True)
    for k in range(round(3.0 * TOLD_LIMIT_S)):
        assert not room.is_clear((), {2: silent}, None, float(k))
    assert is_clear(silent=(PeerReport(2, (keep_m + 0.1, 0.0, -8.0), 20.0, silent=True),))


@pytest.mark.parametrize(
    "told",
    [
        PeerReport(2, (0.0, 0.0, -8.0), 20.0, silent=True, received=True),
        PeerReport(2, (90.0, 0.0, -8.0), 20.0, silent=True, elsewhere=((0.0, 0.0, -8.0),)),
    ],
)
def test_a_place_that_others_alone_tell_keeps_nobody_on_the_ground_for_good(told: PeerReport) -> None:
    room = ClimbRoom(mission())
    for k in range(round(TOLD_LIMIT_S)):
        assert not room.is_clear((), {2: told}, None, float(k))
    assert room.is_clear((), {2: told}, None, TOLD_LIMIT_S)
    assert not room.is_clear((), {2: told}, None, TOLD_LIMIT_S + AGAIN_S + 0.1)  # another takeoff


# --- in the air ---


@pytest.mark.parametrize("state", [S.TAKING_OFF, S.HOLD])
def test_one_that_climbs_has_no_room_where_the_filter_would_keep_another_farther_off(state: FlightState) -> None:
    near_m, steerable_m = HARD_M + MARGIN_M - 0.1, mission().fence.altitude_min_m + MARGIN_M
    up = Position((0.0, 0.0, -steerable_m - 0.1), ZERO)
    near = neighbour(2, (near_m, 0.0, 0.0), state=state, airborne=True)
    far = neighbour(2, (near_m + 0.2, 0.0, 0.0), state=state, airborne=True)
    grounded = neighbour(2, (near_m, 0.0, 0.0), state=S.READY, airborne=False)
    room = ClimbRoom(mission())
    assert not room.is_clear((near,), {}, up, 10.0)
    assert room.is_clear((far, grounded), {}, up, 10.0)
    assert room.is_clear((near,), {}, Position((0.0, 0.0, -steerable_m + 0.1), ZERO), 10.0)  # too low to be steered


def _wanted_rest(rel_ned_m: Vec3, state: FlightState) -> Vec3:
    safety_filter, before = replace(SafetyFilter.of(mission()), altitude_max_m=60.0), ZERO
    other = neighbour(2, rel_ned_m, state=state, airborne=True)
    for _ in range(100):
        before = applied(safety_filter, ZERO, before, Position((0.0, 0.0, -20.0), ZERO), (other,), dt_s=0.05)
    return before


@pytest.mark.parametrize(("state", "down_m"), [(S.TAKING_OFF, 12.0), (S.LANDING, -12.0)])
def test_one_that_comes_up_or_down_here_by_its_autopilot_is_given_way_level(state: FlightState, down_m: float) -> None:
    north, east, down = _wanted_rest((2.0, 0.0, down_m), state)
    assert north < -0.5
    assert abs(east) < 1e-6
    assert abs(down) < 0.2
    assert _wanted_rest((HARD_M + MARGIN_M + 0.1, 0.0, down_m), state) == pytest.approx(ZERO)


@pytest.mark.parametrize(("state", "down_m"), [(S.TAKING_OFF, -12.0), (S.LANDING, 12.0), (S.HOLD, 12.0)])
def test_one_that_goes_away_up_or_down_or_is_steered_is_kept_from_in_three_dimensions(
    state: FlightState, down_m: float
) -> None:
    assert _wanted_rest((2.0, 0.0, down_m), state) == pytest.approx(ZERO)
