"""An airframe as an autopilot knows it that has GNSS, and odometry for where it has none.

While it uses satellites its position follows the fixes, and by them it corrects its velocity and its compass: what is
left of odometry's errors is AIDED of them. When fixes have been bad for STOP_S it uses them no longer: its position
goes on by odometry, and drifts. When they have been good for START_S it uses them again, and its position is at once
where the fix is. So PX4's EKF2 does it by the sources of 1.14 (5 s each way; while flow or vision is used a reset of
the position, none of the velocity); ArduPilot's EKF3 is taken to do the same. Nothing was recorded.

Good is what PX4 asks for by default: EKF2_REQ_NSATS 6, EKF2_REQ_HDOP 2.5, EKF2_REQ_EPH 3 m.

At its start the position is that of the fix, or of the truth where there is none: it was told where it stands.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from mission.document.model import OdometryErrors
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.estimates.odometry import BIAS_MEMORY_S, NOISE_EVERY_S
from sim_bridge.world.sensors.satellites import Fix, Receiver

AIDED: Final = 0.2
STOP_S: Final = 5.0
START_S: Final = 5.0
NEEDS_SATELLITES: Final = 6
NEEDS_HDOP: Final = 2.5
NEEDS_SD_M: Final = 3.0
FOLLOWS_S: Final = 3.0  # a position follows the fixes within so long
SALT: Final = 0xA1DE  # apart from the seeds of placement, wind, radio and the others


def is_good(fix: Fix) -> bool:
    """An autopilot may go by it."""
    return fix.is_3d and fix.satellites >= NEEDS_SATELLITES and fix.hdop <= NEEDS_HDOP and fix.sd_m <= NEEDS_SD_M


class Aided:
    """An Airframe whose state is what satellites and odometry make of another's."""

    def __init__(
        self, airframe: Airframe, receiver: Receiver, errors: OdometryErrors, *, seed: int, vehicle_id: int
    ) -> None:
        self._airframe = airframe
        self._receiver = receiver
        self._errors = errors
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._now_s = 0.0
        self._yaw_error = AIDED * math.radians(errors.yaw_deg) * self._normal()  # true less told: learnt, and kept
        self._bias = (errors.velocity_bias_mps * self._normal(), errors.velocity_bias_mps * self._normal())
        self._share = AIDED  # of bias and noise that is left
        self._noise = (0.0, 0.0)
        self._noise_left_s = 0.0
        receiver.step(airframe.state.pos_ned_m, 0.0)
        self._off = receiver.fix.off_ne_m  # told position less the true one
        self._fix_ned_m = airframe.state.pos_ned_m
        self._uses = True
        self._changing_s = 0.0  # for how long fixes have been other than `uses` goes by
        self._state = self._reported_state()

    @property
    def state(self) -> AirframeState:
        """Position, velocity and yaw as told; the rest as it is. Heights are true."""
        return self._state

    @property
    def uses(self) -> bool:
        """It goes by GNSS."""
        return self._uses

    @property
    def north_off_rad(self) -> float:
        """By how much the north that it tells by is off the map's, eastwards: true yaw less told yaw."""
        return self._yaw_error

    @property
    def fix(self) -> Fix:
        """The receiver's last."""
        return self._receiver.fix

    @property
    def fix_ned_m(self) -> Vec3:
        """Position; the last one, where there is none."""
        return self._fix_ned_m

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow a velocity as told: what the airframe follows is turned by the compass's error, without the bias."""
        north, east = vel_ned_mps[0], vel_ned_mps[1]
        if not self._airframe.state.on_ground:
            north, east = north - self._share * self._bias[0], east - self._share * self._bias[1]
        c, s = math.cos(self._yaw_error), math.sin(self._yaw_error)
        self._airframe.command((c * north - s * east, s * north + c * east, vel_ned_mps[2]), yaw_rad + self._yaw_error)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is."""
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and what is known of it."""
        was = self._airframe.state.vel_ned_mps
        self._airframe.step(dt_s)
        self._now_s += dt_s
        keep = math.exp(-dt_s / BIAS_MEMORY_S)
        fresh = self._errors.velocity_bias_mps * math.sqrt(1.0 - keep * keep)
        self._bias = (keep * self._bias[0] + fresh * self._normal(), keep * self._bias[1] + fresh * self._normal())
        # What it knows of its bias by GNSS it forgets as the bias changes.
        self._share = AIDED if self._uses else 1.0 - keep * (1.0 - self._share)
        self._noise_left_s -= dt_s
        if self._noise_left_s <= 1e-9:
            self._noise_left_s += NOISE_EVERY_S
            noise_mps = self._errors.velocity_noise_mps
            self._noise = (noise_mps * self._normal(), noise_mps * self._normal())
        if self._receiver.step(self._airframe.state.pos_ned_m, self._now_s):
            self._choose()
        if self._uses and self._receiver.fix.is_3d:
            self._apply_fix(self._receiver.fix, dt_s)
        else:
            told = self._state.vel_ned_mps
            self._off = (self._off[0] + (told[0] - was[0]) * dt_s, self._off[1] + (told[1] - was[1]) * dt_s)
        self._state = self._reported_state()

    def _choose(self) -> None:
        """True if satellites are to be used, after another fix."""
        fix, true = self._receiver.fix, self._airframe.state.pos_ned_m
        if fix.is_3d:
            self._fix_ned_m = (true[0] + fix.off_ne_m[0], true[1] + fix.off_ne_m[1], true[2])
        good = is_good(fix)
        if good is self._uses:
            self._changing_s = self._now_s
        elif self._now_s - self._changing_s >= (STOP_S if self._uses else START_S) - 1e-9:
            self._uses, self._changing_s = good, self._now_s
            if good:
                self._off = fix.off_ne_m

    def _apply_fix(self, fix: Fix, dt_s: float) -> None:
        """Bad fixes too, until it stops."""
        share = 1.0 - math.exp(-dt_s / FOLLOWS_S)
        north, east = self._off
        self._off = (north + share * (fix.off_ne_m[0] - north), east + share * (fix.off_ne_m[1] - east))

    def _normal(self) -> float:
        return float(self._rng.standard_normal())

    def _reported_state(self) -> AirframeState:
        true = self._airframe.state
        north = east = 0.0
        if not true.on_ground:
            c, s = math.cos(self._yaw_error), math.sin(self._yaw_error)
            vel, share = true.vel_ned_mps, self._share
            north = c * vel[0] + s * vel[1] + share * (self._bias[0] + self._noise[0])
            east = -s * vel[0] + c * vel[1] + share * (self._bias[1] + self._noise[1])
        roll, pitch, yaw = true.attitude_rad
        pos = true.pos_ned_m
        return AirframeState(
            pos_ned_m=(pos[0] + self._off[0], pos[1] + self._off[1], pos[2]),
            vel_ned_mps=(north, east, true.vel_ned_mps[2]),
            attitude_rad=(roll, pitch, math.remainder(yaw - self._yaw_error, math.tau)),
            rates_radps=true.rates_radps,
            on_ground=true.on_ground,
            throttle=true.throttle,
        )
