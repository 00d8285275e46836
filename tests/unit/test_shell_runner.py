"""The loop over links in memory: deadlines, the order of things, and the vehicle's clock."""

from __future__ import annotations

import math
import os
import select
import signal
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from companion.mavlink import dialect
from companion.mavlink.endpoint import Outbox
from companion.mavlink.frames import Framing, Incoming
from companion.shell import runner as runner_module
from companion.shell.runner import Runner, Stop

OWN = 3


class MemoryLink:
    """A link whose far end is a list."""

    def __init__(self) -> None:
        self.errors = 0
        self.up = True
        self.arriving: deque[bytes] = deque()
        self.sent: list[bytes] = []

    def fileno(self) -> int:
        return -1

    def recv(self) -> bytes | None:
        return self.arriving.popleft() if self.arriving else None

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def close(self) -> None:
        pass


class Recorder:
    """An endpoint that notes what is done to it; as the real one it takes the time of TIMESYNC requests."""

    def __init__(self) -> None:
        self.id = OWN
        self.requested_ns: int | None = None
        self.done: list[tuple[str, bytes, float]] = []
        self.framing = Framing()
        self.read: list[bytes] = []

    def from_peers(self, data: bytes, now_s: float) -> None:
        self.done.append(("peers", data, now_s))

    def from_autopilot(self, data: bytes, now_s: float) -> None:
        self.done.append(("autopilot", data, now_s))

    def from_sensor(self, data: bytes, now_s: float) -> None:
        self.done.append(("sensor", data, now_s))

    def read_autopilot(self, data: bytes) -> list[Incoming]:
        self.read.append(data)
        return self.framing.read(data)

    def autopilot_says(self, messages: list[Incoming], now_s: float) -> None:
        self.done.append(("autopilot", self.read[-1], now_s))
        for said in messages:
            if (said.message_id, said.system, said.component) == (dialect.MAVLINK_MSG_ID_TIMESYNC, OWN, 1):
                self.requested_ns = said.message.ts1 if said.message.tc1 == 0 else self.requested_ns

    def tick(self, now_s: float) -> Outbox:
        self.done.append(("tick", b"", now_s))
        return Outbox(b"to autopilot", b"to peers", sensor=b"to sensor")


class Bench:
    """A runner with its surroundings, whose time passes only while it waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.work_s = 0.0  # how late each wait ends
        self.waits = 0
        self.endpoint = Recorder()
        self.autopilot, self.peers, self.sensor = MemoryLink(), MemoryLink(), MemoryLink()
        self.watch = SimpleNamespace(tick=lambda *_: None, links=lambda *_: None, status=lambda: "fine")
        self.stop = SimpleNamespace(reason="", fileno=lambda: 0)
        endpoint: Any = self.endpoint
        watch: Any = self.watch
        stop: Any = self.stop
        self.alive_s: list[float] = []
        service: Any = SimpleNamespace(alive=lambda now_s, _status: self.alive_s.append(now_s), period_s=math.inf)
        self.runner = Runner(endpoint, self.autopilot, self.peers, watch, stop, service, self.sensor)
        self.waits_left = 0

    def select(self, _r: Any, _w: Any, _x: Any, wait_s: float) -> None:
        assert wait_s >= 0.0
        self.now_s += wait_s + self.work_s
        self.waits_left -= 1
        if self.waits_left == 0:
            self.stop.reason = "test"

    @property
    def ticks_s(self) -> list[float]:
        return [round(now_s, 6) for what, _, now_s in self.endpoint.done if what == "tick"]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    bench = Bench()
    monkeypatch.setattr(runner_module, "time", SimpleNamespace(monotonic=lambda: bench.now_s))
    monkeypatch.setattr(runner_module, "select", SimpleNamespace(select=bench.select))
    return bench


def _timesync(time_ns: int, *, system: int = OWN, component: int = 1, tc1: int = 0) -> bytes:
    packed: bytes = dialect.MAVLink_timesync_message(tc1, time_ns).pack(
        dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    )
    return packed


HEARTBEAT: bytes = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(dialect.MAVLink(None, OWN, 1))


# --- monotonic ---


def test_monotonic_ticks_at_20_hz(bench: Bench) -> None:
    bench.waits_left = 5
    bench.runner.by_monotonic()
    assert bench.ticks_s == [1000.0, 1000.05, 1000.1, 1000.15, 1000.2]
    assert bench.runner.missed == 0


def test_what_comes_between_two_ticks_does_not_wake_it_and_is_taken_in_with_the_next(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To wake for each message cost more than the ticks."""
    waited: list[tuple[int, ...]] = []

    def select_and_note(fds: Any, *rest: Any) -> None:
        waited.append(tuple(fds))
        bench.peers.arriving.append(b"beacons")
        bench.autopilot.arriving.append(b"telemetry")
        bench.select(fds, *rest)

    monkeypatch.setattr(bench.autopilot, "fileno", lambda: 70)
    monkeypatch.setattr(bench.peers, "fileno", lambda: 71)
    monkeypatch.setattr(runner_module, "select", SimpleNamespace(select=select_and_note))
    bench.waits_left = 2
    bench.runner.by_monotonic()
    assert waited == [(bench.stop.fileno(),)] * 2
    assert [(what, now_s) for what, _, now_s in bench.endpoint.done] == [
        (what, pytest.approx(now_s)) for now_s in (1000.0, 1000.05) for what in ("autopilot", "peers", "tick")
    ]


def test_what_a_flood_leaves_over_is_taken_in_before_the_next_sleep(bench: Bench) -> None:
    """A tick takes in 10 ms' worth; more in each would wait for ever longer."""

    def take(_data: bytes, now_s: float) -> None:
        bench.endpoint.done.append(("peers", b"", now_s))
        bench.now_s += 0.004

    bench.endpoint.from_peers = take  # type: ignore[method-assign]
    bench.peers.arriving.extend([b"beacons"] * 9)
    bench.waits_left = 3
    bench.runner.by_monotonic()
    times_s = [now_s for what, _, now_s in bench.endpoint.done if what == "peers"]
    assert [round(now_s, 6) for now_s in times_s] == [1000.0] * 3 + [1000.012] * 6
    assert bench.ticks_s == [1000.0, pytest.approx(1000.05)]


def test_deadlines_do_not_drift(bench: Bench) -> None:
    bench.waits_left, bench.work_s = 100, 0.001
    bench.runner.by_monotonic()
    assert bench.ticks_s[-1] == pytest.approx(1000.0 + 99 * 0.05 + 0.001)


def test_missed_ticks_are_skipped_and_not_made_up(bench: Bench) -> None:
    bench.waits_left, bench.work_s = 1, 0.42
    bench.runner.by_monotonic()
    assert bench.ticks_s == [1000.42]
    assert bench.runner.missed == 8


def test_after_a_stall_the_next_tick_is_on_the_grid(bench: Bench) -> None:
    def stall_once(*_: Any) -> None:
        bench.work_s = 0.42 if bench.waits_left == 4 else 0.0

    bench.watch.tick = stall_once
    bench.waits_left = 5
    bench.runner.by_monotonic()
    assert bench.ticks_s == [1000.0, 1000.47, 1000.5, 1000.55, 1000.6]


def test_both_links_are_drained_before_a_tick_and_peers_are_sent_to_first(bench: Bench) -> None:
    bench.autopilot.arriving.extend([b"a1", b"a2"])
    bench.peers.arriving.extend([b"p1", b"p2"])
    order: list[bytes] = []
    bench.autopilot.sent = bench.peers.sent = order
    bench.waits_left = 1
    bench.runner.by_monotonic()
    assert [data for what, data, _ in bench.endpoint.done if what != "tick"] == [b"a1", b"p1", b"a2", b"p2"]
    assert bench.endpoint.done[-1] == ("tick", b"", 1000.0)
    assert order == [b"to peers", b"to autopilot"]


def test_obstacle_sensor_is_drained_like_the_other_links_and_told_where_to_send(bench: Bench) -> None:
    bench.sensor.arriving.extend([b"s1", b"s2"])
    bench.waits_left = 1
    bench.runner.by_monotonic()
    assert bench.endpoint.done == [("sensor", b"s1", 1000.0), ("sensor", b"s2", 1000.0), ("tick", b"", 1000.0)]
    assert bench.sensor.sent == [b"to sensor"]


@pytest.mark.parametrize("flooded", [{"sensor"}, {"peers"}, {"autopilot"}, {"peers", "autopilot", "sensor"}])
def test_a_flood_of_a_link_stops_neither_the_ticks_nor_the_other_links(
    bench: Bench, flooded: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    links = {"peers": bench.peers, "autopilot": bench.autopilot, "sensor": bench.sensor}
    heard = dict.fromkeys(links, 0)

    def slow(name: str) -> Callable[[bytes, float], None]:
        def take(data: bytes, _now_s: float) -> None:
            heard[name] += 1
            if name in flooded:
                bench.now_s += 0.004
                links[name].arriving.append(data)

        return take

    for name, link in links.items():
        monkeypatch.setattr(bench.endpoint, f"from_{name}", slow(name))
        link.arriving.extend([b"x"] if name in flooded else [b"x"] * 100)
    bench.waits_left = 200
    bench.runner.by_monotonic()
    gaps_s = [b - a for a, b in zip(bench.ticks_s, bench.ticks_s[1:], strict=False)]
    assert len(gaps_s) > 20
    assert max(gaps_s) < 0.1
    assert min(heard.values()) >= 100


def test_every_tick_and_nothing_else_is_a_sign_of_life(bench: Bench) -> None:
    bench.waits_left, bench.work_s = 10, 0.02
    bench.runner.by_monotonic()
    assert [round(now_s, 6) for now_s in bench.alive_s] == bench.ticks_s


# --- vehicle ---


def test_one_tick_for_each_request_at_its_time_neighbours_first(bench: Bench) -> None:
    data = HEARTBEAT + _timesync(50_000_000)
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
    bench.autopilot.arriving.append(_timesync(0))
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [0.0]


def test_events_between_requests_have_the_time_of_the_last_one(bench: Bench) -> None:
    bench.autopilot.arriving.extend([_timesync(1_000_000_000), HEARTBEAT, _timesync(1_050_000_000)])
    bench.waits_left = 3
    bench.runner.by_vehicle(b"hello")
    assert [now_s for what, _, now_s in bench.endpoint.done if what == "autopilot"] == [1.0, 1.0, 1.05]
    assert bench.ticks_s == [1.0, 1.05]


@pytest.mark.parametrize(
    "other",
    [
        _timesync(2_000_000_000, system=OWN + 1),
        _timesync(2_000_000_000, component=190),
        _timesync(2_000_000_000, tc1=1),
        _timesync(1_000_000_000),
        _timesync(999_999_999),
        _timesync(-5),
        _timesync(2_000_000_000)[:-1],
        _timesync(2_000_000_000)[:-1] + b"\0",
    ],
    ids=["other vehicle", "other component", "answer", "repeated", "back", "negative", "cut", "damaged"],
)
def test_what_is_not_a_newer_request_of_the_own_autopilot_is_no_tick(bench: Bench, other: bytes) -> None:
    bench.autopilot.arriving.extend([_timesync(1_000_000_000), other])
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]
    assert {now_s for *_, now_s in bench.endpoint.done} == {1.0}


LARGEST = (1 << 63) - 1


@pytest.mark.parametrize("absurd", [LARGEST, LARGEST // 2, 1 << 62, (1 << 62) - 1, 10**18, -LARGEST])
def test_one_absurd_request_neither_kills_nor_freezes(bench: Bench, absurd: int) -> None:
    times_ns = [1_000_000_000, absurd, 1_050_000_000, absurd, absurd, 1_100_000_000, 1_150_000_000]
    bench.autopilot.arriving.extend(_timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 1.05, 1.1, 1.15]


@pytest.mark.parametrize("absurd", [(1 << 62) - 1, 10**18])
def test_time_that_began_absurdly_goes_on_with_the_true_one(bench: Bench, absurd: int) -> None:
    """Always a time that a TIMESYNC answer can hold, and never back."""
    times_ns = [absurd, *range(1_000_000_000, 1_500_000_000, 50_000_000)]
    bench.autopilot.arriving.extend(_timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert len(bench.ticks_s) == len(times_ns) - 2
    assert bench.ticks_s == sorted(bench.ticks_s)
    assert max(bench.ticks_s) * 1e9 < LARGEST


@pytest.mark.parametrize("absurd", [LARGEST, 1 << 62, -1])
def test_time_that_no_answer_can_hold_is_refused_from_the_first_request_on(bench: Bench, absurd: int) -> None:
    times_ns = [absurd, absurd, 1_000_000_000, 1_050_000_000]
    bench.autopilot.arriving.extend(_timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 1.05]


def test_vehicle_that_starts_again_is_followed_after_three_requests_without_a_step_back(bench: Bench) -> None:
    times_ns = [500_000_000_000, 500_050_000_000, 0, 50_000_000, 100_000_000, 150_000_000]
    bench.autopilot.arriving.extend(_timesync(time_ns) for time_ns in times_ns)
    bench.waits_left = len(times_ns)
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [500.0, 500.05, 500.1, 500.15]


def test_simulator_that_was_paused_ticks_at_its_next_request(bench: Bench) -> None:
    bench.autopilot.arriving.extend([_timesync(1_000_000_000), _timesync(301_000_000_000)])
    bench.waits_left = 2
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0, 301.0]


def test_hello_goes_out_once_a_second_until_the_first_request_and_nothing_else(bench: Bench) -> None:
    bench.waits_left = 4
    bench.runner.by_vehicle(b"hello")
    assert bench.autopilot.sent == bench.peers.sent == [b"hello"] * 4
    bench.autopilot.arriving.append(_timesync(1))
    bench.stop.reason, bench.waits_left = "", 5
    bench.runner.by_vehicle(b"hello")
    assert bench.peers.sent == [b"hello"] * 5 + [b"to peers"]
    assert bench.autopilot.sent == [b"hello"] * 5 + [b"to autopilot"]


def test_a_request_behind_a_frame_that_claims_to_reach_over_it_ticks(bench: Bench) -> None:
    request = _timesync(1_000_000_000)
    damaged = bytearray(HEARTBEAT + request)
    damaged[1] += len(request)
    bench.autopilot.arriving.append(bytes(damaged))
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]


def test_a_request_may_arrive_in_pieces_on_a_stream(bench: Bench) -> None:
    bench.endpoint.framing = Framing(is_stream=True)
    request = _timesync(1_000_000_000)
    bench.autopilot.arriving.extend([request[:7], request[7:]])
    bench.waits_left = 2
    bench.runner.by_vehicle(b"hello")
    assert bench.ticks_s == [1.0]


def test_the_bytes_of_the_autopilot_are_parsed_once(bench: Bench) -> None:
    """Finding the time of a request cost another pass over all of them."""
    data = HEARTBEAT + _timesync(1_000_000_000)
    bench.autopilot.arriving.append(data)
    bench.waits_left = 1
    bench.runner.by_vehicle(b"hello")
    assert bench.endpoint.read == [data]


# --- stopping ---


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gives_the_reason_and_wakes_the_loop(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with Stop() as stop:
        assert stop.reason == ""
        os.kill(os.getpid(), number)
        select.select([stop.fileno()], [], [], 20.0)
        assert stop.reason == number.name
    assert signal.getsignal(number) is before
