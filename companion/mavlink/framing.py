"""Bytes -> messages, for datagrams and byte streams. Bytes from outside never raise: they are counted and dropped."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

from companion.mavlink import dialect, wire

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
SIGNED = 0x01  # incompatibility flag
SIGNATURE_BYTES = 13
BAD_STARTS_MAX = 32  # of one datagram, or one read of a stream; the rest is not worth the time of a tick


def frames(data: bytes, at: int = 0) -> Iterator[tuple[int, int, int]]:
    """(start, end, message id) of each possible MAVLink frame; `end` past the data: the frame is not all there."""
    size = len(data)
    while at < size:
        magic = data[at]
        if magic == MAGIC_V2 and at + 10 <= size:
            end = at + 12 + data[at + 1] + (SIGNATURE_BYTES if data[at + 2] & SIGNED else 0)
            yield at, end, data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        elif magic == MAGIC_V1 and at + 6 <= size:
            end = at + 8 + data[at + 1]
            yield at, end, data[at + 5]
        elif magic in (MAGIC_V1, MAGIC_V2):
            yield at, size + 1, -1
            return
        else:
            at += 1
            continue
        at = end


class Framing:
    """Parses one link. `is_stream`: bytes may break anywhere (serial); else every datagram stands alone."""

    __slots__ = ("_stream", "_tail", "_wanted", "bad")

    def __init__(self, wanted: Container[int] | None = None, *, is_stream: bool = False) -> None:
        """`wanted`: message ids to decode; all of the dialect's by default."""
        self._wanted: Container[int] = dialect.mavlink_map if wanted is None else wanted
        self._stream = is_stream
        self._tail = b""
        self.bad = 0  # frames that were not whole or not valid

    def parse(self, data: bytes) -> list[Any]:
        """The valid, wanted messages in `data`, in order."""
        data = self._tail + data
        self._tail = b""
        found: list[Any] = []
        start, bad_before = 0, self.bad
        while start < len(data) and self.bad - bad_before < BAD_STARTS_MAX:
            start = self._parse_from(data, start, found)
        return found

    def _parse_from(self, data: bytes, at: int, found: list[Any]) -> int:
        """Parse until a frame proves bad; where to go on."""
        for start, end, message_id in frames(data, at):
            if end > len(data):
                if self._stream:
                    self._tail = data[start:]  # at most one frame: 280 bytes
                    return len(data)
                self.bad += 1
                return start + 1
            if message_id not in self._wanted:
                if end == len(data) or data[end] in (MAGIC_V1, MAGIC_V2):
                    continue
                # Its length is not to be believed: another frame should follow.
                self.bad += 1
                return start + 1
            try:
                found.append(wire.decode(data[start:end]))
            except dialect.MAVError:
                # A stray start byte must not swallow the message behind it.
                self.bad += 1
                return start + 1
        return len(data)
