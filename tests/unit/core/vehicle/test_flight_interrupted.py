"""A flight whose companion stalls or starts again, or whose autopilot falls silent or comes late."""

from __future__ import annotations

import re
from typing import Any

import pytest

from companion.core.model.events import AutopilotMode
from companion.core.model.states import (
    AutopilotTraits,
    FlightMode,
    FlightState,
    LandedState,
    Request,
    Severity,
)
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from companion.core.vehicle.requests import RETRY_S
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4
from tests.unit.core.core_flight_kit import (
    AIRBORNE,
    ALTITUDE_M,
    TICK_S,
    Bench,
    M,
    P,
    S,
    asked_to_arm,
    asked_to_climb,
    climbing,
    guided_climb,
    held_by_failsafe,
    landing,
    ready,
    steered,
    streaming,
    taking_off,
)

HEARTBEAT_LOST_S = failsafe_engine.row(Cause.NO_HEARTBEAT).delay_s
SILENT_S = failsafe_engine.row(Cause.AUTOPILOT_SILENT).delay_s

# --- interrupted ---


@pytest.mark.parametrize("traits", [PX4.traits, ARDUPILOT.traits])
def test_restarted_companion_whose_autopilot_still_follows_setpoints_joins(traits: AutopilotTraits) -> None:
    bench = Bench(mode=M.OFFBOARD, armed=True, landed=LandedState.IN_AIR, altitude_m=8.0, traits=traits)
    bench.seconds(3.0, phase=P.TRANSIT)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.WAITING, [], False)
    bench.tick(3, may_join=True)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.TRANSIT, [], True)


@pytest.mark.parametrize("state", AIRBORNE)
def test_interrupted_vehicle_listens_and_joins_once_the_swarm_is_heard(state: FlightState) -> None:
    bench = steered(state)
    bench.flight.stall()
    bench.tick(mode=M.HOLD, failsafe=True)  # the autopilot has acted by itself
    assert bench.state is S.WAITING
    assert not bench.flight.steers
    bench.seconds(1.0)
    assert bench.asked == []
    assert bench.tick(may_join=True).texts == ["in the air, swarm heard: joining"]
    assert bench.seconds(0.5).flight.steers
    bench.tick(2, mode=M.OFFBOARD, hold=False)
    assert bench.state is state


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN, M.LAND, M.TAKEOFF, M.HOLD])
def test_interrupted_vehicle_does_not_join_while_someone_else_flies_it(mode: FlightMode) -> None:
    bench = steered(S.TRANSIT)
    bench.flight.stall()
    bench.seconds(3.0, mode=mode, may_join=True)
    assert bench.state is S.RELEASED
    assert bench.asked == []
    assert not bench.flight.steers


@pytest.mark.parametrize("state", AIRBORNE)
def test_interrupted_vehicle_that_is_to_land_lands(state: FlightState) -> None:
    bench = steered(state)
    bench.flight.stall()
    bench.seconds(1.0, mode=M.HOLD, failsafe=True, land_now=True)
    assert bench.state is S.LANDING
    assert bench.requests == [Request.LAND]


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN, M.LAND, M.TAKEOFF])
def test_interrupted_vehicle_that_is_to_land_is_left_to_who_flies_it(mode: FlightMode) -> None:
    bench = steered(S.TRANSIT)
    bench.flight.stall()
    bench.seconds(3.0, mode=mode, land_now=True)
    assert bench.asked == []


def test_restarted_companion_in_the_air_asks_nothing_until_it_hears_the_swarm() -> None:
    bench = Bench(
        armed=True, failsafe=True, landed=LandedState.IN_AIR, altitude_m=8.0, ready=False, phase=P.TRANSIT
    ).seconds(5.0)
    assert bench.state is S.WAITING
    assert bench.texts == ["waiting: in the air: listening for the swarm"]
    assert bench.asked == []
    assert bench.tick(may_join=True).state is S.HOLD


# --- interrupted in its take-off or its landing ---


def interrupted(bench: Bench, **meanwhile: Any) -> Bench:
    """Stood still while this happened; the HEARTBEAT that tells of it is still to come."""
    bench.tick(0, **meanwhile)
    bench.flight.stall()
    return bench


ALOFT: dict[str, Any] = {"landed": LandedState.IN_AIR, "altitude_m": ALTITUDE_M}


@pytest.mark.parametrize("make", [climbing, asked_to_climb])
def test_interrupted_climb_goes_on_and_is_steered_at_its_end(make: Any) -> None:
    bench = interrupted(make(), mode=M.TAKEOFF, landed=LandedState.IN_AIR, altitude_m=4.0)
    bench.seconds(5.0)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.TAKING_OFF, [], False)
    bench.tick(mode=M.HOLD, altitude_m=ALTITUDE_M)
    assert (bench.state, bench.flight.steers) == (S.HOLD, True)
    assert bench.seconds(0.5).requests == [Request.OFFBOARD]
    assert bench.tick(2, mode=M.OFFBOARD).state is S.GATHERING


@pytest.mark.parametrize("switched_on_in", [M.HOLD, M.OTHER])
def test_climb_that_ended_while_it_stalled_is_its_own(switched_on_in: FlightMode) -> None:
    bench = interrupted(asked_to_climb(switched_on_in), mode=M.HOLD, **ALOFT).tick()
    assert (bench.state, bench.asked, bench.flight.steers) == (S.HOLD, [], True)


@pytest.mark.parametrize("make", [climbing, asked_to_climb, landing])
def test_interrupted_in_its_takeoff_or_landing_it_does_nothing_until_the_autopilot_is_heard(make: Any) -> None:
    bench = interrupted(make(), mode=M.HOLD, **ALOFT)
    before = bench.state
    bench.seconds(HEARTBEAT_LOST_S + 2.0, heartbeat=False, land_now=True)
    assert (bench.state, bench.asked, bench.flight.steers) == (before, [], False)


@pytest.mark.parametrize("make", [climbing, asked_to_climb, lambda: asked_to_climb(M.OTHER)])
@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN, M.LAND, M.OFFBOARD])
def test_pilot_who_took_over_while_it_stalled_in_the_climb_gets_the_vehicle(make: Any, mode: FlightMode) -> None:
    bench = interrupted(make(), mode=mode, **ALOFT).tick()
    assert bench.state is S.RELEASED
    assert bench.seconds(5.0, may_join=True, land_now=True).asked == []
    assert not bench.flight.steers


@pytest.mark.parametrize("make", [climbing, asked_to_climb])
def test_hold_far_below_the_altitude_after_stalling_is_the_pilots(make: Any) -> None:
    bench = interrupted(make(), mode=M.HOLD, landed=LandedState.IN_AIR, altitude_m=0.5 * ALTITUDE_M)
    assert bench.tick().state is S.RELEASED


def test_takeoff_that_was_lost_while_it_stalled_is_asked_for_again() -> None:
    bench = interrupted(asked_to_climb()).seconds(2 * RETRY_S)
    assert bench.state is S.TAKING_OFF
    assert bench.requests[0] is Request.TAKEOFF
    bench.tick(landed=LandedState.TAKEOFF, altitude_m=0.3)  # the HEARTBEAT that shows the mode comes a second later
    assert bench.seconds(1.0).state is S.TAKING_OFF
    assert bench.tick(mode=M.TAKEOFF).tick(mode=M.HOLD, **ALOFT).state is S.HOLD


def test_vehicle_that_disarmed_on_the_ground_while_it_stalled_is_not_armed_again() -> None:
    bench = interrupted(asked_to_climb(), armed=False).tick()
    assert bench.texts == ["companion stalled: resynchronising", "released: disarmed before takeoff"]
    assert bench.seconds(5.0).asked == []


def test_climb_is_its_own_after_stalling_twice() -> None:
    bench = interrupted(climbing(), altitude_m=4.0).tick()
    bench = interrupted(bench, altitude_m=6.0).tick()
    assert bench.state is S.TAKING_OFF
    assert interrupted(bench, mode=M.HOLD, **ALOFT).tick().state is S.HOLD
    assert interrupted(interrupted(bench)).tick().state is S.WAITING
    assert bench.tick(may_join=True).state is S.HOLD


@pytest.mark.parametrize("make", [climbing, asked_to_climb])
@pytest.mark.parametrize("mode", [M.TAKEOFF, M.HOLD])
def test_order_to_land_is_obeyed_after_stalling_in_the_climb(make: Any, mode: FlightMode) -> None:
    bench = interrupted(make(), mode=mode, **ALOFT).tick(2, land_now=True)
    assert (bench.state, bench.requests) == (S.LANDING, [Request.LAND])
    assert interrupted(bench).seconds(RETRY_S + TICK_S).requests == [Request.LAND]
    assert interrupted(bench, mode=M.LAND).tick().state is S.LANDING
    assert interrupted(bench, armed=False, landed=LandedState.ON_GROUND).tick().state is S.LANDED


def test_pilot_who_took_over_while_it_stalled_in_its_landing_gets_the_vehicle() -> None:
    assert interrupted(landing(), mode=M.OTHER).tick().state is S.RELEASED
    assert interrupted(landing().tick(mode=M.LAND), mode=M.HOLD).tick().state is S.RELEASED


def test_interrupted_guided_climb_goes_on_without_setpoints_until_its_end() -> None:
    bench = interrupted(guided_climb(), altitude_m=5.0).seconds(2.0)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.TAKING_OFF, [], False)
    assert interrupted(bench, **ALOFT).tick(3).state is S.GATHERING


@pytest.mark.parametrize("mode", [M.HOLD, M.OTHER, M.LAND])
def test_pilot_who_took_over_while_it_stalled_in_a_guided_climb_gets_the_vehicle(mode: FlightMode) -> None:
    assert interrupted(guided_climb(), mode=mode, **ALOFT).tick().state is S.RELEASED


@pytest.mark.parametrize(
    "make",
    [taking_off, lambda: asked_to_arm(), lambda: asked_to_arm().tick(armed=True)],
    ids=["begun", "asked", "armed"],
)
def test_interrupted_before_it_asked_for_the_climb_it_takes_no_climb_for_its_own(make: Any) -> None:
    assert interrupted(make(), armed=False).tick(2).state is S.TAKING_OFF  # by way of READY
    assert interrupted(make(), armed=True).seconds(5.0).asked == []
    for mode in (M.TAKEOFF, M.HOLD):
        bench = interrupted(make(), armed=True, mode=mode, **ALOFT).seconds(3.0)
        assert (bench.state, bench.asked) == (S.RELEASED, [])


def test_interrupted_between_its_climb_and_offboard_it_listens_and_joins() -> None:
    bench = interrupted(streaming()).seconds(3.0)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.WAITING, [], False)
    assert bench.tick(may_join=True).state is S.HOLD
    assert bench.seconds(0.5).requests == [Request.OFFBOARD]


def test_interrupted_between_its_climb_and_offboard_it_lands_when_ordered_to() -> None:
    bench = interrupted(streaming()).seconds(1.0, land_now=True)
    assert (bench.state, bench.requests) == (S.LANDING, [Request.LAND])


@pytest.mark.parametrize("before", [M.OFFBOARD, M.OTHER])
def test_hold_that_comes_after_another_mode_is_not_the_end_of_the_climb(before: FlightMode) -> None:
    bench = interrupted(streaming()).seconds(1.0, mode=before).tick(mode=M.HOLD, may_join=True)
    assert (bench.state, bench.asked) == (S.RELEASED, [])


def test_hold_of_the_pilot_after_offboard_is_the_pilots_after_stalling() -> None:
    for heard_before in (0, 1):
        bench = guided_climb().tick(**ALOFT)
        assert bench.state is S.HOLD
        bench.flight.receive(
            AutopilotMode([M.OFFBOARD, M.HOLD][heard_before], True, "BRAKE", traits=PX4.traits), bench.now_s
        )
        assert interrupted(bench, mode=M.HOLD).tick(may_join=True).state is S.RELEASED


# --- a silent autopilot ---


@pytest.mark.parametrize("state", AIRBORNE)
def test_silent_autopilot_gets_no_setpoint_after_a_second_and_the_operator_hears_of_it(state: FlightState) -> None:
    bench = steered(state).seconds(SILENT_S - 0.1, silent=True)
    assert bench.flight.steers
    bench.seconds(0.2)
    assert not bench.flight.steers
    [said] = bench.said
    assert said.severity is Severity.CRITICAL
    assert re.fullmatch(r"autopilot link lost 1\.[01] s: setpoints stopped", said.text)
    bench.seconds(10.0, may_join=True)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.WAITING, [], False)
    assert not bench.flight.can_lead


def test_autopilot_that_is_heard_again_is_listened_to_first() -> None:
    bench = steered(S.TRANSIT).seconds(2.0, silent=True)
    bench.seconds(2.0, silent=False, heartbeat=False, may_join=True)
    assert (bench.state, bench.flight.steers) == (S.WAITING, False)
    bench.tick(heartbeat=True, mode=M.HOLD, failsafe=True)
    assert (bench.state, bench.texts) == (S.HOLD, ["in the air, swarm heard: joining"])
    assert bench.tick(2, mode=M.OFFBOARD).state is S.TRANSIT


@pytest.mark.parametrize("mode", [M.OTHER, M.RETURN, M.LAND, M.HOLD])
def test_pilot_who_took_over_while_the_autopilot_was_silent_keeps_the_vehicle(mode: FlightMode) -> None:
    bench = steered(S.TRANSIT).seconds(2.0, silent=True).seconds(1.0, silent=False, mode=mode, may_join=True)
    assert (bench.state, bench.asked) == (S.RELEASED, [])


@pytest.mark.parametrize("make", [climbing, asked_to_climb, landing])
def test_silent_autopilot_climbs_or_lands_on_by_itself_and_is_asked_for_nothing(make: Any) -> None:
    bench = make()
    before = bench.state
    bench.seconds(SILENT_S + 0.2, silent=True)
    bench.seconds(10.0)
    assert (bench.state, bench.asked, bench.texts, bench.flight.steers) == (before, [], [], False)
    mode = M.LAND if before is S.LANDING else M.TAKEOFF
    assert bench.tick(2, silent=False, mode=mode).state is before


def test_autopilot_that_was_never_heard_is_only_waited_for() -> None:
    assert Bench(silent=True).seconds(10.0).texts == ["waiting: no autopilot heartbeat"]


# --- late telemetry ---


@pytest.mark.parametrize("state", AIRBORNE)
def test_telemetry_that_comes_late_in_order_is_said_and_held_for(state: FlightState) -> None:
    bench = steered(state).seconds(10.0).seconds(0.5, late_s=1.5)
    assert bench.state is S.HOLD
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.CRITICAL, "telemetry 1.5 s late")]
    assert bench.flight.vehicle.position_missing(bench.now_s)
    assert bench.flight.steers
    assert bench.seconds(10.0).texts == []
    assert bench.tick(2, late_s=0.1).state is state
    assert bench.seconds(0.5, late_s=1.0).texts == ["telemetry 1.0 s late"]


def test_gap_and_late_telemetry_after_it_are_both_said() -> None:
    bench = steered(S.TRANSIT).seconds(0.7, position=False)
    assert bench.texts == ["hold: position lost"]
    assert bench.tick(position=True, late_s=0.7).texts == ["telemetry 0.7 s late"]


def test_vehicle_whose_telemetry_is_late_neither_takes_off_nor_joins_but_lands_when_ordered() -> None:
    bench = ready().seconds(1.0, late_s=1.0).seconds(1.0, phase=P.GATHER)
    assert (bench.state, bench.asked) == (S.WAITING, [])
    bench = held_by_failsafe().seconds(0.5, late_s=1.0)
    assert bench.texts == ["telemetry 1.0 s late"]
    bench.seconds(5.0, may_join=True)
    assert bench.state is S.WAITING
    assert bench.tick(2, land_now=True).requests == [Request.LAND]
