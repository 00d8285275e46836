"""UDP ports of this machine: taken where they can be had, refused by name where not."""

from __future__ import annotations

import errno
import os
import socket

from mission.cli import EXIT_ENVIRONMENT

LOOPBACK = "127.0.0.1"
PORT_MAX = 65535
BUFFER_BYTES = 1 << 20  # asked of the kernel: what arrives during a slow step


class StartError(Exception):
    """The bridge cannot start. `exit_code`: EXIT_BAD_FILE for wrong usage, else EXIT_ENVIRONMENT."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def bound_socket(
    option: str, port: int, *, host: str = LOOPBACK, avoid: tuple[str, int] | None = None
) -> socket.socket:
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
