"""A flight with a scripted autopilot under it, brought to each of its states."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from companion.core.model.actions import Ask, Say
from companion.core.model.events import AutopilotHealth, AutopilotMode, Landed, Position
from companion.core.model.states import (
    AutopilotTraits,
    FlightMode,
    FlightState,
    LandedState,
    Request,
    SwarmPhase,
)
from companion.core.vehicle.failsafe import Cause, Finding
from companion.core.vehicle.flight import Flight
from companion.core.vehicle.requests import RETRY_S
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4

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
    traits: AutopilotTraits | None = PX4.traits
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
    may_take_off: bool = True
    climb_room: bool = True
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
            out = self.flight.update_flight(
                self.phase,
                self.now_s,
                findings=found,
                may_join=self.may_join,
                may_take_off=self.may_take_off,
                climb_room=self.climb_room,
            )
            self.asked += [a for a in out if isinstance(a, Ask)]
            self.said += [a for a in out if isinstance(a, Say)]
        return self

    def _tell(self) -> None:
        if self.heartbeat:
            name = self.mode.value.upper()
            self.flight.receive(AutopilotMode(self.mode, self.armed, name, self.failsafe, self.traits), self.now_s)
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


def asked_to_arm() -> Bench:
    bench = taking_off().tick()
    assert bench.requests == [Request.ARM]
    return bench


# --- takeoff in GUIDED, as ArduPilot's ---


def guided() -> Bench:
    """Taking off, disarmed, in STABILIZE."""
    bench = Bench(mode=M.OTHER, traits=ARDUPILOT.traits).tick(2).tick(phase=P.GATHER)
    assert bench.state is S.TAKING_OFF
    return bench


def guided_climb() -> Bench:
    bench = guided().seconds(0.5).seconds(RETRY_S, mode=M.OFFBOARD).seconds(2 * RETRY_S, armed=True)
    bench.tick(landed=LandedState.TAKEOFF, altitude_m=3.0)
    assert bench.state is S.TAKING_OFF
    return bench
