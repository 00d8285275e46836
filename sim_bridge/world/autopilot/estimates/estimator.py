"""An airframe as its autopilot believes it to be: what is told, and what is flown by, may be wrong and late.

The truth stays with the airframe. What a wrong belief does to the flight:

- **Velocity** wrong by e: the autopilot flies wrong by -e, as it controls what it believes. On the ground it knows
  that it stands still.
- **Position and height**: what holds them, the autopilot in its own modes and the agent by its velocities, holds what
  is told, so the true ones wander by the error, the other way round. A height by a range finder is one over the ground
  below: where that rises, so does the vehicle.
- **Yaw** told too large by e (clockwise). A heading that is held is held as told: the airframe stands e too far to the
  left. Whoever turns a scan by the told yaw turns it by e. A velocity along north is *not* turned: it is measured by
  satellites, which know nothing of the yaw, and the loop over it ends where the velocity is the one wanted. What is
  turned is the push towards it: the controller works out an acceleration along north and leans, by its yaw, e to the
  left of it. So a change of velocity begins e to the left, and the loop brings it back; with 4 degrees a step to 3 m/s
  strays sideways by less than 0.1 m/s, for a second. (Without GNSS odometry turns with the compass, and so do
  velocities: odometry.py.)
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.estimates.errors import EXACT, Errors, Form
from sim_bridge.world.autopilot.estimates.noise import Noise, Swinging, Wandering

SALT: Final = 0xE571  # apart from the seeds of placement, wind and radio


def estimated(airframe: Airframe, errors: Errors, seed: int, vehicle_id: int) -> Airframe:
    """`airframe` as its autopilot sees it: itself where nothing is wrong."""
    return airframe if errors == EXACT else Estimator(airframe, errors, np.random.default_rng([seed, SALT, vehicle_id]))


def _noise(errors: Errors, rng: np.random.Generator) -> Noise:
    match errors.form:
        case Form.WANDERING:
            return Wandering(
                velocity_sd_mps=errors.velocity_noise_mps,
                climb_sd_mps=errors.climb_noise_mps,
                position_sd_m=errors.position_noise_m,
                height_sd_m=errors.height_noise_m,
                rng=rng,
            )
        case Form.SWINGING:
            return Swinging(
                velocity_sd_mps=errors.velocity_noise_mps,
                climb_sd_mps=errors.climb_noise_mps,
                position_sd_m=errors.position_noise_m,
                height_sd_m=errors.height_noise_m,
                yaw_sd_rad=errors.yaw_noise_rad,
                rng=rng,
            )


class Estimator:
    """An Airframe whose state is an estimate of another's, and whose commands are followed as that estimate has it."""

    def __init__(self, airframe: Airframe, errors: Errors, rng: np.random.Generator) -> None:
        self._airframe = airframe
        self._errors = errors
        turn, up = math.tau * rng.random(), 1.0 if rng.random() < 0.5 else -1.0
        self._bias: Vec3 = (
            errors.velocity_bias_mps * math.cos(turn),
            errors.velocity_bias_mps * math.sin(turn),
            -up * errors.climb_bias_mps,
        )
        self._noise = _noise(errors, rng)
        self._now_s = 0.0
        self._ground_down_m = airframe.state.pos_ned_m[2] if airframe.state.on_ground else 0.0
        self._past: deque[tuple[float, AirframeState]] = deque([(0.0, airframe.state)])
        self._state = self._estimate()

    @property
    def state(self) -> AirframeState:
        """Position, velocity and yaw as believed; roll, pitch, rates, contact and throttle as they are."""
        return self._state

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow velocity and heading as believed: what the airframe follows is these without the errors."""
        wanted, yaw_error = _sum(vel_ned_mps, self._velocity_error(), sign=-1.0), self._yaw_error()
        if yaw_error != 0.0:
            wanted = _turned_push(self._airframe.state.vel_ned_mps, wanted, -yaw_error)
        self._airframe.command(wanted, yaw_rad - yaw_error)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is; a height over ground is estimated as if it were level with the origin."""
        self._ground_down_m = down_m
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and the errors with it."""
        self._airframe.step(dt_s)
        self._now_s += dt_s
        self._noise.step(dt_s)
        self._past.append((self._now_s, self._airframe.state))
        while len(self._past) > 1 and self._past[1][0] <= self._now_s - self._errors.delay_s:
            self._past.popleft()
        self._state = self._estimate()

    def _velocity_error(self) -> Vec3:
        """NED m/s; none on the ground."""
        if self._airframe.state.on_ground:
            return (0.0, 0.0, 0.0)
        return _sum(self._bias, self._noise.velocity_ned_mps)

    def _yaw_error(self) -> float:
        """By how much it believes to look too far to the right."""
        return self._errors.yaw_bias_rad + self._noise.yaw_rad

    def _estimate(self) -> AirframeState:
        true = self._airframe.state
        pos_ned_m, vel_ned_mps = self._delayed()
        if self._errors.over_ground:
            pos_ned_m = (pos_ned_m[0], pos_ned_m[1], pos_ned_m[2] - self._ground_down_m)
        attitude_rad, yaw_error = true.attitude_rad, self._yaw_error()
        if yaw_error != 0.0:
            attitude_rad = (*attitude_rad[:2], math.remainder(attitude_rad[2] + yaw_error, math.tau))
        return AirframeState(
            pos_ned_m=_sum(pos_ned_m, self._noise.pos_ned_m),
            vel_ned_mps=_sum(vel_ned_mps, self._velocity_error()),
            attitude_rad=attitude_rad,
            rates_radps=true.rates_radps,
            on_ground=true.on_ground,
            throttle=true.throttle,
        )

    def _delayed(self) -> tuple[Vec3, Vec3]:
        """Position and velocity `delay_s` ago, between two steps where it falls between them."""
        (before_s, before), (after_s, after) = self._past[0], self._past[min(1, len(self._past) - 1)]
        wanted_s = self._now_s - self._errors.delay_s
        if wanted_s <= before_s or after_s == before_s:
            return before.pos_ned_m, before.vel_ned_mps
        share = min((wanted_s - before_s) / (after_s - before_s), 1.0)
        return (
            _between(before.pos_ned_m, after.pos_ned_m, share),
            _between(before.vel_ned_mps, after.vel_ned_mps, share),
        )


def _turned_push(vel_ned_mps: Vec3, wanted_ned_mps: Vec3, turn_rad: float) -> Vec3:
    """The velocity that has the airframe pushed as from its velocity to the wanted one, turned; clockwise."""
    north, east = wanted_ned_mps[0] - vel_ned_mps[0], wanted_ned_mps[1] - vel_ned_mps[1]
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return (vel_ned_mps[0] + c * north - s * east, vel_ned_mps[1] + s * north + c * east, wanted_ned_mps[2])


def _sum(a: Vec3, b: Vec3, *, sign: float = 1.0) -> Vec3:
    return (a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2])


def _between(a: Vec3, b: Vec3, share: float) -> Vec3:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
