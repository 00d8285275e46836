"""One vehicle's own flight: what to ask of the autopilot, and when it may be steered.

The autopilot's modes and arming are believed from its HEARTBEAT only (`flight_modes`). Two tables run here: which state
follows which event (`flight_table`), and what goes wrong and what follows (`failsafe`): each state gathers what it
finds, and does what the row says that stands highest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, assert_never

from companion.core.model.actions import Ask, Say, brief
from companion.core.model.events import Answer, AutopilotEvent, AutopilotText
from companion.core.model.states import (
    STEERED,
    AutopilotTraits,
    FlightMode,
    FlightState,
    Request,
    Severity,
    SwarmPhase,
)
from companion.core.model.vectors import norm
from companion.core.vehicle import failsafe_engine, flight_table
from companion.core.vehicle.autopilot_state import Vehicle
from companion.core.vehicle.failsafe import Cause, Finding, Readings, Response, Source
from companion.core.vehicle.flight_modes import Climb, Modes
from companion.core.vehicle.flight_table import EVENT_OF_PHASE, EVENT_OF_RESPONSE, Effect, FlightEvent
from companion.core.vehicle.hold_reports import HoldReports
from companion.core.vehicle.obstacle_sensor_monitor import ObstacleSensorMonitor
from companion.core.vehicle.requests import AutopilotRequests
from companion.core.vehicle.waiting import Waiting

LISTENING = "in the air: listening for the swarm"
SETTLED_MPS: Final = 0.5
NOT_OURS = (FlightState.WAITING, FlightState.RELEASED, FlightState.LANDING, FlightState.LANDED)


class Flight:
    """Fed with the autopilot's events; `update_flight` returns requests and texts, `state` says where the flight is."""

    def __init__(self, takeoff_altitude_m: float, sensors: ObstacleSensorMonitor | None = None) -> None:
        self.state = FlightState.WAITING
        self.vehicle = Vehicle(sensors)
        self.grounded = ""  # why it must not arm, empty: it may; one that is in the air already flies on
        self._not_localised = ""  # why its position among the others is not known, so it neither arms nor joins
        self.cause: Cause | None = None  # why it does what it does, where that is not what the phase asks
        self._takeoff_altitude_m = takeoff_altitude_m
        self._modes = Modes(self.vehicle)
        self._requests = AutopilotRequests()
        self._listens_since_s = -1e9  # only a HEARTBEAT after it counts
        self._hold_is_ours = False  # it stalled in the HOLD that awaits OFFBOARD
        self._holds = HoldReports()
        self._steering_since_s: float | None = None  # since when setpoints have been streaming
        self._climb = Climb(self.vehicle, self._modes, takeoff_altitude_m)
        self._may_take_off, self._climb_room = False, True
        self._waiting, self._late_said = Waiting(), False
        self._said: list[Say] = []
        self._now_s = 0.0  # of this tick

    # --- what the autopilot reports ---

    def receive(self, event: AutopilotEvent, now_s: float) -> None:
        """Store one event of the vehicle's own autopilot."""
        self.vehicle.receive(event, now_s)
        if isinstance(event, AutopilotText) or isinstance(event, Answer):  # noqa: SIM101  # a union is made anew
            self._requests.receive_answer(event, now_s)

    # --- what others ask ---

    @property
    def waits_for(self) -> str:
        """The reason for which it waits, in words; empty: it does not."""
        return self._waiting.reason

    @property
    def can_lead(self) -> bool:
        """Its position is known and its autopilot obeys this companion."""
        return self.state not in NOT_OURS

    @property
    def settled(self) -> bool:
        """Steered and nearly at rest."""
        position = self.vehicle.position
        return self.state in STEERED and position is not None and norm(position.vel_ned_mps) < SETTLED_MPS

    def listens_s(self, now_s: float) -> float:
        """Time in the air, held by its autopilot, with all that it takes to be steered but a swarm."""
        return self._waiting.lasts_s(LISTENING, now_s)

    def hand_back(self) -> None:
        """Steer again, or start anew on the ground: an operator gives control back to the companion."""
        if self.state is FlightState.RELEASED:
            self._move(FlightEvent.HAND_BACK_IN_AIR if self.vehicle.airborne else FlightEvent.HAND_BACK_ON_GROUND)

    def stall(self) -> None:
        """Listen first, after a stall of this companion: the autopilot may have acted by itself."""
        self._respond(Finding(Cause.COMPANION_STALLED))

    def _interrupt(self) -> None:
        """Listen again first: the autopilot may have acted by itself.

        The climb or the landing that it has asked for is the autopilot's own, and goes on without it.
        """
        climbs = self.state is FlightState.TAKING_OFF and self._requests.request is Request.TAKEOFF
        if climbs or self.state is FlightState.LANDING:
            self._move(FlightEvent.LISTEN_ON)
            return
        hold_is_ours = self._hold_is_ours or (self.state in STEERED and self._modes.awaits_offboard)
        self._move(FlightEvent.LISTEN)
        self._hold_is_ours = hold_is_ours

    def _listen(self) -> None:
        self._steering_since_s = None
        self._listens_since_s = self.vehicle.heartbeat_s

    @property
    def _listens(self) -> bool:
        """True if no HEARTBEAT has come since it began to listen."""
        return self.vehicle.heartbeat_s <= self._listens_since_s

    def ground(self, why: str) -> None:
        """The preflight forbids to arm; empty: it does not. A vehicle in the air flies on."""
        self.grounded = why

    # --- one tick ---

    def update_flight(
        self,
        phase: SwarmPhase,
        now_s: float,
        *,
        findings: Sequence[Finding],
        may_join: bool,
        may_take_off: bool,
        climb_room: bool = True,
        not_localised: str = "",
    ) -> list[Ask | Say]:
        """Advance. `findings`: all that is found now, its own among them; `may_join`: a leader is known and flies.

        `may_take_off`: by the operator's order; `climb_room`: nobody is in the way of its climb, above or beside, where
        it takes off; `not_localised`: why its position among the others is not known.
        """
        self._not_localised, self._now_s = not_localised, now_s
        self._may_take_off, self._climb_room = may_take_off, climb_room
        asks: list[Ask | Say] = []
        self._mind_silence(now_s)
        self._mind_lateness()
        match self.state:
            case FlightState.WAITING:
                asks += self._wait(now_s, findings, may_join=may_join)
            case FlightState.READY:
                asks += self._ready(phase, now_s, findings)
            case FlightState.TAKING_OFF:
                asks += self._take_off(phase, now_s, findings)
            case FlightState.LANDING:
                asks += self._land(now_s)
            case FlightState.RELEASED | FlightState.LANDED:
                self._steering_since_s = None
            case _:
                asks += self._steer_vehicle(phase, now_s, findings)
        said, self._said = self._said, []
        return [*asks, *said, *self._requests.says(now_s)]

    @property
    def steers(self) -> bool:
        """Setpoints are to be sent."""
        return self._steering_since_s is not None

    def _mind_silence(self, now_s: float) -> None:
        """An autopilot that says nothing may be sent nothing: it cannot be known what it does with it."""
        asked_of_it = self.state in STEERED or self.state in (FlightState.TAKING_OFF, FlightState.LANDING)
        if asked_of_it and not self._listens:
            link = Readings(silence_s=self.vehicle.silence_s(now_s), steers=self.steers)
            for found in failsafe_engine.detect(Source.LINK, link):
                self._respond(found)

    def _mind_lateness(self) -> None:
        """Said once each time, whatever the flight does: a relay's backlog is the operator's to mend."""
        delay = self.vehicle.delay
        if delay.late and not self._late_said and self.vehicle.armed:
            late = Readings(telemetry_late=True, telemetry_late_s=delay.late_s)
            self._report_finding(failsafe_engine.detect(Source.AUTOPILOT, late)[0])
        self._late_said = delay.late and self.vehicle.armed

    def _wait(self, now_s: float, findings: Sequence[Finding], *, may_join: bool) -> list[Ask | Say]:
        reason = self._missing(now_s)
        if self.vehicle.armed and self.vehicle.airborne:
            # Restarted in flight, or recovering: listen first. Any mode but those is the pilot's.
            heard = not self._listens and not self.vehicle.heartbeat_lost(now_s)
            after_climb = self._hold_is_ours and self._modes.is_in(FlightMode.HOLD)
            ours = self._modes.follows_or_holds or after_climb
            if heard and self._left_off(findings if ours else [*findings, self._modes.find_mode_change()]):
                return []
            reason = reason or ("" if heard else "no autopilot heartbeat")
            if heard and not after_climb:
                self._hold_is_ours = False  # OFFBOARD has shown: a HOLD after it has another reason
            if not reason and may_join:
                self._move(FlightEvent.JOIN)
                self._report_text(Severity.NOTICE, "in the air, swarm heard: joining")
            reason = reason or LISTENING
        elif not reason and self.vehicle.armed:
            reason = "armed, but not by this companion"
        elif not reason:
            self._move(FlightEvent.CHECKS_PASS)
            self._report_text(Severity.INFO, "ready")
            return []
        return self._report_wait(reason, now_s)

    def _report_wait(self, reason: str, now_s: float) -> list[Ask | Say]:
        """Wait, and ask for nothing; the reason is said once when it lasts."""
        if self._waiting.update(reason, now_s):
            self._report_text(Severity.INFO, brief(f"waiting: {reason}"))
        return []

    def _missing(self, now_s: float) -> str:
        grounded = f"grounded, {self.grounded}" if self.grounded and not self.vehicle.airborne else ""
        return self.vehicle.missing(now_s) or grounded or self._not_localised

    def _ready(self, phase: SwarmPhase, now_s: float, findings: Sequence[Finding]) -> list[Ask | Say]:
        if self._missing(now_s) or self.vehicle.armed:  # armed: not by this companion
            self._move(FlightEvent.CHECKS_FAIL)
            return []
        if self._may_begin(phase, now_s, findings):
            self._move(FlightEvent.TAKE_OFF)
            return [Say(Severity.NOTICE, f"taking off to {self._takeoff_altitude_m:.1f} m")]
        return []

    def _may_begin(self, phase: SwarmPhase, now_s: float, findings: Sequence[Finding]) -> bool:
        """On the ground: it lacks nothing, its operator and its phase have it fly, and no failsafe would land it."""
        lands = failsafe_engine.demands(failsafe_engine.decide(findings), Response.LAND)
        flies = self._may_take_off and SwarmPhase.GATHER <= phase < SwarmPhase.LAND
        return flies and not lands and not self._missing(now_s)

    def _take_off(self, phase: SwarmPhase, now_s: float, findings: Sequence[Finding]) -> list[Ask | Say]:
        assert self.vehicle.mode is not None
        if self._listens:
            return []
        how = self.vehicle.mode.traits
        if how is None:
            self._respond(self._modes.find_mode_change())
            return []
        if self._left_off([*findings, *self._climb.findings(how)]):
            return []
        if self._climb.seen:
            if not self.vehicle.climbs_by_itself or not self._climb_room:  # steered it gives way, and climbs on
                self._move(FlightEvent.CLIMB_ENDS)
            return []
        if self._requests.request is not Request.TAKEOFF and self._requests.may_ask(how, now_s):
            if not self._may_begin(phase, now_s, findings):  # as it is asked for again, for as long as it is refused
                self._move(FlightEvent.CHECKS_FAIL)
                return []
            if not self._climb_room and not self.vehicle.armed:
                return self._report_wait("a vehicle above", now_s)
            self._waiting.clear()
        return self._next_step(how, now_s)

    def _next_step(self, how: AutopilotTraits, now_s: float) -> list[Ask | Say]:
        """Ask for the first step that does not show yet."""
        assert self.vehicle.mode is not None
        shown = {Request.OFFBOARD: self.vehicle.mode.mode is FlightMode.OFFBOARD, Request.ARM: self.vehicle.armed}
        step = next(step for step in how.takeoff if not shown.get(step))
        if step is Request.OFFBOARD:
            if self._steering_since_s is None:
                self._steering_since_s = now_s
            if now_s - self._steering_since_s < how.stream_first_s:
                return []
        if step is not Request.TAKEOFF:
            return self._send_request(Ask(step), now_s)
        asks = self._send_request(Ask(step, self._takeoff_altitude_m), now_s)
        if asks:
            self._steering_since_s = None  # a setpoint would interrupt the climb
        return asks

    def _steer_vehicle(self, phase: SwarmPhase, now_s: float, findings: Sequence[Finding]) -> list[Ask | Say]:
        assert self.vehicle.mode is not None
        if self._listens:  # handed back: the mode that is known may be from before
            if self.vehicle.heartbeat_lost(now_s):
                self._move(FlightEvent.LISTEN)
            return []
        if self._steering_since_s is None:
            self._steering_since_s = now_s
        streams_s = now_s - self._steering_since_s
        self._modes.see_offboard()
        active = [*findings, *self._modes.findings(now_s, streams_s)]
        if self._left_off(active):
            return []
        found = failsafe_engine.decide(active)
        self.cause = None if found is None else found.cause
        if failsafe_engine.demands(found, Response.STREAM):
            return []
        news = self._holds.update(found, now_s)
        if news is not None:
            self._report_finding(news)
        traits = self.vehicle.mode.traits
        streamed = traits is not None and streams_s >= traits.stream_first_s
        if self.vehicle.mode.mode is not FlightMode.OFFBOARD and streamed:
            return self._send_request(Ask(Request.OFFBOARD), now_s)
        held = failsafe_engine.demands(found, Response.HOLD) or failsafe_engine.demands(found, Response.REST)
        follows = FlightEvent.SEEK if failsafe_engine.demands(found, Response.SEEK) else EVENT_OF_PHASE[phase]
        self._move(follows if self._modes.offboard_seen and not held else FlightEvent.HOLD)
        return []

    def _land(self, now_s: float) -> list[Ask | Say]:
        assert self.vehicle.mode is not None
        may_still_arm = not self._climb.armed_seen and self.vehicle.heartbeat_s < self._requests.arm_shows_by_s
        if not self.vehicle.armed and not may_still_arm:
            self._move(FlightEvent.DISARM)
            return [Say(Severity.NOTICE, "landed")]
        if self._listens or not self.vehicle.armed:
            return []
        # What was asked for just before the landing may still show, and so may a failsafe.
        late = {FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD} if not self._modes.offboard_seen else set()
        expected = not self._modes.left and (self._modes.follows_or_holds or self.vehicle.mode.mode in late)
        if not expected and self._modes.is_anothers(FlightMode.LAND):
            self._respond(self._modes.find_mode_change())
            return []
        if self.vehicle.mode.mode is not FlightMode.OFFBOARD:
            self._steering_since_s = None
        if self.vehicle.mode.mode is FlightMode.LAND:
            return []
        return self._send_request(Ask(Request.LAND), now_s)

    # --- what the table of failsafes asks for ---

    def _left_off(self, findings: Sequence[Finding]) -> bool:
        """Follow the table's row if the findings end what this state does; True if so."""
        found = failsafe_engine.decide(findings)
        if found is None or failsafe_engine.row(found.cause).response not in EVENT_OF_RESPONSE:
            return False
        self._respond(found)
        return True

    def _respond(self, found: Finding) -> None:
        """Do what the cause's row says, and say so. While it steers, rest and hold are `_steer_vehicle`'s."""
        self._report_finding(found)
        if self.state in (FlightState.RELEASED, FlightState.LANDED):  # nothing is left to be done
            return
        response = failsafe_engine.row(found.cause).response
        if response is Response.LISTEN:
            self._interrupt()
        elif response in EVENT_OF_RESPONSE:
            self._move(EVENT_OF_RESPONSE[response])
        self.cause = found.cause

    def _report_finding(self, found: Finding) -> None:
        text = failsafe_engine.text(found)
        if text:
            self._report_text(failsafe_engine.row(found.cause).severity, text)

    def _send_request(self, ask: Ask, now_s: float) -> list[Ask | Say]:
        if self._requests.refused_for_good:
            for found in failsafe_engine.detect(Source.REQUEST, Readings(refused=ask.request.value)):
                self._respond(found)
            return []
        mode, asked_to_land = self.vehicle.mode, self._requests.request is Request.LAND
        if mode is None or mode.traits is None:
            return []
        if self.vehicle.heartbeat_lost(now_s) and (ask.request is not Request.LAND or asked_to_land):
            return []  # its pilot may have it by now: even a landing is asked for but once
        return [*self._requests.send_request(ask, mode.traits, now_s)]

    def _move(self, event: FlightEvent) -> None:
        """Follow the row of the table of flight states."""
        row = flight_table.transition(self.state, event)
        if row.state is not self.state:
            self.state = row.state
            self._waiting.clear()
            self._requests.reset()
            self._modes.begin()
            self._hold_is_ours = False
        for effect in row.effects:
            self._apply(effect)

    def _apply(self, effect: Effect) -> None:
        match effect:
            case Effect.START_OVER:
                self._climb.start_over()
                self._modes.offboard_seen = False
                self._holds.reset()
            case Effect.LISTEN:
                self._listen()
            case Effect.STOP:
                self._steering_since_s = None
            case Effect.STREAM:
                self._steering_since_s = self._now_s
            case Effect.CLIMBS_ON:
                self._climb.stalled = True
            case Effect.AWAIT_FAILSAFE_END:
                self._modes.failsafe_may_end = True
            case Effect.OVERRULE_FAILSAFE:
                self._modes.failsafe_overruled = True
            case Effect.CLEAR_CAUSE:
                self.cause = None
            case _:
                assert_never(effect)

    def _report_text(self, severity: Severity, text: str) -> None:
        self._said.append(Say(severity, text))
