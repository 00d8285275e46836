"""A UDP socket that receives the swarm's radio and cannot send: the kernel refuses to."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Final

from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from companion.shell.links import QUEUE_BYTES, LinkError, resolved, udp_refused
from companion.shell.urls import Scheme, Url

READS_PER_TURN: Final = 512  # datagrams, before the picture is due


class UdpReceiver:
    """A socket bound where `udpin` or `udpbcast` says, which receives from everybody who sends there.

    LinkError when it cannot be opened.
    """

    def __init__(self, url: Url) -> None:
        self._sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE_BYTES)
            if url.scheme is Scheme.UDP_BROADCAST:  # a companion of this computer may have the port, too
                self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._sock.bind(resolved(url))
        except OSError as error:
            self._sock.close()
            raise udp_refused(url, error) from None
        with contextlib.suppress(OSError):  # ENOTCONN: of a socket without another end, and done all the same
            self._sock.shutdown(socket.SHUT_WR)
        try:
            self._sock.sendto(b"", ("127.0.0.1", 9))  # nobody's
        except OSError:
            return
        self._sock.close()
        raise LinkError(f"{url}: this system does not let a socket be for receiving alone")

    @property
    def port(self) -> int:
        """Of this end."""
        port: int = self._sock.getsockname()[1]
        return port

    def receive_datagrams(self, wait_s: float) -> Iterator[bytes]:
        """Yield what comes: waits so long for the first datagram, then takes what there is."""
        self._sock.settimeout(wait_s)
        for _ in range(READS_PER_TURN):
            try:
                data = self._sock.recv(DATAGRAM_MAX_BYTES + 1)
            except (TimeoutError, BlockingIOError):
                return
            except OSError:
                continue
            if len(data) <= DATAGRAM_MAX_BYTES:  # no vehicle sends longer ones
                yield data
            self._sock.settimeout(0.0)

    def close(self) -> None:
        """For good."""
        self._sock.close()
