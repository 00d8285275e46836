"""When a stream is due."""

from __future__ import annotations

import pytest

from sim_bridge.world.autopilot.protocols.streams import StreamTable

STEP_US = 50_000


def table(rates_hz: dict[int, float], first_us: dict[int, int] | None = None) -> StreamTable:
    return StreamTable([1, 2, 3, 32], rates_hz, first_us)


def test_20_hz_comes_at_exactly_every_50_ms_step_for_an_hour() -> None:
    streams = table({32: 20.0})
    for step in range(72_000):
        now_us = round(step * 0.05 * 1e6)  # as an autopilot rounds its time
        assert streams.due(now_us) == [32], step


def test_a_stream_comes_at_most_once_per_call_and_keeps_its_grid() -> None:
    streams = table({1: 98.0})
    assert streams.due(0) == [1]
    assert streams.due(1_000_000) == [1]
    assert streams.due(1_000_001) == []


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 8.0, 10.0, 29.0, 49.0, 98.0])
def test_rates_do_not_drift(rate_hz: float) -> None:
    streams = table({1: rate_hz})
    came = sum(bool(streams.due(now_us)) for now_us in range(0, 100_000_000, 4_000))
    assert came == pytest.approx(100.0 * rate_hz, rel=1e-3)


def test_those_due_together_come_in_the_order_of_the_table() -> None:
    streams = table({32: 20.0, 2: 20.0, 1: 20.0})
    assert streams.due(0) == [1, 2, 32]


def test_a_stream_starts_when_it_is_told() -> None:
    streams = table({1: 1.0}, {1: 1_500_000})
    due_us = [now_us for now_us in range(0, 5_000_000, STEP_US) if streams.due(now_us)]
    assert due_us == [1_500_000, 2_500_000, 3_500_000, 4_500_000]


def test_an_interval_that_is_set_begins_at_once() -> None:
    streams = table({})
    assert streams.due(10_000_000) == []
    assert streams.set_interval_us(32, STEP_US, 10_000_000)
    assert [streams.due(10_000_000 + k * STEP_US) for k in range(3)] == [[32], [32], [32]]


def test_minus_one_stops_and_zero_restores_the_default() -> None:
    streams = table({1: 10.0})
    assert streams.interval_us(1) == 100_000
    assert streams.set_interval_us(1, -1, 0)
    assert streams.interval_us(1) == -1
    assert streams.due(0) == []
    assert streams.set_interval_us(1, 0, 0)
    assert streams.interval_us(1) == 100_000
    assert streams.set_interval_us(2, 0, 0)  # not streamed by default
    assert streams.interval_us(2) == -1


def test_what_cannot_be_streamed_is_refused() -> None:
    streams = table({1: 10.0})
    assert not streams.set_interval_us(9999, 100_000, 0)
    assert streams.interval_us(9999) == 0


def test_no_interval_is_shorter_than_a_millisecond() -> None:
    streams = table({})
    streams.set_interval_us(1, 1, 0)
    assert streams.interval_us(1) == 1_000
