"""Velocities that take a vehicle somewhere: pure, NED metres and m/s. Any personality's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mission.common.frames import Vec3


@dataclass(slots=True, init=False, unsafe_hash=True)
class SpeedLimits:
    """Largest speeds in m/s, each positive."""

    xy_mps: Final[float]
    up_mps: Final[float]
    down_mps: Final[float]

    def __init__(self, xy_mps: float, up_mps: float, down_mps: float) -> None:
        self.xy_mps = xy_mps
        self.up_mps = up_mps
        self.down_mps = down_mps


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


def pursuit(here_m: float, want_m: float | None, vel_mps: float | None, gain: float) -> float:
    """One axis of a setpoint: the speed (m/s) towards its position, if it has one, and on with its velocity."""
    return (gain * (want_m - here_m) if want_m is not None else 0.0) + (vel_mps or 0.0)


def stopping_point(pos_ned_m: Vec3, vel_ned_mps: Vec3, *, brake_mps2: float) -> Vec3:
    """Position at which a vehicle that brakes from now on comes to rest, each axis by itself."""

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


def approach_mps(distance_m: float, *, gain: float, brake_mps2: float) -> float:
    """The speed from which a vehicle can still stop at `distance_m`: square root far away, linear near."""
    near_m = brake_mps2 / (gain * gain)
    if distance_m <= near_m:
        return gain * distance_m
    return math.sqrt(brake_mps2 * (2.0 * distance_m - near_m))


class Shaper:
    """Velocity with limited acceleration and jerk towards a desired one: ArduPilot's input shaping, in two parts."""

    def __init__(self) -> None:
        self.vel_ned_mps: Vec3 = (0.0, 0.0, 0.0)
        self._accel: Vec3 = (0.0, 0.0, 0.0)

    def restart(self, vel_ned_mps: Vec3) -> None:
        """From this velocity, without acceleration."""
        self.vel_ned_mps, self._accel = vel_ned_mps, (0.0, 0.0, 0.0)

    def track_velocity(
        self,
        wanted_ned_mps: Vec3,
        dt_s: float,
        *,
        accel_mps2: float,
        jerk_mps3: float,
        lag_s: float,
        lead_s: float,
    ) -> Vec3:
        """One step towards `wanted_ned_mps`; horizontally along the difference, vertically by itself.

        `lag_s`: of the end of the way. `lead_s`: how far ahead the result is, for an airframe that lags behind it.
        """
        wanted, now = wanted_ned_mps, self.vel_ned_mps
        north, east, down = wanted[0] - now[0], wanted[1] - now[1], wanted[2] - now[2]
        accel_n, accel_e, accel_d = self._accel
        rest = math.hypot(north, east)
        desired = _shaped_accel(rest, accel_mps2=accel_mps2, jerk_mps3=jerk_mps3, lag_s=lag_s)
        desired_n, desired_e = (desired * north / rest, desired * east / rest) if rest > 0.0 else (0.0, 0.0)
        desired_d = math.copysign(
            _shaped_accel(abs(down), accel_mps2=accel_mps2, jerk_mps3=jerk_mps3, lag_s=lag_s), down
        )
        change_n, change_e = desired_n - accel_n, desired_e - accel_e
        change_max, change = jerk_mps3 * dt_s, math.hypot(change_n, change_e)
        if change > change_max:
            change_n, change_e = change_n * change_max / change, change_e * change_max / change
        change_d = min(max(desired_d - accel_d, -change_max), change_max)
        self._accel = (accel_n + change_n, accel_e + change_e, accel_d + change_d)
        self.vel_ned_mps = _ahead(self.vel_ned_mps, self._accel, dt_s)
        return _ahead(self.vel_ned_mps, self._accel, lead_s)


def _ahead(vel_ned_mps: Vec3, accel: Vec3, seconds: float) -> Vec3:
    return (
        vel_ned_mps[0] + accel[0] * seconds,
        vel_ned_mps[1] + accel[1] * seconds,
        vel_ned_mps[2] + accel[2] * seconds,
    )


def _shaped_accel(rest_mps: float, *, accel_mps2: float, jerk_mps3: float, lag_s: float) -> float:
    """From which the rest of the way can be made with this jerk; linear near its end."""
    return min(accel_mps2, rest_mps / lag_s, math.sqrt(jerk_mps3 * rest_mps))
