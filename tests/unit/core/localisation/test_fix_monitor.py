"""Fixes held against the own way: a drift is found before it leads far, and noise is none."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.localisation.gnss_denied.global_localisation import AGAINST_FIXES
from companion.core.localisation.integrity.fix_monitor import NOTE_S, WINDOW_S, FixMonitor, Noise, Parted
from companion.core.localisation.integrity.own_position import BY_TRUNKS
from companion.core.perception.obstacle_perception import FRAME_BY_SECTORS_RAD, FRAME_RAD

SPEED_MPS = 2.0
BEGINS_S = 20.0


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


@pytest.mark.parametrize("noise", [BY_TRUNKS, AGAINST_FIXES])
def test_drawn_noise_alone_alarms_at_most_once_an_hour(noise: Noise) -> None:
    """As stated in docs/explanation/spoofing.md; 40 flights of 200 s are 2.2 hours."""
    assert sum(flown(noise, seed, 200.0)[0] is not None for seed in range(40)) <= 2


@pytest.mark.parametrize(("rate_mps", "most_m"), [(0.1, 15.0), (0.2, 6.0), (0.5, 5.0)])
def test_by_trunks_a_drift_is_found_before_it_has_led_far(rate_mps: float, most_m: float) -> None:
    for seed in range(8):
        bearing = 0.8 * seed
        drift = (rate_mps * math.cos(bearing), rate_mps * math.sin(bearing))
        found_s, parted = flown(BY_TRUNKS, seed, 200.0, drift)
        assert found_s is not None
        assert parted is not None
        assert found_s * rate_mps < most_m


@pytest.mark.parametrize("rate_mps", [0.2, 0.5])
def test_against_odometry_a_faster_one_is(rate_mps: float) -> None:
    for seed in range(8):
        found_s, _ = flown(AGAINST_FIXES, seed, 200.0, (0.0, rate_mps))
        assert found_s is not None
        assert found_s * rate_mps < 5.0


def test_what_is_found_is_where_the_own_way_has_led_since_the_fix_left() -> None:
    monitor = FixMonitor(BY_TRUNKS)
    for k in range(60):
        led_m = 0.4 * max(0, k - 20)
        parted = monitor.update((led_m, 2.0 * k), (100.0, 2.0 * k - 50.0), float(k))
        if parted is not None:
            break
    assert parted is not None
    assert parted.fix_ne_m == pytest.approx((0.0, 2.0 * k), abs=0.5)
    assert parted.since_s == pytest.approx(20.0, abs=3.0)


@pytest.mark.parametrize("knows", [True, False])
def test_a_frame_that_is_known_to_be_unsure_parts_nothing_when_it_is_turned(knows: bool) -> None:
    """Trunks' frame is turned by 3 degrees at first, and turned back about the vehicle after 20 s."""
    monitor, turn, moved = FixMonitor(BY_TRUNKS), math.radians(3.0), (0.0, 0.0)
    found = False
    for k in range(60):
        place = (0.0, 3.0 * k)
        c, s = math.cos(turn), math.sin(turn)
        way = (c * place[0] - s * place[1] + moved[0], s * place[0] + c * place[1] + moved[1])
        rad2 = math.radians(4.0) ** 2 if turn and knows else 0.0
        found |= monitor.update(place, way, float(k), frame=(turn, *moved), frame_rad2=rad2) is not None
        if k == 20:
            turn, moved = 0.0, (way[0] - place[0], way[1] - place[1])
    assert found is not knows


def test_a_frame_that_turns_back_by_more_than_is_thought_of_it_parts_nothing() -> None:
    """As among trees by sectors, where two of eight vehicles alarmed that nothing led astray: 3.6 degrees in 35 s."""
    monitor, found = FixMonitor(BY_TRUNKS), False
    for k in range(60):
        turned = math.radians(3.6) * max(0.0, 1.0 - k / 35.0)
        place = (0.0, 2.7 * k)
        c, s = math.cos(turned), math.sin(turned)
        way = (c * place[0] - s * place[1], s * place[0] + c * place[1])
        thought_rad2 = max(math.radians(0.7) ** 2, FRAME_BY_SECTORS_RAD**2)
        frame = (turned, 0.0, 0.0)
        found |= monitor.update(place, way, float(k), frame=frame, frame_rad2=thought_rad2) is not None
    assert not found


def test_a_frame_that_turns_by_far_more_than_is_thought_of_it_parts_nothing() -> None:
    """As in tests/testdata/found/hemmed_in.toml: 15 degrees in 76 s, by a lidar, where no fix was led astray."""
    monitor, found, moved, step = FixMonitor(BY_TRUNKS), False, (0.0, 0.0), math.radians(15.0) / 76.0
    c, s = math.cos(step), math.sin(step)
    for k in range(77):
        place = (0.0, 3.0 * k)
        north, east = place[0] - moved[0], place[1] - moved[1]  # it turns about the vehicle
        moved = (place[0] - c * north + s * east, place[1] - s * north - c * east)
        frame = (step * (k + 1), *moved)
        found |= monitor.update(place, place, float(k), frame=frame, frame_rad2=math.radians(1.3) ** 2) is not None
    assert not found


def test_it_keeps_a_bounded_past_and_forgets_it_when_told() -> None:
    monitor = FixMonitor(BY_TRUNKS)
    for k in range(3 * WINDOW_S):
        assert monitor.update((0.0, 0.0), (0.0, 0.0), float(k)) is None
    assert len(monitor._notes) == WINDOW_S
    monitor.forget()
    assert monitor.update((50.0, 0.0), (0.0, 0.0), 1000.0) is None


def test_notes_older_than_the_window_count_no_more() -> None:
    """Trunks were out of sight meanwhile: a way of long ago tells nothing."""
    monitor = FixMonitor(BY_TRUNKS)
    for k in range(20):
        assert monitor.update((0.0, float(k)), (0.0, float(k)), float(k)) is None
    assert monitor.update((40.0, 200.0), (0.0, 200.0), 19.0 + WINDOW_S + 1.0) is None


def test_a_frame_that_turns_on_the_way_back_parts_nothing() -> None:
    """As in a mission that returns (search, seed 9689): 2.6 degrees on 60 m back, to where the way out began."""
    monitor, found, moved, turned, step = FixMonitor(BY_TRUNKS), False, (0.0, 0.0), 0.0, math.radians(2.6) / 30.0
    c, s = math.cos(step), math.sin(step)
    for k in range(95):
        returns = k > 64
        place = (2.0 * (94 - k if returns else min(k, 30)), 0.0)
        if returns:
            north, east = moved[0] - place[0], moved[1] - place[1]  # it turns about the vehicle
            moved, turned = (place[0] + c * north - s * east, place[1] + s * north + c * east), turned + step
        way = (place[0], 0.05 * (60.0 - place[0]) if returns else 0.0)  # and slides by 3 m all the same
        frame = (turned, *moved)
        found |= monitor.update(place, way, float(k), frame=frame, frame_rad2=FRAME_BY_SECTORS_RAD**2) is not None
    assert not found
