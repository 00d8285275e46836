"""One vehicle's own flight: what to ask of the autopilot, and when it may be steered.

The autopilot's modes and arming are believed from its HEARTBEAT only. A mode that this companion did not ask for is the
pilot's: setpoints stop, and nothing is asked of the autopilot until an operator hands control back.
"""

from __future__ import annotations

from companion.core.types import (
    Answer,
    Ask,
    AutopilotEvent,
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
)

HEARTBEAT_LOST_S = 3.0  # the autopilot sends one a second
POSITION_LOST_S = 0.5
RETRY_S = 1.5  # a mode change shows up to 1 s late in PX4's HEARTBEAT
REFUSALS_SAID = 3  # the first few reach the operator; all are retried
WAIT_SAID_S = 3.0  # an autopilot boots for longer than it is worth a word; ArduPilot's readiness takes 40 s
SETTLED_MPS = 0.5
TAKEOFF_SHORT_M, TAKEOFF_SHORT_SHARE = 1.0, 0.1  # how far below the altitude it may end; PX4 stops 0.8 m short
PREFLIGHT_STREAM_S = 0.3  # setpoints before OFFBOARD is asked for; PX4 wants two or three

PILOTS_MODES = frozenset({FlightMode.OTHER, FlightMode.RETURN})  # never asked for by a companion
STEERED = frozenset(
    {
        FlightState.GATHERING,
        FlightState.TRANSIT,
        FlightState.COVERAGE,
        FlightState.RETURNING,
        FlightState.HOLD,
    }
)
STATE_OF_PHASE = {
    SwarmPhase.ASSEMBLE: FlightState.HOLD,
    SwarmPhase.GATHER: FlightState.GATHERING,
    SwarmPhase.TRANSIT: FlightState.TRANSIT,
    SwarmPhase.COVERAGE: FlightState.COVERAGE,
    SwarmPhase.RETURN: FlightState.RETURNING,
    SwarmPhase.LAND: FlightState.HOLD,
}


class Flight:
    """Feed it the autopilot's events; `step` returns what to ask and say, `state` says where the flight is."""

    def __init__(self, takeoff_altitude_m: float) -> None:
        self.state = FlightState.WAITING
        self.position: Position | None = None
        self.battery_percent: int | None = None
        self.grounded = ""  # why it must not arm; whoever is in the air already flies on
        self._takeoff_altitude_m = takeoff_altitude_m
        self._mode: AutopilotMode | None = None
        self._landed = LandedState.UNDEFINED
        self._ready_to_arm = False
        self._heartbeat_s = -1e9
        self._position_s = -1e9
        self._asked_s = -1e9
        self._steering_since_s: float | None = None  # since when setpoints have been streaming
        self._takeoff_seen = self._offboard_seen = self._land_seen = False
        self._refusals = 0
        self._last_text = ""
        self._waits_for = ""
        self._waits_since_s = 0.0
        self._wait_said = False
        self._said: list[Say] = []

    # --- what the autopilot tells ---

    def receive(self, event: AutopilotEvent, now_s: float) -> None:
        """Store one event of the vehicle's own autopilot."""
        match event:
            case Position():
                self.position, self._position_s = event, now_s
            case AutopilotMode():
                self._mode, self._heartbeat_s = event, now_s
            case AutopilotHealth():
                self._ready_to_arm, self.battery_percent = event.ready_to_arm, event.battery_percent
            case Landed():
                self._landed = event.state
            case AutopilotText():
                self._last_text = event.text
            case Answer():
                self._hear_answer(event)

    def _hear_answer(self, answer: Answer) -> None:
        if answer.result in (Result.ACCEPTED, Result.IN_PROGRESS):
            self._refusals = 0
            return
        self._refusals += 1
        if self._refusals <= REFUSALS_SAID:
            why = f": {self._last_text}" if self._last_text else ""
            self._say(Severity.WARNING, f"{answer.request.value} refused ({answer.result.name}){why}")

    # --- what others ask ---

    @property
    def can_lead(self) -> bool:
        """Its position is known and its autopilot obeys this companion."""
        return self.state not in (
            FlightState.WAITING,
            FlightState.RELEASED,
            FlightState.LANDING,
            FlightState.LANDED,
        )

    @property
    def airborne(self) -> bool:
        """In the air, whoever flies it."""
        return self._landed in (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)

    @property
    def settled(self) -> bool:
        """Steered and nearly at rest."""
        return self.state in STEERED and self.position is not None and _speed(self.position) < SETTLED_MPS

    def position_known(self, now_s: float) -> bool:
        """The autopilot's position estimate is fresh."""
        return self.position is not None and now_s - self._position_s <= POSITION_LOST_S

    def hand_back(self) -> None:
        """An operator gives control back to the companion."""
        if self.state is FlightState.RELEASED:
            self._enter(FlightState.HOLD if self.airborne else FlightState.WAITING)
            self._listen()

    def interrupt(self) -> None:
        """This companion stood still for so long that the autopilot has acted by itself: listen again first."""
        if self.state not in (FlightState.RELEASED, FlightState.LANDED):
            self._enter(FlightState.WAITING)
            self._listen()

    def _listen(self) -> None:
        self._takeoff_seen = self._offboard_seen = self._land_seen = False
        self._steering_since_s = None

    # --- one tick ---

    def step(self, phase: SwarmPhase, now_s: float, *, land_now: bool, hold: bool, may_join: bool) -> list[Ask | Say]:
        """Advance. `land_now`: land here; `hold`: do not follow the phase; `may_join`: a leader is known and flies."""
        asks: list[Ask | Say] = []
        match self.state:
            case FlightState.WAITING:
                asks += self._wait(now_s, land_now=land_now, may_join=may_join)
            case FlightState.READY:
                asks += self._ready(phase, now_s, land_now=land_now)
            case FlightState.TAKING_OFF:
                asks += self._take_off(now_s, land_now=land_now)
            case FlightState.LANDING:
                asks += self._land(now_s)
            case FlightState.RELEASED | FlightState.LANDED:
                self._steering_since_s = None
            case _:
                asks += self._steer(phase, now_s, land_now=land_now, hold=hold)
        asks += self._said
        self._said = []
        return asks

    @property
    def steers(self) -> bool:
        """Setpoints are to be sent."""
        return self._steering_since_s is not None

    def _wait(self, now_s: float, *, land_now: bool, may_join: bool) -> list[Ask | Say]:
        reason = self._missing(now_s)
        if not reason and self.airborne and self._armed:
            # Restarted in flight: listen; act only if the autopilot holds by itself, join only a swarm that flies.
            holds = self._mode is not None and self._mode.mode in (FlightMode.HOLD, FlightMode.OFFBOARD)
            if holds and land_now:
                return self._start_landing("landing")
            if holds and may_join:
                self._enter(FlightState.HOLD)
                self._say(Severity.NOTICE, "in the air, swarm heard: joining")
            reason = "in the air: listening for the swarm"
        elif not reason:
            self._enter(FlightState.READY)
            self._say(Severity.INFO, "ready")
            return []
        if reason != self._waits_for:
            self._waits_for, self._waits_since_s, self._wait_said = reason, now_s, False
        if not self._wait_said and now_s - self._waits_since_s >= WAIT_SAID_S:
            self._wait_said = True
            self._say(Severity.INFO, f"waiting: {reason}")
        return []

    def _missing(self, now_s: float) -> str:
        if now_s - self._heartbeat_s > HEARTBEAT_LOST_S:
            return "no autopilot heartbeat"
        if not self.position_known(now_s):
            return "no position"
        if self._landed is LandedState.UNDEFINED:
            return "no landed state"
        if not self._armed and not self._ready_to_arm:
            return "autopilot not ready to arm"
        if self.grounded and not self.airborne:
            return f"grounded, {self.grounded}"
        return ""

    def _ready(self, phase: SwarmPhase, now_s: float, *, land_now: bool) -> list[Ask | Say]:
        if self._missing(now_s) or (self.airborne and self._armed):  # in the air: someone else has taken off with it
            self._enter(FlightState.WAITING)
            return []
        if SwarmPhase.GATHER <= phase < SwarmPhase.LAND and not land_now:
            self._enter(FlightState.TAKING_OFF)
            return [Say(Severity.NOTICE, f"taking off to {self._takeoff_altitude_m:.1f} m")]
        return []

    def _take_off(self, now_s: float, *, land_now: bool) -> list[Ask | Say]:
        assert self._mode is not None
        assert self.position is not None
        if self._takeoff_seen and self._mode.mode in PILOTS_MODES:
            return self._release()
        if land_now:
            return self._start_landing("landing during takeoff")
        if not self._armed:
            if self._takeoff_seen:
                self._enter(FlightState.LANDED)
                return [Say(Severity.ERROR, "disarmed during takeoff")]
            return self._ask(Ask(Request.ARM), now_s)
        if self._mode.mode is FlightMode.TAKEOFF:
            self._takeoff_seen = True
            return []
        if not self._takeoff_seen:
            return self._ask(Ask(Request.TAKEOFF, self._takeoff_altitude_m), now_s)
        short_m = self._takeoff_altitude_m + self.position.pos_ned_m[2]
        reached = short_m <= max(TAKEOFF_SHORT_M, TAKEOFF_SHORT_SHARE * self._takeoff_altitude_m)
        if self._mode.mode is not FlightMode.HOLD or not reached:
            return self._release()
        self._enter(FlightState.HOLD)
        self._steering_since_s = now_s
        return []

    def _steer(self, phase: SwarmPhase, now_s: float, *, land_now: bool, hold: bool) -> list[Ask | Say]:
        assert self._mode is not None
        if self._steering_since_s is None:
            self._steering_since_s = now_s
        if not self._armed:
            self._enter(FlightState.LANDED)
            return [Say(Severity.NOTICE, "disarmed: on the ground")]
        if land_now and self._mode.mode in (FlightMode.OFFBOARD, FlightMode.HOLD, FlightMode.TAKEOFF):
            return self._start_landing("landing")
        if self._mode.mode is FlightMode.OFFBOARD:
            self._offboard_seen = True
        elif self._offboard_seen or self._mode.mode not in (FlightMode.HOLD, FlightMode.TAKEOFF):
            return self._release()
        elif now_s - self._steering_since_s >= PREFLIGHT_STREAM_S:
            return self._ask(Ask(Request.OFFBOARD), now_s)
        lost = not self.position_known(now_s) or now_s - self._heartbeat_s > HEARTBEAT_LOST_S
        if lost and self.state is not FlightState.HOLD:
            self._say(Severity.CRITICAL, f"holding: {self._missing(now_s)}")
        wanted = STATE_OF_PHASE[phase] if self._offboard_seen and not hold and not lost else FlightState.HOLD
        self._enter(wanted)
        return []

    def _land(self, now_s: float) -> list[Ask | Say]:
        assert self._mode is not None
        if not self._armed:
            self._enter(FlightState.LANDED)
            return [Say(Severity.NOTICE, "landed")]
        if self._mode.mode is FlightMode.LAND:
            self._land_seen = True
            self._steering_since_s = None
            return []
        if self._land_seen or self._mode.mode in PILOTS_MODES:
            return self._release()
        return self._ask(Ask(Request.LAND), now_s)

    def _start_landing(self, why: str) -> list[Ask | Say]:
        self._land_seen = False
        self._enter(FlightState.LANDING)
        return [Say(Severity.NOTICE, why)]

    def _release(self) -> list[Ask | Say]:
        assert self._mode is not None
        self._enter(FlightState.RELEASED)
        self._steering_since_s = None
        return [Say(Severity.WARNING, f"released to the pilot: mode {self._mode.name}")]

    def _ask(self, ask: Ask, now_s: float) -> list[Ask | Say]:
        if now_s - self._asked_s < RETRY_S:
            return []
        self._asked_s = now_s
        return [ask]

    def _enter(self, state: FlightState) -> None:
        if state is not self.state:
            self.state = state
            self._waits_for = ""
            self._asked_s = -1e9
            self._refusals = 0

    def _say(self, severity: Severity, text: str) -> None:
        self._said.append(Say(severity, text))

    @property
    def _armed(self) -> bool:
        return self._mode is not None and self._mode.armed


def _speed(position: Position) -> float:
    v = position.vel_ned_mps
    return float((v[0] ** 2 + v[1] ** 2 + v[2] ** 2) ** 0.5)
