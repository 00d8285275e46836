"""A runner over links in memory, whose time passes only while it waits."""

from __future__ import annotations

import math
from collections import deque
from types import SimpleNamespace
from typing import Any

from companion.mavlink import dialect
from companion.mavlink.endpoint import Outbox
from companion.mavlink.framing.frames import Framing, Incoming
from companion.shell.runner import Runner

OWN = 3


class MemoryLink:
    """A link whose far end is a list."""

    def __init__(self) -> None:
        self.errors = self.lost = 0
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

    def from_sensor(self, data: bytes, now_s: float, link: str) -> None:
        self.done.append((link, data, now_s))

    def read_autopilot(self, data: bytes) -> list[Incoming]:
        self.read.append(data)
        return self.framing.read_messages(data)

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
        self.lines: list[str] = []
        self.watch = SimpleNamespace(
            log_changes=lambda *_: None,
            log_links=lambda *_: None,
            log_lines=lambda _now_s, lines: self.lines.extend(lines),
            status_line=lambda: "fine",
        )
        self.stop = SimpleNamespace(reason="", fileno=lambda: 0)
        endpoint: Any = self.endpoint
        watch: Any = self.watch
        stop: Any = self.stop
        self.alive_s: list[float] = []
        self._others: Any = (watch, stop)
        self.runner = self.runner_of(endpoint)
        self.waits_left = 0

    def runner_of(self, endpoint: Any, recorder: Any = None, sensors: tuple[str, ...] = ("sensor",)) -> Runner:
        """Another one, with the same surroundings."""
        watch, stop = self._others
        service: Any = SimpleNamespace(alive=lambda now_s, _status: self.alive_s.append(now_s), period_s=math.inf)
        links = dict.fromkeys(sensors, self.sensor)
        return Runner(endpoint, self.autopilot, self.peers, watch, stop, service, links, recorder)

    def select(self, _r: Any, _w: Any, _x: Any, wait_s: float) -> None:
        assert wait_s >= 0.0
        self.now_s += wait_s + self.work_s
        self.waits_left -= 1
        if self.waits_left == 0:
            self.stop.reason = "test"

    @property
    def ticks_s(self) -> list[float]:
        return [round(now_s, 6) for what, _, now_s in self.endpoint.done if what == "tick"]


def timesync(time_ns: int, *, system: int = OWN, component: int = 1, tc1: int = 0) -> bytes:
    packed: bytes = dialect.MAVLink_timesync_message(tc1, time_ns).pack(
        dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    )
    return packed


HEARTBEAT: bytes = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(dialect.MAVLink(None, OWN, 1))
