"""One vehicle ordered to land or disarmed, and what others ask of a flight."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.events import AutopilotHealth, Landed
from companion.core.model.states import FlightState, LandedState, Request, Severity
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import CRITICAL_BATTERY_PERCENT, Cause
from companion.core.vehicle.flight import STEERED
from companion.core.vehicle.waiting import WAIT_SAID_S
from tests.unit.core.core_flight_kit import (
    AIRBORNE,
    Bench,
    M,
    P,
    S,
    climbing,
    landed,
    landing,
    ready,
    released,
    steered,
    streaming,
    taking_off,
)

AIRBORNE_COUNTS_S = failsafe_engine.row(Cause.DISARMED_IN_AIR).lingers_s

# --- landing ---


@pytest.mark.parametrize("state", AIRBORNE)
def test_ordered_to_land_it_lands_from_every_steered_state(state: FlightState) -> None:
    bench = steered(state).tick(land_now=True)
    assert bench.state is S.LANDING
    assert bench.tick().requests == [Request.LAND]
    assert bench.flight.steers  # until the mode shows, or the autopilot would take it for a lost companion
    bench.tick(mode=M.LAND)
    assert not bench.flight.steers
    assert bench.seconds(10.0).asked == []
    bench.tick(armed=False, landed=LandedState.ON_GROUND)
    assert bench.state is S.LANDED
    assert bench.texts == ["landed"]


@pytest.mark.parametrize("make", [lambda: taking_off().tick(armed=True), climbing, streaming])
def test_ordered_to_land_during_takeoff_it_lands(make: Any) -> None:
    bench = make().tick(land_now=True)
    assert bench.state is S.LANDING
    bench.seconds(1.0)
    assert bench.requests == [Request.LAND]


def test_ordered_to_land_before_it_armed_it_is_landed() -> None:
    bench = taking_off().tick(2, land_now=True)
    assert bench.state is S.LANDED
    assert bench.asked == []


@pytest.mark.parametrize("make", [Bench, ready, landed])
def test_ordered_to_land_on_the_ground_it_stays_there(make: Any) -> None:
    bench = make().seconds(3.0, land_now=True, phase=P.GATHER)
    assert bench.asked == []
    assert bench.state in (S.READY, S.LANDED)


def test_landing_goes_on_when_the_order_is_gone() -> None:
    assert landing().tick(5, land_now=False).state is S.LANDING


def test_landed_vehicle_never_takes_off_again() -> None:
    bench = landed().seconds(5.0, land_now=False, phase=P.TRANSIT, may_join=True)
    assert bench.state is S.LANDED
    assert bench.asked == []
    bench.flight.stall()
    assert bench.seconds(2.0).state is S.LANDED


@pytest.mark.parametrize("state", AIRBORNE)
def test_disarmed_on_the_ground_while_steered_it_is_done(state: FlightState) -> None:
    bench = steered(state).seconds(AIRBORNE_COUNTS_S + 0.1, landed=LandedState.ON_GROUND).tick(armed=False)
    assert bench.state is S.LANDED
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.NOTICE, "disarmed on the ground")]
    assert not bench.tick().flight.steers


@pytest.mark.parametrize("state", AIRBORNE)
@pytest.mark.parametrize("landed", [LandedState.IN_AIR, LandedState.ON_GROUND], ids=["in_air", "called_landed_at_once"])
def test_disarmed_in_the_air_while_steered_it_is_done_and_the_operator_hears_that_it_falls(
    state: FlightState, landed: LandedState
) -> None:
    bench = steered(state).seconds(1.0, landed=landed).tick(armed=False)
    assert bench.state is S.LANDED
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.CRITICAL, "disarmed in the air")]
    assert not bench.tick().flight.steers


# --- what others ask ---


@pytest.mark.parametrize(
    ("make", "can_lead"),
    [
        (Bench, False),
        (ready, True),
        (climbing, True),
        (streaming, True),
        (lambda: steered(S.TRANSIT), True),
        (landing, False),
        (landed, False),
        (released, False),
    ],
    ids=["waiting", "ready", "climbing", "streaming", "transit", "landing", "landed", "released"],
)
def test_who_may_lead(make: Any, can_lead: bool) -> None:
    assert make().flight.can_lead is can_lead


@pytest.mark.parametrize("state", list(LandedState))
def test_airborne_is_what_the_autopilot_says(state: LandedState) -> None:
    bench = ready()
    bench.flight.receive(Landed(state), bench.now_s)
    assert bench.flight.vehicle.airborne == (state in (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING))


def test_steered_states_are_those_in_which_setpoints_flow() -> None:
    assert frozenset([*AIRBORNE, FlightState.SEEKING]) == STEERED


@pytest.mark.parametrize("percent", [0, CRITICAL_BATTERY_PERCENT])
def test_vehicle_with_a_critical_battery_waits_on_the_ground_and_says_why(percent: int) -> None:
    bench = Bench(battery_percent=percent).seconds(WAIT_SAID_S + 1.0, phase=P.GATHER)
    assert bench.state is S.WAITING
    assert bench.texts == [f"waiting: battery at {percent} %"]
    assert bench.asked == []
    assert bench.tick(2, phase=P.ASSEMBLE, battery_percent=percent + CRITICAL_BATTERY_PERCENT + 1).state is S.READY


def test_ready_vehicle_whose_battery_becomes_critical_is_ready_no_more() -> None:
    assert ready().tick(2, battery_percent=CRITICAL_BATTERY_PERCENT).state is S.WAITING
    assert ready().tick(2, battery_percent=CRITICAL_BATTERY_PERCENT + 1).state is S.READY


def test_battery_is_what_the_autopilot_said_last() -> None:
    bench = ready()
    bench.flight.receive(AutopilotHealth(True, 12), bench.now_s)
    assert bench.flight.vehicle.battery_percent == 12
    bench.flight.receive(AutopilotHealth(True, None), bench.now_s)
    assert bench.flight.vehicle.battery_percent is None


def test_grounded_vehicle_never_arms_says_why_and_flies_once_it_may() -> None:
    bench = ready()
    bench.flight.ground("no preflight")
    bench.seconds(WAIT_SAID_S + 1.0, phase=P.GATHER)
    assert (bench.state, bench.requests, bench.texts) == (S.WAITING, [], ["waiting: grounded, no preflight"])
    bench.flight.ground("")
    assert bench.seconds(0.5).requests == [Request.ARM]


def test_grounded_companion_that_starts_again_in_the_air_rejoins() -> None:
    bench = Bench(landed=LandedState.IN_AIR, armed=True, failsafe=True, altitude_m=8.0, phase=P.TRANSIT, may_join=True)
    bench.flight.ground("preflight is 13 h old")
    assert bench.tick(2).texts == ["in the air, swarm heard: joining"]
    assert bench.seconds(1.0).flight.steers
