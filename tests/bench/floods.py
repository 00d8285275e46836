"""What floods cost a companion: the dearest datagrams that there are, and 10,000 a second on each of its links.

`python -m tests.bench floods`: first CPU time of datagrams of 64 KiB, and of the longest that is read, on each link;
then a vehicle in the air whose links are flooded one by one, from the very address that its autopilot, its radio and its
sensor's driver have. Its neighbour's beacons come by the flooded link. Times: of this machine.
"""

from __future__ import annotations

import argparse
import gc
import re
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES, frames
from companion.records.frames import RECORD_ID, VECTOR_ID
from companion.sensors.table import sensors_of
from companion.shell.links import UdpLink
from companion.shell.urls import Scheme, Url
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import end
from sim_bridge.drive.links.hub import split
from sim_bridge.drive.links.ports import bound_socket
from sim_bridge.drive.lockstep.processes import start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.bench.setpoint_gaps import SETPOINT_ID, TIMESTAMPNS, _received, point_mass
from tests.bench.table import Row
from tests.fuzz.companion import Episode
from tests.fuzz.flights import Heard, heard_in
from tests.fuzz.mutations import DATAGRAM_MAX, frame_of

RATE_HZ = 10_000
STEP_S = 0.01
READY_LIMIT_S = 120.0
COST_MS, GAP_MS = 10.0, 250.0
TRIES = 5  # of a datagram's cost, of which the least counts: another program's work is none of its
SENDER = """
import socket, sys, time
bound = socket.socket(fileno=int(sys.argv[1]))
to = (sys.argv[2], int(sys.argv[3]))
data, rate, for_s = open(sys.argv[4], "rb").read(), float(sys.argv[5]), float(sys.argv[6])
began = time.monotonic()
sent = lost = 0
while (now := time.monotonic() - began) < for_s:
    while sent < now * rate and time.monotonic() - began < for_s:
        try:
            bound.sendto(data, to)
        except OSError:
            lost += 1
        sent += 1
    time.sleep(0.001)
print(sent - lost)
"""


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
    for message_id in (swarm_beacon.MESSAGE_ID, 52102, RECORD_ID, VECTOR_ID):
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


def costs(size: int) -> list[Cost]:
    """Of each datagram of so many bytes, to a companion in flight that has lidar, ranging and records; dearest first."""
    heard = heard_in("stand")[:700]
    drivers = sorted({id_ for one in sensors_of(Episode("stand").mission) for id_ in one.MESSAGES})
    found: list[Cost] = []
    for link, datagrams in (
        ("peers", peers_datagrams(heard, size)),
        ("autopilot", other_datagrams(sorted(dialect.mavlink_map), 1, size)),
        ("sensor", other_datagrams(drivers, 196, size)),
    ):
        episode = flown(heard)
        now_s = heard[-1].now_s
        for name, data in datagrams:
            read: Callable[[bytes, float], None] = getattr(episode, f"from_{link}")
            least = Cost(link, name, float("inf"), float("inf"))
            for _ in range(TRIES):
                now_s += 0.05
                times_ms = [cpu_ms(lambda: read(data, now_s)), cpu_ms(lambda: episode.tick(now_s))]  # noqa: B023
                least = min(least, Cost(link, name, *times_ms), key=lambda cost: cost.read_ms)
            found.append(least)
    return sorted(found, key=lambda cost: -cost.read_ms)


def flown(heard: Sequence[Heard]) -> Endpoint:
    """A companion that has heard this, with the collector as a companion has it."""
    one = Episode("stand").endpoint
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
    yield Row("any datagram of 64 KiB, on any link", f"<= {COST_MS:g} ms CPU", f"{dropped:.3f} ms: dropped unread", dropped <= COST_MS)
    for link in ("peers", "autopilot", "sensor"):
        worst = next(cost for cost in costs_read() if cost.link == link)
        yield Row(
            f"- the dearest of {DATAGRAM_MAX_BYTES} bytes, the longest that is read, {link}",
            f"<= {COST_MS:g} ms CPU",
            f"{worst.read_ms:.2f} ms, its tick {worst.tick_ms:.2f} ms ({worst.name})",
            max(worst.read_ms, worst.tick_ms) <= COST_MS,
        )


_COSTS: dict[int, list[Cost]] = {}


def costs_read() -> list[Cost]:
    """Of the longest datagrams that are read, measured once."""
    if not _COSTS:
        _COSTS[0] = costs(DATAGRAM_MAX_BYTES)
    return _COSTS[0]


# --- a vehicle in the air ---


def mission() -> Mission:
    """Two vehicles with obstacle sensors, steered for as long as it takes."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "floods",
            "route": {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 3600.0},
            "swarm": {"size": 2},
            "sensing": {"sensor": "scan-1deg", "range_m": 12.0},
        }
    ).with_origin(DEFAULT_ORIGIN)
