"""SWARM_RANGES that are sent again, held back, or from ahead of their driver's clock."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from companion.core.model.events import Ranges
from companion.mavlink.packing import pack_ranges
from companion.sensors.range_radio import RangeRadio
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

DRIVER = 26
PERIOD_S = 0.1


def sent(at_s: float, metres: float = 8.0) -> SimpleNamespace:
    return SimpleNamespace(time_boot_ms=round(at_s * 1e3), ranges=pack_ranges([(2, metres, 0.0)]))


def heard_until(radio: RangeRadio, until_s: float, *, boot_s: float = 90.0) -> list[SimpleNamespace]:
    """Every frame, 5 ms after it was sent by a driver whose clock began at `boot_s`; the last is at `until_s`."""
    frames = []
    for k in range(round((until_s - 100.0) / PERIOD_S) + 1):
        frames.append(sent(100.0 + k * PERIOD_S - boot_s))
        radio.decode(frames[-1], DRIVER, 100.005 + k * PERIOD_S)
    return frames


def age_s(event: object) -> float:
    assert isinstance(event, Ranges)
    return event.ranges[0][2]


def test_a_frame_in_time_is_as_old_as_it_says() -> None:
    radio = RangeRadio.of(mission())
    heard_until(radio, 110.0)
    assert age_s(radio.decode(sent(20.1), DRIVER, 110.105)) == 0.0
    assert radio.counters() == {"range frames out of their time": 0}


def test_one_of_before_is_dropped_and_the_next_genuine_one_taken() -> None:
    radio = RangeRadio.of(mission())
    frames = heard_until(radio, 110.0)
    assert radio.decode(frames[10], DRIVER, 110.05) is None
    assert radio.counters() == {"range frames out of their time": 1}
    assert age_s(radio.decode(sent(20.1), DRIVER, 110.105)) == 0.0


def test_the_newest_sent_again_and_again_grows_old() -> None:
    radio = RangeRadio.of(mission())
    frames = heard_until(radio, 110.0)
    assert age_s(radio.decode(frames[-1], DRIVER, 110.4)) > 0.35
    assert age_s(radio.decode(frames[-1], DRIVER, 112.0)) > 1.9
    assert radio.freshness(116.0) == {DRIVER: False}


def test_a_whole_run_of_old_ones_is_never_taken_as_new() -> None:
    radio = RangeRadio.of(mission())
    frames = heard_until(radio, 130.0)
    for k, frame in enumerate(frames[:50]):
        event = radio.decode(frame, DRIVER, 130.1 + k * PERIOD_S)
        assert event is None or age_s(event) > 1.0  # nothing flies by one that old


def test_frames_that_are_held_back_are_as_much_older() -> None:
    radio = RangeRadio.of(mission())
    heard_until(radio, 110.0)
    for k in range(1, 20):
        event = radio.decode(sent(20.0 + k * PERIOD_S), DRIVER, 110.805 + k * PERIOD_S)
        assert age_s(event) == pytest.approx(0.8, abs=0.05)


def test_one_from_far_ahead_keeps_no_genuine_one_out() -> None:
    radio = RangeRadio.of(mission())
    heard_until(radio, 110.0)
    assert radio.decode(sent(4e6), DRIVER, 110.05) is None
    assert age_s(radio.decode(sent(20.1), DRIVER, 110.105)) == 0.0


def test_a_driver_that_begins_anew_is_heard_within_three_frames() -> None:
    radio = RangeRadio.of(mission())
    heard_until(radio, 110.0)
    taken = [radio.decode(sent(0.5 + k * PERIOD_S), DRIVER, 115.0 + k * PERIOD_S) for k in range(4)]
    assert taken[0] is None
    assert [age_s(event) for event in taken[2:]] == [0.0, 0.0]


def test_a_driver_without_a_clock_is_heard_as_it_comes() -> None:
    radio = RangeRadio.of(mission())
    heard_until(radio, 110.0)
    for _ in range(3):
        assert age_s(radio.decode(sent(0.0), DRIVER + 1, 111.0)) == 0.0


def test_components_that_never_end_fill_no_table() -> None:
    radio = RangeRadio.of(mission())
    for component in range(1, 200):
        radio.decode(sent(20.0), component, 110.0)
    assert len(radio.freshness(110.0)) <= 8
