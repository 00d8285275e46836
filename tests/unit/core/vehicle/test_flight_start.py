"""One vehicle before its flight: what it waits for, what it asks the autopilot for, and what it does when refused."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.actions import Ask
from companion.core.model.events import Answer, AutopilotText
from companion.core.model.states import FlightMode, LandedState, Request, Result, Severity, SwarmPhase
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from companion.core.vehicle.requests import REASON_S, REFUSALS_SAID, RETRY_S
from companion.core.vehicle.waiting import WAIT_SAID_S
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4
from tests.unit.core.core_flight_kit import (
    ALTITUDE_M,
    TICK_S,
    Bench,
    M,
    P,
    S,
    asked_to_arm,
    climbing,
    guided,
    guided_climb,
    landing,
    ready,
    streaming,
    taking_off,
)

HEARTBEAT_LOST_S = failsafe_engine.row(Cause.NO_HEARTBEAT).delay_s

# --- before the flight ---


@pytest.mark.parametrize(
    ("missing", "reason"),
    [
        ({"heartbeat": False}, "no autopilot heartbeat"),
        ({"position": False}, "no position"),
        ({"landed": LandedState.UNDEFINED}, "no landed state"),
        ({"ready": False}, "autopilot not ready to arm"),
    ],
)
def test_waits_and_says_for_what(missing: dict[str, Any], reason: str) -> None:
    bench = Bench().seconds(WAIT_SAID_S + 5.0, **missing)
    assert bench.state is S.WAITING
    assert bench.texts == [f"waiting: {reason}"]  # once, not every tick
    assert bench.asked == []
    bench.tick(2, heartbeat=True, position=True, ready=True, landed=LandedState.ON_GROUND)
    assert bench.state is S.READY
    assert bench.texts == ["ready"]


def test_new_reason_to_wait_is_said() -> None:
    bench = Bench().seconds(5.0, heartbeat=False, position=False)
    assert bench.seconds(5.0, heartbeat=True).texts == ["waiting: no position"]
    assert bench.seconds(5.0, position=True, ready=False).texts == ["waiting: autopilot not ready to arm"]


def test_reason_that_comes_back_is_said_again() -> None:
    bench = Bench().seconds(WAIT_SAID_S + 2.0, position=False)
    assert bench.tick(position=True).state is S.READY
    assert bench.seconds(WAIT_SAID_S + 4.0, position=False).texts == ["waiting: no position"]


def test_what_is_soon_there_is_not_worth_a_word() -> None:
    bench = Bench().seconds(WAIT_SAID_S - 0.5, ready=False)
    assert bench.texts == []
    assert bench.tick(2, ready=True).texts == ["ready"]


def test_ready_vehicle_stays_on_the_ground_until_the_swarm_gathers() -> None:
    bench = ready().seconds(5.0)
    assert bench.state is S.READY
    assert bench.asked == []


@pytest.mark.parametrize("missing", [{"ready": False}, {"position": False}, {"heartbeat": False}])
def test_ready_vehicle_that_loses_what_it_needs_waits_again(missing: dict[str, Any]) -> None:
    assert ready().seconds(HEARTBEAT_LOST_S + 0.2, **missing).state is S.WAITING


@pytest.mark.parametrize("mode", [M.OTHER, M.HOLD, M.TAKEOFF])
def test_vehicle_that_the_pilot_took_off_with_before_the_swarm_is_left_alone(mode: FlightMode) -> None:
    bench = ready().tick(armed=True, mode=mode, landed=LandedState.IN_AIR, altitude_m=5.0)
    assert bench.state is S.WAITING
    assert bench.seconds(3.0, phase=P.GATHER).asked == []
    assert bench.state is S.RELEASED


@pytest.mark.parametrize("phase", list(SwarmPhase))
def test_vehicle_in_the_air_is_not_taken_for_grounded_while_the_landed_state_is_unknown(phase: SwarmPhase) -> None:
    bench = Bench(armed=True, landed=LandedState.UNDEFINED, altitude_m=8.0, phase=phase).seconds(3.0)
    assert bench.state is S.WAITING
    assert bench.asked == []


@pytest.mark.parametrize("phase", [P.GATHER, P.TRANSIT, P.COVERAGE, P.RETURN])
def test_ready_vehicle_takes_off_with_the_swarm_or_after_it(phase: SwarmPhase) -> None:
    bench = ready().tick(phase=phase)
    assert bench.state is S.TAKING_OFF
    assert bench.texts == ["taking off to 8.0 m"]


def test_ready_vehicle_does_not_take_off_to_land() -> None:
    assert ready().tick(5, phase=P.LAND).state is S.READY
    assert ready().tick(5, phase=P.GATHER, land_now=True).state is S.READY


# --- takeoff ---


def test_arms_then_takes_off_to_the_missions_altitude() -> None:
    bench = taking_off().tick()
    assert bench.asked == [Ask(Request.ARM)]
    bench.tick(armed=True)
    # The mode is still HOLD: armed is shown, so the takeoff may be asked for.
    bench.seconds(RETRY_S)
    assert bench.asked == [Ask(Request.TAKEOFF, ALTITUDE_M)]


def test_request_is_repeated_every_second_and_a_half_until_it_shows() -> None:
    bench = taking_off().seconds(4 * RETRY_S)
    assert bench.requests == [Request.ARM] * 4


TEMPORARY = [Result.TEMPORARILY_REJECTED, Result.FAILED, Result.CANCELLED]
FOR_GOOD = [Result.DENIED, Result.UNSUPPORTED]


@pytest.mark.parametrize("result", TEMPORARY)
@pytest.mark.parametrize("text_first", [True, False])
def test_temporary_refusal_is_said_three_times_with_the_autopilots_reason_and_tried_on(
    result: Result, text_first: bool
) -> None:
    bench = asked_to_arm()
    texts: list[str] = []
    for _ in range(6):
        events = [AutopilotText(2, "Arm: compass"), Answer(Request.ARM, result)]
        for event in events if text_first else reversed(events):
            bench.flight.receive(event, bench.now_s)
        bench.seconds(RETRY_S + TICK_S)
        assert bench.requests == [Request.ARM]
        texts += bench.texts
    assert texts == [f"arm refused ({result.name}): Arm: compass"] * REFUSALS_SAID


def test_all_reasons_of_a_refusal_are_said_each_once_and_none_that_is_old_or_no_warning() -> None:
    bench = taking_off()
    bench.flight.receive(AutopilotText(2, "PreArm: from before"), bench.now_s)
    bench.tick()
    bench.flight.receive(Answer(Request.ARM, Result.FAILED), bench.now_s)
    for severity, text in [(2, "Arm: gyros"), (6, "EKF3 initialised"), (2, "Arm: home"), (2, "Arm: gyros")]:
        bench.flight.receive(AutopilotText(severity, text), bench.now_s)
    assert bench.seconds(0.5).texts == ["arm refused (FAILED): Arm: gyros; Arm: home"]


@pytest.mark.parametrize("result", FOR_GOOD)
@pytest.mark.parametrize(
    "make", [lambda: asked_to_arm(), lambda: asked_to_arm().seconds(2 * RETRY_S, armed=True)], ids=["arm", "takeoff"]
)
def test_permanent_refusal_on_the_ground_releases_the_vehicle_and_says_why(make: Any, result: Result) -> None:
    bench = make()
    request = Request.TAKEOFF if bench.armed else Request.ARM
    bench.flight.receive(Answer(request, result), bench.now_s)
    bench.flight.receive(AutopilotText(2, "never"), bench.now_s)
    bench.seconds(5.0)
    assert bench.state is S.RELEASED
    assert bench.asked == []
    assert f"released: {request.value} denied" in bench.texts
    assert f"{request.value} refused ({result.name}): never" in bench.texts


@pytest.mark.parametrize("result", FOR_GOOD)
def test_permanent_refusal_of_offboard_in_flight_releases_the_vehicle(result: Result) -> None:
    bench = streaming()
    while not bench.asked:
        bench.tick()
    bench.flight.receive(Answer(Request.OFFBOARD, result), bench.now_s)
    bench.seconds(3.0)
    assert bench.state is S.RELEASED
    assert not bench.flight.steers
    assert bench.asked == []


@pytest.mark.parametrize("result", list(Result))
def test_landing_is_asked_for_whatever_the_answer(result: Result) -> None:
    bench = landing()
    wait_s = RETRY_S
    for _ in range(20):
        bench.seconds(wait_s)
        assert bench.requests == [Request.LAND]
        bench.flight.receive(Answer(Request.LAND, result), bench.now_s)
        wait_s = PX4.traits.mode_shows_s + TICK_S if result in (Result.ACCEPTED, Result.IN_PROGRESS) else RETRY_S


def test_after_a_permanent_refusal_an_operator_may_have_it_tried_again() -> None:
    bench = asked_to_arm()
    bench.flight.receive(Answer(Request.ARM, Result.DENIED), bench.now_s)
    bench.seconds(3.0)
    bench.flight.hand_back()
    assert bench.seconds(1.0).requests == [Request.ARM]


def test_answer_to_someone_elses_request_changes_nothing() -> None:
    bench = asked_to_arm()
    for request in (Request.TAKEOFF, Request.OFFBOARD, Request.LAND):
        bench.flight.receive(Answer(request, Result.DENIED), bench.now_s)
    assert bench.seconds(1.0).texts == []
    assert bench.state is S.TAKING_OFF


def test_no_answer_is_said_three_times_and_asked_again() -> None:
    bench = asked_to_arm().seconds(6 * (RETRY_S + TICK_S))
    assert bench.requests == [Request.ARM] * 6
    assert bench.texts == ["arm not answered"] * REFUSALS_SAID


@pytest.mark.parametrize("result", [Result.ACCEPTED, Result.IN_PROGRESS])
def test_acceptance_is_news_only_when_nothing_comes_of_it(result: Result) -> None:
    bench = asked_to_arm()
    bench.flight.receive(Answer(Request.ARM, result), bench.now_s)
    assert bench.seconds(PX4.traits.mode_shows_s - 0.1).texts == []
    assert bench.seconds(0.1 + REASON_S + 0.1).texts == [f"arm answered {result.name}, without effect"]


def test_acceptance_alone_changes_nothing_only_the_heartbeat_counts() -> None:
    bench = taking_off().tick()
    bench.flight.receive(Answer(Request.ARM, Result.ACCEPTED), bench.now_s)
    bench.seconds(2 * RETRY_S)
    assert Request.TAKEOFF not in bench.requests
    assert Request.ARM in bench.requests


def test_no_setpoints_before_the_climb_is_done() -> None:
    assert not climbing().tick(20).flight.steers


def test_climb_done_starts_the_setpoints_and_only_then_offboard_is_asked_for() -> None:
    bench = streaming()
    assert bench.flight.steers
    started_s = bench.now_s
    while not bench.asked:
        bench.tick()
        assert bench.flight.steers
        assert bench.state is S.HOLD
    assert bench.asked == [Ask(Request.OFFBOARD)]
    assert bench.now_s - started_s >= ARDUPILOT.traits.stream_first_s - 1e-9


def test_autopilot_may_still_show_takeoff_while_offboard_is_asked_for() -> None:
    bench = streaming().seconds(1.0, mode=M.TAKEOFF)
    assert bench.state is S.HOLD
    assert bench.requests == [Request.OFFBOARD]


def test_takeoff_that_ends_low_is_the_pilots_doing() -> None:
    bench = climbing().tick(mode=M.HOLD, altitude_m=0.5 * ALTITUDE_M)
    assert bench.state is S.RELEASED


def test_vehicle_that_disarms_in_its_takeoff_is_done_and_says_so() -> None:
    bench = climbing().tick(armed=False)
    assert bench.state is S.LANDED
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.ERROR, "disarmed in takeoff")]


def test_guided_first_then_arming_then_the_climb() -> None:
    bench = guided().seconds(0.5)
    assert bench.requests == [Request.OFFBOARD]
    assert bench.seconds(RETRY_S, mode=M.OFFBOARD).requests == [Request.ARM]
    assert bench.seconds(RETRY_S + TICK_S, armed=True).asked == [Ask(Request.TAKEOFF, ALTITUDE_M)]


def test_setpoints_stream_before_guided_and_not_from_the_takeoff_to_the_top() -> None:
    bench = guided().tick()
    assert bench.flight.steers
    assert bench.asked == []
    assert bench.seconds(1.0).flight.steers
    assert bench.seconds(RETRY_S, mode=M.OFFBOARD).flight.steers
    while Request.TAKEOFF not in bench.requests:
        assert bench.flight.steers
        bench.tick(armed=True)
    for altitude_m in (0.0, 1.0, 4.0, 7.9):
        bench.seconds(2.0, altitude_m=altitude_m, landed=LandedState.TAKEOFF)
        assert not bench.flight.steers
        assert bench.asked == []
    assert bench.tick(altitude_m=ALTITUDE_M, landed=LandedState.IN_AIR).flight.steers
    assert bench.state is S.HOLD
    assert bench.tick(2).state is S.GATHERING
    assert bench.seconds(3.0).asked == []


def test_guided_climb_that_ends_low_is_the_pilots_doing() -> None:
    assert guided_climb().tick(landed=LandedState.IN_AIR).state is S.RELEASED


def test_takeoff_refused_in_guided_is_asked_for_again_without_setpoints() -> None:
    bench = guided().seconds(0.5).seconds(RETRY_S, mode=M.OFFBOARD)
    while Request.TAKEOFF not in bench.requests:
        bench.tick(armed=True)
    bench.flight.receive(Answer(Request.TAKEOFF, Result.FAILED), bench.now_s)
    assert bench.seconds(RETRY_S + TICK_S).requests == [Request.TAKEOFF]
    assert bench.texts == ["takeoff refused (FAILED)"]
    assert not bench.flight.steers


@pytest.mark.parametrize("answer", [Result.ACCEPTED, Result.IN_PROGRESS])
def test_accepted_takeoff_is_given_time_to_spool_up(answer: Result) -> None:
    bench = guided().seconds(0.5).seconds(RETRY_S, mode=M.OFFBOARD)
    while Request.TAKEOFF not in bench.requests:
        bench.tick(armed=True)
    bench.flight.receive(Answer(Request.TAKEOFF, answer), bench.now_s)
    assert bench.seconds(PX4.traits.climb_shows_s - 0.1).asked == []
    assert bench.seconds(0.2).requests == [Request.TAKEOFF]


@pytest.mark.parametrize("make", [taking_off, guided])
def test_vehicle_that_disarms_on_the_ground_is_not_armed_again(make: Any) -> None:
    bench = make().seconds(1.0).tick(armed=True).tick(armed=False)
    assert bench.state is S.RELEASED
    assert bench.texts == ["released: disarmed before takeoff"]
    assert bench.seconds(5.0).asked == []
