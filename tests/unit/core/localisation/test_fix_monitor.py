"""Fixes held against the own way: a drift is found before it leads far, and noise is none."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.localisation.gnss_denied.global_localisation import AGAINST_FIXES
from companion.core.localisation.integrity.fix_monitor import NOTE_S, WINDOW_S, FixMonitor, Noise, Parted

SPEED_MPS = 2.0
BEGINS_S = 20.0
FRAME_RAD = math.radians(1.0)


def flown(
    noise: Noise, seed: int, lasts_s: float, drift_ne_mps: tuple[float, float] = (0.0, 0.0)
) -> tuple[float | None, Parted | None]:
    """Flies with drawn errors as `noise` has them; when it was found, s after the drift began, and what."""
    rng, monitor = random.Random(seed), FixMonitor(noise)
    keep = math.exp(-NOTE_S / noise.fix_memory_s)
    fresh = noise.fix_m * math.sqrt(1.0 - keep * keep)
    fix = [noise.fix_m * rng.gauss(0.0, 1.0) for _ in range(2)]
    walk, turn = [0.0, 0.0], FRAME_RAD * rng.gauss(0.0, 1.0)
    for k in range(round(lasts_s / NOTE_S)):
        now_s = k * NOTE_S
        fix = [keep * one + fresh * rng.gauss(0.0, 1.0) for one in fix]
        walk = [one + math.sqrt(noise.walk_m2_per_s * NOTE_S) * rng.gauss(0.0, 1.0) for one in walk]
        true = (30.0 * math.sin(SPEED_MPS * now_s / 30.0), SPEED_MPS * now_s)
        led_s = max(0.0, now_s - BEGINS_S)
        place = (true[0] + fix[0] + drift_ne_mps[0] * led_s, true[1] + fix[1] + drift_ne_mps[1] * led_s)
        c, s = math.cos(turn), math.sin(turn)
        way = (c * true[0] - s * true[1] + walk[0], s * true[0] + c * true[1] + walk[1])
        parted = monitor.update(place, way, now_s, frame_rad2=FRAME_RAD**2)
        if parted is not None:
            return now_s - BEGINS_S, parted
    return None, None


def test_drawn_noise_alone_alarms_at_most_once_an_hour() -> None:
    """As stated in docs/explanation/spoofing.md; 40 flights of 200 s are 2.2 hours."""
    assert sum(flown(AGAINST_FIXES, seed, 200.0)[0] is not None for seed in range(40)) <= 2


@pytest.mark.parametrize("rate_mps", [0.2, 0.5])
def test_against_odometry_a_faster_one_is(rate_mps: float) -> None:
    for seed in range(8):
        found_s, _ = flown(AGAINST_FIXES, seed, 200.0, (0.0, rate_mps))
        assert found_s is not None
        assert found_s * rate_mps < 5.0


def test_what_is_found_is_where_the_own_way_has_led_since_the_fix_left() -> None:
    monitor = FixMonitor(AGAINST_FIXES)
    for k in range(60):
        led_m = 0.4 * max(0, k - 20)
        parted = monitor.update((led_m, 2.0 * k), (100.0, 2.0 * k - 50.0), float(k))
        if parted is not None:
            break
    assert parted is not None
    assert parted.fix_ne_m == pytest.approx((0.0, 2.0 * k), abs=0.5)
    assert parted.since_s == pytest.approx(20.0, abs=3.0)


def test_it_keeps_a_bounded_past_and_forgets_it_when_told() -> None:
    monitor = FixMonitor(AGAINST_FIXES)
    for k in range(3 * WINDOW_S):
        assert monitor.update((0.0, 0.0), (0.0, 0.0), float(k)) is None
    assert len(monitor._notes) == WINDOW_S
    monitor.forget()
    assert monitor.update((50.0, 0.0), (0.0, 0.0), 1000.0) is None
