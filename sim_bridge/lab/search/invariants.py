"""Invariants of every tick of every flight, whatever happens; contacts, fence and leaders are the verdict's."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from typing import ClassVar, Final

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.framing.frames import source, whole
from companion.mavlink.framing.wire import HEADER_BYTES
from mission.common.frames import Vec3
from mission.document.model import Mission, Personality
from mission.schema.kinds import FaultKind
from sim_bridge.drive.fly import Flight
from sim_bridge.judge.tick import Tick
from sim_bridge.judge.verdict import HARMLESS, LOSSES, Grade
from sim_bridge.lab.search.authority import Authority
from sim_bridge.world.autopilot import CopterMode, Px4Mode

OVER_SHARE: Final = 1.02  # of a limit: setpoints travel as 32-bit floats
OVER_MPS: Final = 0.02
# Modes of an armed vehicle that none but a pilot chooses
STICKS: Final = {
    Personality.PX4: frozenset({Px4Mode.MANUAL, Px4Mode.ALTCTL, Px4Mode.POSCTL, Px4Mode.ACRO, Px4Mode.STABILIZED}),
    Personality.ARDUPILOT: frozenset(
        {CopterMode.STABILIZE, CopterMode.ALT_HOLD, CopterMode.LOITER, CopterMode.POSHOLD}
    ),
}
STEERING: Final = frozenset(  # commands that take a vehicle from its pilot
    {
        dialect.MAV_CMD_DO_SET_MODE,
        dialect.MAV_CMD_COMPONENT_ARM_DISARM,
        dialect.MAV_CMD_NAV_TAKEOFF,
        dialect.MAV_CMD_NAV_LAND,
    }
)
HANDED_BACK: Final = (dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAV_CMD_MISSION_START)
STANDSTILL_S: Final = 60.0  # so long nobody gets anywhere, and nobody says why
STANDSTILL_M: Final = 1.0
SAMPLED_S: Final = 1.0
ALONE_S: Final = 5.0  # after its companion has ended a vehicle has braked, by its autopilot's failsafe
ALONE_MPS: Final = 2.0
ALONE_FOR_S: Final = 3.0  # a position that jumps back is flown to in less
PASSED_BY: Final = (*LOSSES, *HARMLESS)  # they are no reason to wait


class Invariant(ABC):
    """Looks at a flight after every tick, in the order of time. `violation`: the first one; empty: it holds."""

    cause: ClassVar[str]
    means: ClassVar[str]  # of the cause, for people
    grade: ClassVar[Grade] = Grade.UNSAFE

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.violation = ""

    def check_flight(self, flight: Flight) -> None:
        """After a tick."""
        if not self.violation:
            self.violation = self.find_violation(flight)

    @abstractmethod
    def find_violation(self, flight: Flight) -> str:
        """The violation in the last tick, in words, or ""."""


class Setpoints(Invariant):
    """Companions ask their autopilots for finite velocities within the mission's limits."""

    cause = "setpoint"
    means = "a companion asked for a velocity that is not finite, or beyond limits"

    def find_violation(self, flight: Flight) -> str:
        """A velocity beyond the limits."""
        tick, limits = flight.last, self.mission.limits
        speed_mps = OVER_SHARE * limits.speed_max_mps + OVER_MPS
        climb_mps = OVER_SHARE * limits.climb_max_mps + OVER_MPS
        for vehicle_id, asked_ned_mps in enumerate(tick.asked_ned_mps, start=1):
            if asked_ned_mps is None:
                continue
            finite = all(math.isfinite(value) for value in asked_ned_mps)
            if not finite or math.hypot(*asked_ned_mps) > speed_mps or abs(asked_ned_mps[2]) > climb_mps:
                asked = ", ".join([f"{value:.2f}" for value in asked_ned_mps])
                return f"setpoint of vehicle {vehicle_id} at {tick.time_s:.2f} s: {asked} m/s (NED)"
        return ""


class Pilots(Invariant):
    """A companion that has been told of its pilot's mode sends no setpoint, mode, arming, takeoff or landing.

    Until an operator hands the vehicle back. By the bytes of its link: what it was handed, and what it answered then.
    """

    cause = "takeover"
    means = "a companion steered a vehicle that its pilot had taken over"

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self._taken: set[int] = set()

    def find_violation(self, flight: Flight) -> str:
        """Something sent that steers."""
        for vehicle_id, told in flight.lockstep.to_companion.items():
            self._read_link(vehicle_id, told)
            if vehicle_id in self._taken:
                steers = _steering(flight.lockstep.from_companion.get(vehicle_id, b""))
                if steers:
                    return f"vehicle {vehicle_id}: {steers} at {flight.last.time_s:.2f} s, though its pilot flies it"
        return ""

    def _read_link(self, vehicle_id: int, told: bytes) -> None:
        for start, _, message_id in whole(told):
            payload = told[start + HEADER_BYTES :]
            if message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT and source(told, start) == (vehicle_id, 1):
                mode, armed = int.from_bytes(payload[:4], "little"), payload[6] & dialect.MAV_MODE_FLAG_SAFETY_ARMED
                if armed and mode in STICKS[self.mission.sim.personality_of(vehicle_id)]:
                    self._taken.add(vehicle_id)
            elif (message_id, _command(payload)) == HANDED_BACK:
                self._taken.discard(vehicle_id)


class Progress(Invariant):
    """Liveness: on its way, with its faults over and nobody holding by a failsafe, somebody gets on."""

    cause = "deadlock"
    means = f"on the way nobody got anywhere for {STANDSTILL_S:g} s, and nobody said why: they wait for one another"
    grade = Grade.INCOMPLETE

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self._past: deque[tuple[float, dict[int, Vec3]]] = deque()  # since when all this holds

    def find_violation(self, flight: Flight) -> str:
        """A standstill."""
        tick = flight.last
        if self._past and tick.time_s < self._past[-1][0] + SAMPLED_S - 1e-6:
            return ""
        going = {k: tick.pos_ned_m[k - 1] for k in _on_the_way(tick)}
        if len(going) < 2 or _struck(flight, tick.time_s):
            self._past.clear()
            return ""
        self._past = deque(row for row in self._past if row[1].keys() == going.keys() and not _has_moved(row[1], going))
        self._past.append((tick.time_s, going))
        stood_s = tick.time_s - self._past[0][0]
        if stood_s < STANDSTILL_S:
            return ""
        who = ", ".join(map(str, sorted(going)))
        return f"vehicles {who} stand still on their way since {self._past[0][0]:.0f} s, and none says why"


class Alone(Invariant):
    """A vehicle whose companion has ended is held, or landed, by its autopilot's own failsafe."""

    cause = "runaway"
    means = "a vehicle flew on without its companion"

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self._since_s: dict[int, float] = {}  # its companion is gone
        self._fast_s: dict[int, float] = {}  # it has been fast since

    def find_violation(self, flight: Flight) -> str:
        """A vehicle that flies on after its companion has ended, in words, or ""."""
        tick = flight.last
        for index, vel_ned_mps in enumerate(tick.vel_ned_mps):
            vehicle_id = index + 1
            if vehicle_id in flight.lockstep.companions:
                self._since_s.pop(vehicle_id, None)
                continue
            gone_s = tick.time_s - self._since_s.setdefault(vehicle_id, tick.time_s)
            speed_mps = math.hypot(*vel_ned_mps[:2])
            if gone_s < ALONE_S or speed_mps < ALONE_MPS or tick.on_ground[index] or tick.touched[index]:
                self._fast_s[vehicle_id] = tick.time_s
            elif tick.time_s - self._fast_s[vehicle_id] > ALONE_FOR_S:
                return f"vehicle {vehicle_id} flies at {speed_mps:.1f} m/s {gone_s:.0f} s after its companion has ended"
        return ""


class OneDecides(Invariant):
    """The beacons of the flight are a trace of the model of who decides."""

    cause = "authority"
    means = "two vehicles decided for the swarm at once, or one that had not the majority"

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self._model = Authority(mission)

    def find_violation(self, flight: Flight) -> str:
        """The first beacon that no trace of the model has."""
        tick = flight.last
        lies = [event for event in flight.faults.happened if event.kind is FaultKind.INSIDER]
        liars = {vehicle for event in lies for vehicle in event.vehicles}
        broken = self._model.judge_tick(tick.time_s, tick.said, tick.answered, liars)
        return broken and f"{broken}, at {tick.time_s:.1f} s"


INVARIANTS: Final[tuple[type[Invariant], ...]] = (Setpoints, Pilots, Alone, OneDecides, Progress)  # worst first


def _on_the_way(tick: Tick) -> list[int]:
    """Vehicles that their companions fly to a goal, by what they say; none, while any holds and so says why."""
    states = {k: FlightState(tick.said[k].flight_state) for k in tick.answered if k in tick.said}
    if {FlightState.HOLD, FlightState.SEEKING}.intersection(states.values()):
        return []
    return [k for k, state in states.items() if state in (FlightState.TRANSIT, FlightState.RETURNING)]


def _struck(flight: Flight, now_s: float) -> bool:
    """A fault that can end is in force."""
    return any(
        event.kind not in PASSED_BY and (event.until_s is None or event.until_s > now_s)
        for event in flight.faults.happened
    )


def _has_moved(before: dict[int, Vec3], now: dict[int, Vec3]) -> bool:
    return any(math.dist(before[k], now[k]) > STANDSTILL_M for k in now)


def _steering(sent: bytes) -> str:
    """The first message that steers a vehicle, in words."""
    for start, _, message_id in whole(sent):
        if message_id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            return "a setpoint"
        if message_id == dialect.MAVLINK_MSG_ID_SET_MODE:
            return "a mode"
        if message_id == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
            command = _command(sent[start + HEADER_BYTES :])
            if command in STEERING:
                return f"command {command}"
    return ""


def _command(payload: bytes) -> int:
    """COMMAND_LONG.command, after seven floats."""
    return int.from_bytes(payload[28:30], "little")
