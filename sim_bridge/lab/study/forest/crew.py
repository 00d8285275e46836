"""The agents of one flight, each on an autopilot that does at once what it is asked: the flight software itself.

Nothing is encoded: beacons travel as values, with where they were sent from. What the agents do is theirs alone, so
elections, splits, failsafes and coverage are what they are on a board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from companion.core.agent import Agent
from companion.core.model.actions import Ask, SendBeacon, VelocitySetpoint
from companion.core.model.beacon import Beacon
from companion.core.model.events import (
    Answer,
    AutopilotHealth,
    AutopilotMode,
    HeardBeacon,
    Landed,
    ObstacleScan,
    OperatorOrder,
    Position,
)
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightMode, LandedState, Order, Request, Result, SwarmPhase
from companion.core.model.vectors import limit, scale, sub
from companion.core.perception.obstacle_map import ObstacleMap
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3, ned_to_enu
from mission.document.model import Mission
from sim_bridge.lab.study.forest.air import Sent
from sim_bridge.lab.study.law import Bools, Floats

CLIMB_MPS = 1.5
TELL_S = 0.5  # between two of an autopilot's words on mode, battery and ground; on changes at once
BATTERY_PERCENT = 90
AIRBORNE_M = 0.1
SEEN_WITHIN_M = 8.0  # of the map, for a stage
TAKEN_OFF = 0.98  # of the height asked for
HOLD_PER_S = 1.0  # back to the place above which it took off, as autopilots hold it: gusts push, they carry none away
HOLD_MPS = 2.0  # of that
REST = VelocitySetpoint((0.0, 0.0, 0.0), 0.0)


class Stage(Protocol):
    """One vehicle's law to pass trees, in place of ours: it gets what an agent that sees none would fly."""

    def velocity(
        self, wanted_ned_mps: Vec3, own: Position, neighbours: Sequence[Neighbour], points_m: Floats, now_s: float
    ) -> Vec3:
        """NED m/s. `points_m`: (k, 2) north and east from the vehicle to what was seen."""


@dataclass(slots=True)
class Seat:
    """An agent, and what its autopilot does."""

    agent: Agent
    mode: FlightMode = FlightMode.HOLD
    armed: bool = False
    told_s: float = -1e9
    takeoff_m: float = 0.0
    held_ned_m: Vec3 | None = None  # where it took off, until it is steered
    setpoint: VelocitySetpoint = REST
    stage: Stage | None = None
    seen: ObstacleMap = field(default_factory=ObstacleMap)  # for the stage


class Crew:
    """Vehicle k of the mission is row k - 1 of all arrays."""

    def __init__(self, mission: Mission, stages: Sequence[Stage] = ()) -> None:
        """`stages`: one for each vehicle, to fly by them; the agents then see no trees."""
        blind = mission.model_copy(update={"sensing": None}) if stages else mission
        self.seats = [Seat(Agent(blind, k)) for k in range(1, mission.swarm.size + 1)]
        for seat, stage in zip(self.seats, stages, strict=bool(stages)):
            seat.stage = stage
        self.range_m = np.full(mission.swarm.size, mission.radio.transit_range_m)
        self._flying = list(range(len(self.seats)))  # rows of those that are not lost
        for seat in self.seats:
            seat.agent.receive(OperatorOrder(Order.START), 0.0)

    @property
    def leader(self) -> int | None:
        """Row of the vehicle that acts as leader; of two, that with the lower id."""
        acting = self._acting()
        return acting[0] if acting else None

    @property
    def phase(self) -> SwarmPhase:
        """Phase that the leader announces, or without one the furthest that any does."""
        rows = self._acting()[:1] or self._flying
        return max((self.seats[row].agent.swarm.phases.phase for row in rows), default=SwarmPhase.ASSEMBLE)

    @property
    def acting(self) -> int:
        """Number of acting leaders."""
        return len(self._acting())

    def _acting(self) -> list[int]:
        return [row for row in self._flying if self.seats[row].armed and self.seats[row].agent.swarm.election.acts]

    @property
    def steered(self) -> Bools:
        """(n,) whose setpoints count: in the air, and not on the way up or down."""
        return np.array([seat.mode is FlightMode.OFFBOARD for seat in self.seats])

    def receive_scan(self, row: int, scan: ObstacleScan, now_s: float) -> None:
        """A scan of the vehicle in this row has come."""
        seat = self.seats[row]
        own = seat.agent.flight.vehicle.position
        if seat.stage is None:
            seat.agent.receive(scan, now_s)
        elif own is not None:
            seat.seen.integrate_scan(scan, own, now_s, [n.rel_ned_m for n in seat.agent.localiser.neighbours])

    def receive_beacon(self, sent: Sent, pos_enu_m: Floats, now_s: float) -> None:
        """A beacon has come; `pos_enu_m`: where each receiver believes to be."""
        beacon, from_ned_m = sent.message
        for row in sent.receivers:
            seat = self.seats[row]
            rel = sub(from_ned_m, _ned(pos_enu_m[row]))
            seat.agent.receive(HeardBeacon(beacon, rel), now_s)

    def tick(
        self, pos_enu_m: Floats, vel_enu_mps: Floats, alive: list[bool], now_s: float
    ) -> tuple[Floats, Floats, dict[int, tuple[Beacon, Vec3]]]:
        """(n, 3) ENU m/s to fly, (n,) headings, and the beacons sent; positions as each autopilot reports them."""
        sent: dict[int, tuple[Beacon, Vec3]] = {}
        command = np.zeros_like(pos_enu_m)
        self._flying = [row for row, is_alive in enumerate(alive) if is_alive]
        for row in self._flying:
            seat, pos = self.seats[row], _ned(pos_enu_m[row])
            self._send_state(seat, pos, _ned(vel_enu_mps[row]), now_s)
            for action in seat.agent.tick(now_s):
                match action:
                    case VelocitySetpoint():
                        seat.setpoint = action
                    case SendBeacon(beacon):
                        sent[row] = beacon, pos
                        self.range_m[row] = beacon.range_m
                    case Ask(request, altitude_m):
                        _obey(seat, request, altitude_m, pos, now_s)
            command[row] = _wanted(seat, pos, now_s)
        yaw = np.array([seat.setpoint.yaw_rad for seat in self.seats])
        return command, yaw, sent

    def _send_state(self, seat: Seat, pos_ned_m: Vec3, vel_ned_mps: Vec3, now_s: float) -> None:
        agent, altitude_m = seat.agent, -pos_ned_m[2]
        if seat.mode is FlightMode.TAKEOFF and altitude_m >= TAKEN_OFF * seat.takeoff_m:
            seat.mode, seat.told_s = FlightMode.HOLD, -1e9
        if now_s - seat.told_s >= TELL_S:
            seat.told_s = now_s
            landed = LandedState.IN_AIR if altitude_m > AIRBORNE_M else LandedState.ON_GROUND
            agent.receive(AutopilotMode(seat.mode, seat.armed, seat.mode.value, traits=PX4.traits), now_s)
            agent.receive(AutopilotHealth(True, BATTERY_PERCENT), now_s)
            agent.receive(Landed(landed), now_s)
        agent.receive(Position(pos_ned_m, vel_ned_mps, None), now_s)


def _wanted(seat: Seat, pos_ned_m: Vec3, now_s: float) -> Vec3:
    """Velocity that the autopilot flies, ENU m/s."""
    match seat.mode:
        case FlightMode.TAKEOFF:
            return (*_held(seat, pos_ned_m)[:2], CLIMB_MPS)
        case FlightMode.OFFBOARD:
            wanted, own = seat.setpoint.vel_ned_mps, seat.agent.flight.vehicle.position
            if seat.stage is not None and own is not None:
                points_m = np.column_stack(seat.seen.find_near(own.pos_ned_m, SEEN_WITHIN_M))
                wanted = seat.stage.velocity(wanted, own, seat.agent.localiser.neighbours, points_m, now_s)
            return ned_to_enu(wanted)
        case FlightMode.LAND if pos_ned_m[2] < 0.0:
            return (0.0, 0.0, -CLIMB_MPS)
        case FlightMode.HOLD:
            return _held(seat, pos_ned_m)
        case _:
            return (0.0, 0.0, 0.0)


def _held(seat: Seat, pos_ned_m: Vec3) -> Vec3:
    """ENU m/s back above the place of the takeoff, level; rest after the vehicle was steered."""
    if seat.held_ned_m is None:
        return (0.0, 0.0, 0.0)
    north, east, _ = limit(scale(sub(seat.held_ned_m, (pos_ned_m[0], pos_ned_m[1], 0.0)), HOLD_PER_S), HOLD_MPS)
    return (east, north, 0.0)


def _obey(seat: Seat, request: Request, altitude_m: float, pos_ned_m: Vec3, now_s: float) -> None:
    match request:
        case Request.ARM:
            seat.armed = True
        case Request.TAKEOFF:
            seat.mode, seat.takeoff_m = FlightMode.TAKEOFF, altitude_m
            seat.held_ned_m = (pos_ned_m[0], pos_ned_m[1], 0.0)
        case Request.OFFBOARD:
            seat.mode, seat.held_ned_m = FlightMode.OFFBOARD, None
        case Request.LAND:
            seat.mode = FlightMode.LAND
    seat.told_s = -1e9  # its next word comes at once
    seat.agent.receive(Answer(request, Result.ACCEPTED), now_s)


def _ned(enu: Floats) -> Vec3:
    east, north, up = enu.tolist()
    return (north, east, -up)
