"""Notifications to the service manager (sd_notify(3)): ready, alive, a line for people, stopping. Only the loop speaks.

One datagram each to $NOTIFY_SOCKET. Own code: of the libraries one has had no release since 2017, the other must be
compiled on the board.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Mapping

STATE = "STATE_DIRECTORY"  # systemd's name of the folder where a service keeps what outlives it
STATUS_S = 1.0  # without a watchdog
WORDS_PER_WATCHDOG = 4  # twice as often as systemd asks for: one word may be lost


class Service:
    """Does nothing where there is no service manager. Never waits, never raises; what cannot be sent is in `errors`."""

    def __init__(self, environment: Mapping[str, str], pid: int) -> None:
        """`pid`: of this process; a watchdog that was set for another one is not for us."""
        self.errors = 0
        self.period_s = math.inf  # how often `alive` wants to be called
        self._next_s = -math.inf
        self._ready = False
        self._address = _address(environment.get("NOTIFY_SOCKET", ""))
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
            self.period_s = min(STATUS_S, _watchdog_s(environment, pid) / WORDS_PER_WATCHDOG)

    def alive(self, now_s: float, status: Callable[[], str]) -> None:
        """From every turn of the loop that steers; `now_s` is monotonic. The first one says that it is ready."""
        if self._socket is None or now_s < self._next_s:
            return
        self._next_s = now_s + self.period_s
        ready = "" if self._ready else "READY=1\n"
        self._ready = self._send(f"{ready}WATCHDOG=1\nSTATUS={status()}") or self._ready

    def stopping(self) -> None:
        """The loop has ended."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """For good."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _send(self, words: str) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.sendto(words.encode(errors="backslashreplace"), self._address)
        except OSError:  # nobody there, or its queue is full
            self.errors += 1
            return False
        return True


def _address(name: str) -> str:
    """ "" when it is none of ours; `@` stands for the null byte of an abstract socket."""
    return name.replace("@", "\0", 1) if name.startswith(("/", "@")) else ""


def _watchdog_s(environment: Mapping[str, str], pid: int) -> float:
    period_us = environment.get("WATCHDOG_USEC", "")
    if environment.get("WATCHDOG_PID", str(pid)) != str(pid) or not (period_us.isascii() and period_us.isdecimal()):
        return math.inf
    return int(period_us) / 1e6 or math.inf
