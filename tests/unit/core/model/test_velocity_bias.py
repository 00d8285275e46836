"""A told velocity held against the told positions."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.model.vectors import ZERO, norm
from companion.core.model.velocity_bias import JUMP_M, LIMIT_MPS, VelocityBias


def seen(bias_mps: float, *, seconds: float = 20.0, noise_m: float = 0.0, seed: int = 1) -> VelocityBias:
    """One that turns in a circle at 2 m/s, whose estimator adds `bias_mps` to the north."""
    rng, drift = random.Random(seed), VelocityBias()
    for k in range(round(seconds * 20)):
        t = 0.05 * k
        pos = (4.0 * math.sin(0.5 * t) + rng.gauss(0.0, noise_m), 4.0 - 4.0 * math.cos(0.5 * t), -8.0)
        vel = (2.0 * math.cos(0.5 * t) + bias_mps, 2.0 * math.sin(0.5 * t), 0.0)
        drift.update(pos, vel, 100.0 + t)
    return drift


@pytest.mark.parametrize("bias_mps", [-0.4, 0.0, 0.4])
def test_lie_is_found_whatever_the_flight(bias_mps: float) -> None:
    assert seen(bias_mps).ned_mps == pytest.approx((-bias_mps, 0.0, 0.0), abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_position_hardly_shows(seed: int) -> None:
    assert norm(seen(0.0, noise_m=0.05, seed=seed).ned_mps) < 0.06


def test_half_of_a_lie_is_found_within_two_seconds() -> None:
    assert -0.4 <= seen(0.4, seconds=2.0).ned_mps[0] <= -0.2


def test_jump_of_the_position_is_no_velocity() -> None:
    drift = seen(0.0)
    before = drift.ned_mps
    for k in range(20):
        drift.update((50.0 + 2.0 * JUMP_M, 0.0, -8.0), ZERO, 120.0 + 0.05 * k)
    assert drift.ned_mps == pytest.approx(before, abs=0.01)


def test_what_is_found_is_bounded() -> None:
    drift = VelocityBias()
    for k in range(400):
        drift.update((0.06 * k, 0.0, 0.0), (-5.0, 0.0, 0.0), 0.05 * k)
        assert norm(drift.ned_mps) <= LIMIT_MPS + 1e-9


def test_after_a_silence_it_is_watched_anew() -> None:
    drift = seen(0.4)
    drift.update((900.0, 0.0, -8.0), ZERO, 200.0)
    assert drift.ned_mps == ZERO


def test_repeated_or_overtaken_word_changes_nothing() -> None:
    drift = seen(0.4)
    before = drift.ned_mps
    drift.update((7.0, 7.0, -8.0), ZERO, 119.95)
    drift.update((7.0, 7.0, -8.0), ZERO, 119.5)
    assert drift.ned_mps == before


def test_what_is_no_number_is_forgotten_with_the_next_that_is() -> None:
    drift = seen(0.0)
    drift.update((math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), 120.0)
    for k in range(20):
        drift.update((0.0, 0.0, -8.0), ZERO, 120.05 + 0.05 * k)
    assert norm(drift.ned_mps) < 0.05
