"""The links of a companion: UDP and serial, non-blocking. Opening one can fail; after that nothing raises.

What happens in flight (no route, nobody listening, a full buffer, an unplugged cable) is counted in `errors`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import time
from typing import Protocol

import serial

from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from companion.shell.floods import drop_longer, dropped_of
from companion.shell.serial_port import ERRORS, PortOpening
from companion.shell.urls import Scheme, Url, is_ipv4

RECV_BYTES = 65536  # the longest UDP datagram
OTHER_END_S = 3.0  # silent for longer, another may take its place: a router that was started again has another port
QUEUE_BYTES = 1 << 20  # asked of the kernel, which may give less: a swarm's beacons while this process is not scheduled
REOPEN_S = 1.0
OPEN_S = 1.0  # that a port which may be absent is waited for at the start
ABSENT = frozenset({errno.ENOENT, errno.ENXIO, errno.ENODEV})  # a serial device, not (yet) plugged in


class LinkError(Exception):
    """A link cannot be opened; the message names it, and what to do."""


class Link(Protocol):
    """Both ends of one link."""

    errors: int  # sends and receives that failed, and datagrams of strangers, or too long

    @property
    def lost(self) -> int:
        """Datagrams that the kernel dropped so far: more came than were read, or they were too long."""

    @property
    def up(self) -> bool:
        """False while the device is gone."""

    def fileno(self) -> int:
        """To wait on; -1 while the device is gone. It changes when the device is opened again."""

    def recv(self) -> bytes | None:
        """One datagram, or what bytes there are; None: nothing more now. A stranger's datagram reads as b""."""

    def send(self, data: bytes) -> None:
        """Send one datagram, or drop and count it."""

    def close(self) -> None:
        """For good."""


def open_link(
    url: Url,
    *,
    may_be_absent: bool = False,
    hears_all: bool = False,
    dtr: bool = True,
    datagram_max_bytes: int = DATAGRAM_MAX_BYTES,
) -> Link:
    """LinkError when it cannot be opened.

    `may_be_absent`: a serial device that is not there counts as unplugged. `hears_all`: see UdpLink. `dtr`: the level
    of that line of a serial port, where it has one. `datagram_max_bytes`: longer ones are dropped, and count as errors.
    """
    match url.scheme:
        case Scheme.SERIAL:
            return SerialLink(url, may_be_absent=may_be_absent, dtr=dtr)
        case Scheme.UDP_BROADCAST:
            return BroadcastLink(url, datagram_max_bytes=datagram_max_bytes)
        case Scheme.UDP_IN | Scheme.UDP_OUT:
            return UdpLink(url, hears_all=hears_all, datagram_max_bytes=datagram_max_bytes)


class UdpLink:
    """`udpin`: bound; the other end is the first that speaks, until it is silent. `udpout`: connected to its other end.

    Nobody else is heard or answered. Silent means that its queue was found empty: what came while this process stood
    still is no silence.

    `hears_all`, of `udpin`: everybody is heard, and the last that spoke is answered: drivers of obstacle sensors.
    """

    __slots__ = ("_connected", "_heard_s", "_hears_all", "_most", "_other_end", "_sock", "errors")

    def __init__(self, url: Url, *, hears_all: bool = False, datagram_max_bytes: int = DATAGRAM_MAX_BYTES) -> None:
        self.errors = 0
        self._most = datagram_max_bytes
        self._hears_all = hears_all
        self._other_end: tuple[str, int] | None = None  # of `udpin`
        self._heard_s = 0.0
        self._connected = url.scheme is Scheme.UDP_OUT
        self._sock = _udp_socket(datagram_max_bytes)
        try:
            address = resolved(url)
            if self._connected:
                self._sock.connect(address)
            else:
                self._sock.bind(address)
        except OSError as error:
            self._sock.close()
            raise udp_refused(url, error) from None

    @property
    def lost(self) -> int:
        """Of this socket's queue."""
        return dropped_of(self._sock)

    @property
    def up(self) -> bool:
        """Always: a socket stays."""
        return True

    @property
    def port(self) -> int:
        """Of this end."""
        port: int = self._sock.getsockname()[1]
        return port

    def fileno(self) -> int:
        """The socket, to wait on."""
        return self._sock.fileno()

    def recv(self) -> bytes | None:
        """The next datagram of the other end, b"" for a stranger's, or one too long; None: nothing more now."""
        while True:
            try:
                if self._connected:
                    return self._bounded(self._sock.recv(self._most + 1))
                return self._from_other_end(*self._sock.recvfrom(self._most + 1))
            except BlockingIOError:
                if self._other_end is not None and time.monotonic() - self._heard_s > OTHER_END_S:
                    self._other_end = None
                return None
            except ConnectionRefusedError:  # an earlier datagram found nobody; there may be others behind it
                self.errors += 1
            except OSError:
                self.errors += 1
                return None

    def _from_other_end(self, data: bytes, sender: tuple[str, int]) -> bytes:
        if self._other_end is None or self._hears_all:
            self._other_end = sender
        if sender != self._other_end:
            self.errors += 1
            return b""  # and not the next one: a flood of them is the loop's to bound
        self._heard_s = time.monotonic()
        return self._bounded(data)

    def _bounded(self, data: bytes) -> bytes:
        """b"" where it is too long: the kernel has cut it there, and nothing of it is read."""
        if len(data) <= self._most:
            return data
        self.errors += 1
        return b""

    def send(self, data: bytes) -> None:
        """To the other end, if there is one; what the kernel does not take is dropped and counted."""
        try:
            if self._connected:
                self._sock.send(data)
            elif self._other_end is not None:
                self._sock.sendto(data, self._other_end)
        except OSError:
            self.errors += 1

    def close(self) -> None:
        """For good."""
        self._sock.close()


class BroadcastLink:
    """Everybody on a mesh. Bound to the broadcast address: what is sent to this computer alone stays out."""

    __slots__ = ("_in", "_most", "_out", "_own", "errors")

    def __init__(self, url: Url, *, datagram_max_bytes: int = DATAGRAM_MAX_BYTES) -> None:
        self.errors = 0
        self._most = datagram_max_bytes
        self._in = _udp_socket(datagram_max_bytes)
        self._out = _udp_socket(datagram_max_bytes)  # its own port tells own datagrams from others'
        try:
            self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._in.bind((url.place, url.number))
            self._out.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            self._out.connect((url.place, url.number))
        except OSError as error:
            self.close()
            raise udp_refused(url, error) from None
        self._own = self._out.getsockname()

    @property
    def lost(self) -> int:
        """Of this socket's queue."""
        return dropped_of(self._in)

    @property
    def up(self) -> bool:
        """Always: a socket stays."""
        return True

    def fileno(self) -> int:
        """The socket that hears, to wait on."""
        return self._in.fileno()

    def recv(self) -> bytes | None:
        """The next datagram of another sender, b"" for one too long; None: nothing more now."""
        while True:
            try:
                data, sender = self._in.recvfrom(self._most + 1)
            except BlockingIOError:
                return None
            except OSError:
                self.errors += 1
                return None
            if sender == self._own:
                continue
            if len(data) <= self._most:
                return data
            self.errors += 1
            return b""

    def send(self, data: bytes) -> None:
        """To all on the mesh; what the kernel does not take is dropped and counted."""
        try:
            self._out.send(data)
        except OSError:
            self.errors += 1

    def close(self) -> None:
        """Both sockets, for good."""
        self._in.close()
        self._out.close()


class SerialLink:
    """A serial port; unplugged, it is opened again as soon as it is back.

    pyserial only opens and configures: its non-blocking `write` spins while the port's buffer is full.
    """

    __slots__ = ("_dtr", "_opening", "_port", "_rest", "_retry_s", "_url", "errors")

    def __init__(self, url: Url, *, may_be_absent: bool, dtr: bool = True) -> None:
        self.errors = 0
        self._url = url
        self._dtr = dtr
        self._rest = b""  # of a datagram that the port has taken only in part: a frame cut short spoils the next
        self._retry_s = 0.0
        self._port: serial.Serial | None = None
        self._opening: PortOpening | None = PortOpening(url, dtr=dtr)
        self._opening.wait(OPEN_S if may_be_absent else None)
        try:
            self._take_opened()
        except ERRORS as error:
            if not (may_be_absent and getattr(error, "errno", None) in ABSENT):
                raise _serial_refused(url, error) from None

    @property
    def lost(self) -> int:
        """0: what a port loses shows as bad frames."""
        return 0

    @property
    def up(self) -> bool:
        """False while the device is gone."""
        return self._port is not None

    def fileno(self) -> int:
        """The port, to wait on; -1 while the device is gone."""
        return -1 if self._port is None else self._port.fileno()

    def recv(self) -> bytes | None:
        """Bytes received; None: nothing more now. A device that is back is opened again."""
        if self._port is None:
            self._reopen()
        if self._port is None:
            return None
        try:
            data = os.read(self._port.fileno(), DATAGRAM_MAX_BYTES)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if not data:  # readable without data: it has been unplugged
            self._lost()
            return None
        return data

    def send(self, data: bytes) -> None:
        """As much as the port takes; the rest goes first next time, and until it has gone data is dropped."""
        if self._rest:
            self._rest = self._rest[self._write(self._rest) :]
        if self._rest or self._port is None:
            self.errors += 1
            return
        self._rest = data[self._write(data) :]

    def close(self) -> None:
        """For good."""
        if self._opening is not None:
            self._opening.give_up()
        self._opening = None
        self._close_port()

    def _close_port(self) -> None:
        if self._port is not None:
            self._port.close()
        self._port = None

    def _write(self, data: bytes) -> int:
        """Write what goes at once; the number of bytes."""
        if self._port is None:
            return 0
        try:
            return os.write(self._port.fileno(), data)
        except BlockingIOError:
            return 0
        except OSError:
            self._lost()
            return 0

    def _lost(self) -> None:
        self.errors += 1
        self._rest = b""
        self._close_port()

    def _reopen(self) -> None:
        """Begins to, and takes the port when it is open: no turn of the loop waits for a device."""
        now_s = time.monotonic()
        if self._opening is None and now_s >= self._retry_s:
            self._retry_s = now_s + REOPEN_S
            self._opening = PortOpening(self._url, dtr=self._dtr)
        with contextlib.suppress(*ERRORS):
            self._take_opened()

    def _take_opened(self) -> None:
        """One of ERRORS."""
        opening = self._opening
        if opening is not None and opening.is_done:
            self._opening, self._rest = None, b""
            self._port = opening.take_port()


def _udp_socket(datagram_max_bytes: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE_BYTES)
    drop_longer(sock, datagram_max_bytes)
    return sock


def resolved(url: Url) -> tuple[str, int]:
    """Names are looked up once, before the flight; for that, Python loads 1 MB of tables that an address needs not."""
    return (url.place if is_ipv4(url.place) else socket.gethostbyname(url.place), url.number)


def udp_refused(url: Url, error: OSError) -> LinkError:
    """Error that says why `url` cannot be opened, and what to do."""
    match error.errno:
        case errno.EADDRINUSE:
            who = f"ss -ulpn 'sport = :{url.number}'"
            fix = f"the port is taken: end the program that has it ({who} names it), or choose another"
        case errno.EADDRNOTAVAIL:
            fix = "no interface of this computer has that address (ip address lists them)"
        case errno.EACCES if url.scheme is Scheme.UDP_OUT:
            fix = "that is a broadcast address: use udpbcast://"
        case errno.EACCES:
            fix = "no permission: ports below 1024 are root's, choose a higher one"
        case errno.ENETUNREACH | errno.EHOSTUNREACH:
            fix = "no interface reaches it: is the network up?"
        case _ if isinstance(error, socket.gaierror):
            fix = "no such host: check the name, or give its IPv4 address"
        case _:
            fix = f"cannot be opened: {error.strerror or error}"
    return LinkError(f"{url}: {fix}")


def _serial_refused(url: Url, error: Exception) -> LinkError:
    match getattr(error, "errno", None):
        case number if number in ABSENT:
            fix = "no such device: is it plugged in? (ls /dev/tty* /dev/serial/by-id lists them)"
        case errno.EACCES | errno.EPERM:
            fix = 'no permission: join the group that owns it (sudo usermod -aG dialout "$USER"), and log in again'
        case errno.EAGAIN | errno.EBUSY:
            fix = "another program has it open (fuser -v names it): end that program"
        case _:
            fix = f"cannot be opened as a serial port: {error}"
    return LinkError(f"{url}: {fix}")
