"""An airframe as an autopilot without GNSS knows it: by flow or visual-inertial odometry, compass and barometer.

Its positions count from where it was switched on, along the north of its own compass. They come from velocities that
are wrong by noise and a slow bias, so they drift. Nothing of the true place gets past here: whoever flies and tells by
this state cannot leak it. On the ground it knows that it stands still.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from mission.document.model import OdometryErrors
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState

BIAS_MEMORY_S: Final = 20.0
YAW_MEMORY_S: Final = 300.0
NOISE_EVERY_S: Final = 0.1
HEIGHT_NOISE_M: Final = 0.1  # of a barometer with a rangefinder beside it
HEIGHT_MEMORY_S: Final = 10.0
SALT: Final = 0x0D0  # apart from the seeds of placement, wind, radio and the others


class Odometer:
    """An Airframe whose state is what odometry makes of another's, and whose commands are followed as it has them."""

    def __init__(
        self, airframe: Airframe, errors: OdometryErrors, *, seed: int, vehicle_id: int, turn_rad: float = 0.0
    ) -> None:
        """`turn_rad`: by how much the north of all compasses is off the map's, eastwards."""
        self._airframe = airframe
        self._errors = errors
        self._turn_rad = turn_rad
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._yaw_sd = math.radians(errors.yaw_deg)
        self._yaw_error = self._yaw_sd * self._normal()  # true yaw less told yaw, beside `turn_rad`
        self._bias = (errors.velocity_bias_mps * self._normal(), errors.velocity_bias_mps * self._normal())
        self._noise = (0.0, 0.0)
        self._noise_left_s = 0.0
        self._height_off_m = 0.0
        self._odo = (0.0, 0.0)
        self._began_down_m = airframe.state.pos_ned_m[2]
        self._state = self._reported_state()

    @property
    def state(self) -> AirframeState:
        """Position, velocity and yaw as told; the rest as it is."""
        return self._state

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow a velocity as told: what the airframe follows is turned by the compass's error, and without the bias.

        Noise is too quick to be followed.
        """
        north, east = vel_ned_mps[0], vel_ned_mps[1]
        if not self._airframe.state.on_ground:
            north, east = north - self._bias[0], east - self._bias[1]
        c, s = self._turned()
        level = (c * north - s * east, s * north + c * east)
        self._airframe.command((*level, vel_ned_mps[2]), yaw_rad + self.north_off_rad)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is."""
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and the errors with it."""
        self._airframe.step(dt_s)
        errors = self._errors
        keep = math.exp(-dt_s / BIAS_MEMORY_S)
        fresh = errors.velocity_bias_mps * math.sqrt(1.0 - keep * keep)
        self._bias = (keep * self._bias[0] + fresh * self._normal(), keep * self._bias[1] + fresh * self._normal())
        keep = math.exp(-dt_s / YAW_MEMORY_S)
        self._yaw_error = keep * self._yaw_error + self._yaw_sd * math.sqrt(1.0 - keep * keep) * self._normal()
        keep = math.exp(-dt_s / HEIGHT_MEMORY_S)
        self._height_off_m = keep * self._height_off_m + HEIGHT_NOISE_M * math.sqrt(1.0 - keep * keep) * self._normal()
        self._noise_left_s -= dt_s
        if self._noise_left_s <= 1e-9:
            self._noise_left_s += NOISE_EVERY_S
            self._noise = (errors.velocity_noise_mps * self._normal(), errors.velocity_noise_mps * self._normal())
        before = self._state.vel_ned_mps
        self._odo = (self._odo[0] + before[0] * dt_s, self._odo[1] + before[1] * dt_s)
        self._state = self._reported_state()

    def _normal(self) -> float:
        return float(self._rng.standard_normal())

    @property
    def north_off_rad(self) -> float:
        """By how much the north that it tells by is off the map's, eastwards: true yaw less told yaw."""
        return self._yaw_error + self._turn_rad

    def _turned(self) -> tuple[float, float]:
        return math.cos(self.north_off_rad), math.sin(self.north_off_rad)

    def _reported_state(self) -> AirframeState:
        true = self._airframe.state
        north = east = down = height_m = 0.0
        if not true.on_ground:
            c, s = self._turned()
            vel = true.vel_ned_mps
            north = c * vel[0] + s * vel[1] + self._bias[0] + self._noise[0]
            east = -s * vel[0] + c * vel[1] + self._bias[1] + self._noise[1]
            down, height_m = vel[2], self._height_off_m
        roll, pitch, yaw = true.attitude_rad
        return AirframeState(
            pos_ned_m=(*self._odo, true.pos_ned_m[2] - self._began_down_m + height_m),
            vel_ned_mps=(north, east, down),
            attitude_rad=(roll, pitch, math.remainder(yaw - self.north_off_rad, math.tau)),
            rates_radps=true.rates_radps,
            on_ground=true.on_ground,
            throttle=true.throttle,
        )
