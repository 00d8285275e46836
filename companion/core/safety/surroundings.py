"""Surroundings of a vehicle in one tick: read by guidance, and by the safety filter after it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour, find_told_places
from companion.core.model.vectors import ZERO, add
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from companion.core.safety.response_model import CALM, Disturbance
from mission.common.frames import Vec3


@final
class Surroundings:
    """The vehicle's own motion, the others, and what stands about it."""

    __slots__ = (
        "cloud",
        "commanded_ned_mps",
        "disturbance",
        "drift_ned_mps",
        "error_m",
        "free_up_m",
        "hovering",
        "neighbours",
        "own",
        "placed",
        "relayed",
        "seen",
        "silent_ned_m",
    )

    def __init__(
        self,
        own: Position,
        neighbours: Sequence[Neighbour],
        hovering: Mapping[int, PeerReport],
        cloud: LocalObstacleCloud,
        *,
        seen: Sequence[SeenVehicle] = (),
        off_ned_m: Vec3 = ZERO,
        bias_ned_mps: Vec3 = ZERO,
        disturbance: Disturbance = CALM,
        commanded_ned_mps: Vec3 = ZERO,
        relayed: Sequence[tuple[Vec3, float]] = (),
        free_up_m: float = -math.inf,
        error_m: float = 0.0,
    ) -> None:
        """`off_ned_m`: the mission's place less the own reported one. `bias_ned_mps`: true velocity less reported."""
        self.own: Final = own  # with its true velocity
        # The same in the mission's frame: for fence and trunks.
        self.placed: Final = own if off_ned_m == ZERO else Position(add(own.pos_ned_m, off_ned_m), own.vel_ned_mps)
        self.neighbours: Final = neighbours
        self.hovering: Final = hovering  # by id: in the air, and steered by no companion
        # Where those that fell silent hover: others that hover are among the neighbours.
        self.silent_ned_m: Final[list[Vec3]] = [s.rel_ned_m for s in hovering.values() if s.silent and not s.received]
        self.seen: Final = seen  # vehicles by the own scans, that are not heard
        # Places (relative) at which others hear those that this vehicle does not, and how old that is.
        self.relayed: Final = relayed
        self.cloud: Final = cloud
        # Height to which the column that it is in is free by its own rays, where it may fly above the fence's ceiling
        self.free_up_m: Final = free_up_m
        self.error_m: Final = error_m  # level, that the own position may have beyond what goes with GNSS
        self.disturbance: Final = disturbance
        # What is flown less what is commanded.
        self.drift_ned_mps: Final = bias_ned_mps if disturbance is CALM else add(bias_ned_mps, disturbance.vel_ned_mps)
        self.commanded_ned_mps: Final = commanded_ned_mps  # the last setpoint

    @property
    def told_ned_m(self) -> list[Vec3]:
        """Positions at which others alone say that one hovers silent: they slow, and push nobody."""
        return find_told_places(self.hovering.values())
