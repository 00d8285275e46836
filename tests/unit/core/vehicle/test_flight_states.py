"""One vehicle in the air: it follows the phase, yields to the pilot, and tells a failsafe from the pilot."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.states import FlightMode, FlightState, LandedState, Request, Severity, SwarmPhase
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from companion.core.vehicle.flight import Flight
from companion.mavlink.makes.px4 import PX4
from tests.unit.core.core_flight_kit import (
    AIRBORNE,
    ALTITUDE_M,
    Bench,
    M,
    P,
    S,
    climbing,
    held_by_failsafe,
    landed,
    landing,
    ready,
    released,
    steered,
    streaming,
    taking_off,
)

GAP_SHOWN_S = failsafe_engine.row(Cause.SETPOINTS_CUT).lingers_s
HEARTBEAT_LOST_S = failsafe_engine.row(Cause.NO_HEARTBEAT).delay_s
POSITION_LOST_S = failsafe_engine.row(Cause.NO_POSITION).delay_s

# --- whom the companion does not fly ---


def test_unknown_autopilot_is_said_and_never_armed() -> None:
    bench = Bench(traits=None, phase=P.GATHER).seconds(10.0)
    assert bench.state is S.WAITING
    assert bench.texts == ["waiting: HOLD"]  # the codec's words for what it is
    assert bench.asked == []


def test_vehicle_that_someone_else_has_armed_is_left_alone() -> None:
    for bench in (Bench(armed=True), ready().tick(armed=True)):
        bench.seconds(5.0, phase=P.GATHER)
        assert bench.state is S.WAITING
        assert bench.asked == []
        assert bench.tick(2, armed=False).state in (S.READY, S.TAKING_OFF)


# --- steered ---


@pytest.mark.parametrize("state", AIRBORNE)
def test_state_follows_the_phase_in_offboard(state: FlightState) -> None:
    bench = steered(state).tick(20)
    assert bench.state is state
    assert bench.flight.steers
    assert bench.asked == []


@pytest.mark.parametrize("state", AIRBORNE)
def test_told_to_hold_it_holds_and_then_goes_on(state: FlightState) -> None:
    bench = steered(state)
    assert bench.tick(hold=True).state is S.HOLD
    assert bench.flight.steers
    assert bench.tick(hold=state is S.HOLD).state is state


@pytest.mark.parametrize("state", [s for s in AIRBORNE if s is not S.HOLD])
@pytest.mark.parametrize(
    ("lost", "after_s", "text"),
    [
        ("position", POSITION_LOST_S, "hold: position lost"),
        ("heartbeat", HEARTBEAT_LOST_S, "hold: autopilot heartbeat lost"),
    ],
)
def test_lost_position_or_link_is_an_alarm_and_a_hold(state: FlightState, lost: str, after_s: float, text: str) -> None:
    bench = steered(state).seconds(after_s - 0.1, **{lost: False})
    assert bench.state is state
    bench.tick(4)
    assert bench.state is S.HOLD
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.CRITICAL, text)]
    assert bench.flight.steers  # zero velocity keeps OFFBOARD; separation goes on
    assert bench.tick(2, **{lost: True}).state is state


def test_position_is_known_while_fresh() -> None:
    bench = steered(S.TRANSIT)
    assert not bench.flight.vehicle.position_missing(bench.now_s + POSITION_LOST_S)
    assert bench.flight.vehicle.position_missing(bench.now_s + POSITION_LOST_S + 0.01)


def test_settled_is_steered_and_nearly_at_rest() -> None:
    bench = steered(S.GATHERING)
    assert bench.flight.settled
    assert not bench.tick(speed_mps=0.6).flight.settled
    assert not ready().flight.settled


# --- the pilot ---


PILOTS = [M.OTHER, M.RETURN, M.LAND, M.HOLD, M.TAKEOFF]


@pytest.mark.parametrize("state", AIRBORNE)
@pytest.mark.parametrize("mode", PILOTS)
def test_mode_that_was_not_asked_for_releases_the_vehicle_to_the_pilot(state: FlightState, mode: FlightMode) -> None:
    bench = steered(state).tick(mode=mode)
    assert bench.state is S.RELEASED
    assert not bench.flight.steers
    assert [(s.severity, s.text) for s in bench.said] == [
        (Severity.WARNING, f"released: pilot, mode {mode.value.upper()}")
    ]


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN, M.LAND])
def test_pilot_who_takes_over_before_offboard_gets_the_vehicle(mode: FlightMode) -> None:
    for bench in (climbing(), streaming()):
        bench.tick(mode=mode)
        assert bench.state is S.RELEASED
        assert not bench.flight.steers


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN])
def test_pilots_mode_is_above_an_order_to_land(mode: FlightMode) -> None:
    for bench in (climbing(), streaming(), *(steered(state) for state in AIRBORNE)):
        bench.tick(mode=mode, land_now=True)
        assert bench.state is S.RELEASED
        assert bench.seconds(3.0).asked == []
        assert not bench.flight.steers


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN])
def test_pilot_who_takes_over_while_the_landing_is_asked_for_gets_the_vehicle(mode: FlightMode) -> None:
    bench = landing().tick(mode=mode)
    assert bench.state is S.RELEASED
    assert bench.seconds(3.0).asked == []


def test_pilot_who_takes_over_a_landing_gets_the_vehicle() -> None:
    assert landing().tick(mode=M.OTHER).state is S.RELEASED
    assert landing().tick(mode=M.LAND).tick(mode=M.HOLD).state is S.RELEASED
    assert landing().tick(mode=M.LAND).tick(mode=M.OTHER).state is S.RELEASED


@pytest.mark.parametrize("mode", list(FlightMode))
@pytest.mark.parametrize("land_now", [False, True])
def test_released_vehicle_gets_no_request_and_no_setpoint_whatever_comes(mode: FlightMode, land_now: bool) -> None:
    bench = released()
    for phase in SwarmPhase:
        bench.seconds(2.0, mode=mode, phase=phase, land_now=land_now, may_join=True)
        assert bench.asked == []
        assert not bench.flight.steers
    bench.flight.stall()
    bench.seconds(2.0, armed=False, landed=LandedState.ON_GROUND)
    assert bench.state is S.RELEASED
    assert bench.asked == []


def test_operator_hands_back_in_the_air_setpoints_first_then_offboard() -> None:
    bench = released().tick(mode=M.HOLD)
    bench.flight.hand_back()
    bench.tick()
    assert bench.state is S.HOLD
    assert bench.flight.steers
    assert bench.asked == []
    assert bench.seconds(0.5).requests == [Request.OFFBOARD]
    assert bench.tick(2, mode=M.OFFBOARD).state is S.TRANSIT


def test_operator_hands_back_on_the_ground_and_it_waits_to_be_ready() -> None:
    bench = released().tick(armed=False, landed=LandedState.ON_GROUND, mode=M.HOLD, phase=P.ASSEMBLE)
    bench.flight.hand_back()
    assert bench.state is S.WAITING
    assert bench.tick().state is S.READY


def test_handing_back_while_the_pilot_still_flies_releases_again_without_a_request() -> None:
    bench = released()
    bench.flight.hand_back()
    bench.seconds(2.0, mode=M.OTHER)
    assert bench.state is S.RELEASED
    assert bench.asked == []


@pytest.mark.parametrize("make", [ready, taking_off, streaming, landing, landed])
def test_handing_back_what_was_not_released_changes_nothing(make: Any) -> None:
    bench = make()
    before = bench.state
    bench.flight.hand_back()
    assert bench.state is before


# --- failsafes ---


@pytest.mark.parametrize("state", AIRBORNE)
def test_failsafe_that_holds_although_setpoints_never_stopped_releases_the_vehicle(state: FlightState) -> None:
    """For lost RC, a fence, a battery: going back to OFFBOARD would override it."""
    bench = steered(state).seconds(5.0).tick(mode=M.HOLD, failsafe=True)
    assert bench.state is S.RELEASED
    assert bench.texts == ["released: failsafe, mode HOLD"]
    for failsafe in (True, False):
        assert bench.seconds(10.0, failsafe=failsafe, may_join=True).asked == []
        assert not bench.flight.steers


def test_failsafe_that_holds_after_the_link_was_down_is_taken_for_lost_setpoints() -> None:
    bench = steered(S.TRANSIT).seconds(0.6, silent=True)
    bench.tick(silent=False, mode=M.HOLD, failsafe=True)
    assert bench.state is S.WAITING
    assert not bench.flight.steers
    assert bench.texts == ["failsafe hold: resynchronising"]
    bench.seconds(0.9, heartbeat=False, may_join=True)
    assert bench.state is S.WAITING  # what it knows is from before
    assert bench.tick(heartbeat=True).state is S.HOLD


def test_failsafe_that_holds_long_after_the_link_was_down_releases_the_vehicle() -> None:
    bench = steered(S.TRANSIT).seconds(0.6, silent=True).seconds(GAP_SHOWN_S + 0.1, silent=False)
    assert bench.state is S.TRANSIT
    assert bench.tick(mode=M.HOLD, failsafe=True).state is S.RELEASED


def test_failsafe_for_lost_setpoints_is_ended_by_setpoints_and_not_by_a_request() -> None:
    bench = held_by_failsafe().tick(may_join=True)
    assert (bench.state, bench.texts) == (S.HOLD, ["in the air, swarm heard: joining"])
    bench.seconds(PX4.traits.failsafe_ends_s - 0.5)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.HOLD, [], True)
    assert bench.tick(2, mode=M.OFFBOARD, failsafe=False).state is S.TRANSIT
    assert bench.tick(mode=M.HOLD, failsafe=True).state is S.RELEASED  # another one


@pytest.mark.parametrize("restarted", [False, True])
def test_failsafe_that_setpoints_do_not_end_has_another_cause_and_releases_the_vehicle(restarted: bool) -> None:
    bench = held_by_failsafe()
    if restarted:
        bench.flight = Flight(ALTITUDE_M)
        bench.tick(2)
    bench.seconds(PX4.traits.failsafe_ends_s + 0.2, may_join=True)
    assert bench.state is S.RELEASED
    assert bench.texts[-1] == "released: failsafe, mode HOLD"
    assert bench.asked == []
    assert not bench.flight.steers


def test_climb_that_ends_in_a_failsafes_hold_is_not_flown_on() -> None:
    bench = climbing().tick(mode=M.HOLD, failsafe=True, altitude_m=ALTITUDE_M).seconds(3.0)
    assert (bench.state, bench.asked) == (S.RELEASED, [])


def test_operator_who_hands_back_a_vehicle_in_a_failsafes_hold_overrules_it_once() -> None:
    bench = steered(S.TRANSIT).seconds(5.0).tick(mode=M.HOLD, failsafe=True)
    bench.flight.hand_back()
    bench.seconds(PX4.traits.failsafe_ends_s + 3.0)
    assert bench.state is S.HOLD
    assert set(bench.requests) == {Request.OFFBOARD}
    assert bench.tick(2, mode=M.OFFBOARD, phase=P.ASSEMBLE).state is S.HOLD
    assert bench.tick(mode=M.HOLD).state is S.RELEASED


@pytest.mark.parametrize("state", AIRBORNE)
@pytest.mark.parametrize("mode", [M.LAND, M.RETURN, M.OTHER])
def test_failsafe_that_does_not_hold_is_left_to_the_autopilot(state: FlightState, mode: FlightMode) -> None:
    bench = steered(state).tick(mode=mode, failsafe=True)
    assert bench.state is S.RELEASED
    assert bench.texts == [f"released: failsafe, mode {mode.value.upper()}"]
    assert bench.seconds(5.0, may_join=True).asked == []
    assert not bench.flight.steers


def test_landing_is_asked_for_through_a_failsafe_that_holds_without_setpoints() -> None:
    bench = landing().tick(mode=M.HOLD, failsafe=True)
    assert bench.state is S.LANDING
    assert not bench.flight.steers
    assert set(bench.seconds(3.0).requests) == {Request.LAND}
