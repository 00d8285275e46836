"""Velocities that take a vehicle somewhere: pure, NED metres and m/s. Any personality's."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.frames import Vec3


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """Largest speeds in m/s, each positive."""

    xy_mps: float
    up_mps: float
    down_mps: float


def limited(vel_ned_mps: Vec3, limits: SpeedLimits) -> Vec3:
    """Same horizontal direction, within the limits."""
    north, east, down = vel_ned_mps
    speed = math.hypot(north, east)
    if speed > max(limits.xy_mps, 0.0):
        scale = limits.xy_mps / speed
        north, east = north * scale, east * scale
    return (north, east, min(max(down, -limits.up_mps), limits.down_mps))


def towards(pos_ned_m: Vec3, target_ned_m: Vec3, *, gain_xy: float, gain_z: float, limits: SpeedLimits) -> Vec3:
    """Proportional position loop (gains in 1/s), the first stage of PX4's and ArduPilot's cascade."""
    return limited(
        (
            gain_xy * (target_ned_m[0] - pos_ned_m[0]),
            gain_xy * (target_ned_m[1] - pos_ned_m[1]),
            gain_z * (target_ned_m[2] - pos_ned_m[2]),
        ),
        limits,
    )


def stopping_point(pos_ned_m: Vec3, vel_ned_mps: Vec3, *, brake_mps2: float) -> Vec3:
    """Where a vehicle that brakes from now on comes to rest, each axis by itself."""

    def axis(pos: float, vel: float) -> float:
        return pos + vel * abs(vel) / (2.0 * brake_mps2)

    return (
        axis(pos_ned_m[0], vel_ned_mps[0]),
        axis(pos_ned_m[1], vel_ned_mps[1]),
        axis(pos_ned_m[2], vel_ned_mps[2]),
    )


def interpolated(x: float, x_low: float, y_low: float, x_high: float, y_high: float) -> float:
    """From `y_low` at `x_low` to `y_high` at `x_high`, constant outside."""
    if x <= x_low:
        return y_low
    if x >= x_high:
        return y_high
    return y_low + (y_high - y_low) * (x - x_low) / (x_high - x_low)


def wrapped_rad(angle_rad: float) -> float:
    """The same angle in -pi..pi."""
    return math.remainder(angle_rad, math.tau)
