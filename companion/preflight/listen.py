"""A while on one link: all that comes, to an end that is told that somebody is there."""

from __future__ import annotations

import select
import time
from collections.abc import Iterator

from companion.mavlink import wire
from companion.mavlink.endpoint import COMPONENT, heartbeat
from companion.shell.links import Link

HELLO_S = 0.5
SYSTEM_ID = 254  # of nobody: 255 is the ground station, whose loss is a failsafe


def listen(link: Link, seconds: float) -> Iterator[bytes]:
    """What comes within so many seconds, saying HEARTBEAT meanwhile; then the link is closed."""
    try:
        deadline_s = time.monotonic() + seconds
        hello_s = time.monotonic()
        seq = 0
        while (now_s := time.monotonic()) < deadline_s:
            if now_s >= hello_s:
                link.send(wire.pack(heartbeat(), seq=seq, system=SYSTEM_ID, component=COMPONENT))
                seq, hello_s = seq + 1, now_s + HELLO_S
            if link.fileno() >= 0:
                select.select([link.fileno()], [], [], max(0.0, min(hello_s, deadline_s) - now_s))
            else:
                time.sleep(max(0.0, hello_s - now_s))
            while (data := link.recv()) is not None:
                yield data
    finally:
        link.close()
