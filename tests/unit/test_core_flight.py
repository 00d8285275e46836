"""One vehicle's own flight: every state, what leads out of it, and what is asked of the autopilot on the way."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import pytest

from companion.core.failsafe import CRITICAL_BATTERY_PERCENT, Cause, Finding
from companion.core.flight import (
    PREFLIGHT_STREAM_S,
    STEERED,
    WAIT_SAID_S,
    Flight,
)
from companion.core.modes import FAILSAFE_ENDS_S
from companion.core.requests import EFFECT_S, REASON_S, REFUSALS_SAID, RETRY_S, SPOOL_UP_S
from companion.core.types import (
    CLIMBS_IN_OFFBOARD,
    CLIMBS_IN_TAKEOFF,
    Answer,
    Ask,
    AutopilotHealth,
    AutopilotMode,
    AutopilotText,
    FlightMode,
    FlightState,
    Landed,
    LandedState,
    Position,
    Request,
    Result,
    Say,
    Severity,
    SwarmPhase,
    Takeoff,
)
from companion.core.vehicle import AIRBORNE_COUNTS_S, GAP_SHOWN_S, HEARTBEAT_LOST_S, POSITION_LOST_S, SILENT_S

ALTITUDE_M = 8.0
TICK_S = 0.05
S, M, P = FlightState, FlightMode, SwarmPhase
AIRBORNE = [S.HOLD, S.GATHERING, S.TRANSIT, S.COVERAGE, S.RETURNING]
PHASE_OF = {
    S.HOLD: P.ASSEMBLE,
    S.GATHERING: P.GATHER,
    S.TRANSIT: P.TRANSIT,
    S.COVERAGE: P.COVERAGE,
    S.RETURNING: P.RETURN,
}


@dataclass
class Bench:
    """A Flight and what its autopilot tells it; each `tick` repeats position and heartbeat unless told not to."""

    flight: Flight = field(default_factory=lambda: Flight(ALTITUDE_M))
    now_s: float = 100.0
    mode: FlightMode = FlightMode.HOLD
    armed: bool = False
    failsafe: bool = False
    takeoff: Takeoff | None = CLIMBS_IN_TAKEOFF
    altitude_m: float = 0.0
    ready: bool = True
    battery_percent: int | None = 80
    landed: LandedState = LandedState.ON_GROUND
    heartbeat: bool = True
    position: bool = True
    silent: bool = False  # no message at all
    late_s: float = 0.0  # of the positions
    boot_at_s: float = 90.0  # when the autopilot was started
    phase: SwarmPhase = SwarmPhase.ASSEMBLE
    land_now: bool = False
    hold: bool = False
    may_join: bool = False
    speed_mps: float = 0.0
    asked: list[Ask] = field(default_factory=list)
    said: list[Say] = field(default_factory=list)

    def tick(self, n: int = 1, **changes: Any) -> Bench:
        """`n` ticks after these changes; `asked` and `said` are of these ticks."""
        for name, value in changes.items():
            setattr(self, name, value)
        self.asked, self.said = [], []
        for _ in range(n):
            self.now_s += TICK_S
            if not self.silent:
                self._tell()
            found = self.flight.vehicle.findings(self.now_s)
            found += [Finding(Cause.LAND_ALL)] * self.land_now + [Finding(Cause.NO_LEADER)] * self.hold
            out = self.flight.step(self.phase, self.now_s, findings=found, may_join=self.may_join)
            self.asked += [a for a in out if isinstance(a, Ask)]
            self.said += [a for a in out if isinstance(a, Say)]
        return self

    def _tell(self) -> None:
        if self.heartbeat:
            name = self.mode.value.upper()
            self.flight.receive(AutopilotMode(self.mode, self.armed, name, self.failsafe, self.takeoff), self.now_s)
        if self.position:
            boot_s = self.now_s - self.late_s - self.boot_at_s
            here = Position((0.0, 0.0, -self.altitude_m), (self.speed_mps, 0.0, 0.0), boot_s)
            self.flight.receive(here, self.now_s)
        self.flight.receive(AutopilotHealth(self.ready, self.battery_percent), self.now_s)
        self.flight.receive(Landed(self.landed), self.now_s)

    def seconds(self, seconds: float, **changes: Any) -> Bench:
        return self.tick(round(seconds / TICK_S), **changes)

    @property
    def state(self) -> FlightState:
        return self.flight.state

    @property
    def requests(self) -> list[Request]:
        return [ask.request for ask in self.asked]

    @property
    def texts(self) -> list[str]:
        return [say.text for say in self.said]


def ready() -> Bench:
    bench = Bench().tick(2)
    assert bench.state is S.READY
    return bench


def taking_off() -> Bench:
    bench = ready().tick(phase=P.GATHER)
    assert bench.state is S.TAKING_OFF
    return bench


def asked_to_climb(mode: FlightMode = M.HOLD) -> Bench:
    """Armed, on the ground, in the mode it was switched on with; the take-off was asked for and does not show yet."""
    bench = Bench(mode=mode).tick(2).tick(2, phase=P.GATHER)
    while Request.TAKEOFF not in bench.requests:
        bench.tick(armed=True)
    assert bench.state is S.TAKING_OFF
    return bench


def climbing() -> Bench:
    bench = asked_to_climb().tick(mode=M.TAKEOFF, landed=LandedState.IN_AIR, altitude_m=3.0)
    assert bench.state is S.TAKING_OFF
    return bench


def streaming() -> Bench:
    """At altitude, steered, but not yet in OFFBOARD."""
    bench = climbing().tick(mode=M.HOLD, altitude_m=ALTITUDE_M)
    assert bench.state is S.HOLD
    return bench


def steered(state: FlightState) -> Bench:
    bench = streaming().tick(2, mode=M.OFFBOARD, phase=PHASE_OF[state], hold=state is S.HOLD)
    assert bench.state is state
    return bench


def landing() -> Bench:
    bench = steered(S.TRANSIT).tick(land_now=True)
    assert bench.state is S.LANDING
    return bench


def landed() -> Bench:
    bench = landing().tick(mode=M.LAND).tick(armed=False, landed=LandedState.ON_GROUND, altitude_m=0.0)
    assert bench.state is S.LANDED
    return bench


def released() -> Bench:
    bench = steered(S.TRANSIT).tick(mode=M.OTHER)
    assert bench.state is S.RELEASED
    return bench


def held_by_failsafe() -> Bench:
    """Its companion stalled, and its autopilot holds because setpoints stopped."""
    bench = steered(S.TRANSIT)
    bench.flight.stall()
    bench.tick(2, mode=M.HOLD, failsafe=True)
    assert bench.state is S.WAITING
    return bench


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


def asked_to_arm() -> Bench:
    bench = taking_off().tick()
    assert bench.requests == [Request.ARM]
    return bench


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
    assert f"released: {request.value} refused for good" in bench.texts
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
        wait_s = EFFECT_S + TICK_S if result in (Result.ACCEPTED, Result.IN_PROGRESS) else RETRY_S


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
    assert bench.seconds(EFFECT_S - 0.1).texts == []
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
    assert bench.now_s - started_s >= PREFLIGHT_STREAM_S - 1e-9


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
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.ERROR, "disarmed during takeoff")]


# --- takeoff in GUIDED, as ArduPilot's ---


def guided() -> Bench:
    """Taking off, disarmed, in STABILIZE."""
    bench = Bench(mode=M.OTHER, takeoff=CLIMBS_IN_OFFBOARD).tick(2).tick(phase=P.GATHER)
    assert bench.state is S.TAKING_OFF
    return bench


def guided_climb() -> Bench:
    bench = guided().seconds(0.5).seconds(RETRY_S, mode=M.OFFBOARD).seconds(2 * RETRY_S, armed=True)
    bench.tick(landed=LandedState.TAKEOFF, altitude_m=3.0)
    assert bench.state is S.TAKING_OFF
    return bench


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
    assert bench.seconds(SPOOL_UP_S - 0.1).asked == []
    assert bench.seconds(0.2).requests == [Request.TAKEOFF]


@pytest.mark.parametrize("make", [taking_off, guided])
def test_vehicle_that_disarms_on_the_ground_is_not_armed_again(make: Any) -> None:
    bench = make().seconds(1.0).tick(armed=True).tick(armed=False)
    assert bench.state is S.RELEASED
    assert bench.texts == ["released: disarmed before takeoff"]
    assert bench.seconds(5.0).asked == []


# --- whom the companion does not fly ---


def test_unknown_autopilot_is_said_and_never_armed() -> None:
    bench = Bench(takeoff=None, phase=P.GATHER).seconds(10.0)
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
        ("position", POSITION_LOST_S, "holding: no position"),
        ("heartbeat", HEARTBEAT_LOST_S, "holding: no autopilot heartbeat"),
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
        (Severity.WARNING, f"released to the pilot: mode {mode.value.upper()}")
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
    assert bench.texts == ["autopilot holds by its failsafe; resynchronising"]
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
    bench.seconds(FAILSAFE_ENDS_S - 0.5)
    assert (bench.state, bench.asked, bench.flight.steers) == (S.HOLD, [], True)
    assert bench.tick(2, mode=M.OFFBOARD, failsafe=False).state is S.TRANSIT
    assert bench.tick(mode=M.HOLD, failsafe=True).state is S.RELEASED  # another one


@pytest.mark.parametrize("restarted", [False, True])
def test_failsafe_that_setpoints_do_not_end_has_another_cause_and_releases_the_vehicle(restarted: bool) -> None:
    bench = held_by_failsafe()
    if restarted:
        bench.flight = Flight(ALTITUDE_M)
        bench.tick(2)
    bench.seconds(FAILSAFE_ENDS_S + 0.2, may_join=True)
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
    bench.seconds(FAILSAFE_ENDS_S + 3.0)
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


# --- interrupted ---


@pytest.mark.parametrize("takeoff", [CLIMBS_IN_TAKEOFF, CLIMBS_IN_OFFBOARD])
def test_restarted_companion_whose_autopilot_still_follows_setpoints_joins(takeoff: Takeoff) -> None:
    bench = Bench(mode=M.OFFBOARD, armed=True, landed=LandedState.IN_AIR, altitude_m=8.0, takeoff=takeoff)
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
    assert bench.texts == ["companion stalled; resynchronising", "released: disarmed before takeoff"]
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
        bench.flight.receive(AutopilotMode([M.OFFBOARD, M.HOLD][heard_before], True, "BRAKE"), bench.now_s)
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
    assert re.fullmatch(r"autopilot silent for 1\.[01] s: setpoints stopped", said.text)
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
    assert bench.texts == ["holding: no position"]
    assert bench.tick(position=True, late_s=0.7).texts == ["telemetry 0.7 s late"]


def test_vehicle_whose_telemetry_is_late_neither_takes_off_nor_joins_but_lands_when_ordered() -> None:
    bench = ready().seconds(1.0, late_s=1.0).seconds(1.0, phase=P.GATHER)
    assert (bench.state, bench.asked) == (S.WAITING, [])
    bench = held_by_failsafe().seconds(0.5, late_s=1.0)
    assert bench.texts == ["telemetry 1.0 s late"]
    bench.seconds(5.0, may_join=True)
    assert bench.state is S.WAITING
    assert bench.tick(2, land_now=True).requests == [Request.LAND]


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
    assert [(s.severity, s.text) for s in bench.said] == [(Severity.NOTICE, "disarmed: on the ground")]
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
    assert frozenset(AIRBORNE) == STEERED


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
    bench.flight.grounded = "no preflight"
    bench.seconds(WAIT_SAID_S + 1.0, phase=P.GATHER)
    assert (bench.state, bench.requests, bench.texts) == (S.WAITING, [], ["waiting: grounded, no preflight"])
    bench.flight.grounded = ""
    assert bench.seconds(0.5).requests == [Request.ARM]


def test_grounded_companion_that_starts_again_in_the_air_rejoins() -> None:
    bench = Bench(landed=LandedState.IN_AIR, armed=True, failsafe=True, altitude_m=8.0, phase=P.TRANSIT, may_join=True)
    bench.flight.grounded = "preflight is 13 h old"
    assert bench.tick(2).texts == ["in the air, swarm heard: joining"]
    assert bench.seconds(1.0).flight.steers
