"""Finds MAVLink frames in bytes, of datagrams and of byte streams.

Bytes from outside never raise: what is no frame is counted and dropped. `find_frame` and `frames` believe the length
that a frame claims, which is enough to pass bytes on; `Framing` and `beacon.beacons` hand on only what its checksum
holds for.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect
from companion.mavlink.framing import wire

MAGIC_V1: Final = 0xFE  # as numbers, and not by the dialect's names: asked for at every frame, in every tick
MAGIC_V2: Final = 0xFD
_START_V1: Final = bytes([MAGIC_V1])
_START_V2: Final = bytes([MAGIC_V2])
SIGNED: Final = 0x01
SIGNATURE_BYTES: Final = 13
DATAGRAM_MAX_BYTES: Final = 4096  # that a companion reads: senders keep to an Ethernet frame, and 64 KiB cost 70 ms
BAD_STARTS_MAX: Final = 32  # of one datagram, or one read of a stream; the rest is not worth the time of a tick


def find_frame(data: bytes, at: int = 0) -> tuple[int, int, int]:
    """(start, end, message id) of the next possible frame from `at` on.

    `start` is the length of the data where there is none. `end` is past the data where the frame is not all there, and
    the id then -1 where not even the header is.
    """
    size = len(data)
    at = _find_start(data, at)
    if at == size:
        return size, size, -1
    if data[at] == MAGIC_V2:
        if at + 10 > size:
            return at, size + 1, -1
        end = at + 12 + data[at + 1] + (SIGNATURE_BYTES if data[at + 2] & SIGNED else 0)
        return at, end, data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    if at + 6 > size:
        return at, size + 1, -1
    return at, at + 8 + data[at + 1], data[at + 5]


def _find_start(data: bytes, at: int) -> int:
    """The next start byte from `at` on, or the data's length. Nearly always the first; garbage is not looped over."""
    size = len(data)
    if at >= size or data[at] == MAGIC_V2 or data[at] == MAGIC_V1:
        return min(at, size)
    v2 = data.find(_START_V2, at)
    v1 = data.find(_START_V1, at, size if v2 < 0 else v2)
    if v1 >= 0:
        return v1
    return size if v2 < 0 else v2


def payload_of(frame: bytes, id_bytes: bytes, crc_extra: bytes, size: int) -> bytes | None:
    """A whole MAVLink 2 frame -> its message's payload of `size` bytes, with the trailing zeros that the wire cuts off.

    A signature is not read. None when it is another message (`id_bytes`: three, as on the wire), or its checksum wrong.
    """
    if len(frame) < wire.HEADER_BYTES or frame[7:10] != id_bytes or frame[2] & ~SIGNED:
        return None
    end = wire.HEADER_BYTES + frame[1]
    behind = wire.CRC_BYTES + (SIGNATURE_BYTES if frame[2] else 0)
    if frame[1] > size or len(frame) != end + behind:
        return None
    if mcrf4xx(frame[1:end] + crc_extra) != frame[end] | frame[end + 1] << 8:
        return None
    return frame[wire.HEADER_BYTES : end].ljust(size, b"\0")


def frames(data: bytes, at: int = 0) -> list[tuple[int, int, int]]:
    """(start, end, message id) of each possible frame from `at` on; the last may not be all there: see `find_frame`."""
    found: list[tuple[int, int, int]] = []
    while at < len(data):
        start, at, message_id = find_frame(data, at)
        if start < len(data):
            found.append((start, at, message_id))
    return found


def whole(data: bytes) -> list[tuple[int, int, int]]:
    """As `frames`, without what is not all there."""
    found = frames(data)
    if found and found[-1][1] > len(data):
        found.pop()
    return found


def source(data: bytes, start: int = 0) -> tuple[int, int]:
    """System and component that the frame at `start` says it is from; its header must be there."""
    at = start + (5 if data[start] == MAGIC_V2 else 3)
    return data[at], data[at + 1]


@dataclass(slots=True, init=False, unsafe_hash=True)
class Incoming:
    """A valid message, which vehicle and component sent it, and the frame as it came."""

    message: Final[Any]  # its fields as attributes, by their MAVLink names and in their MAVLink units
    message_id: Final[int]
    system: Final[int]
    component: Final[int]
    frame: Final[bytes]

    def __init__(self, message: Any, message_id: int, system: int, component: int, frame: bytes) -> None:
        self.message = message
        self.message_id = message_id
        self.system = system
        self.component = component
        self.frame = frame


class Framing:
    """Reads one link. `is_stream`: bytes may break anywhere (serial); else every datagram stands alone."""

    __slots__ = ("_stream", "_tail", "_wanted", "bad", "garbage_bytes", "passed_over")

    def __init__(self, wanted: Container[int] | None = None, *, is_stream: bool = False) -> None:
        """`wanted`: message ids to read; all of the dialect's by default."""
        self._wanted: Container[int] = dialect.mavlink_map if wanted is None else wanted
        self._stream = is_stream
        self._tail = b""
        self.bad = 0  # frames that were not whole or not valid
        self.passed_over = 0  # frames of messages that are not wanted: not checked
        self.garbage_bytes = 0  # in no frame

    def parse(self, data: bytes) -> list[Any]:
        """The valid, wanted messages in `data`, in order, as pymavlink's objects."""
        return [wire.decode(incoming.frame) for incoming in self.read_messages(data)]

    def read_messages(self, data: bytes) -> list[Incoming]:
        """The valid, wanted messages in `data`, in order."""
        if self._tail:
            data, self._tail = self._tail + data, b""
        found: list[Incoming] = []
        size = len(data)
        at = in_frames = bad = 0
        while at < size and bad < BAD_STARTS_MAX:
            start, end, message_id = find_frame(data, at)
            at = start + 1  # a start byte that proves bad must not swallow the message behind it
            if end > size:
                if self._stream:
                    self._tail = data[start:]  # at most one frame: 280 bytes
                    break
                bad += 1
            elif start == size:
                break
            elif message_id in self._wanted:
                frame = data[start:end]
                try:
                    message = wire.fields(frame)
                except dialect.MAVError:
                    bad += 1
                    continue
                system, component = source(frame)
                found.append(Incoming(message, message_id, system, component, frame))
                in_frames += end - start
                at = end
            elif end == size or self._goes_on(data, end):
                self.passed_over += 1
                in_frames += end - start
                at = end
            else:
                bad += 1
        self.bad += bad
        self.garbage_bytes += size - len(self._tail) - in_frames
        return found

    def _goes_on(self, data: bytes, at: int) -> bool:
        """Another frame may start here: else the length of the one before it is not to be believed."""
        if data[at] not in (MAGIC_V1, MAGIC_V2):
            return False
        return self._stream or find_frame(data, at)[1] <= len(data)
