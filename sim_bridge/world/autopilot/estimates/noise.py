"""Noises of an estimator: random, slow, stationary from their first value on, exact in steps of any length.

Two forms. `Wandering`: what was recorded up to 2026-11, each axis forgets evenly, as a random walk that is pulled back
(Ornstein-Uhlenbeck). `Swinging`: what real PX4 showed against its simulator's truth. There an error is smooth at first
and then gone quickly, or swings to the other side: each is a damped swing (`Shape`) pushed by white noise, and a part
of the position's error is the velocity's, added up and forgotten, so that the two go together (exact in steps of up to
a second).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

import numpy as np

from mission.common.frames import Vec3

VELOCITY_MEMORY_S: Final = 4.0  # recorded: an error of the velocity is a quarter as large after 5 s
POSITION_MEMORY_S: Final = 10.0


@dataclass(slots=True, init=False, unsafe_hash=True)
class Shape:
    """Decay of an error: a swing of this frequency and damping (above 1: none to the other side; never 1 itself).

    `rough` is the share of its variance that is the swing's rate, which white noise moves; 0: smooth.
    """

    frequency_radps: Final[float]
    damping: Final[float]
    rough: Final[float]

    def __init__(self, frequency_radps: float, damping: float, rough: float = 0.0) -> None:
        self.frequency_radps = frequency_radps
        self.damping = damping
        self.rough = rough

    def turns(self, dt_s: float) -> tuple[float, float, float, float]:
        """Transition matrix of the free swing's place and rate over `dt_s`, by rows; the rate in frequencies."""
        frequency = self.frequency_radps
        slowing = self.damping * frequency
        apart = frequency * math.sqrt(abs(1.0 - self.damping * self.damping))
        if self.damping < 1.0:
            left = math.exp(-slowing * dt_s)
            even, odd = left * math.cos(apart * dt_s), left * math.sin(apart * dt_s) / apart
        else:
            late, soon = math.exp((apart - slowing) * dt_s), math.exp(-(apart + slowing) * dt_s)
            even, odd = (late + soon) / 2.0, (late - soon) / (2.0 * apart)
        across = frequency * odd
        return even + slowing * odd, across, -across, even - slowing * odd

    def left(self, after_s: float) -> float:
        """Autocorrelation: what is left of an error after that time, in the mean."""
        place, _, _, rate = self.turns(after_s)
        return (1.0 - self.rough) * place + self.rough * rate


# Fitted to what was left of PX4's errors: level velocity after 0.5 to 8 s, level position (with what the velocity adds
# to it) after 1 to 10 s. The others' are not told. Height: no quicker than the vertical velocity is wrong (at 1.2 m it
# changes by 0.18 m/s). Yaw: most of it forgotten within a quarter of a minute.
VELOCITY: Final = Shape(0.43, 0.65, 0.2)
POSITION: Final = Shape(0.53, 1.27)
HEIGHT: Final = Shape(0.15, 1.8)
YAW: Final = Shape(0.3, 1.8)
ADDED_PER_RATIO: Final = 0.115  # of the velocity's error goes into the position, each in its own size
ADDED_MEMORY_S: Final = 16.0


class Noise(ABC):
    """Errors of one vehicle as they are now."""

    velocity_ned_mps: Vec3
    pos_ned_m: Vec3
    yaw_rad: float

    @abstractmethod
    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`."""


class Wandering(Noise):
    """Errors that wander; the yaw is exact. Sizes are standard deviations, level ones on each axis."""

    def __init__(
        self,
        *,
        velocity_sd_mps: float,
        climb_sd_mps: float,
        position_sd_m: float,
        height_sd_m: float,
        rng: np.random.Generator,
    ) -> None:
        self._velocity = _Wander(velocity_sd_mps, climb_sd_mps, VELOCITY_MEMORY_S, rng)
        self._position = _Wander(position_sd_m, height_sd_m, POSITION_MEMORY_S, rng)
        self.velocity_ned_mps, self.pos_ned_m, self.yaw_rad = self._velocity.value, self._position.value, 0.0

    def step(self, dt_s: float) -> None:
        self._velocity.step(dt_s)
        self._position.step(dt_s)
        self.velocity_ned_mps, self.pos_ned_m = self._velocity.value, self._position.value


class _Wander:
    """An Ornstein-Uhlenbeck process on three axes, the vertical one of a size of its own."""

    def __init__(self, level_sd: float, vertical_sd: float, memory_s: float, rng: np.random.Generator) -> None:
        self._level_sd, self._vertical_sd = level_sd, vertical_sd
        self._memory_s, self._rng = memory_s, rng
        self.value: Vec3 = self._draw(1.0)

    def step(self, dt_s: float) -> None:
        if self._level_sd == self._vertical_sd == 0.0:
            return
        kept = math.exp(-dt_s / self._memory_s)
        fresh = self._draw(math.sqrt(1.0 - kept * kept))
        north, east, down = self.value
        self.value = (kept * north + fresh[0], kept * east + fresh[1], kept * down + fresh[2])

    def _draw(self, share: float) -> Vec3:
        north, east, down = (float(x) for x in self._rng.standard_normal(3))
        level_sd = share * self._level_sd
        return (level_sd * north, level_sd * east, share * self._vertical_sd * down)


class Swinging(Noise):
    """Errors that swing, the yaw's too; sizes are standard deviations, level on each axis."""

    def __init__(
        self,
        *,
        velocity_sd_mps: float,
        climb_sd_mps: float,
        position_sd_m: float,
        height_sd_m: float,
        yaw_sd_rad: float,
        rng: np.random.Generator,
    ) -> None:
        self._rng = rng
        self._sizes = (velocity_sd_mps, climb_sd_mps, position_sd_m, height_sd_m, yaw_sd_rad)
        shapes = (VELOCITY, VELOCITY, VELOCITY, POSITION, POSITION, HEIGHT, YAW)
        draws: list[float] = rng.standard_normal(2 * len(shapes) + 2).tolist()
        self._swings = [_Swing(shape, draws[2 * k], draws[2 * k + 1]) for k, shape in enumerate(shapes)]
        self._added = [_Added(self._swings[k], draws[2 * len(shapes) + k]) for k in (0, 1)]
        self._own_share = math.sqrt(1.0 - _Added.variance())
        self._sum_errors()

    def step(self, dt_s: float) -> None:
        swings = self._swings
        draws: list[float] = self._rng.standard_normal(2 * len(swings)).tolist()
        for k, swing in enumerate(swings):
            swing.step(dt_s, draws[2 * k], draws[2 * k + 1])
        for added in self._added:
            added.step(dt_s)
        self._sum_errors()

    def _sum_errors(self) -> None:
        velocity_mps, climb_mps, position_m, height_m, yaw_rad = self._sizes
        v_north, v_east, v_down, north, east, down, yaw = [swing.value for swing in self._swings]
        own, added = self._own_share, self._added
        self.velocity_ned_mps = (velocity_mps * v_north, velocity_mps * v_east, climb_mps * v_down)
        self.pos_ned_m = (
            position_m * (own * north + added[0].value),
            position_m * (own * east + added[1].value),
            height_m * down,
        )
        self.yaw_rad = yaw_rad * yaw


class _Swing:
    """A damped swing that white noise pushes: `value` has mean 0 and variance 1."""

    def __init__(self, shape: Shape, place: float, rate: float) -> None:
        """`place`, `rate`: drawn from the standard normal distribution; so are they when it is at rest in time."""
        self.shape: Final = shape
        self.place = place
        self.rate = rate  # in frequencies
        self._of_place: Final = math.sqrt(1.0 - shape.rough)
        self._of_rate: Final = math.sqrt(shape.rough)
        self._dt_s = 0.0
        self._turns = (1.0, 0.0, 0.0, 1.0)
        self._push = (0.0, 0.0, 0.0)
        self.value = self._of_place * place + self._of_rate * rate

    def step(self, dt_s: float, first: float, second: float) -> None:
        """Advance by `dt_s`, with two draws of the standard normal distribution."""
        if dt_s != self._dt_s:
            self._set_pace(dt_s)
        pp, pr, rp, rr = self._turns
        push_p, push_pr, push_r = self._push
        place, rate = self.place, self.rate
        self.place = pp * place + pr * rate + push_p * first
        self.rate = rp * place + rr * rate + push_pr * first + push_r * second
        self.value = self._of_place * self.place + self._of_rate * self.rate

    def _set_pace(self, dt_s: float) -> None:
        """Sets transition and noise for `dt_s`; the noise restores what a step loses: the variances stay 1."""
        self._dt_s = dt_s
        self._turns = pp, pr, rp, rr = self.shape.turns(dt_s)
        push_p = math.sqrt(max(1.0 - pp * pp - pr * pr, 0.0))
        push_pr = -(pp * rp + pr * rr) / push_p if push_p > 0.0 else 0.0
        self._push = (push_p, push_pr, math.sqrt(max(1.0 - rp * rp - rr * rr - push_pr * push_pr, 0.0)))


class _Added:
    """The part of a position's error that follows from its velocity's, per unit of the position's size."""

    def __init__(self, velocity: _Swing, draw: float) -> None:
        """`draw`: from the standard normal distribution; begins as it goes on, given the velocity's error."""
        self._velocity: Final = velocity
        self._velocity_was = velocity.value
        with_place, with_rate = self._covariances()
        own = self.variance() - with_place * with_place - with_rate * with_rate
        self.value = with_place * velocity.place + with_rate * velocity.rate + math.sqrt(own) * draw

    def step(self, dt_s: float) -> None:
        """After the velocity's."""
        mean = (self._velocity_was + self._velocity.value) / 2.0
        self._velocity_was = self._velocity.value
        kept = math.exp(-dt_s / ADDED_MEMORY_S)
        self.value = kept * self.value + ADDED_PER_RATIO * ADDED_MEMORY_S * (1.0 - kept) * mean

    @staticmethod
    def _covariances() -> tuple[float, float]:
        """With place and rate of the velocity's swing, once all is at rest in time."""
        lost, frequency = 1.0 / ADDED_MEMORY_S, VELOCITY.frequency_radps
        of_place = ADDED_PER_RATIO * math.sqrt(1.0 - VELOCITY.rough)
        of_rate = ADDED_PER_RATIO * math.sqrt(VELOCITY.rough)
        # What each gains and loses in a moment is alike: of_place + frequency with_rate = lost with_place, and
        # of_rate - frequency with_place = (swing's slowing + lost) with_rate.
        slows = 2.0 * VELOCITY.damping * frequency + lost
        with_rate = (of_rate * lost - frequency * of_place) / (frequency * frequency + slows * lost)
        return (of_place + frequency * with_rate) / lost, with_rate

    @staticmethod
    def variance() -> float:
        """Of `value`."""
        with_place, with_rate = _Added._covariances()
        moved = math.sqrt(1.0 - VELOCITY.rough) * with_place + math.sqrt(VELOCITY.rough) * with_rate
        return ADDED_PER_RATIO * ADDED_MEMORY_S * moved
