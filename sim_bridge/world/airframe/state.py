"""State of an airframe: position, velocity, attitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mission.common.frames import Vec3


@dataclass(slots=True, init=False, unsafe_hash=True)
class AirframeState:
    """Ground truth of one airframe; NED about the mission's origin, which lies on the ground (down = 0)."""

    pos_ned_m: Final[Vec3]
    vel_ned_mps: Final[Vec3]
    attitude_rad: Final[Vec3]  # roll, pitch, yaw
    rates_radps: Final[Vec3]  # body p, q, r
    on_ground: Final[bool]
    throttle: Final[float]  # mean of the rotors, 0..1
    hit_ned_mps: Final[Vec3 | None]  # how it met the ground in the last step, where the airframe tells it; else None

    def __init__(
        self,
        pos_ned_m: Vec3,
        vel_ned_mps: Vec3,
        attitude_rad: Vec3,
        rates_radps: Vec3,
        on_ground: bool,
        throttle: float,
        hit_ned_mps: Vec3 | None = None,
    ) -> None:
        self.pos_ned_m = pos_ned_m
        self.vel_ned_mps = vel_ned_mps
        self.attitude_rad = attitude_rad
        self.rates_radps = rates_radps
        self.on_ground = on_ground
        self.throttle = throttle
        self.hit_ned_mps = hit_ned_mps
