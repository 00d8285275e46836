"""An airframe as its autopilot believes it to be: what is told, and what is flown by, may be wrong and late.

The truth stays with the airframe. A velocity that is wrong by e makes the autopilot fly wrong by -e: it controls what
it believes. On the ground it knows that it stands still.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from mission.document.model import Estimates, Personality, Sim
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState

VELOCITY_MEMORY_S: Final = 4.0  # recorded: an error of the velocity is a quarter as large after 5 s
POSITION_MEMORY_S: Final = 10.0
VERTICAL_SHARE: Final = 0.5  # recorded: 0.12 m/s beside 0.23 m/s
SALT = 0xE571  # apart from the seeds of placement, wind and radio


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of the estimates of one vehicle are; the noises are standard deviations on each level axis."""

    velocity_bias_mps: float = 0.0  # level, the direction by the seed
    climb_bias_mps: float = 0.0  # up or down, by the seed
    velocity_noise_mps: float = 0.0
    position_noise_m: float = 0.0
    delay_s: float = 0.0


EXACT = Errors()
# As tests/scenario/test_recorded_estimates.py finds them: in the air, told velocities against the change of told
# positions; standing, how far told positions wander.
RECORDED: Mapping[Personality, Errors] = {
    Personality.PX4: Errors(velocity_noise_mps=0.23, position_noise_m=0.1),
    Personality.ARDUPILOT: Errors(velocity_bias_mps=0.025, velocity_noise_mps=0.015, position_noise_m=0.01),
}


def errors_of(sim: Sim, vehicle_id: int) -> Errors:
    """Errors that `[sim]` gives one vehicle: the keys that stand there, over its personality's figures."""
    errors = RECORDED[sim.personality_of(vehicle_id)] if sim.estimates is Estimates.RECORDED else EXACT
    keys = ("velocity_bias_mps", "climb_bias_mps", "velocity_noise_mps", "position_noise_m")
    given = {key: value for key in keys if (value := getattr(sim, key)) is not None}
    return replace(errors, **given, delay_s=sim.estimate_delay_s)


def estimated(airframe: Airframe, errors: Errors, seed: int, vehicle_id: int) -> Airframe:
    """`airframe` as its autopilot sees it: itself where nothing is wrong."""
    return airframe if errors == EXACT else Estimator(airframe, errors, np.random.default_rng([seed, SALT, vehicle_id]))


class Estimator:
    """An Airframe whose state is an estimate of another's, and whose commands are followed as that estimate has it."""

    def __init__(self, airframe: Airframe, errors: Errors, rng: np.random.Generator) -> None:
        self._airframe = airframe
        self._errors = errors
        self._rng = rng
        turn, up = math.tau * rng.random(), 1.0 if rng.random() < 0.5 else -1.0
        self._bias: Vec3 = (
            errors.velocity_bias_mps * math.cos(turn),
            errors.velocity_bias_mps * math.sin(turn),
            -up * errors.climb_bias_mps,
        )
        self._velocity_noise = _Wander(errors.velocity_noise_mps, VELOCITY_MEMORY_S, rng)
        self._position_noise = _Wander(errors.position_noise_m, POSITION_MEMORY_S, rng)
        self._now_s = 0.0
        self._past: deque[tuple[float, AirframeState]] = deque([(0.0, airframe.state)])
        self._state = self._estimate()

    @property
    def state(self) -> AirframeState:
        """Position and velocity as believed; attitude, rates, contact and throttle as they are."""
        return self._state

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow a velocity as believed: what the airframe follows is that without the error."""
        self._airframe.command(_sum(vel_ned_mps, self._velocity_error(), sign=-1.0), yaw_rad)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is."""
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and the errors with it."""
        self._airframe.step(dt_s)
        self._now_s += dt_s
        self._velocity_noise.step(dt_s)
        self._position_noise.step(dt_s)
        self._past.append((self._now_s, self._airframe.state))
        while len(self._past) > 1 and self._past[1][0] <= self._now_s - self._errors.delay_s:
            self._past.popleft()
        self._state = self._estimate()

    def _velocity_error(self) -> Vec3:
        """NED m/s; none on the ground."""
        if self._airframe.state.on_ground:
            return (0.0, 0.0, 0.0)
        return _sum(self._bias, self._velocity_noise.value)

    def _estimate(self) -> AirframeState:
        pos_ned_m, vel_ned_mps = self._delayed()
        return replace(
            self._airframe.state,
            pos_ned_m=_sum(pos_ned_m, self._position_noise.value),
            vel_ned_mps=_sum(vel_ned_mps, self._velocity_error()),
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


class _Wander:
    """An Ornstein-Uhlenbeck process on three axes, the vertical one smaller; steps of any length are exact."""

    def __init__(self, sd: float, memory_s: float, rng: np.random.Generator) -> None:
        self._sd, self._memory_s, self._rng = sd, memory_s, rng
        self.value: Vec3 = self._draw(sd)

    def step(self, dt_s: float) -> None:
        if self._sd == 0.0:
            return
        kept = math.exp(-dt_s / self._memory_s)
        fresh = self._draw(self._sd * math.sqrt(1.0 - kept * kept))
        north, east, down = self.value
        self.value = (kept * north + fresh[0], kept * east + fresh[1], kept * down + fresh[2])

    def _draw(self, sd: float) -> Vec3:
        north, east, down = (float(x) for x in self._rng.standard_normal(3))
        return (sd * north, sd * east, VERTICAL_SHARE * sd * down)


def _sum(a: Vec3, b: Vec3, *, sign: float = 1.0) -> Vec3:
    return (a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2])


def _between(a: Vec3, b: Vec3, share: float) -> Vec3:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
