"""SWARM_BEACON by hand: a vehicle decodes one from each neighbour each period. Held equal to pymavlink's by a test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from fastcrc.crc16 import mcrf4xx

from companion.mavlink import dialect
from companion.mavlink.framing import BAD_STARTS_MAX, MAGIC_V2

MESSAGE_ID = dialect.MAVLINK_MSG_ID_SWARM_BEACON
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
_PAYLOAD = dialect.MAVLink_swarm_beacon_message.unpacker
_FIELDS = dialect.MAVLink_swarm_beacon_message.ordered_fieldnames
_CRC_EXTRA = bytes([dialect.MAVLink_swarm_beacon_message.crc_extra])
_ID_BYTES = MESSAGE_ID.to_bytes(3, "little")
_HEADER_BYTES, _CRC_BYTES = 10, 2
_MEMBERS_BYTES = 96
_MEMBERS_AT = _PAYLOAD.size - _MEMBERS_BYTES


class WireBeacon(NamedTuple):
    """The fields as they are on the wire, in wire order; units as in swarm.xml."""

    time_boot_ms: int
    lat: int
    lon: int
    alt: int
    vx: float
    vy: float
    vz: float
    ref_vx: float
    ref_vy: float
    ref_vz: float
    dest_x: float
    dest_y: float
    dest_z: float
    route_cost: float
    governor: float
    leader_seq: int
    leader_ends: int
    seen_x: float
    seen_y: float
    seen_z: float
    range_dm: int
    seen_age: int
    leader: int
    leader_priority: int
    leader_score: int
    heir: int
    hop: int
    candidate: int
    candidate_priority: int
    candidate_score: int
    parent: int
    phase: int
    flags: int
    flight_state: int
    seen: int
    members: bytes  # 96: three sets of 256 bits, see `members` and `sets`

    @property
    def acting_leader(self) -> int:
        """The established leader, else 0."""
        return self.leader if self.flags & dialect.SWARM_BEACON_FLAGS_ESTABLISHED else 0


assert WireBeacon._fields == tuple(_FIELDS)


def beacons(data: bytes) -> Iterator[tuple[int, bytes, WireBeacon]]:
    """(sender's system id, frame, fields) of each valid SWARM_BEACON of a companion in a datagram.

    Nothing else is believed, its claimed length least of all: a stray start byte costs nobody behind it, until there
    are too many for a tick's time.
    """
    at = bad = 0
    while bad < BAD_STARTS_MAX and (at := data.find(MAGIC_V2, at)) >= 0:
        end = at + _HEADER_BYTES + _CRC_BYTES + (data[at + 1] if at + 1 < len(data) else 0)
        frame = data[at:end]
        wire = unpack(frame)
        if wire is None:
            at += 1
            bad += 1
            continue
        if frame[6] == COMPONENT:
            yield frame[5], frame, wire
        at = end


def unpack(frame: bytes) -> WireBeacon | None:
    """A whole, unsigned SWARM_BEACON frame -> its fields; None when it is none, or its checksum is wrong."""
    if len(frame) < _HEADER_BYTES or frame[7:10] != _ID_BYTES or frame[2]:
        return None
    length = frame[1]
    end = _HEADER_BYTES + length
    if length > _PAYLOAD.size or len(frame) != end + _CRC_BYTES:
        return None
    if mcrf4xx(frame[1:end] + _CRC_EXTRA) != frame[end] | frame[end + 1] << 8:
        return None
    payload = frame[_HEADER_BYTES:end].ljust(_PAYLOAD.size, b"\0")  # MAVLink 2 cuts trailing zeros off
    numbers = _PAYLOAD.unpack(payload)[:-_MEMBERS_BYTES]
    return WireBeacon._make((*numbers, payload[_MEMBERS_AT:]))


def members(done: int, present: int, flown: int) -> bytes:
    """Three sets, interleaved: of a small swarm they are a few bytes, as MAVLink 2 cuts trailing zeros off."""
    data = bytearray(_MEMBERS_BYTES)
    for at, bits in enumerate((done, present, flown)):
        data[at::3] = bits.to_bytes(_MEMBERS_BYTES // 3, "little")
    return bytes(data)


def sets(data: bytes) -> tuple[int, int, int]:
    """`members` back to (done, present, flown)."""
    return (
        int.from_bytes(data[0::3], "little"),
        int.from_bytes(data[1::3], "little"),
        int.from_bytes(data[2::3], "little"),
    )
