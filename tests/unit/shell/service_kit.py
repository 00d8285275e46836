"""The service manager's end of NOTIFY_SOCKET, for tests."""

from __future__ import annotations

import select
import socket

HAPPEN_LIMIT_S = 30.0
WATCHDOG_USEC = 200_000
QUIET_S = 2 * WATCHDOG_USEC / 1e6  # eight words are due in this time; what hangs sends none, however long it takes


class Manager:
    """The far end of NOTIFY_SOCKET."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(name.replace("@", "\0", 1))

    def hear(self, limit_s: float = HAPPEN_LIMIT_S) -> dict[str, str]:
        """The next datagram's words; empty when there is none within `limit_s`."""
        if not select.select([self.socket], [], [], limit_s)[0]:
            return {}
        return dict(line.split("=", 1) for line in self.socket.recv(4096).decode().split("\n"))

    def drain(self) -> None:
        while self.hear(0.0):
            pass
