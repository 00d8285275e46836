"""Floods: datagrams that are too long are dropped unread, what the kernel drops is counted, and it is told."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest

from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from companion.shell import floods
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


def opened_link(kind: str, opened: ExitStack) -> tuple[Link, socket.socket]:
    """A link of this kind, and a socket that it hears."""
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
    return link, other


KINDS = ("udpin", "udpout", "udpbcast")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", TOO_LONG)
def test_the_kernel_drops_a_datagram_that_no_vehicle_sends_and_it_takes_no_place_in_the_queue(
    kind: str, size: int, opened: ExitStack
) -> None:
    link, other = opened_link(kind, opened)
    for data in (b"\x01" * DATAGRAM_MAX_BYTES, *[b"\x02" * size] * 500, b"after"):
        other.send(data)
    assert [next_of(link) for _ in range(2)] == [b"\x01" * DATAGRAM_MAX_BYTES, b"after"]
    assert (link.lost, link.errors) == (500, 0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", TOO_LONG)
def test_where_the_kernel_cannot_one_that_is_too_long_is_dropped_unread_and_counted(
    kind: str, size: int, opened: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(floods, "ATTACH_FILTER", 9999)
    link, other = opened_link(kind, opened)
    for data in (b"\x01" * DATAGRAM_MAX_BYTES, b"\x02" * size, b"after"):
        other.send(data)
    assert [next_of(link) for _ in range(3)] == [b"\x01" * DATAGRAM_MAX_BYTES, b"", b"after"]
    assert (link.lost, link.errors) == (0, 1)


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


def log_of(links: dict[str, Counted]) -> tuple[FloodLog, list[tuple[float, str, bool]]]:
    said: list[tuple[float, str, bool]] = []
    return FloodLog(links, lambda now_s, text, is_over: said.append((now_s, text, is_over))), said


def test_a_flood_is_told_when_it_begins_and_when_it_is_over() -> None:
    peers = Counted(7)
    log, said = log_of({"peers' link": peers, "autopilot link": Counted()})
    for tick in range(40):
        now_s = 0.5 * tick
        peers.lost += 100 if 4.0 <= now_s < 6.0 else 0
        log.update(now_s)
    assert said[0] == (4.0, "peers' link flooded: 100 lost unread", False)
    assert said[1][1:] == ("peers' link flood over: 400 lost unread", True)
    assert 5.5 + OVER_S <= said[1][0] <= 6.0 + OVER_S + LOOK_S
    assert len(said) == 2
    assert log.counters() == {
        "datagrams lost unread on the peers' link": 407,
        "datagrams lost unread on the autopilot link": 0,
    }


def test_one_that_pauses_is_one_flood() -> None:
    link = Counted()
    log, said = log_of({"peers' link": link})
    for second in range(30):
        link.lost += 10 if second % 5 == 0 else 0
        log.update(float(second))
    assert [text for _, text, _ in said if "over" in text] == []
    assert [now_s for now_s, _, _ in said] == [0.0, 10.0, 20.0]


def test_a_long_flood_is_told_now_and_then() -> None:
    link = Counted()
    log, said = log_of({"autopilot link": link})
    for second in range(60):
        link.lost += 10
        log.update(float(second))
    assert [now_s for now_s, _, _ in said] == [k * AGAIN_S for k in range(6)]
    assert said[-1][1] == "autopilot link flooded: 510 lost unread"


def test_without_losses_nothing_is_told() -> None:
    log, said = log_of({"peers' link": Counted(5)})
    for second in range(100):
        log.update(float(second))
    assert said == []
