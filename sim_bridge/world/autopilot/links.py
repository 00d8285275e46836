"""One MAVLink channel of any autopilot: frames out of datagrams, messages into datagrams."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from companion.mavlink import dialect, wire

AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
DATAGRAM_MAX_BYTES = 1280  # fits every path's MTU
QUEUE_MAX_FRAMES = 512  # answers waiting on a link that nobody drains; the oldest go first

_MAGIC_V1, _MAGIC_V2 = dialect.PROTOCOL_MARKER_V1, dialect.PROTOCOL_MARKER_V2
_KNOWN_IDS = dialect.mavlink_map


class Link(StrEnum):
    """Where a datagram comes from or goes to."""

    ONBOARD = "onboard"  # the companion; PX4's 14540 side
    GROUND = "ground"  # ground stations; the 14550 side


@dataclass(slots=True)
class LinkCounts:
    """What a link has seen, since boot."""

    frames: int = 0  # valid, of a message that the dialect knows
    unknown: int = 0  # whole frames of a message that it does not know (unverifiable, dropped)
    garbage_bytes: int = 0  # neither


@dataclass(frozen=True, slots=True)
class Incoming:
    """A valid message, who sent it, and the frame as it came (for forwarding unmodified)."""

    message: Any
    message_id: int
    system: int
    component: int
    frame: bytes


class Port:
    """One channel: its sequence number, its queue and its counts."""

    def __init__(self, system: int, component: int = AUTOPILOT_COMPONENT) -> None:
        self.counts = LinkCounts()
        self._system, self._component = system, component
        self._seq = 0
        self._queue: deque[bytes] = deque(maxlen=QUEUE_MAX_FRAMES)

    def pack(self, message: Any) -> bytes:
        """The frame of `message`, with this channel's next sequence number."""
        frame = wire.pack(message, seq=self._seq, system=self._system, component=self._component)
        self._seq = (self._seq + 1) & 0xFF
        return frame

    def send(self, message: Any) -> None:
        """Queue `message` for the next `drain`."""
        self._queue.append(self.pack(message))

    def forward(self, frame: bytes) -> None:
        """Queue somebody else's frame as it is."""
        self._queue.append(frame)

    def drain(self) -> list[bytes]:
        """All that is queued, in order, as datagrams of whole frames."""
        queue = self._queue
        if not queue:
            return []
        datagrams: list[bytes] = []
        batch: list[bytes] = []
        size = 0
        for frame in queue:
            if size + len(frame) > DATAGRAM_MAX_BYTES:
                datagrams.append(b"".join(batch))
                batch, size = [], 0
            batch.append(frame)
            size += len(frame)
        datagrams.append(b"".join(batch))
        queue.clear()
        return datagrams

    def read(self, datagram: bytes) -> Iterator[Incoming]:
        """The valid messages of one datagram; nothing is carried over to the next, and nothing raises.

        A stray magic byte costs one byte, not the message behind it: a frame is taken only when its checksum
        holds. An unknown message cannot be verified: it is skipped whole only when nothing follows it, or
        what may be another frame.
        """
        at, end = 0, len(datagram)
        while at < end:
            size = _claimed_size(datagram, at)
            if not 0 < size <= end - at:
                self.counts.garbage_bytes += 1
                at += 1
                continue
            frame = datagram[at : at + size]
            v2 = frame[0] == _MAGIC_V2
            message_id = frame[7] | frame[8] << 8 | frame[9] << 16 if v2 else frame[5]
            if message_id not in _KNOWN_IDS:
                if at + size == end or _fits(datagram, at + size):
                    self.counts.unknown += 1
                    at += size
                else:
                    self.counts.garbage_bytes += 1
                    at += 1
                continue
            try:
                message = wire.decode(frame)
            except dialect.MAVError:
                self.counts.garbage_bytes += 1
                at += 1
                continue
            self.counts.frames += 1
            at += size
            system, component = (frame[5], frame[6]) if v2 else (frame[3], frame[4])
            yield Incoming(message, message_id, system, component, frame)


def _fits(data: bytes, at: int) -> bool:
    """True when what starts at `at` could be a frame that ends within the datagram."""
    size = _claimed_size(data, at)
    return 0 < size <= len(data) - at


def _claimed_size(data: bytes, at: int) -> int:
    """Bytes that the frame starting at `at` says it has; 0: no frame starts here."""
    if data[at] == _MAGIC_V2 and at + 3 <= len(data):
        signed = data[at + 2] & dialect.MAVLINK_IFLAG_SIGNED
        return 12 + int(data[at + 1]) + (dialect.MAVLINK_SIGNATURE_BLOCK_LEN if signed else 0)
    if data[at] == _MAGIC_V1 and at + 2 <= len(data):
        return 8 + int(data[at + 1])
    return 0
