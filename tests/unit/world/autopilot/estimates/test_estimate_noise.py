"""The errors' noises: stationary from the first value on, of any step, each vehicle's its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.world.autopilot.estimates.errors import PX4_SEEN
from sim_bridge.world.autopilot.estimates.noise import HEIGHT, POSITION, VELOCITY, YAW, Shape, Swinging

SHAPES = st.builds(
    Shape,
    st.floats(0.05, 2.0),
    st.one_of(st.floats(0.1, 0.99), st.floats(1.01, 4.0)),
    st.floats(0.0, 0.5),
)
STEPS_S = st.floats(0.004, 2.0)
SIZES = (0.2, 0.3, 0.5, 0.8, 0.05)  # velocity, climb, position, height, yaw
WANTED = np.array([0.2, 0.2, 0.3, 0.5, 0.5, 0.8, 0.05])


def swinging(*seed: int, sizes: tuple[float, float, float, float, float] = SIZES) -> Swinging:
    return Swinging(
        velocity_sd_mps=sizes[0],
        climb_sd_mps=sizes[1],
        position_sd_m=sizes[2],
        height_sd_m=sizes[3],
        yaw_sd_rad=sizes[4],
        rng=np.random.default_rng(seed),
    )


def values(noise: Swinging) -> tuple[float, ...]:
    return (*noise.velocity_ned_mps, *noise.pos_ned_m, noise.yaw_rad)


def series(noise: Swinging, seconds: float, dt_s: float) -> list[tuple[float, ...]]:
    rows = [values(noise)]
    for _ in range(round(seconds / dt_s)):
        noise.step(dt_s)
        rows.append(values(noise))
    return rows


@given(SHAPES, STEPS_S, STEPS_S)
def test_two_steps_are_one(shape: Shape, one_s: float, other_s: float) -> None:
    first, second = (np.array(shape.turns(dt_s)).reshape(2, 2) for dt_s in (one_s, other_s))
    assert (second @ first).ravel().tolist() == pytest.approx(list(shape.turns(one_s + other_s)), abs=1e-9)


@given(SHAPES, STEPS_S)
def test_a_step_never_adds_to_an_error_so_that_noise_can_make_up_for_what_is_lost(shape: Shape, dt_s: float) -> None:
    turns = np.array(shape.turns(dt_s)).reshape(2, 2)
    assert np.linalg.eigvalsh(np.eye(2) - turns @ turns.T).min() > -1e-12
    assert abs(shape.left(dt_s)) <= 1.0 + 1e-12
    assert shape.left(0.0) == 1.0
    assert abs(shape.left(2000.0)) < 0.01


def test_sizes_are_the_same_at_the_start_and_later_over_many_vehicles() -> None:
    noises = [swinging(seed) for seed in range(1500)]
    for steps in (0, 1, 3, 40):
        for noise in noises:
            for _ in range(steps):
                noise.step(0.5)
        found = np.array([values(noise) for noise in noises])
        assert np.std(found, axis=0).tolist() == pytest.approx(WANTED.tolist(), rel=0.08), steps
        assert (np.abs(np.mean(found, axis=0)) / WANTED).tolist() == pytest.approx([0.0] * 7, abs=0.12), steps


@pytest.mark.parametrize("dt_s", [0.05, 0.25])
def test_steps_of_any_length_forget_alike(dt_s: float) -> None:
    rows = np.array(series(swinging(5), 8000.0, dt_s))
    lag = round(2.0 / dt_s)
    for axis, shape in ((0, VELOCITY), (1, VELOCITY), (2, VELOCITY), (5, HEIGHT), (6, YAW)):
        found = np.corrcoef(rows[:-lag, axis], rows[lag:, axis])[0, 1]
        assert found == pytest.approx(shape.left(2.0), abs=0.08), axis
    assert POSITION.left(2.0) < np.corrcoef(rows[:-lag, 3], rows[lag:, 3])[0, 1] < 0.9


def test_axes_and_vehicles_are_apart() -> None:
    """But for the level position and the velocity along it."""
    one, other = (np.array(series(swinging(1, k), 20_000.0, 1.0)) for k in (1, 2))
    together = np.abs(np.corrcoef(np.hstack([one, other]).T)) - np.eye(14)
    for velocity, position in ((0, 3), (1, 4), (7, 10), (8, 11)):
        assert together[velocity, position] > 0.2
        together[velocity, position] = together[position, velocity] = 0.0
    assert together.max() < 0.12


def test_a_seed_gives_the_same_noise_to_the_bit() -> None:
    assert series(swinging(3, 1), 5.0, 0.05) == series(swinging(3, 1), 5.0, 0.05) != series(swinging(3, 2), 5.0, 0.05)


def test_without_sizes_nothing_is_wrong() -> None:
    assert set(series(swinging(1, sizes=(0.0,) * 5), 1.0, 0.05)) == {(0.0,) * 7}


def test_vehicles_draw_their_sizes_from_all_that_was_seen() -> None:
    drawn = [PX4_SEEN.draw(np.random.default_rng([1, k])) for k in range(500)]
    turn = math.radians(1.0)
    for found, (least, most) in (
        ([e.velocity_noise_mps for e in drawn], PX4_SEEN.velocity_mps),
        ([e.climb_noise_mps for e in drawn], PX4_SEEN.climb_mps),
        ([e.position_noise_m for e in drawn], PX4_SEEN.position_m),
        ([e.height_noise_m for e in drawn], PX4_SEEN.height_m),
        ([e.yaw_bias_rad / turn for e in drawn], PX4_SEEN.yaw_mean_deg),
        ([e.yaw_noise_rad / turn for e in drawn], PX4_SEEN.yaw_deg),
    ):
        assert least <= min(found) < least + 0.02 * (most - least)
        assert most - 0.02 * (most - least) < max(found) <= most
