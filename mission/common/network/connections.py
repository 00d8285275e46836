"""Bounds of a server that strangers reach: how many connections, how slowly one may ask, how slowly take an answer.

Nothing here reads a clock: times are arguments, s, of one monotonic clock.
"""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

HEAD_MAX_BYTES: Final = 8192  # of a request's line and headers: what other servers take
CONNECTIONS_MAX: Final = 64
OF_ADDRESS_MAX: Final = 16  # a browser opens six to a server
SEND_BUFFER_BYTES: Final = 1 << 16  # asked of the kernel, which doubles it: all that waits for a slow reader
CHUNK_BYTES: Final = 1 << 16
AGAIN_S: Final = 10.0  # between two lines that say the same
LINES_MAX: Final = 64  # of which it is remembered when they were said

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Patience:
    """Time that clients are given."""

    head_s: float = 5.0  # for a whole request, from its connection on
    answer_s: float = 10.0  # for an answer to be taken,
    rate_bytes_s: float = 1 << 15  # and a second more for so many bytes: a poor mesh carries ten times that


class TooSlowError(Exception):
    """A client did not ask, or did not take, in time, or asks for too much; the message says which."""


def read_head(read: Callable[[float], bytes], clock: Callable[[], float], until_s: float) -> tuple[bytes, bytes]:
    """A request up to its empty line, and what came behind it. `read`: what comes within so many seconds; b"": the
    other end has gone.

    TooSlowError at `until_s`, however many bytes drip in until then, and for a head beyond HEAD_MAX_BYTES.
    """
    head = b""
    while True:
        left_s = until_s - clock()
        if left_s <= 0.0:
            raise TooSlowError(f"no whole request in time ({len(head)} bytes)")
        try:
            data = read(left_s)
        except TimeoutError:
            continue
        if not data:
            return head, b""
        head += data
        ends = [at + len(empty) for empty in (b"\r\n\r\n", b"\n\n") if (at := head.find(empty)) >= 0]
        if ends:
            return head[: min(ends)], head[min(ends) :]
        if len(head) > HEAD_MAX_BYTES:
            raise TooSlowError(f"request: more than {HEAD_MAX_BYTES} bytes of headers")


def read_body(
    read: Callable[[float], bytes], come: bytes, length: int, clock: Callable[[], float], until_s: float
) -> bytes:
    """The `length` bytes behind a head, of which `come` came with it. `read`, `until_s`: as of `read_head`; the caller
    bounds `length`. TooSlowError; ConnectionError when the other end goes before."""
    while len(come) < length:
        left_s = until_s - clock()
        if left_s <= 0.0:
            raise TooSlowError(f"no whole request in time ({len(come)} of {length} bytes of its body)")
        try:
            data = read(left_s)
        except TimeoutError:
            continue
        if not data:
            raise ConnectionError(f"gone after {len(come)} of {length} bytes")
        come += data
    return come[:length]


def send_within(connection: socket.socket, data: bytes, clock: Callable[[], float], patience: Patience) -> None:
    """All of `data`. TooSlowError once it takes too long as a whole, however little is taken in between; OSError."""
    until_s = clock() + patience.answer_s + len(data) / patience.rate_bytes_s
    rest = memoryview(data)
    while rest:
        left_s = until_s - clock()
        if left_s <= 0.0:
            raise TooSlowError(f"answer: taken too slowly ({len(rest)} of {len(data)} bytes left)")
        connection.settimeout(left_s)
        try:
            rest = rest[connection.send(rest[:CHUNK_BYTES]) :]
        except TimeoutError:
            continue


class Connections(Generic[Key]):
    """Table of those that are open, oldest first, and of which still ask.

    Where there is no room, the oldest that still asks makes it: who has asked is answered, and who only holds a
    connection open keeps nobody out.
    """

    def __init__(self, most: int = CONNECTIONS_MAX, of_address: int = OF_ADDRESS_MAX) -> None:
        self._most, self._of_address = most, of_address
        self._address: dict[Key, str] = {}
        self._asking: dict[Key, None] = {}

    def __len__(self) -> int:
        return len(self._address)

    def admit(self, connection: Key, address: str) -> tuple[bool, Key | None]:
        """True: it is let in; and the connection that goes for it, if any. False: it is turned away."""
        counts = Counter(self._address.values())
        goes: Key | None = None
        if counts[address] >= self._of_address:
            goes = self._oldest_asking(address)
        elif len(self._address) >= self._most:
            goes = self._oldest_asking(counts.most_common(1)[0][0]) or self._oldest_asking(None)
        else:
            self._address[connection], self._asking[connection] = address, None
            return True, None
        if goes is None:
            return False, None
        self.remove(goes)
        self._address[connection], self._asking[connection] = address, None
        return True, goes

    def mark_asked(self, connection: Key) -> None:
        """Its request is whole."""
        self._asking.pop(connection, None)

    def remove(self, connection: Key) -> None:
        """It is closed."""
        self._address.pop(connection, None)
        self._asking.pop(connection, None)

    def _oldest_asking(self, address: str | None) -> Key | None:
        """Of one address; None: of any."""
        return next((one for one in self._asking if address in (None, self._address[one])), None)


class Notices:
    """Lines about clients, each at most once in AGAIN_S, however often it happens."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said_s: dict[str, float] = {}

    def note(self, address: str, what: str, now_s: float) -> None:
        """`what` with no number in it that changes from one to the next counts as the same line."""
        key = f"{address} {what.partition('(')[0]}"
        if now_s - self._said_s.get(key, float("-inf")) < AGAIN_S:
            return
        if len(self._said_s) >= LINES_MAX:
            del self._said_s[next(iter(self._said_s))]
        self._said_s.pop(key, None)
        self._said_s[key] = now_s
        self._say(f"{address}: {what}: dropped")
