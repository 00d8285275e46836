"""Noise of the scans by the scans themselves: none in a stand that is flown through, all of it where there is some."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.model.events import Position
from companion.core.perception.level_scan import LevelScan, ScanClass, level_scan_of
from companion.core.perception.scan_noise import WIDENS_MAX_M, ScanNoise
from tests.unit.core.perception.scan_kit import FINE, SECTORS, level_scan, sectors
from tests.unit.core.perception.test_scan_odometry import stand

STEP_S = 0.1


def flown(kind: ScanClass, noise_m: float, *, speed_mps: float = 3.0, turns: int = 80) -> ScanNoise:
    """North through a stand; the sensor's class errs as it does, and by so much more."""
    rng, stems, noise = random.Random(3), stand(), ScanNoise(kind)
    sd_m = math.hypot(kind.range_sd_m, noise_m)
    for k in range(turns):
        eye = (speed_mps * STEP_S * k, 0.0)
        turn = (
            level_scan(stems, eye)
            if kind.has_widths
            else level_scan_of(sectors(stems, eye, 0.2 * math.sin(k)), Position((*eye, -4.0), (0.0, 0.0, 0.0)))
        )
        turn.ranges_m = [r + rng.gauss(0.0, sd_m) if r < math.inf else r for r in turn.ranges_m]
        noise.note_turn(1, turn, STEP_S * k)
    return noise


@pytest.mark.parametrize("kind", [FINE, SECTORS])
@pytest.mark.parametrize("speed_mps", [0.0, 3.0])
def test_a_sensor_as_it_should_be_widens_nothing(kind: ScanClass, speed_mps: float) -> None:
    assert flown(kind, 0.0, speed_mps=speed_mps).wider_m == 0.0


@pytest.mark.parametrize("kind", [FINE, SECTORS])
@pytest.mark.parametrize("noise_m", [0.4, 0.6])
def test_one_that_is_noisy_is_known_by_its_turns(kind: ScanClass, noise_m: float) -> None:
    noise = flown(kind, noise_m)
    assert noise.noise_m == pytest.approx(noise_m, rel=0.35)
    assert 0.1 < noise.wider_m <= WIDENS_MAX_M


def test_it_is_over_when_it_is_over() -> None:
    noise = flown(FINE, 0.6)
    assert noise.wider_m > 0.0
    for k in range(20):
        noise.note_turn(1, level_scan(stand(), (24.0, 0.0)), 8.0 + STEP_S * k)
    assert noise.wider_m == 0.0


def test_turns_that_are_too_few_or_far_apart_tell_nothing() -> None:
    noise = ScanNoise(FINE)
    for k in range(10):
        noise.note_turn(1, level_scan(stand(), (0.0, 0.0)), 1.0 * k)
        part = LevelScan(math.tau / 360)
        noise.note_turn(1, part, 1.0 * k + 0.1)
    assert noise.noise_m == 0.0


def test_two_sensors_are_no_noise_of_each_other() -> None:
    """The second tells all 0.6 m too far, always alike: that is an offset, and no noise."""
    noise, far = ScanNoise(FINE), level_scan(stand(), (0.0, 0.0))
    far.ranges_m = [range_m + 0.6 for range_m in far.ranges_m]
    for k in range(40):
        noise.note_turn(1, level_scan(stand(), (0.0, 0.0)), 0.1 * k)
        noise.note_turn(2, far, 0.1 * k + 0.05)
    assert noise.noise_m == 0.0


def test_a_part_of_a_turn_is_not_compared() -> None:
    noise = ScanNoise(FINE)
    whole = level_scan(stand(), (0.0, 0.0))
    for k in range(40):
        part = LevelScan(whole.step_rad)
        for j in range(90):
            part.add_ray(whole.bearings_rad[j], whole.ranges_m[j] + 0.5 * (k % 2), 0.0, 0.0)
        noise.note_turn(1, part, 0.1 * k)
    assert noise.noise_m == 0.0
