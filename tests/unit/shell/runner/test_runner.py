"""The loop by the monotonic clock: deadlines, the order of things, floods, and its end."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from companion.shell import runner as runner_module
from companion.shell.runner import Stop
from tests.unit.shell.runner_kit import Bench


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

    bench.watch.log_changes = stall_once
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
        def take(data: bytes, _now_s: float, **_: str) -> None:
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gives_the_reason_and_wakes_the_loop(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with Stop() as stop:
        assert stop.reason == ""
        os.kill(os.getpid(), number)
        select.select([stop.fileno()], [], [], 20.0)
        assert stop.reason == number.name
    assert signal.getsignal(number) is before


def test_a_flooded_link_is_read_again_before_the_kernels_queue_is_full(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """500 datagrams in 50 ms are more than it keeps: what is genuine was lost with the rest."""
    soon = runner_module.FLOOD_WAIT_S
    waited_s = waits_while(bench, monkeypatch, [65, 3, 2], 35)
    few = round(runner_module.FLOOD_OVER_S / soon) + 1  # and then it is over
    assert waited_s[:2] == pytest.approx([0.0, soon])
    assert max(waited_s[1 : few - 1]) <= soon + 1e-9
    assert max(waited_s[few:]) == pytest.approx(0.05)
    assert bench.ticks_s[:3] == [1000.0, 1000.05, 1000.1]


def test_a_flood_that_comes_in_bursts_is_not_over_in_between(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """250 datagrams of 4 KiB are all that the kernel keeps: a sleep of 50 ms lost a fifth of them."""
    waited_s = waits_while(bench, monkeypatch, [65] + [0, 0, 25] * 100, 300)
    assert max(waited_s) <= runner_module.FLOOD_WAIT_S + 1e-9


def test_few_datagrams_wait_for_the_tick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    assert waits_while(bench, monkeypatch, [64] * 20, 20)[1:] == pytest.approx([0.05] * 19)


def waits_while(bench: Bench, monkeypatch: pytest.MonkeyPatch, comes: list[int], waits: int) -> list[float]:
    """How long it waits each time while so many datagrams come."""
    waited_s: list[float] = []
    coming = iter(comes)

    def select_and_note(*arguments: Any) -> None:
        waited_s.append(arguments[3])
        bench.select(*arguments)
        bench.peers.arriving.extend([b"flood"] * next(coming, 0))

    monkeypatch.setattr(runner_module, "select", SimpleNamespace(select=select_and_note))
    bench.waits_left = waits
    bench.runner.by_monotonic()
    return waited_s


def test_dear_datagrams_of_a_radio_take_no_turns_of_the_autopilots(bench: Bench) -> None:
    """A link's share is time, not datagrams: 4 KiB of frames cost a hundred times what a telemetry datagram does."""

    def take(_data: bytes, now_s: float) -> None:
        bench.endpoint.done.append(("peers", b"", now_s))
        bench.now_s += 0.004

    def take_telemetry(data: bytes, now_s: float) -> None:
        bench.endpoint.done.append(("autopilot", data, now_s))
        bench.now_s += 0.0001

    bench.endpoint.from_peers = take  # type: ignore[method-assign]
    bench.endpoint.from_autopilot = take_telemetry  # type: ignore[method-assign]
    bench.peers.arriving.extend([b"flood"] * 1000)
    bench.autopilot.arriving.extend([b"telemetry"] * 30)
    bench.waits_left = 1
    bench.runner.by_monotonic()
    heard = [what for what, _, _ in bench.endpoint.done]
    assert heard.count("autopilot") == 30
    assert heard.index("tick") == len(heard) - 1
    assert heard.count("peers") <= 3
