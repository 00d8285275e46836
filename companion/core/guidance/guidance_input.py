"""The values that guidance works on: what it goes by in one tick, and what it desires."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.guidance import formation
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3


@dataclass(slots=True, init=False, unsafe_hash=True)
class GuidanceInput:
    """Input of guidance in one tick: the vehicle's surroundings, and the swarm's orders."""

    around: Final[Surroundings]
    state: Final[FlightState]
    phase: Final[SwarmPhase]
    route: Final[formation.Route]
    range_m: Final[float]
    role: Final[Role]
    governor: Final[float]
    lease_freshness: Final[float]  # 1 while the leader is heard of, falling to 0 as its lease runs out
    goal: Final[tuple[Vec3, float] | None]  # a leader's: see `phases.Phases.goal`
    goal_moves: Final[bool]  # as the estimate of the own position does, or from visit to visit
    dest_ned_m: Final[Vec3 | None]  # the vector to d2, where it is known; on lanes None: no tree is ahead
    size: Final[int]  # of the swarm in the air
    corridors: Final[Sequence[PredictedCorridor]]  # of those that trees hide; none without a sensor
    layer_m: Final[float | None]  # height above the origin that the part without the majority flies at
    excitation_ned_mps: Final[Vec3]  # see `excitation`

    def __init__(
        self,
        around: Surroundings,
        *,
        state: FlightState,
        phase: SwarmPhase,
        route: formation.Route,
        range_m: float,
        role: Role,
        governor: float,
        lease_freshness: float,
        goal: tuple[Vec3, float] | None,
        size: int,
        dest_ned_m: Vec3 | None = None,
        goal_moves: bool = False,
        corridors: Sequence[PredictedCorridor] = (),
        layer_m: float | None = None,
        excitation_ned_mps: Vec3 = ZERO,
    ) -> None:
        self.around = around
        self.state = state
        self.phase = phase
        self.route = route
        self.range_m = range_m
        self.role = role
        self.governor = governor
        self.lease_freshness = lease_freshness
        self.goal = goal
        self.goal_moves = goal_moves
        self.dest_ned_m = dest_ned_m
        self.size = size
        self.corridors = corridors
        self.layer_m = layer_m
        self.excitation_ned_mps = excitation_ned_mps


@dataclass(slots=True, init=False, unsafe_hash=True)
class Desired:
    """The velocity and heading that guidance asks for: the safety filter cuts the velocity."""

    vel_ned_mps: Final[Vec3]
    ref_ned_mps: Final[Vec3]  # the course that a vehicle hands down to those that follow it
    yaw_rad: Final[float]

    def __init__(self, vel_ned_mps: Vec3, ref_ned_mps: Vec3, yaw_rad: float) -> None:
        self.vel_ned_mps = vel_ned_mps
        self.ref_ned_mps = ref_ned_mps
        self.yaw_rad = yaw_rad
