"""A vehicle's stages in a row, as `agent.Agent` runs them: perception, guidance, safety filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import Guidance
from companion.core.model.beacon import PeerReport
from companion.core.model.events import ObstacleScan, Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import ZERO, add
from companion.core.perception.obstacle_perception import build_perception
from companion.core.safety.disturbance import build_disturbance_observer
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission

DT_S = 0.05


class Steered:
    """One vehicle."""

    def __init__(self, mission: Mission, me: int) -> None:
        self.guidance = Guidance(mission, me)
        self.perception = build_perception(mission, 1)
        self.disturbances = build_disturbance_observer(mission)
        self.safety_filter = SafetyFilter.of(mission)
        self.setpoint_ned_mps: Vec3 = ZERO
        self.yaw_rad = 0.0

    @property
    def ref_ned_mps(self) -> Vec3:
        """What it hands down."""
        return self.guidance.ref_ned_mps

    def integrate_scan(self, scan: ObstacleScan, own: Position, now_s: float) -> None:
        """Nobody is near."""
        self.perception.integrate_scan(scan, own, now_s, ())

    def observe(
        self,
        own: Position,
        now_s: float,
        neighbours: Sequence[Neighbour] = (),
        hovering: Mapping[int, PeerReport] | None = None,
        bias: Vec3 = ZERO,
    ) -> Surroundings:
        """Once a tick."""
        hovering = hovering or {}
        disturbance = self.disturbances.observe_disturbance(own, add(self.setpoint_ned_mps, bias), DT_S, None)
        cloud = self.perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, hovering, now_s)
        return Surroundings(
            own,
            neighbours,
            hovering,
            cloud,
            bias_ned_mps=bias,
            disturbance=disturbance,
            commanded_ned_mps=self.setpoint_ned_mps,
        )

    def steer(self, around: Surroundings, **orders: Any) -> Vec3:
        """The setpoint, NED m/s."""
        desired = self.guidance.guide(GuidanceInput(around, **orders), dt_s=DT_S)
        self.yaw_rad = desired.yaw_rad
        self.setpoint_ned_mps = self.safety_filter.apply(desired.vel_ned_mps, around, dt_s=DT_S).vel_ned_mps
        return self.setpoint_ned_mps
