"""UDP ports of this machine: taken where they can be had, refused by name where not."""

from __future__ import annotations

import errno
import os
import selectors
import socket
import time
from collections.abc import Callable
from typing import Any

from mission.cli.main import EXIT_ENVIRONMENT
from sim_bridge.errors import StartError
from sim_bridge.options.ports import LOOPBACK as LOOPBACK
from sim_bridge.options.ports import PORT_MAX as PORT_MAX
from sim_bridge.options.ports import Address as Address

DATAGRAM_MAX_BYTES = 65536
BUFFER_BYTES = 1 << 20  # asked of the kernel: what arrives during a slow step
READS_PER_TURN = 256  # datagrams of one socket before the others, and the next step, have their turn,
READ_S = 0.05  # and for how long: a flood of one slows the world down, and does not stop it

Reader = Callable[[bytes, Address, float], None]


def bound_socket(option: str, port: int, *, host: str = LOOPBACK, avoid: Address | None = None) -> socket.socket:
    """A non-blocking UDP socket on `port`; on a free one for 0, but not on that of `avoid`. StartError names it."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise StartError(_port_refused(option, port, error), EXIT_ENVIRONMENT) from None
    if avoid is not None and bound.getsockname()[1] == avoid[1]:
        with bound:  # held until another is found
            return bound_socket(option, port, host=host, avoid=avoid)
    return bound


def _port_refused(option: str, port: int, error: OSError) -> str:
    match error.errno:
        case errno.EADDRINUSE:
            return (
                f"{option}: UDP port {port} is taken: end the program that has it "
                f"(ss -ulpn 'sport = :{port}' names it), or choose another"
            )
        case errno.EACCES:
            return f"{option}: UDP port {port}: no permission: choose one of 1024..{PORT_MAX}"
        case _:
            return f"{option}: UDP port {port or '(any)'}: {os.strerror(error.errno or 0)}"


class Listener:
    """Waits on bound sockets, and hands what comes to their readers: datagram, sender, wall time."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def listen(self, bound: socket.socket, reader: Reader) -> None:
        """Non-blocking; its owner closes it."""
        self._selector.register(bound, selectors.EVENT_READ, reader)

    def poll(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Wait for datagrams, at most `timeout_s`, and take in what has come: from each socket only so much."""
        ready = self._selector.select(max(0.0, timeout_s))
        now_s = clock()
        for key, _ in ready:
            bound: Any = key.fileobj
            for _ in range(READS_PER_TURN):
                try:
                    data, address = bound.recvfrom(DATAGRAM_MAX_BYTES)
                except BlockingIOError:
                    break
                except OSError:  # an earlier datagram found its port closed
                    continue
                key.data(data, address, now_s)
                if clock() - now_s >= READ_S:
                    break

    def close(self) -> None:
        """Stop listening."""
        self._selector.close()
