"""The own velocity without its odometer's noise, and what is made of the odometer's bias."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.steady import BIAS_MAX_MPS, Steady, drift_of
from companion.core.stopping import DEAD_S, LAG_S
from mission.frames import Vec3

TICK_S, MOST_MPS2 = 0.05, 3.0


def flown(asked: list[tuple[float, float]], *, noise_mps: float, seed: int = 1) -> tuple[float, float]:
    """Rms of what is told less what is flown, and of what is believed less it; a point mass follows `asked`."""
    rng, steady, v, told_off = Random(seed), Steady(TICK_S), (0.0, 0.0), (0.0, 0.0)
    dead, last, told2, steady2 = [(0.0, 0.0)] * round(DEAD_S / TICK_S), (0.0, 0.0), 0.0, 0.0
    for tick, setpoint in enumerate(asked):
        if tick % 2 == 0:  # new every 0.1 s
            told_off = (rng.gauss(0.0, noise_mps), rng.gauss(0.0, noise_mps))
        told: Vec3 = (v[0] + told_off[0], v[1] + told_off[1], 0.0)
        found = steady.velocity(told, (*last, 0.0), acceleration_mps2=MOST_MPS2, dt_s=TICK_S)
        told2 += (told[0] - v[0]) ** 2 + (told[1] - v[1]) ** 2
        steady2 += (found[0] - v[0]) ** 2 + (found[1] - v[1]) ** 2
        last = setpoint
        dead.append(setpoint)
        s = dead.pop(0)
        d = ((s[0] - v[0]) * TICK_S / LAG_S, (s[1] - v[1]) * TICK_S / LAG_S)
        share = min(1.0, MOST_MPS2 * TICK_S / max(math.hypot(*d), 1e-9))
        v = (v[0] + share * d[0], v[1] + share * d[1])
    return math.sqrt(told2 / len(asked)), math.sqrt(steady2 / len(asked))


def test_noise_is_halved_on_a_straight_way_and_through_turns() -> None:
    straight = [(3.0, 0.0)] * 400
    turns = [(3.0 * math.cos(k / 20.0), 3.0 * math.sin(k / 20.0)) for k in range(400)]
    for asked in (straight, turns):
        told_mps, found_mps = flown(asked, noise_mps=0.1)
        assert found_mps < 0.6 * told_mps


def test_a_hard_stop_is_seen_as_fast_as_the_vehicle_flies_it() -> None:
    _, found_mps = flown([(3.0, 0.0)] * 100 + [(0.0, 0.0)] * 60, noise_mps=0.0)
    assert found_mps < 0.05


def test_what_the_model_does_not_foretell_is_believed_within_half_a_second() -> None:
    steady = Steady(TICK_S)
    steady.velocity((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), acceleration_mps2=MOST_MPS2, dt_s=TICK_S)
    for _ in range(10):  # a gust
        found = steady.velocity((1.0, 0.0, 0.2), (1.0, 0.0, 0.0), acceleration_mps2=MOST_MPS2, dt_s=TICK_S)
    assert found[0] > 0.9
    assert found[2] == 0.2  # heights have no such noise


def test_one_that_was_not_steered_begins_with_what_is_told() -> None:
    steady = Steady(TICK_S)
    for told in ((2.0, 0.0, 0.0), (2.0, 0.0, 0.0)):
        steady.velocity(told, (2.0, 0.0, 0.0), acceleration_mps2=MOST_MPS2, dt_s=TICK_S)
    steady.rest()
    assert steady.velocity((-1.0, 1.0, 0.0), (0.0, 0.0, 0.0), acceleration_mps2=MOST_MPS2, dt_s=TICK_S)[0] == -1.0


def test_a_bias_is_taken_off_as_far_as_an_odometers_may_be() -> None:
    assert drift_of((0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert drift_of((0.03, -0.04)) == pytest.approx((-0.03, 0.04, 0.0))
    assert math.hypot(*drift_of((3.0, -4.0))[:2]) == pytest.approx(BIAS_MAX_MPS)
    assert drift_of((math.nan, 0.0)) == (0.0, 0.0, 0.0)
