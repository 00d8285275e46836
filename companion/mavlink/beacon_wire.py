"""SWARM_BEACON by hand: the one message of which a vehicle decodes dozens a tick. Held equal to pymavlink's by a test."""

from __future__ import annotations

from typing import NamedTuple

from companion.mavlink import dialect
from companion.mavlink.framing import MAGIC_V2

MESSAGE_ID = dialect.MAVLINK_MSG_ID_SWARM_BEACON
_PAYLOAD = dialect.MAVLink_swarm_beacon_message.unpacker
_FIELDS = dialect.MAVLink_swarm_beacon_message.ordered_fieldnames
_CRC_EXTRA = bytes([dialect.MAVLink_swarm_beacon_message.crc_extra])
_HEADER_BYTES, _CRC_BYTES = 10, 2
_DONE_BYTES = 32
_DONE_AT = _PAYLOAD.size - _DONE_BYTES


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
    range_dm: int
    leader: int
    leader_priority: int
    leader_score: int
    hop: int
    parent: int
    phase: int
    flags: int
    flight_state: int
    done: int  # 256 bits, little-endian

    @property
    def acting_leader(self) -> int:
        """The established leader, else 0."""
        return self.leader if self.flags & dialect.SWARM_BEACON_FLAGS_ESTABLISHED else 0


assert WireBeacon._fields == tuple(_FIELDS)


def unpack(frame: bytes) -> WireBeacon | None:
    """A whole SWARM_BEACON frame -> its fields; None when length or checksum are wrong."""
    length = frame[1]
    end = _HEADER_BYTES + length
    if frame[0] != MAGIC_V2 or length > _PAYLOAD.size or len(frame) < end + _CRC_BYTES:
        return None
    if dialect.x25crc(frame[1:end] + _CRC_EXTRA).crc != frame[end] | frame[end + 1] << 8:
        return None
    payload = frame[_HEADER_BYTES:end].ljust(_PAYLOAD.size, b"\0")  # MAVLink 2 cuts trailing zeros off
    numbers = _PAYLOAD.unpack(payload)[:-_DONE_BYTES]
    return WireBeacon._make((*numbers, int.from_bytes(payload[_DONE_AT:], "little")))
