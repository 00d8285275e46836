"""Estimate errors of each vehicle's autopilot: what `[sim]` asks for, and what real autopilots showed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

import numpy as np

from mission.document.model import Estimates, Personality, Sim

SALT: Final = 0xE572  # apart from the seeds of placement, wind, radio and the errors themselves


class Form(Enum):
    """Course of errors in time: see noise.py."""

    WANDERING = "wandering"
    SWINGING = "swinging"


@dataclass(frozen=True, slots=True)
class Errors:
    """Sizes of one vehicle's errors; the noises are standard deviations, level ones on each axis."""

    velocity_bias_mps: float = 0.0  # level, the direction by the seed
    climb_bias_mps: float = 0.0  # up or down, by the seed
    velocity_noise_mps: float = 0.0  # level
    position_noise_m: float = 0.0  # level
    climb_noise_mps: float = 0.0  # vertical, and the next
    height_noise_m: float = 0.0
    yaw_bias_rad: float = 0.0
    yaw_noise_rad: float = 0.0
    delay_s: float = 0.0
    over_ground: bool = False  # the height is estimated as if the ground were level, as by a downward range finder
    form: Form = Form.WANDERING


@dataclass(frozen=True, slots=True)
class Seen:
    """From the least to the most that vehicles of a make showed; each vehicle of each flight has its own between."""

    velocity_mps: tuple[float, float]
    climb_mps: tuple[float, float]
    position_m: tuple[float, float]
    height_m: tuple[float, float]
    yaw_mean_deg: tuple[float, float]
    yaw_deg: tuple[float, float]

    def draw(self, rng: np.random.Generator) -> Errors:
        """One vehicle's."""
        velocity, climb, position, height, yaw_mean, yaw = (
            float(rng.uniform(least, most))
            for least, most in (
                self.velocity_mps,
                self.climb_mps,
                self.position_m,
                self.height_m,
                self.yaw_mean_deg,
                self.yaw_deg,
            )
        )
        return Errors(
            velocity_noise_mps=velocity,
            climb_noise_mps=climb,
            position_noise_m=position,
            height_noise_m=height,
            yaw_bias_rad=math.radians(yaw_mean),
            yaw_noise_rad=math.radians(yaw),
            form=Form.SWINGING,
        )


EXACT = Errors()
# Eight PX4 1.16 in its own simulator (SIH), told against true, in the air
PX4_SEEN: Final = Seen(
    velocity_mps=(0.21, 0.27),
    climb_mps=(0.17, 0.23),
    position_m=(0.17, 0.28),
    height_m=(0.34, 1.2),
    yaw_mean_deg=(-4.3, 4.3),
    yaw_deg=(1.0, 3.1),
)
VERTICAL_SHARE: Final = 0.5  # of the level error; recorded: 0.12 m/s beside 0.23 m/s
# As tests/scenario/test_recorded_estimates.py finds them in logs that know no truth: in the air, told velocities
# against the change of told positions; standing, how far told positions wander. ArduCopter has no other: its truth
# has not been recorded.
RECORDED_2026_11: Mapping[Personality, Errors] = {
    Personality.PX4: Errors(
        velocity_noise_mps=0.23,
        climb_noise_mps=VERTICAL_SHARE * 0.23,
        position_noise_m=0.1,
        height_noise_m=VERTICAL_SHARE * 0.1,
    ),
    Personality.ARDUPILOT: Errors(
        velocity_bias_mps=0.025,
        velocity_noise_mps=0.015,
        climb_noise_mps=VERTICAL_SHARE * 0.015,
        position_noise_m=0.01,
        height_noise_m=VERTICAL_SHARE * 0.01,
    ),
}
# Chosen, not recorded: of a height that the EKF takes from a downward range finder over firm ground.
RANGE_FINDER_HEIGHT_M: Final = 0.1
RANGE_FINDER_CLIMB_MPS: Final = 0.05


def errors_of(sim: Sim, vehicle_id: int) -> Errors:
    """Errors that `[sim]` gives one vehicle: the keys that stand there, over its make's figures."""
    errors = _recorded(sim, vehicle_id)
    keys = ("velocity_bias_mps", "climb_bias_mps", "velocity_noise_mps", "position_noise_m")
    given = {key: value for key in keys if (value := getattr(sim, key)) is not None}
    for level, vertical in (("velocity_noise_mps", "climb_noise_mps"), ("position_noise_m", "height_noise_m")):
        if level in given:
            given[vertical] = VERTICAL_SHARE * given[level]
    errors = replace(errors, **given, delay_s=sim.estimate_delay_s)
    return _with_range_finder(errors) if sim.range_finder else errors


def _with_range_finder(errors: Errors) -> Errors:
    return replace(
        errors,
        climb_bias_mps=0.0,
        climb_noise_mps=min(errors.climb_noise_mps, RANGE_FINDER_CLIMB_MPS),
        height_noise_m=min(errors.height_noise_m, RANGE_FINDER_HEIGHT_M),
        over_ground=True,
    )


def _recorded(sim: Sim, vehicle_id: int) -> Errors:
    make = sim.personality_of(vehicle_id)
    match sim.estimates:
        case Estimates.EXACT:
            return EXACT
        case Estimates.RECORDED_2026_11:
            return RECORDED_2026_11[make]
        case Estimates.RECORDED:
            if make is Personality.PX4:
                return PX4_SEEN.draw(np.random.default_rng([sim.seed, SALT, vehicle_id]))
            return RECORDED_2026_11[make]
