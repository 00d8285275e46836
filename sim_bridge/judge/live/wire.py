"""Messages between a flight and the process of its map: JSON objects, one a message, over a local socket pair.

The socket keeps messages apart and in order, and takes each whole or not at all. Neither end ever waits for the other:
a message that does not fit any more is not sent.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator, Mapping
from typing import Any, Final

MESSAGE_MAX_BYTES: Final = 1 << 18  # a row of 250 vehicles takes a third of it
READS_PER_TURN: Final = 64  # messages before others have their turn


class GoneError(Exception):
    """The other end is closed."""


def pair() -> tuple[socket.socket, socket.socket]:
    """Two ends, neither of which blocks."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * MESSAGE_MAX_BYTES)
    return ends


def send(end: socket.socket, message: Mapping[str, Any]) -> bool:
    """False: there is no room for it now. GoneError."""
    try:
        end.send(json.dumps(message, separators=(",", ":")).encode())
    except BlockingIOError:
        return False
    except OSError as error:
        raise GoneError(str(error)) from None
    return True


def received(end: socket.socket) -> Iterator[bytes]:
    """Messages that have come by now, at most READS_PER_TURN messages. GoneError after the last of a closed end."""
    for _ in range(READS_PER_TURN):
        try:
            data = end.recv(MESSAGE_MAX_BYTES)
        except BlockingIOError:
            return
        except ConnectionResetError:  # closed, and not all was read there; what it said is still to be had
            continue
        except OSError as error:
            raise GoneError(str(error)) from None
        if not data:
            raise GoneError("closed")
        yield data
