"""A vehicle that has begun to take off, and is held back before it climbs."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.events import Answer
from companion.core.model.states import Request, Result
from companion.core.vehicle.requests import RETRY_S
from companion.core.vehicle.waiting import WAIT_SAID_S
from companion.mavlink.makes.px4 import PX4
from tests.unit.core.core_flight_kit import M, P, S, asked_to_arm, asked_to_climb, guided, ready

FORBIDDEN: list[dict[str, Any]] = [
    {"may_take_off": False},
    {"phase": P.LAND},
    {"position": False},
    {"ready": False},
]


@pytest.mark.parametrize("forbidden", FORBIDDEN)
def test_what_forbids_a_takeoff_forbids_it_until_the_climb_has_been_asked_for(forbidden: dict[str, Any]) -> None:
    bench = asked_to_arm().seconds(RETRY_S + 1.0, **forbidden)
    assert bench.state in (S.READY, S.WAITING)
    assert bench.seconds(10.0).asked == []
    bench.tick(5, may_take_off=True, phase=P.GATHER, position=True, ready=True)
    assert bench.state is S.TAKING_OFF
    assert bench.requests == [Request.ARM]


def test_one_that_is_grounded_meanwhile_asks_for_nothing_more() -> None:
    bench = asked_to_arm()
    bench.flight.ground("cell broken")
    assert bench.seconds(10.0).asked == []
    assert bench.flight.waits_for == "grounded, cell broken"


def test_one_that_is_armed_and_held_back_takes_off_once_its_autopilot_has_disarmed_itself() -> None:
    bench = asked_to_arm().tick(armed=True).seconds(5.0, may_take_off=False)
    assert bench.asked == []
    assert bench.state is S.WAITING
    bench.tick(2, armed=False)
    assert bench.state is S.READY
    assert bench.tick(2, may_take_off=True).state is S.TAKING_OFF


def test_in_guided_no_setpoints_go_on_once_it_is_held_back() -> None:
    bench = guided().seconds(0.5).tick(mode=M.OFFBOARD)
    assert bench.flight.steers
    bench.seconds(3.0, may_take_off=False)
    assert bench.state is S.READY
    assert not bench.flight.steers


def test_climb_that_has_been_asked_for_is_not_held_back() -> None:
    bench = asked_to_climb().seconds(10.0, may_take_off=False)
    assert bench.state is S.TAKING_OFF


def test_one_under_another_waits_before_it_arms_and_says_so() -> None:
    bench = ready()
    bench.seconds(WAIT_SAID_S + 1.0, phase=P.GATHER, climb_room=False)
    assert bench.asked == []
    assert bench.texts == ["taking off to 8.0 m", "waiting: a vehicle above"]
    assert bench.flight.waits_for == "a vehicle above"
    assert bench.tick(climb_room=True).requests == [Request.ARM]
    assert bench.flight.waits_for == ""
    # Armed: no time is left for that
    assert bench.seconds(2 * RETRY_S, armed=True, climb_room=False).requests == [Request.TAKEOFF]


def test_a_climb_beside_another_ends_early_and_it_is_steered() -> None:
    bench = asked_to_climb()
    bench.seconds(2.0, armed=True, mode=M.TAKEOFF, climb_room=True)
    assert bench.state is S.TAKING_OFF
    bench.seconds(0.1, armed=True, mode=M.TAKEOFF, climb_room=False)
    assert bench.state is S.HOLD
    assert bench.flight.steers
    assert Request.OFFBOARD in bench.seconds(2 * RETRY_S, armed=True, mode=M.TAKEOFF).requests


def test_landing_ends_no_sooner_than_the_arming_that_was_asked_for_would_show() -> None:
    bench = asked_to_arm()
    bench.flight.receive(Answer(Request.ARM, Result.ACCEPTED), bench.now_s)
    bench.seconds(0.5, heartbeat=False, land_now=True)
    assert bench.state is S.LANDING
    assert bench.seconds(0.5, heartbeat=True, armed=True).requests == [Request.LAND]
    assert bench.seconds(PX4.traits.mode_shows_s, armed=False).state is S.LANDED
    assert asked_to_arm().seconds(PX4.traits.mode_shows_s + 0.1, land_now=True).state is S.LANDED  # it never armed
