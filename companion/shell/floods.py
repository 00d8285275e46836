"""Floods: what the kernel dropped of a link's datagrams, since more came than was read or they were too long.

Genuine beacons are among what a full queue loses: the kernel does not look. How many arrive is told with it.
"""

from __future__ import annotations

import ctypes
import socket
import struct
from collections.abc import Callable, Mapping
from typing import Final, Protocol

MEMINFO: Final = (
    55  # SO_MEMINFO of Linux: nine numbers about a socket's queue, of which the last counts what it dropped
)
MEMINFO_NUMBERS: Final = struct.Struct("=9I")
ATTACH_FILTER: Final = 26  # SO_ATTACH_FILTER of Linux: a program that the kernel asks about each datagram
UDP_HEADER_BYTES: Final = 8  # which it sees, too
LOOK_S: Final = 1.0
OVER_S: Final = 5.0  # without a loss
AGAIN_S: Final = 10.0  # between two lines of one flood


class Queue(Protocol):
    """A link that may lose datagrams before they are read."""

    @property
    def lost(self) -> int:
        """Datagrams so far."""


class FloodLog:
    """Notices floods of some links. `update` each tick; it looks once in LOOK_S. Times: local clock, s."""

    __slots__ = ("_began", "_due_s", "_last", "_links", "_lost_s", "_said_s", "_say")

    def __init__(self, links: Mapping[str, Queue], say: Callable[[float, str, bool], None]) -> None:
        """`say`: takes the time, a text, and whether that flood is over."""
        self._links: Final = dict(links)
        self._say: Final = say
        self._last = {name: link.lost for name, link in links.items()}
        self._began: dict[str, int] = {}  # by a link that is flooded: what it had lost before
        self._lost_s: dict[str, float] = {}  # and when it lost something last
        self._said_s: dict[str, float] = {}
        self._due_s = float("-inf")

    def update(self, now_s: float) -> None:
        """A text when a flood begins, some while it lasts, and one when it is over."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + LOOK_S
        for name, link in self._links.items():
            lost, before = link.lost, self._last[name]
            self._last[name] = lost
            if lost != before:
                began = self._began.setdefault(name, before)
                self._lost_s[name] = now_s
                if now_s - self._said_s.get(name, float("-inf")) >= AGAIN_S:
                    self._said_s[name] = now_s
                    self._say(now_s, f"{name} flooded: {lost - began} lost unread", False)
            elif name in self._began and now_s - self._lost_s[name] >= OVER_S:
                self._said_s.pop(name)
                self._say(now_s, f"{name} flood over: {lost - self._began.pop(name)} lost unread", True)

    def counters(self) -> dict[str, int]:
        """Losses so far, by link."""
        return {f"datagrams lost unread on the {name}": link.lost for name, link in self._links.items()}


def dropped_of(sock: socket.socket) -> int:
    """Datagrams that the kernel dropped: this socket's queue was full, or `drop_longer` does; 0: it does not tell."""
    try:
        found = sock.getsockopt(socket.SOL_SOCKET, MEMINFO, MEMINFO_NUMBERS.size)
    except OSError:
        return 0
    return int(MEMINFO_NUMBERS.unpack(found)[-1]) if len(found) == MEMINFO_NUMBERS.size else 0


def drop_longer(sock: socket.socket, most_bytes: int) -> None:
    """Let the kernel drop longer datagrams before they fill the queue: thirty of 64 KiB do. Nothing where it cannot."""
    # The length; if greater, none of it; else all of it.
    program = struct.pack(
        "=HBBIHBBIHBBIHBBI",
        *(0x80, 0, 0, 0),
        *(0x25, 0, 1, most_bytes + UDP_HEADER_BYTES),
        *(0x06, 0, 0, 0),
        *(0x06, 0, 0, 0xFFFFFFFF),
    )
    kept = ctypes.create_string_buffer(program)  # the kernel copies it
    try:
        sock.setsockopt(socket.SOL_SOCKET, ATTACH_FILTER, struct.pack("HP", 4, ctypes.addressof(kept)))
    except OSError:
        return
