"""Positions that all report, held against ranges: who is led astray, and how near a neighbour may be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.core.localisation.integrity.range_check import FOUND_M, NEAR_M, RangeCheck
from companion.core.model.displaced import Displaced
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import norm
from mission.common.frames import Vec3
from tests.unit.core.core_kit import beacon

DT_S = 0.1


def neighbour(vehicle: int, rel_ned_m: Vec3) -> Neighbour:
    return Neighbour(beacon(vehicle), rel_ned_m, None, 0.0, (0.0, 0.0, 0.0), norm(rel_ned_m))


class Swarm:
    """Vehicle 1 among others, whose ranges have noise and are now and then too long; positions err as recorded."""

    def __init__(self, seed: int, places: list[tuple[float, float]]) -> None:
        self.rng = np.random.default_rng(seed)
        self.true = np.array([(0.0, 0.0), *places])
        self.error = self.rng.normal(0.0, 0.25, self.true.shape)
        self.led = np.zeros_like(self.true)
        self.check = RangeCheck(1, len(self.true))
        self.now_s = 0.0

    def run(self, for_s: float, drift_mps: tuple[float, float] = (0.0, 0.0), of: int = 1) -> Displaced | None:
        """Until it is found, or for so long."""
        until_s = self.now_s + for_s
        while self.now_s < until_s and self.check.displaced is None:
            self.now_s += DT_S
            self.led[of - 1] += np.array(drift_mps) * DT_S
            told = self.true + self.error + self.led
            apart = np.linalg.norm(self.true - self.true[0], axis=1)
            late = np.where(self.rng.random(len(apart)) < 0.05, self.rng.uniform(0.2, 1.2, len(apart)), 0.0)
            measured = apart + self.rng.normal(0.0, 0.1, len(apart)) + late
            self.check.receive(tuple((k + 1, float(measured[k]), 0.0) for k in range(1, len(apart))), self.now_s)
            rel = told - told[0]
            seen = [neighbour(k + 1, (float(rel[k, 0]), float(rel[k, 1]), 0.0)) for k in range(1, len(apart))]
            self.check.update(seen, self.now_s)
        return self.check.displaced


def drawn(seed: int, n: int) -> list[tuple[float, float]]:
    """Places about the vehicle, 6 to 20 m off, none in the direction of another."""
    rng = np.random.default_rng([seed, n])
    angles = rng.uniform(0.0, 2.0 * math.pi) + np.arange(n - 1) * 2.0 * math.pi / (n - 1)
    away = rng.uniform(6.0, 20.0, n - 1)
    return [(float(m * math.cos(a)), float(m * math.sin(a))) for a, m in zip(angles, away, strict=True)]


@pytest.mark.parametrize("n", [4, 8, 12])
@pytest.mark.parametrize("seed", range(8))
def test_true_positions_are_believed(seed: int, n: int) -> None:
    assert Swarm(seed, drawn(seed, n)).run(60.0) is None


@pytest.mark.parametrize("n", [6, 8, 12])
@pytest.mark.parametrize("seed", range(8))
def test_a_drift_is_found_before_5_m_on_the_side_on_which_it_is(seed: int, n: int) -> None:
    swarm, angle = Swarm(seed, drawn(seed, n)), 0.7 * seed
    found = swarm.run(60.0, (0.3 * math.cos(angle), 0.3 * math.sin(angle)))
    assert found is not None
    assert float(np.linalg.norm(swarm.led[0])) <= 5.0
    wrong_m = swarm.led[0] + swarm.error[0] - swarm.error[1:].mean(axis=0) - np.array(found.off_ne_m)
    assert float(np.linalg.norm(wrong_m)) <= 1.2
    assert found.error_m == FOUND_M
    assert math.hypot(*found.drift_ne_mps) < 1.0


@pytest.mark.parametrize("seed", range(8))
def test_a_neighbour_that_is_led_astray_or_lies_moves_nobody_else(seed: int) -> None:
    swarm = Swarm(seed, drawn(seed, 6))
    assert swarm.run(60.0, (0.5, 0.3), of=3) is None


def test_of_three_neighbours_one_may_be_the_liar() -> None:
    """Two are as far as before, on their circles: the third alone tells, and could be wrong itself."""
    swarm = Swarm(4, drawn(4, 4))
    angle = 0.7 * 4
    found = swarm.run(60.0, (0.3 * math.cos(angle), 0.3 * math.sin(angle)))
    assert found is not None
    assert float(np.linalg.norm(swarm.led[0])) > 5.0


def test_two_neighbours_tell_nothing() -> None:
    assert Swarm(1, drawn(1, 3)).run(60.0, (0.5, 0.0)) is None


def test_in_one_line_the_side_stays_open() -> None:
    """Led away from the line of the others, it is off by so much, or on the line's other side."""
    found = Swarm(2, [(-4.0, 8.0), (-4.0, -8.0), (-4.0, 16.0), (-4.0, -16.0)]).run(60.0, (0.3, 0.0))
    assert found is not None
    assert found.off_ne_m == found.drift_ne_mps == (0.0, 0.0)
    assert found.error_m >= 8.0


def test_ranges_bring_nearer_and_make_none_farther() -> None:
    check = RangeCheck(1, 3)
    check.receive(((2, 5.0, 0.0), (3, 30.0, 0.0)), 1.0)
    assert check.near_ned_m(2, (8.0, 0.0, 0.0), 1.1) == pytest.approx((5.0 + NEAR_M, 0.0, 0.0))
    assert check.near_ned_m(3, (8.0, 0.0, 0.0), 1.1) == (8.0, 0.0, 0.0)
    assert check.near_ned_m(2, (8.0, 0.0, 0.0), 2.0) == (8.0, 0.0, 0.0)  # long ago
    near = check.bring_near(neighbour(2, (0.0, 8.0, 3.0)), 1.1)
    assert near.rel_ned_m == pytest.approx((0.0, 4.0 + NEAR_M, 3.0))
    assert near.distance_m == pytest.approx(norm(near.rel_ned_m))


def test_ranges_to_strangers_and_itself_are_none() -> None:
    check = RangeCheck(1, 2)
    check.receive(((1, 2.0, 0.0), (7, 2.0, 0.0)), 1.0)
    assert check.near_ned_m(7, (8.0, 0.0, 0.0), 1.0) == (8.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_liar_beside_others_in_a_line_chooses_no_side(seed: int) -> None:
    """Its false place fits the own one's mirror image; the own fix walks by 2 m, as GNSS may: nobody is moved there."""
    swarm = Swarm(seed, [(-4.0, 8.0), (-4.0, -8.0), (-4.0, 16.0), (-4.0, -16.0), (-4.0, 12.0), (6.0, 3.0)])
    swarm.led[6] = (-20.0, 0.0)
    swarm.led[0] = (2.0, 0.0)
    found = swarm.run(20.0)
    assert found is None or found.off_ne_m == (0.0, 0.0)
