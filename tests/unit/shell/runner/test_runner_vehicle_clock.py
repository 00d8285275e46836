"""The loop by the vehicle's clock: a tick for each request, whatever time it tells."""

from __future__ import annotations

import pytest

from companion.mavlink.framing.frames import Framing
from companion.shell.runner import DRAIN_MAX
from tests.unit.shell.runner_kit import HEARTBEAT, OWN, Bench, timesync


def test_one_tick_for_each_request_at_its_time_neighbours_first(bench: Bench) -> None:
    data = HEARTBEAT + timesync(50_000_000)
    bench.peers.arriving.append(b"beacons")
    bench.sensor.arriving.append(b"scan")
    bench.autopilot.arriving.append(data)
    bench.waits_left = 1
    bench.runner.now_s = 0.0  # a time is known: no hello
    bench.runner.by_vehicle(b"hello")
    assert bench.endpoint.done == [
        ("peers", b"beacons", 0.05),
        ("sensor", b"scan", 0.05),
        ("autopilot", data, 0.05),
        ("tick", b"", 0.05),
    ]


def test_beacons_from_before_there_is_a_time_are_too_old(bench: Bench) -> None:
    bench.peers.arriving.append(b"too old")
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert not bench.peers.arriving
    assert bench.endpoint.done == []


def test_the_vehicles_time_may_start_at_zero(bench: Bench) -> None:
    bench.autopilot.arriving.append(timesync(0))
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [0.0]


def test_events_between_requests_have_the_time_of_the_last_one(bench: Bench) -> None:
    bench.autopilot.arriving.extend([timesync(1_000_000_000), HEARTBEAT, timesync(1_050_000_000)])
    bench.waits_left = 3
    bench.runner.by_vehicle(b"hello")
    assert [now_s for what, _, now_s in bench.endpoint.done if what == "autopilot"] == [1.0, 1.0, 1.05]
    assert bench.ticks_s == [1.0, 1.05]


@pytest.mark.parametrize(
    "other",
    [
        timesync(2_000_000_000, system=OWN + 1),
        timesync(2_000_000_000, component=190),
        timesync(2_000_000_000, tc1=1),
        timesync(1_000_000_000),
        timesync(999_999_999),
        timesync(-5),
        timesync(2_000_000_000)[:-1],
        timesync(2_000_000_000)[:-1] + b"\0",
    ],
    ids=["other vehicle", "other component", "answer", "repeated", "back", "negative", "cut", "damaged"],
)
def test_what_is_not_a_newer_request_of_the_own_autopilot_is_no_tick(bench: Bench, other: bytes) -> None:
    bench.autopilot.arriving.extend([timesync(1_000_000_000), other])
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]
    assert {now_s for *_, now_s in bench.endpoint.done} == {1.0}


LARGEST = (1 << 63) - 1


@pytest.mark.parametrize("absurd", [LARGEST, LARGEST // 2, 1 << 62, (1 << 62) - 1, 10**18, -LARGEST])
def test_one_absurd_request_neither_kills_nor_freezes(bench: Bench, absurd: int) -> None:
    times_ns = [1_000_000_000, absurd, 1_050_000_000, absurd, absurd, 1_100_000_000, 1_150_000_000]
    bench.autopilot.arriving.extend(timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 1.05, 1.1, 1.15]


@pytest.mark.parametrize("absurd", [(1 << 62) - 1, 10**18])
def test_time_that_began_absurdly_goes_on_with_the_true_one(bench: Bench, absurd: int) -> None:
    """Always a time that a TIMESYNC answer can hold, and never back."""
    times_ns = [absurd, *range(1_000_000_000, 1_500_000_000, 50_000_000)]
    bench.autopilot.arriving.extend(timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert len(bench.ticks_s) == len(times_ns) - 2
    assert bench.ticks_s == sorted(bench.ticks_s)
    assert max(bench.ticks_s) * 1e9 < LARGEST


@pytest.mark.parametrize("absurd", [LARGEST, 1 << 62, -1])
def test_time_that_no_answer_can_hold_is_refused_from_the_first_request_on(bench: Bench, absurd: int) -> None:
    times_ns = [absurd, absurd, 1_000_000_000, 1_050_000_000]
    bench.autopilot.arriving.extend(timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 1.05]


def test_vehicle_that_starts_again_is_followed_after_three_requests_without_a_step_back(bench: Bench) -> None:
    times_ns = [500_000_000_000, 500_050_000_000, 0, 50_000_000, 100_000_000, 150_000_000]
    bench.autopilot.arriving.extend(timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [500.0, 500.05, 500.1, 500.15]


def test_simulator_that_was_paused_ticks_at_its_next_request(bench: Bench) -> None:
    bench.autopilot.arriving.extend([timesync(1_000_000_000), timesync(301_000_000_000)])
    bench.waits_left = 2
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 301.0]


def test_hello_goes_out_once_a_second_until_the_first_request_and_nothing_else(bench: Bench) -> None:
    bench.waits_left = 4
    bench.runner.by_vehicle(b"hello")
    assert bench.autopilot.sent == bench.peers.sent == [b"hello"] * 4
    bench.autopilot.arriving.append(timesync(1))
    bench.stop.reason, bench.waits_left = "", 5
    bench.runner.by_vehicle(b"hello")
    assert bench.peers.sent == [b"hello"] * 5 + [b"to peers"]
    assert bench.autopilot.sent == [b"hello"] * 5 + [b"to autopilot"]


def test_a_request_behind_a_frame_that_claims_to_reach_over_it_ticks(bench: Bench) -> None:
    request = timesync(1_000_000_000)
    damaged = bytearray(HEARTBEAT + request)
    damaged[1] += len(request)
    bench.autopilot.arriving.append(bytes(damaged))
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]


def test_a_request_may_arrive_in_pieces_on_a_stream(bench: Bench) -> None:
    bench.endpoint.framing = Framing(is_stream=True)
    request = timesync(1_000_000_000)
    bench.autopilot.arriving.extend([request[:7], request[7:]])
    bench.waits_left = 2
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]


def test_the_bytes_of_the_autopilot_are_parsed_once(bench: Bench) -> None:
    """Finding the time of a request cost another pass over all of them."""
    data = HEARTBEAT + timesync(1_000_000_000)
    bench.autopilot.arriving.append(data)
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.endpoint.read == [data]


def test_a_flood_of_any_link_takes_a_bounded_part_of_a_tick_and_each_request_is_answered(bench: Bench) -> None:
    for _ in range(3):
        bench.peers.arriving.extend([b"flood"] * 10_000)
        bench.sensor.arriving.extend([b"flood"] * 10_000)
    bench.autopilot.arriving.extend(timesync(k * 50_000_000) for k in range(1, 4))
    bench.waits_left = 3
    bench.runner.now_s = 0.0  # a time is known: no hello
    bench.runner.by_vehicle(b"hello")
    heard = [what for what, _, _ in bench.endpoint.done]
    assert bench.ticks_s == [0.05, 0.1, 0.15]
    assert (heard.count("peers"), heard.count("sensor")) == (3 * DRAIN_MAX, 3 * DRAIN_MAX)
