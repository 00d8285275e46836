"""SWARM_BEACON: found in datagrams, its checksum held, read once for all receivers of one process.

A vehicle decodes one beacon from each neighbour each period, so this is done without pymavlink's objects; tests hold
the bytes equal to pymavlink's. Its fields are rows of companion/mavlink/schema, of which `own_messages` is generated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

from companion.core.model.beacon import Beacon
from companion.mavlink import dialect, own_messages
from companion.mavlink.framing.frames import BAD_STARTS_MAX, find_frame, payload_of, source
from companion.mavlink.own_messages import BEACON_PAYLOAD, WireBeacon, decode_beacon, encode_beacon, unpack_beacon
from mission.common.frames import LocalFrame, Vec3, Wgs84

VERSION: Final = own_messages.VERSION
MESSAGE_ID = dialect.MAVLINK_MSG_ID_SWARM_BEACON
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
NOWHERE_DEG: Final = (2**31 - 1) / 1e7  # latitude and longitude that are not broadcast: INT32_MAX on the wire

Read = TypeVar("Read")
_CRC_EXTRA = bytes([dialect.MAVLink_swarm_beacon_message.crc_extra])
_ID_BYTES = MESSAGE_ID.to_bytes(3, "little")

__all__ = [
    "COMPONENT",
    "MESSAGE_ID",
    "NOWHERE_DEG",
    "REFUSED",
    "VERSION",
    "Decoded",
    "Reader",
    "WireBeacon",
    "beacons",
    "decode",
    "encode",
    "read_each",
    "unpack",
]


def encode(beacon: Beacon, here: Wgs84) -> bytes:
    """The payload of SWARM_BEACON, with its trailing zeros, of a sender at `here` (level: NOWHERE_DEG, not broadcast).

    struct.error when a number does not fit its field: the core keeps them in bounds.
    """
    return encode_beacon(beacon, here)


def beacons(data: bytes, beside: Callable[[bytes], bool] | None = None) -> list[tuple[int, bytes, WireBeacon]]:
    """(sender's system id, frame, fields) of each SWARM_BEACON of a companion in a datagram, of whatever version.

    Only a beacon whose checksum holds is taken, and the length that anything else claims is not used: a stray start
    byte does not hide the beacon behind it. After BAD_STARTS_MAX of them the rest of the datagram is dropped.
    """
    return read_each(data, unpack, beside)


def read_each(
    data: bytes, decode_frame: Callable[[bytes], Read | None], beside: Callable[[bytes], bool] | None = None
) -> list[tuple[int, bytes, Read]]:
    """As `beacons`, with what `decode_frame` makes of a frame instead of its fields: None of what is no beacon.

    `beside` is asked about each other frame: True takes it, as a valid one.
    """
    each: list[tuple[int, bytes, Read]] = []
    at = bad = 0
    while bad < BAD_STARTS_MAX:
        start, end, message_id = find_frame(data, at)
        if start == len(data):
            break
        frame = data[start:end]
        found = decode_frame(frame) if message_id == MESSAGE_ID else None
        if found is None:
            if beside is not None and end <= len(data) and message_id != MESSAGE_ID and beside(frame):
                at = end
                continue
            at = start + 1
            bad += 1
            continue
        at = end
        sender, component = source(frame)
        if component == COMPONENT:
            each.append((sender, frame, found))
    return each


class Decoded(NamedTuple):
    """A decoded beacon, the same for every receiver."""

    version: int
    said: Beacon | None  # None: a field is outside its bounds, as another version is
    pos_ned_m: Vec3  # the sender's, in the mission's frame
    is_vouched: bool = True  # False: its sender does not vouch for what it sends


REFUSED: Final = Decoded(0, None, (0.0, 0.0, 0.0))  # in the place of a beacon that did not pass


class Reader:
    """Reads beacons for the receivers of one mission, for `read_each`.

    Receivers in one process may share a reader that remembers: a frame that reaches many of them is decoded once.
    """

    __slots__ = ("_frame", "_known", "_remembers")

    def __init__(self, frame: LocalFrame, *, remembers: int = 0) -> None:
        """`remembers`: that many frames at most."""
        self._frame = frame
        self._remembers = remembers
        self._known: dict[bytes, Decoded] = {}

    def decode_frame(self, frame: bytes, passes: Callable[[bytes], bool] | None = None) -> Decoded | None:
        """A whole SWARM_BEACON frame -> what it says; None as `unpack`.

        `passes`: asked about a valid frame before it is decoded, which costs most of all; False: REFUSED.
        """
        known = self._known.get(frame) if self._remembers else None
        payload = None if known is not None else _payload(frame)
        if known is None and payload is None:
            return None
        if passes is not None and not passes(frame):
            return REFUSED
        if payload is None:
            return known
        decoded = decode(frame[5], unpack_beacon(payload), self._frame)
        if self._remembers:
            if len(self._known) >= self._remembers:
                self._known.clear()
            self._known[frame] = decoded
        return decoded


def unpack(frame: bytes) -> WireBeacon | None:
    """A whole SWARM_BEACON frame -> its fields, a signature unread; None when it is none, or its checksum is wrong."""
    payload = _payload(frame)
    return None if payload is None else unpack_beacon(payload)


def _payload(frame: bytes) -> bytes | None:
    return payload_of(frame, _ID_BYTES, _CRC_EXTRA, BEACON_PAYLOAD.size)


def decode(sender: int, fields: WireBeacon, frame: LocalFrame) -> Decoded:
    """Fields -> what they say; `sender`: system id, `frame`: the mission's."""
    return Decoded(fields.version, decode_beacon(sender, fields), frame.to_ned(own_messages.here_of(fields)))
