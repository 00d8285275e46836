"""One MAVLink channel of any autopilot: frames out of datagrams, messages into datagrams."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from companion.mavlink import dialect as mav
from companion.mavlink.autopilot_link.signing import LinkSigning
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import Framing, Incoming

AUTOPILOT_COMPONENT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
NO_TARGET: Final = 0  # system or component 0: broadcast
DATAGRAM_MAX_BYTES: Final = 1280  # fits every path's MTU
QUEUE_MAX_FRAMES: Final = 512  # answers waiting on a link that is not drained; the oldest go first
_HAS_SYSTEM = frozenset(i for i, m in mav.mavlink_map.items() if "target_system" in m.fieldnames)
_HAS_COMPONENT = frozenset(i for i, m in mav.mavlink_map.items() if "target_component" in m.fieldnames)


class Link(StrEnum):
    """Address that a datagram comes from or goes to."""

    ONBOARD = "onboard"  # the companion; PX4's 14540 side
    GROUND = "ground"  # ground stations; the 14550 side


@dataclass(slots=True)
class LinkCounts:
    """Counters of a link, since boot."""

    frames: int = 0  # valid, of a message that the dialect knows
    unknown: int = 0  # whole frames of a message that it does not know (unverifiable, dropped)
    garbage_bytes: int = 0  # neither


@dataclass(slots=True, init=False, unsafe_hash=True)
class Packed:
    """A message without an object of its own, for those that are sent at every tick."""

    message_id: Final[int]
    payload: Final[bytes]  # its fields in the wire's order

    def __init__(self, message_id: int, payload: bytes) -> None:
        self.message_id = message_id
        self.payload = payload


class Port:
    """One channel: its sequence number, its queue and its counts."""

    def __init__(self, system: int, component: int = AUTOPILOT_COMPONENT) -> None:
        self.counts = LinkCounts()
        self.signing: LinkSigning | None = None  # as real ones do, with a clock that the other end's frames push on
        self._framing = Framing()
        self._sender = wire.Sender(system, component)
        self._queue: deque[bytes] = deque(maxlen=QUEUE_MAX_FRAMES)

    def pack(self, message: Any) -> bytes:
        """The frame of `message` (pymavlink's, or Packed), with this channel's next sequence number."""
        if isinstance(message, Packed):
            frame = self._sender.frame(message.message_id, message.payload)
        else:
            frame = self._sender.pack(message)
        return frame if self.signing is None else self.signing.seal(frame, 0.0)

    def send(self, message: Any) -> None:
        """Queue `message` for the next `drain`."""
        self._queue.append(self.pack(message))

    def forward(self, frame: bytes) -> None:
        """Queue another sender's frame as it is."""
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

    def parse_datagram(self, datagram: bytes) -> list[Incoming]:
        """The valid messages of one datagram; nothing is carried over to the next, and nothing raises."""
        found = self._framing.read_messages(datagram)
        self.counts.frames += len(found)
        self.counts.unknown = self._framing.passed_over
        self.counts.garbage_bytes = self._framing.garbage_bytes
        signing = self.signing
        return found if signing is None else [incoming for incoming in found if signing.admits(incoming.frame)]


def target_of(incoming: Incoming) -> tuple[int, int]:
    """System and component that a message is for; 0: broadcast."""
    message, message_id = incoming.message, incoming.message_id
    return (
        message.target_system if message_id in _HAS_SYSTEM else NO_TARGET,
        message.target_component if message_id in _HAS_COMPONENT else NO_TARGET,
    )


def checked_sysid(sysid: int) -> int:
    """`sysid`; ValueError when it is not one of a vehicle."""
    if not 1 <= sysid <= 255:
        raise ValueError(f"sysid = {sysid}: must be 1..255")
    return sysid
