"""Listening to links for a while: all that comes, to ends that are told that somebody is there."""

from __future__ import annotations

import select
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack

from companion.mavlink.endpoint import COMPONENT, heartbeat
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing
from companion.mavlink.sensor_source import SensorSource, SensorTally
from companion.shell.links import Link

HELLO_S = 0.5
SYSTEM_ID = 254  # of nobody: 255 is the ground station, whose loss is a failsafe


class SensorWindow:
    """Tallies of what sensors' drivers sent while their links were listened to. Times: monotonic, s."""

    def __init__(self, kinds: Iterable[type[SensorSource]]) -> None:
        """`kinds`: the sensors that are looked for, on every link."""
        self.began_s = self.ended_s = time.monotonic()
        self.byte_count = 0
        self.tallies: dict[str, SensorTally] = {kind.NAME: kind.tally(self.began_s) for kind in kinds}
        self._names = {message_id: kind.NAME for kind in kinds for message_id in kind.MESSAGES}

    def fill(self, links: Sequence[Link], *, streams: Sequence[bool], seconds: float) -> None:
        """Listen; `streams`: of each link, whether its bytes may break anywhere."""
        framings = [Framing(frozenset(self._names), is_stream=is_stream) for is_stream in streams]
        for at, data in listen_all(links, seconds):
            self.byte_count += len(data)
            for heard in framings[at].read_messages(data):
                tally = self.tallies[self._names[heard.message_id]]
                tally.add(heard.message, heard.system, heard.component, time.monotonic())
        self.ended_s = time.monotonic()


def listen(link: Link, seconds: float) -> Iterator[bytes]:
    """Yield what comes within so many seconds; then the link is closed."""
    for _, data in listen_all([link], seconds):
        yield data


def listen_all(links: Sequence[Link], seconds: float) -> Iterator[tuple[int, bytes]]:
    """Yield what comes by which of the links, saying HEARTBEAT meanwhile; then they are closed."""
    with ExitStack() as opened:
        for link in links:
            opened.callback(link.close)
        deadline_s = time.monotonic() + seconds
        hello_s = time.monotonic()
        seq = 0
        while (now_s := time.monotonic()) < deadline_s:
            if now_s >= hello_s:
                for link in links:
                    link.send(wire.pack(heartbeat(), seq=seq, system=SYSTEM_ID, component=COMPONENT))
                seq, hello_s = (seq + 1) % 256, now_s + HELLO_S
            # A serial port that is gone has no descriptor: it is opened again by reading
            waiting = [link.fileno() for link in links if link.fileno() >= 0]
            select.select(waiting, [], [], max(0.0, min(hello_s, deadline_s) - now_s))
            for at, link in enumerate(links):
                while (data := link.recv()) is not None:
                    yield at, data
