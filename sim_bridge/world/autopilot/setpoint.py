"""SET_POSITION_TARGET_LOCAL_NED, as both personalities read it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from companion.mavlink import dialect as mav
from mission.common.frames import Vec3

POSITION_IGNORE = 0x7  # type mask


@dataclass(slots=True, init=False, unsafe_hash=True)
class Setpoint:
    """Per axis a position (NED m, mission's origin), a velocity (m/s), or both.

    `yaw_rad` None and `yaw_rate_radps` 0: keep the heading.
    """

    pos_ned_m: Final[tuple[float | None, float | None, float | None]]
    vel_ned_mps: Final[tuple[float | None, float | None, float | None]]
    yaw_rad: Final[float | None]
    yaw_rate_radps: Final[float]

    def __init__(
        self,
        pos_ned_m: tuple[float | None, float | None, float | None],
        vel_ned_mps: tuple[float | None, float | None, float | None],
        yaw_rad: float | None = None,
        yaw_rate_radps: float = 0.0,
    ) -> None:
        self.pos_ned_m = pos_ned_m
        self.vel_ned_mps = vel_ned_mps
        self.yaw_rad = yaw_rad
        self.yaw_rate_radps = yaw_rate_radps

    @property
    def finite(self) -> bool:
        """Nothing in it is NaN or infinite."""
        # Each looked at by itself: a tuple of them all would be made at every setpoint.
        (north_m, east_m, down_m), (north_mps, east_mps, down_mps) = self.pos_ned_m, self.vel_ned_mps
        return (
            _finite(north_m)
            and _finite(east_m)
            and _finite(down_m)
            and _finite(north_mps)
            and _finite(east_mps)
            and _finite(down_mps)
            and _finite(self.yaw_rad)
            and _finite(self.yaw_rate_radps)
        )


STOP = Setpoint((None, None, None), (0.0, 0.0, 0.0))


def _finite(value: float | None) -> bool:
    return value is None or math.isfinite(value)


def from_message(message: Any, origin_ned_m: Vec3, heading_rad: float) -> Setpoint | None:
    """None for a kind that is not flown here: another frame, or an axis of which only an acceleration is given.

    In MAV_FRAME_BODY_NED velocities are along and across the heading, and there are no positions.
    """
    mask = message.type_mask
    body = message.coordinate_frame == mav.MAV_FRAME_BODY_NED
    if not body and message.coordinate_frame != mav.MAV_FRAME_LOCAL_NED:
        return None
    if body:
        mask |= POSITION_IGNORE
    north, east, down = (
        None if mask & 1 else message.x + origin_ned_m[0],
        None if mask & 2 else message.y + origin_ned_m[1],
        None if mask & 4 else message.z + origin_ned_m[2],
    )
    velocity = (
        None if mask & 8 else message.vx,
        None if mask & 16 else message.vy,
        None if mask & 32 else message.vz,
    )
    if body and velocity[0] is not None and velocity[1] is not None:
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        velocity = (
            cos * velocity[0] - sin * velocity[1],
            sin * velocity[0] + cos * velocity[1],
            velocity[2],
        )
    vel_north, vel_east, vel_down = velocity
    lacks_level = (north is None and vel_north is None) or (east is None and vel_east is None)
    if lacks_level or (down is None and vel_down is None):
        return None
    yaw = None if mask & mav.POSITION_TARGET_TYPEMASK_YAW_IGNORE else message.yaw
    rate = 0.0 if mask & mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else message.yaw_rate
    return Setpoint((north, east, down), velocity, yaw, rate)
