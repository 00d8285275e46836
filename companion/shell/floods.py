"""Floods: what the kernel dropped since more came than was read, counted for each link and told in the flight log.

Genuine beacons are among what is lost: the kernel does not look. How many of each neighbour's arrive is told with it.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Mapping
from typing import Final, Protocol

MEMINFO: Final = (
    55  # SO_MEMINFO of Linux: nine numbers about a socket's queue, of which the last counts what it dropped
)
MEMINFO_NUMBERS: Final = struct.Struct("=9I")
LOOK_S: Final = 1.0
OVER_S: Final = 5.0  # without a loss
AGAIN_S: Final = 10.0  # between two lines of one flood


class Queue(Protocol):
    """A link that may lose datagrams before they are read."""

    @property
    def lost(self) -> int:
        """Datagrams so far."""


class FloodLog:
    """Notices floods of a companion's links. `update` each tick; it looks once in LOOK_S. Times: local clock, s."""

    __slots__ = ("_began", "_due_s", "_last", "_links", "_lost_s", "_said_s", "_say", "_shares")

    def __init__(
        self, links: Mapping[str, Queue], say: Callable[[float, str], None], shares: Callable[[], Mapping[int, float]]
    ) -> None:
        """`shares`: by neighbour, which share of its beacons arrives, 0..1."""
        self._links: Final = dict(links)
        self._say: Final = say
        self._shares: Final = shares
        self._last = {name: link.lost for name, link in links.items()}
        self._began: dict[str, int] = {}  # by a link that is flooded: what it had lost before
        self._lost_s: dict[str, float] = {}  # and when it lost something last
        self._said_s: dict[str, float] = {}
        self._due_s = float("-inf")

    def update(self, now_s: float) -> None:
        """A line when a flood begins, some while it lasts, and one when it is over."""
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
                    self._say(now_s, f"{name} flooded: {lost - began} datagrams lost unread{self._heard()}")
            elif name in self._began and now_s - self._lost_s[name] >= OVER_S:
                self._said_s.pop(name)
                self._say(now_s, f"{name}: flood over, {lost - self._began.pop(name)} datagrams lost unread")

    def counters(self) -> dict[str, int]:
        """Losses so far, by link."""
        return {f"datagrams lost unread on the {name}": link.lost for name, link in self._links.items()}

    def _heard(self) -> str:
        shares = ", ".join(f"{vehicle} {100.0 * share:.0f} %" for vehicle, share in sorted(self._shares().items()))
        return f"; beacons that arrive: {shares}" if shares else ""


def dropped_of(sock: socket.socket) -> int:
    """Datagrams that found this socket's queue full, so far; 0 where the kernel does not tell."""
    try:
        found = sock.getsockopt(socket.SOL_SOCKET, MEMINFO, MEMINFO_NUMBERS.size)
    except OSError:
        return 0
    return int(MEMINFO_NUMBERS.unpack(found)[-1]) if len(found) == MEMINFO_NUMBERS.size else 0
