"""The orders of one tick: what has been decided, for guidance, for the beacon and for the autopilot. Frozen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.guidance import formation
from companion.core.model.actions import Ask, Say
from companion.core.model.beacon import Lease
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import sub
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3


@dataclass(slots=True, init=False, unsafe_hash=True)
class Goal:
    """The place where a leader goes, and how far from it it comes to rest."""

    pos_ned_m: Final[Vec3]
    stop_m: Final[float]
    is_own: Final[bool]  # by the own odometry, else in the mission's frame

    def __init__(self, pos_ned_m: Vec3, stop_m: float, *, is_own: bool) -> None:
        self.pos_ned_m = pos_ned_m
        self.stop_m = stop_m
        self.is_own = is_own

    def resolve(self, offset_ned_m: Vec3) -> tuple[Vec3, float]:
        """By the own odometry. `offset_ned_m`: the own position in the mission's frame less the reported one."""
        return (self.pos_ned_m if self.is_own else sub(self.pos_ned_m, offset_ned_m)), self.stop_m


@dataclass(slots=True, init=False, unsafe_hash=True)
class Orders:
    """One vehicle's, of one tick."""

    leader: Final[int]  # the established one; 0: none
    role: Final[Role]
    phase: Final[SwarmPhase]  # LAND where this vehicle lands by itself, too
    gathers: Final[bool]  # the swarm waits for all
    stop: Final[int]  # which of the mission's visits it is bound for, or at
    route: Final[formation.Route]
    range_m: Final[float]  # that the formation keeps
    radio_range_m: Final[float]
    governor: Final[float]
    lease_freshness: Final[float]  # 1 while the leader is heard of, falling to 0 as its lease runs out
    goal: Final[Goal | None]  # a leader's
    size: Final[int]  # of the swarm in the air
    layer_m: Final[float | None]  # height above the origin that its part flies at; None: the mission's
    state: Final[FlightState]
    cause: Final[Cause | None]
    steers: Final[bool]  # setpoints are to be sent
    rests: Final[bool]  # ... of zero: a cause demands it
    broadcasts: Final[bool]  # a beacon is due
    lease: Final[Lease | None]  # that it tells
    reports: Final[Sequence[Say]]  # of the swarm, for the operator
    requests: Final[Sequence[Ask | Say]]  # of the flight, for the autopilot and the operator

    def __init__(
        self,
        *,
        leader: int,
        role: Role,
        phase: SwarmPhase,
        gathers: bool,
        stop: int,
        route: formation.Route,
        range_m: float,
        radio_range_m: float,
        governor: float,
        lease_freshness: float,
        goal: Goal | None,
        size: int,
        layer_m: float | None,
        state: FlightState,
        cause: Cause | None,
        steers: bool,
        rests: bool,
        broadcasts: bool,
        lease: Lease | None,
        reports: Sequence[Say],
        requests: Sequence[Ask | Say],
    ) -> None:
        self.leader = leader
        self.role = role
        self.phase = phase
        self.gathers = gathers
        self.stop = stop
        self.route = route
        self.range_m = range_m
        self.radio_range_m = radio_range_m
        self.governor = governor
        self.lease_freshness = lease_freshness
        self.goal = goal
        self.size = size
        self.layer_m = layer_m
        self.state = state
        self.cause = cause
        self.steers = steers
        self.rests = rests
        self.broadcasts = broadcasts
        self.lease = lease
        self.reports = reports
        self.requests = requests
