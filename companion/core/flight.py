"""One vehicle's own flight: what to ask of the autopilot, and when it may be steered.

The autopilot's modes and arming are believed from its HEARTBEAT only. A mode that this companion did not ask for is the
pilot's: setpoints stop, and nothing is asked of the autopilot until an operator hands control back. So is a failsafe
that holds, unless this companion's setpoints did stop: then it listens, and streams again. PX4 goes back to OFFBOARD by
itself when that was the cause; when it does not, the hold has another cause, and the vehicle is released.
"""

from __future__ import annotations

from companion.core.asking import Asking
from companion.core.types import (
    STEERED,
    Answer,
    Ask,
    AutopilotEvent,
    AutopilotMode,
    AutopilotText,
    FlightMode,
    FlightState,
    LandedState,
    Position,
    Request,
    Say,
    Severity,
    SwarmPhase,
    Takeoff,
)
from companion.core.vehicle import TELEMETRY_LATE, Vehicle

LISTENING = "in the air: listening for the swarm"
WAIT_SAID_S = 3.0  # an autopilot boots for longer than it is worth a word; ArduPilot's readiness takes 40 s
SETTLED_MPS = 0.5
TAKEOFF_SHORT_M, TAKEOFF_SHORT_SHARE = 1.0, 0.1  # how far below the altitude it may end; PX4 stops 0.8 m short
PREFLIGHT_STREAM_S = 0.3  # setpoints before OFFBOARD is asked for; PX4 wants two or three
FAILSAFE_ENDS_S = 3.0  # setpoints end PX4's offboard-loss failsafe at once; one HEARTBEAT that shows it may be lost

BEFORE_OFFBOARD = frozenset({FlightMode.HOLD, FlightMode.TAKEOFF})
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
        self.vehicle = Vehicle()
        self.grounded = ""  # why it must not arm, empty: it may; one that is in the air already flies on
        self._takeoff_altitude_m = takeoff_altitude_m
        self._asking = Asking()
        self._began_in = ""  # name of the mode in which this state began
        self._left = False  # and the mode that was asked for has shown since
        self._listens_since_s = -1e9  # only a HEARTBEAT after it counts
        self._stood_still = False  # while it climbs
        self._hold_is_ours = False  # stood still in the HOLD that `_awaits_offboard`
        self._failsafe_may_end = False  # it holds because setpoints stopped, or for another reason: streaming tells
        self._late_said = False
        self._failsafe_overruled = False  # an operator has handed back a vehicle that holds by its failsafe
        self._lost_said = ""
        self._steering_since_s: float | None = None  # since when setpoints have been streaming
        self._armed_seen = self._takeoff_seen = self._offboard_seen = False
        self.waits_for = ""
        self._waits_since_s = 0.0
        self._wait_said = False
        self._said: list[Say] = []

    # --- what the autopilot tells ---

    def receive(self, event: AutopilotEvent, now_s: float) -> None:
        """Store one event of the vehicle's own autopilot."""
        self.vehicle.receive(event, now_s)
        if isinstance(event, AutopilotText | Answer):
            self._asking.hear(event, now_s)

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
    def position(self) -> Position | None:
        """The last one told, however old."""
        return self.vehicle.position

    @property
    def battery_percent(self) -> int | None:
        """0..100; None: unknown."""
        return self.vehicle.battery_percent

    @property
    def airborne(self) -> bool:
        """In the air, whoever flies it."""
        return self.vehicle.airborne

    @property
    def settled(self) -> bool:
        """Steered and nearly at rest."""
        return self.state in STEERED and self.position is not None and _speed(self.position) < SETTLED_MPS

    def position_known(self, now_s: float) -> bool:
        """The autopilot's position estimate is fresh: it came just now, and was not long under way."""
        return not self.vehicle.position_missing(now_s)

    def listens_s(self, now_s: float) -> float:
        """How long it has been in the air, held by its autopilot, with all that it takes to be steered but a swarm."""
        return now_s - self._waits_since_s if self.waits_for == LISTENING else 0.0

    def hand_back(self) -> None:
        """An operator gives control back to the companion."""
        if self.state is FlightState.RELEASED:
            self._start_over(FlightState.HOLD if self.airborne else FlightState.WAITING)
            self._failsafe_overruled = True

    def interrupt(self) -> None:
        """The autopilot has acted by itself, since this companion stood still or has not heard it: listen again first.

        The climb or the landing that it has asked for is the autopilot's own, and goes on without it.
        """
        match self.state:
            case FlightState.RELEASED | FlightState.LANDED:
                return
            case FlightState.TAKING_OFF if self._asking.request is Request.TAKEOFF:
                self._stood_still = True
                self._listen()
            case FlightState.LANDING:
                self._listen()
            case _:
                hold_is_ours = self._hold_is_ours or self._awaits_offboard
                self._start_over(FlightState.WAITING)
                self._hold_is_ours = hold_is_ours

    def _start_over(self, state: FlightState) -> None:
        self._enter(state)
        self._armed_seen = self._takeoff_seen = self._offboard_seen = False
        self._lost_said = ""
        self._listen()

    def _listen(self) -> None:
        self._steering_since_s = None
        self._listens_since_s = self.vehicle.heartbeat_s

    @property
    def _listens(self) -> bool:
        """What the autopilot has told is from before."""
        return self.vehicle.heartbeat_s <= self._listens_since_s

    # --- one tick ---

    def step(self, phase: SwarmPhase, now_s: float, *, land_now: bool, hold: bool, may_join: bool) -> list[Ask | Say]:
        """Advance. `land_now`: land here; `hold`: do not follow the phase; `may_join`: a leader is known and flies."""
        asks: list[Ask | Say] = []
        self._mind_silence(now_s)
        self._mind_lateness()
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
        asks += [*self._said, *self._asking.says(now_s)]
        self._said = []
        return asks

    @property
    def steers(self) -> bool:
        """Setpoints are to be sent."""
        return self._steering_since_s is not None

    def _mind_silence(self, now_s: float) -> None:
        """An autopilot that says nothing may be sent nothing: nobody knows what it does with it."""
        silent_s = self.vehicle.silent_s(now_s)
        asked_of_it = self.state in STEERED or self.state in (FlightState.TAKING_OFF, FlightState.LANDING)
        if silent_s and asked_of_it and not self._listens:
            stopped = ": setpoints stopped" if self.steers else ""
            self._say(Severity.CRITICAL, f"autopilot silent for {silent_s:.1f} s{stopped}")
            self.interrupt()

    def _mind_lateness(self) -> None:
        """Said once each time, whatever the flight does: a relay's backlog is the operator's to mend."""
        delay = self.vehicle.delay
        if delay.late and not self._late_said and self._armed:
            holding = ": holding" if self.steers else ""
            self._say(Severity.CRITICAL, f"telemetry {delay.late_s:.1f} s late{holding}")
        self._late_said = delay.late and self._armed

    def _wait(self, now_s: float, *, land_now: bool, may_join: bool) -> list[Ask | Say]:
        reason = self._missing(now_s)
        if self._armed and self.airborne:
            # Restarted in flight, or recovering: listen first. Any mode but those is the pilot's.
            heard = not self._listens and not self.vehicle.heartbeat_lost(now_s)
            after_climb = self._hold_is_ours and self._mode is not None and self._mode.mode is FlightMode.HOLD
            if heard and not self._follows_or_holds and not after_climb:
                return self._release()
            reason = reason or ("" if heard else "no autopilot heartbeat")
            if heard and land_now:
                return self._start_landing("landing")
            if heard and not after_climb:
                self._hold_is_ours = False  # OFFBOARD has shown: a HOLD after it has another reason
            if not reason and may_join:
                self._enter(FlightState.HOLD)
                self._failsafe_may_end = True
                self._say(Severity.NOTICE, "in the air, swarm heard: joining")
            reason = reason or LISTENING
        elif not reason and self._armed:
            reason = "armed by someone else"
        elif not reason:
            self._enter(FlightState.READY)
            self._say(Severity.INFO, "ready")
            return []
        if reason != self.waits_for:
            self.waits_for, self._waits_since_s, self._wait_said = reason, now_s, False
        if not self._wait_said and now_s - self._waits_since_s >= WAIT_SAID_S:
            self._wait_said = True
            self._say(Severity.INFO, f"waiting: {reason}")
        return []

    def _missing(self, now_s: float) -> str:
        if self.vehicle.heartbeat_lost(now_s):
            return "no autopilot heartbeat"
        if self._mode is not None and self._mode.takeoff is None:
            return self._mode.name
        if self.vehicle.position_missing(now_s):
            return self.vehicle.position_missing(now_s)
        if self.vehicle.landed is LandedState.UNDEFINED:
            return "no landed state"
        if not self._armed and not self.vehicle.ready_to_arm:
            return "autopilot not ready to arm"
        if self.grounded and not self.airborne:
            return f"grounded, {self.grounded}"
        return ""

    def _ready(self, phase: SwarmPhase, now_s: float, *, land_now: bool) -> list[Ask | Say]:
        if self._missing(now_s) or self._armed:  # armed: someone else has done it
            self._enter(FlightState.WAITING)
            return []
        if SwarmPhase.GATHER <= phase < SwarmPhase.LAND and not land_now:
            self._enter(FlightState.TAKING_OFF)
            return [Say(Severity.NOTICE, f"taking off to {self._takeoff_altitude_m:.1f} m")]
        return []

    def _take_off(self, now_s: float, *, land_now: bool) -> list[Ask | Say]:
        assert self._mode is not None
        if self._listens:
            return []
        if self._stood_still and self.airborne:  # it climbs or has climbed: it need not be seen to
            self._takeoff_seen = self._left = True
        self._stood_still = False
        how = self._mode.takeoff
        if how is None or self._is_pilots(how.climbs_in, ends_in_hold=how.climbs_in is FlightMode.TAKEOFF):
            return self._release()
        self._armed_seen |= self._armed
        self._takeoff_seen |= self._climbs(how) or (how.climbs_in is FlightMode.OFFBOARD and self.airborne)
        if self._armed_seen and not self._armed:
            if not self._takeoff_seen:
                return self._release("disarmed before takeoff")
            self._enter(FlightState.LANDED)
            return [Say(Severity.ERROR, "disarmed during takeoff")]
        if self._takeoff_seen and not self._climbs(how) and not self._at_altitude:
            return self._release()
        if land_now:
            return self._start_landing("landing during takeoff")
        if self._takeoff_seen:
            if not self._climbs(how):
                self._enter(FlightState.HOLD)
                self._steering_since_s = now_s
            return []
        return self._next_step(how, now_s)

    def _climbs(self, how: Takeoff) -> bool:
        """The autopilot shows its own climb."""
        assert self._mode is not None
        if how.climbs_in is FlightMode.TAKEOFF:
            return self._mode.mode is FlightMode.TAKEOFF
        return self._mode.mode is how.climbs_in and self.vehicle.landed is LandedState.TAKEOFF

    def _next_step(self, how: Takeoff, now_s: float) -> list[Ask | Say]:
        """Ask for the first step that does not show yet."""
        assert self._mode is not None
        shown = {Request.OFFBOARD: self._mode.mode is FlightMode.OFFBOARD, Request.ARM: self._armed}
        step = next(step for step in how.steps if not shown.get(step))
        if step is Request.OFFBOARD:
            if self._steering_since_s is None:
                self._steering_since_s = now_s
            if now_s - self._steering_since_s < PREFLIGHT_STREAM_S:
                return []
        if step is not Request.TAKEOFF:
            return self._ask(Ask(step), now_s)
        asks = self._ask(Ask(step, self._takeoff_altitude_m), now_s)
        if asks:
            self._steering_since_s = None  # a setpoint would interrupt the climb
        return asks

    @property
    def _at_altitude(self) -> bool:
        assert self.position is not None
        short_m = self._takeoff_altitude_m + self.position.pos_ned_m[2]
        return short_m <= max(TAKEOFF_SHORT_M, TAKEOFF_SHORT_SHARE * self._takeoff_altitude_m)

    def _steer(self, phase: SwarmPhase, now_s: float, *, land_now: bool, hold: bool) -> list[Ask | Say]:
        assert self._mode is not None
        if self._steering_since_s is None:
            self._steering_since_s = now_s
        if not self._armed:
            self._enter(FlightState.LANDED)
            return [Say(Severity.NOTICE, "disarmed: on the ground")]
        if self._mode.mode is FlightMode.OFFBOARD:
            self._offboard_seen, self._failsafe_overruled = True, False
        elif self._mode.mode not in BEFORE_OFFBOARD or (self._offboard_seen and not self._holds_by_failsafe):
            return self._release()
        if land_now:
            return self._start_landing("landing")
        if self._holds_by_failsafe and not self._failsafe_overruled:
            return self._mind_failsafe(now_s)
        if self._mode.mode is not FlightMode.OFFBOARD and now_s - self._steering_since_s >= PREFLIGHT_STREAM_S:
            return self._ask(Ask(Request.OFFBOARD), now_s)
        lost = self._lost(now_s)
        wanted = STATE_OF_PHASE[phase] if self._offboard_seen and not hold and not lost else FlightState.HOLD
        self._enter(wanted)
        return []

    def _mind_failsafe(self, now_s: float) -> list[Ask | Say]:
        """It holds by its failsafe while setpoints stream. Theirs ends by itself once they do; any other stays."""
        if self._offboard_seen and self.vehicle.was_cut_off(now_s):
            self._start_over(FlightState.WAITING)
            return [Say(Severity.WARNING, "autopilot holds by its failsafe: listening first")]
        assert self._steering_since_s is not None
        if self._failsafe_may_end and not self._offboard_seen and now_s - self._steering_since_s <= FAILSAFE_ENDS_S:
            return []
        return self._release()

    def _lost(self, now_s: float) -> bool:
        """Its position or its mode is not known; said once each time."""
        lost = self._missing(now_s) if self.vehicle.heartbeat_lost(now_s) else self.vehicle.position_missing(now_s)
        if lost and lost not in (self._lost_said, TELEMETRY_LATE):  # which is said elsewhere
            self._say(Severity.CRITICAL, f"holding: {lost}")
        self._lost_said = lost
        return bool(lost)

    def _land(self, now_s: float) -> list[Ask | Say]:
        assert self._mode is not None
        if not self._armed:
            self._enter(FlightState.LANDED)
            return [Say(Severity.NOTICE, "landed")]
        if self._listens:
            return []
        # What was asked for just before the landing may still show, and so may a failsafe.
        late = {FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD} if not self._offboard_seen else set()
        expected = not self._left and (self._follows_or_holds or self._mode.mode in late)
        if not expected and self._is_pilots(FlightMode.LAND):
            return self._release()
        if self._mode.mode is not FlightMode.OFFBOARD:
            self._steering_since_s = None
        if self._mode.mode is FlightMode.LAND:
            return []
        return self._ask(Ask(Request.LAND), now_s)

    def _start_landing(self, why: str) -> list[Ask | Say]:
        self._enter(FlightState.LANDING)
        return [Say(Severity.NOTICE, why)]

    # --- whose mode it is ---

    @property
    def _holds_by_failsafe(self) -> bool:
        return self._mode is not None and self._mode.mode is FlightMode.HOLD and self._mode.failsafe

    @property
    def _follows_or_holds(self) -> bool:
        """The autopilot still follows setpoints, or holds by its failsafe: perhaps because they stopped."""
        return self._holds_by_failsafe or (self._mode is not None and self._mode.mode is FlightMode.OFFBOARD)

    def _is_pilots(self, asked_for: FlightMode, *, ends_in_hold: bool = False) -> bool:
        """The mode is neither the one in which this state began nor `asked_for`, or is no more `asked_for`."""
        assert self._mode is not None
        if self._mode.mode is asked_for:
            self._left = True
            return False
        if self._left:
            return not (ends_in_hold and self._mode.mode is FlightMode.HOLD)
        return not self._as_it_began

    @property
    def _awaits_offboard(self) -> bool:
        """Steered, but still in the HOLD in which its climb ended or an operator handed it back."""
        in_hold = self._mode is not None and self._mode.mode is FlightMode.HOLD and self._as_it_began
        return in_hold and self.state in STEERED and not self._offboard_seen

    @property
    def _as_it_began(self) -> bool:
        """In the mode in which this state began."""
        return self._mode is not None and self._mode.name == self._began_in

    def _release(self, why: str = "") -> list[Ask | Say]:
        """Nothing is sent or asked for any more, until an operator hands back."""
        assert self._mode is not None
        self._enter(FlightState.RELEASED)
        self._steering_since_s = None
        if why:
            return [Say(Severity.ERROR, f"released: {why}")]
        whose = "released: failsafe," if self._mode.failsafe else "released to the pilot:"
        return [Say(Severity.WARNING, f"{whose} mode {self._mode.name}")]

    def _ask(self, ask: Ask, now_s: float) -> list[Ask | Say]:
        if self._asking.refused_for_good:
            return self._release(f"{ask.request.value} refused for good")
        return [*self._asking.ask(ask, now_s)]

    def _enter(self, state: FlightState) -> None:
        if state is not self.state:
            self.state = state
            self.waits_for = ""
            self._asking.reset()
            self._began_in = "" if self._mode is None else self._mode.name
            self._left = self._hold_is_ours = self._failsafe_may_end = self._failsafe_overruled = False

    def _say(self, severity: Severity, text: str) -> None:
        self._said.append(Say(severity, text))

    @property
    def _mode(self) -> AutopilotMode | None:
        return self.vehicle.mode

    @property
    def _armed(self) -> bool:
        return self.vehicle.armed


def _speed(position: Position) -> float:
    v = position.vel_ned_mps
    return float((v[0] ** 2 + v[1] ** 2 + v[2] ** 2) ** 0.5)
