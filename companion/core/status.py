"""One frozen read-out of an agent, for the log, the report and the live view: nothing reaches in from outside."""

from __future__ import annotations

from dataclasses import dataclass

from companion.core.model.beacon import Lease
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3


@dataclass(frozen=True, slots=True)
class Status:
    """Status of one agent, as of its last tick. Sets of vehicles: bit k-1 for vehicle k."""

    id: int  # its own
    state: FlightState
    cause: Cause | None  # the failsafe that decides, or decided that state; None: the phase does
    phase: SwarmPhase  # of the swarm, as far as this vehicle knows
    waits_for: str  # in words; empty: nothing
    grounded: str  # why it must not arm; empty: it may
    # the leader
    lease: Lease | None
    leader: int  # that is established; 0: none
    role: Role
    hop: int  # to the leader
    parent: int  # the neighbour on the way to it; 0: none
    route_cost: float
    governor: float  # share of cruise speed, 0..1
    # the others
    neighbours: tuple[int, ...]  # heard, ascending
    silent: tuple[int, ...]  # fell silent in the air, ascending
    done: int
    present: int
    flown: int
    # its own vehicle
    mode: str  # of the autopilot, as an operator knows it; empty: not heard yet
    armed: bool
    airborne: bool
    position: Position | None  # the last one told, NED m about the mission's origin, however old
    position_known: bool  # that one is fresh
    telemetry_late_s: float
    motion_seen: bool  # trunks that it sees correct its own velocity, lately
    battery_percent: int | None  # 0..100; None: unknown
    dest_ned_m: Vec3 | None  # from the vehicle to d2; None: not known here
    setpoint_ned_mps: Vec3  # the last velocity asked for
