"""An airframe as its autopilot knows it whose receiver has no fix for a time, or is led astray.

Of vehicles that have nothing but satellites to fly by; where odometry is there, see aiding.py.

- **No fix**: the estimator goes on by its inertial sensors, whose velocity departs from the true one by ACCEL_SD_MPS2
  an axis (a tilt wrong by half a degree), for RECKONS_S: PX4's EKF2_NOAID_TOUT. Then it has no position, and nobody
  controls how the vehicle drifts. Nothing was recorded.
- **No fix, but a velocity from outside** (ODOMETRY of a companion): the estimator is pulled towards it, by FOLLOWS of
  what is between them with each message, and RECKONS_S count from the last one. Its position drifts as its velocity is
  wrong, which is more than what it is told, as the tilt stays wrong: EKF2 would learn some of that. Not recorded.
- **Led astray** (spoofed, or drifting): the estimator follows in position and velocity, as it does where the drift is
  slow against its gates; so what holds a position drifts the other way.

When it is over the estimator is at once where the fix is.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState

ACCEL_SD_MPS2: Final = 0.1
RECKONS_S: Final = 5.0
FOLLOWS: Final = 0.07  # EKF2_ACC_NOISE 0.35 m/s2 against EKF2_EVV_NOISE 0.1 m/s, ten times a second
SALT: Final = 0x6A55  # apart from the seeds of placement, wind, radio and the others


class FaultyGnss:
    """An Airframe whose state is another's, as wrong as its receiver has it."""

    def __init__(self, airframe: Airframe, *, seed: int, vehicle_id: int, body: Airframe | None = None) -> None:
        """`body`: what truly flies, if `airframe` is not that but an estimate of it."""
        self._airframe = airframe
        self._body = airframe if body is None else body
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._drift_ne_mps = (0.0, 0.0)
        self._accel_ne_mps2 = (0.0, 0.0)
        self._vel_error = (0.0, 0.0)  # reported less true, north and east
        self._off = (0.0, 0.0)
        self._without_fix_s = 0.0
        self.has_fix = True
        self._state = airframe.state

    @property
    def state(self) -> AirframeState:
        """Position and velocity as reported, the rest as it is."""
        return self._state

    @property
    def has_position(self) -> bool:
        """The estimator still knows where it is, or thinks so."""
        return self.has_fix or self._without_fix_s < RECKONS_S - 1e-9

    def set_fix(self, has_fix: bool) -> None:
        """Takes the receiver's satellites away, or gives them back."""
        if has_fix is self.has_fix:
            return
        self.has_fix = has_fix
        self._without_fix_s = 0.0
        self._accel_ne_mps2 = (0.0, 0.0) if has_fix else (self._accel(), self._accel())
        if has_fix:
            self._vel_error, self._off = (0.0, 0.0), (0.0, 0.0)

    def receive_velocity(self, vel_ne_mps: tuple[float, float]) -> None:
        """A velocity measured from outside, which counts while there is no fix."""
        if self.has_fix:
            return
        (north, east), told = self._vel_error, self._state.vel_ned_mps
        north, east = north + FOLLOWS * (vel_ne_mps[0] - told[0]), east + FOLLOWS * (vel_ne_mps[1] - told[1])
        self._vel_error = (north, east)
        self._without_fix_s = 0.0

    def set_drift(self, drift_ne_mps: tuple[float, float] | None) -> None:
        """Leads the receiver astray so fast, north and east; None: no more."""
        self._drift_ne_mps = drift_ne_mps or (0.0, 0.0)
        if drift_ne_mps is None and self.has_fix:
            self._off = (0.0, 0.0)

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow a velocity as reported: what the airframe follows is that without the error."""
        north, east = self._vel_error
        self._airframe.command((vel_ned_mps[0] - north, vel_ned_mps[1] - east, vel_ned_mps[2]), yaw_rad)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is."""
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and the error with it."""
        self._airframe.step(dt_s)
        if self._airframe.state.on_ground:  # it knows that it stands still, but the fix wanders all the same
            self._vel_error = (0.0, 0.0)
        elif self.has_fix:
            self._vel_error = self._drift_ne_mps
        elif self.has_position:
            north, east = self._vel_error
            self._vel_error = (north + self._accel_ne_mps2[0] * dt_s, east + self._accel_ne_mps2[1] * dt_s)
        north, east = self._drift_ne_mps if self.has_fix else self._misses()
        self._off = (self._off[0] + north * dt_s, self._off[1] + east * dt_s)
        if not self.has_fix:
            self._without_fix_s += dt_s
        self._state = self._reported_state()

    def _misses(self) -> tuple[float, float]:
        """Without a fix the position is where the reported velocity, all of its errors in it, has led."""
        told, true = self._airframe.state.vel_ned_mps, self._body.state.vel_ned_mps
        return told[0] + self._vel_error[0] - true[0], told[1] + self._vel_error[1] - true[1]

    def _accel(self) -> float:
        return ACCEL_SD_MPS2 * float(self._rng.standard_normal())

    def _reported_state(self) -> AirframeState:
        known = self._airframe.state
        if not (math.hypot(*self._off) or math.hypot(*self._vel_error)):
            return known
        pos, vel = known.pos_ned_m, known.vel_ned_mps
        return AirframeState(
            pos_ned_m=(pos[0] + self._off[0], pos[1] + self._off[1], pos[2]),
            vel_ned_mps=(vel[0] + self._vel_error[0], vel[1] + self._vel_error[1], vel[2]),
            attitude_rad=known.attitude_rad,
            rates_radps=known.rates_radps,
            on_ground=known.on_ground,
            throttle=known.throttle,
        )


def has_position(airframe: Airframe) -> bool:
    """Whoever flies by `airframe` knows where it is, or thinks so."""
    return not isinstance(airframe, FaultyGnss) or airframe.has_position
