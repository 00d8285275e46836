"""CPU time of the dearest datagrams that there are, on each link of a companion in flight."""

from __future__ import annotations

import gc
import random
import select
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES, frames
from companion.mavlink.relative import RELATIVE_ID
from companion.records.frames import RECORD_ID, VECTOR_ID
from companion.sensors.table import SENSORS
from companion.shell.links import UdpLink
from companion.shell.urls import Scheme, Url
from tests.bench.flood_datagrams import FLOODS, frames_of
from tests.bench.table import Row
from tests.fuzz.companion import Episode
from tests.fuzz.flights import Heard, heard_in
from tests.fuzz.mutations import DATAGRAM_MAX, frame_of

COST_MS = 10.0
DRAWN = 500  # datagrams of each kind
SEED = 25
TRIES = 5  # of a datagram's cost, of which the least counts: another program's work is none of its


def filled(make: Callable[[int], bytes], size: int) -> bytes:
    """As many frames as there is room for."""
    found: list[bytes] = []
    while sum(map(len, found)) + len(made := make(len(found))) <= size:
        found.append(made)
    return b"".join(found)


def sender(system: int, component: int, number: int = 0) -> bytes:
    """A header's flags, sequence, system and component."""
    return bytes([0, 0, number & 0xFF, system, component])


def genuine(heard: Sequence[Heard], link: str, message_id: int) -> bytes:
    """The last frame of this message."""
    for now in reversed(heard):
        data: bytes = getattr(now, link)
        for start, stop, found in frames(data):
            if found == message_id:
                return data[start:stop]
    raise LookupError(f"no message {message_id} on the link {link}")


def resent(frame: bytes, system: int, number: int) -> bytes:
    """The same of another vehicle."""
    message_id = int.from_bytes(frame[7:10], "little")
    return frame_of(message_id, frame[10 : 10 + frame[1]], sender(system, frame[6], number))


def peers_datagrams(heard: Sequence[Heard], size: int) -> Iterator[tuple[str, bytes]]:
    """By what each is."""
    magic = b"\xfd\xff\0\0\0\x01\xbf" + swarm_beacon.MESSAGE_ID.to_bytes(3, "little")
    yield "start bytes", b"\xfd" * size
    yield "claims of 255 bytes, one in the other", filled(lambda _: magic + bytes(20), size)
    beacon = genuine(heard, "peers", swarm_beacon.MESSAGE_ID)
    yield "beacons of 250 ids", filled(lambda k: resent(beacon, 1 + k % 250, k), size)
    yield "beacons of members", filled(lambda k: resent(beacon, (1, 3, 4)[k % 3], k), size)
    for name, message_id in (("records", RECORD_ID), ("vectors", VECTOR_ID)):
        one = genuine(heard, "peers", message_id)
        yield f"{name} of members", filled(lambda k, one=one: resent(one, (1, 3, 4)[k % 3], k), size)  # type: ignore[misc]
    yield "vectors, each of ten new logs", filled(lambda k: new_logs(k, genuine(heard, "peers", VECTOR_ID)), size)
    for message_id in (swarm_beacon.MESSAGE_ID, RELATIVE_ID, RECORD_ID, VECTOR_ID):
        name = dialect.mavlink_map[message_id].msgname
        yield f"shortest {name}", filled(lambda _, i=message_id: frame_of(i, b"\0", sender(3, 191)), size)  # type: ignore[misc]


def new_logs(k: int, vector: bytes) -> bytes:
    """A vector that tells of ten logs that nobody has heard of, with all numbers up to the largest."""
    numbers = b"\0" * 6 + b"\xff\xff\x7f" + b"\0" * 7
    entries = b"".join(bytes([1 + j % 4]) + (16 * k + j + 100).to_bytes(4, "little") + numbers for j in range(10))
    return frame_of(VECTOR_ID, vector[10:20] + entries, sender((1, 3, 4)[k % 3], 191))


def other_datagrams(ids: Sequence[int], component: int, size: int) -> Iterator[tuple[str, bytes]]:
    """The shortest and the longest of each message."""
    for message_id in ids:
        message = dialect.mavlink_map[message_id]
        for how, payload in (("shortest", b"\0"), ("longest", b"\x01" * message.unpacker.size)):
            name = f"{how} {message.msgname}"
            yield name, filled(lambda _, i=message_id, p=payload: frame_of(i, p, sender(2, component)), size)  # type: ignore[misc]


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU time of one datagram, and of the tick behind it, ms."""

    link: str
    name: str
    read_ms: float
    tick_ms: float
    data: bytes


@cache
def costs(size: int) -> list[Cost]:
    """Of each datagram of so many bytes, to a companion in flight with lidar, ranging and records; dearest first."""
    heard = heard_in("stand")[:700]
    drivers = sorted({id_ for kind in SENSORS.values() for id_ in kind.MESSAGES})
    found: list[Cost] = []
    for link, datagrams in (
        ("peers", peers_datagrams(heard, size)),
        ("autopilot", other_datagrams(sorted(dialect.mavlink_map), 1, size)),
        ("sensor", other_datagrams(drivers, 196, size)),
    ):
        episode = flown("stand", heard)
        now_s = heard[-1].now_s
        for name, data in datagrams:
            read: Callable[[bytes, float], None] = getattr(episode, f"from_{link}")
            least = Cost(link, name, float("inf"), float("inf"), data)
            for _ in range(TRIES):
                now_s += 0.05
                times_ms = [cpu_ms(lambda: read(data, now_s)), cpu_ms(lambda: episode.tick(now_s))]  # noqa: B023
                least = min(least, Cost(link, name, *times_ms, data), key=lambda cost: cost.read_ms)
            found.append(least)
    return sorted(found, key=lambda cost: -cost.read_ms)


def flown(flight: str, heard: Sequence[Heard]) -> Endpoint:
    """A companion that has heard this, with the collector as a companion has it."""
    one = Episode(flight).endpoint
    for now in heard:
        one.from_peers(now.peers, now.now_s)
        one.from_sensor(now.sensor, now.now_s)
        one.from_autopilot(now.autopilot, now.now_s)
        one.tick(now.now_s)
    gc.collect()
    gc.freeze()
    return one


def cpu_ms(work: Callable[[], Any]) -> float:
    """CPU time of this thread."""
    began_s = time.thread_time()
    work()
    return 1e3 * (time.thread_time() - began_s)


def dropped_ms() -> float:
    """CPU time of a datagram of 64 KiB at a link, which drops it unread."""
    link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0), hears_all=True)
    least = float("inf")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 18)
        for _ in range(TRIES):
            other.sendto(bytes(DATAGRAM_MAX), ("127.0.0.1", link.port))
            select.select([link.fileno()], (), (), 5.0)
            least = min(least, cpu_ms(link.recv))
    assert link.errors == TRIES
    link.close()
    return least


def cost_rows() -> Iterator[Row]:
    """Of the dearest datagram that is read, and of one of 64 KiB."""
    dropped = dropped_ms()
    yield Row(
        "any datagram of 64 KiB, on any link",
        f"<= {COST_MS:g} ms CPU",
        f"{dropped:.3f} ms: dropped unread",
        dropped <= COST_MS,
    )
    for link in ("peers", "autopilot", "sensor"):
        worst = next(cost for cost in costs(DATAGRAM_MAX_BYTES) if cost.link == link)
        yield Row(
            f"- the dearest of {DATAGRAM_MAX_BYTES} bytes, the longest that is read, {link}",
            f"<= {COST_MS:g} ms CPU",
            f"{worst.read_ms:.2f} ms, its tick {worst.tick_ms:.2f} ms ({worst.name})",
            max(worst.read_ms, worst.tick_ms) <= COST_MS,
        )


def drawn_rows() -> Iterator[Row]:
    """CPU time of drawn datagrams of each flood, those that are read."""
    for (link, signed), floods in FLOODS.items():
        flight = "signed" if signed else "stand"
        heard = heard_in(flight)[:700]
        genuine = frames_of([getattr(now, link) for now in heard[-100:]])
        for what, draw in floods.items():
            episode, rng, now_s = flown(flight, heard), random.Random(f"{SEED} {link} {what}"), heard[-1].now_s
            read: Callable[[bytes, float], None] = getattr(episode, f"from_{link}")
            drawn = [draw(rng, genuine) for _ in range(DRAWN)]
            if len(drawn[0]) > DATAGRAM_MAX_BYTES:
                continue  # dropped unread
            each = np.full(DRAWN, np.inf)
            for _ in range(TRIES):
                now_s += 0.05
                each = np.minimum(each, [cpu_ms(lambda: read(data, now_s)) for data in drawn])  # noqa: B023
                episode.tick(now_s)
            p50, p99, most = (float(np.percentile(each, q)) for q in (50, 99, 100))
            yield Row(
                f"- {DRAWN} drawn, {'signed' if signed else 'unsigned'}, {link}: {what}",
                f"<= {COST_MS:g} ms CPU",
                f"median {p50:.3f} ms, p99 {p99:.3f}, most {most:.3f}",
                most <= COST_MS,
            )
