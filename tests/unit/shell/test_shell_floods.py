"""Floods: datagrams that are too long are dropped unread, what the kernel drops is counted, and both are told."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest

from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from companion.shell.floods import AGAIN_S, LOOK_S, OVER_S, FloodLog
from companion.shell.links import BroadcastLink, Link, UdpLink
from companion.shell.urls import Scheme, Url
from companion.watch.udp_receiver import UdpReceiver

TOO_LONG = (DATAGRAM_MAX_BYTES + 1, 65_507)


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def sender_to(address: tuple[str, int], opened: ExitStack) -> socket.socket:
    other = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    other.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    other.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 18)
    other.connect(address)
    return other


def next_of(link: Link) -> bytes | None:
    assert select.select([link.fileno()], (), (), 20.0)[0]
    return link.recv()


@pytest.mark.parametrize("kind", ["udpin", "udpout", "udpbcast"])
@pytest.mark.parametrize("size", TOO_LONG)
def test_a_datagram_that_no_vehicle_sends_is_dropped_unread_and_counted(
    kind: str, size: int, opened: ExitStack
) -> None:
    link: Link
    if kind == "udpout":
        other = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        other.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 18)
        other.bind(("127.0.0.1", 0))
        link = UdpLink(Url(Scheme.UDP_OUT, "127.0.0.1", other.getsockname()[1]))
        link.send(b"hello")
        other.connect(other.recvfrom(100)[1])
    elif kind == "udpin":
        link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0))
        other = sender_to(("127.0.0.1", link.port), opened)
    else:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.255.255.255", 0))
            port = free.getsockname()[1]
        link = BroadcastLink(Url(Scheme.UDP_BROADCAST, "127.255.255.255", port))
        other = sender_to(("127.255.255.255", port), opened)
    opened.callback(link.close)
    for data in (b"\x01" * DATAGRAM_MAX_BYTES, b"\x02" * size, b"after"):
        other.send(data)
    assert [next_of(link) for _ in range(3)] == [b"\x01" * DATAGRAM_MAX_BYTES, b"", b"after"]
    assert link.errors == 1


def test_a_simulator_in_lockstep_may_send_longer_ones(opened: ExitStack) -> None:
    link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0), datagram_max_bytes=65_536)
    opened.callback(link.close)
    sender_to(("127.0.0.1", link.port), opened).send(bytes(60_000))
    assert next_of(link) == bytes(60_000)
    assert link.errors == 0


@pytest.mark.parametrize("size", TOO_LONG)
def test_the_watch_passes_over_what_no_vehicle_sends(size: int, opened: ExitStack) -> None:
    receiver = UdpReceiver(Url(Scheme.UDP_IN, "127.0.0.1", 0))
    opened.callback(receiver.close)
    other = sender_to(("127.0.0.1", receiver.port), opened)
    for data in (bytes(size), b"beacon"):
        other.send(data)
    assert next(iter(receiver.receive_datagrams(20.0))) == b"beacon"


def test_what_the_kernel_drops_is_counted(opened: ExitStack) -> None:
    link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0))
    opened.callback(link.close)
    other = sender_to(("127.0.0.1", link.port), opened)
    assert link.lost == 0
    sent = 0
    while link.lost == 0:
        other.send(bytes(1000))
        sent += 1
        assert sent < 20_000
    lost = link.lost
    read = 0
    while link.recv() is not None:
        read += 1
    assert read + lost == sent


@dataclass
class Counted:
    lost: int = 0


def log_of(links: dict[str, Counted], shares: dict[int, float]) -> tuple[FloodLog, list[tuple[float, str]]]:
    said: list[tuple[float, str]] = []
    return FloodLog(links, lambda now_s, text: said.append((now_s, text)), lambda: shares), said


def test_a_flood_is_told_when_it_begins_and_when_it_is_over_with_the_beacons_that_arrive() -> None:
    peers = Counted(7)
    log, said = log_of({"peers' link": peers, "autopilot link": Counted()}, {3: 0.4, 2: 1.0})
    for tick in range(40):
        now_s = 0.5 * tick
        peers.lost += 100 if 4.0 <= now_s < 6.0 else 0
        log.update(now_s)
    assert said[0] == (4.0, "peers' link flooded: 100 datagrams lost unread; beacons that arrive: 2 100 %, 3 40 %")
    assert said[1][1] == "peers' link: flood over, 400 datagrams lost unread"
    assert 5.5 + OVER_S <= said[1][0] <= 6.0 + OVER_S + LOOK_S
    assert len(said) == 2
    assert log.counters() == {
        "datagrams lost unread on the peers' link": 407,
        "datagrams lost unread on the autopilot link": 0,
    }


def test_a_long_flood_is_told_now_and_then() -> None:
    link = Counted()
    log, said = log_of({"autopilot link": link}, {})
    for second in range(60):
        link.lost += 10
        log.update(float(second))
    assert [now_s for now_s, _ in said] == [k * AGAIN_S for k in range(6)]
    assert said[-1][1] == "autopilot link flooded: 510 datagrams lost unread"


def test_without_losses_nothing_is_told() -> None:
    log, said = log_of({"peers' link": Counted(5)}, {2: 1.0})
    for second in range(100):
        log.update(float(second))
    assert said == []
