"""SWARM_RELATIVE and SWARM_TRUNKS, of a GNSS-denied swarm: read from a frame whose checksum holds."""

from __future__ import annotations

from typing import Final

from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.mavlink import dialect
from companion.mavlink.framing.frames import payload_of
from companion.mavlink.own_messages import (
    RELATIVE_REPORT_PAYLOAD,
    TRUNK_REPORT_PAYLOAD,
    decode_relative_report,
    decode_trunk_report,
    unpack_relative_report,
    unpack_trunk_report,
)

RELATIVE_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_RELATIVE
TRUNKS_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_TRUNKS
_ID_BYTES: Final = RELATIVE_ID.to_bytes(3, "little")
_CRC_EXTRA = bytes([dialect.MAVLink_swarm_relative_message.crc_extra])
_TRUNKS_ID_BYTES: Final = TRUNKS_ID.to_bytes(3, "little")
_TRUNKS_CRC_EXTRA = bytes([dialect.MAVLink_swarm_trunks_message.crc_extra])


def is_relative_report(frame: bytes) -> bool:
    """A whole SWARM_RELATIVE frame whose checksum holds; nothing of it is read."""
    return payload_of(frame, _ID_BYTES, _CRC_EXTRA, RELATIVE_REPORT_PAYLOAD.size) is not None


def read_relative_report(frame: bytes) -> RelativeReport | None:
    """A whole SWARM_RELATIVE frame -> what it says, a signature unread; None: it is none, or not to be believed."""
    payload = payload_of(frame, _ID_BYTES, _CRC_EXTRA, RELATIVE_REPORT_PAYLOAD.size)
    return None if payload is None else decode_relative_report(frame[5], unpack_relative_report(payload))


def is_trunk_report(frame: bytes) -> bool:
    """The same of SWARM_TRUNKS, as `is_relative_report`."""
    return payload_of(frame, _TRUNKS_ID_BYTES, _TRUNKS_CRC_EXTRA, TRUNK_REPORT_PAYLOAD.size) is not None


def read_trunk_report(frame: bytes) -> TrunkReport | None:
    """The same of SWARM_TRUNKS, as `read_relative_report`."""
    payload = payload_of(frame, _TRUNKS_ID_BYTES, _TRUNKS_CRC_EXTRA, TRUNK_REPORT_PAYLOAD.size)
    return None if payload is None else decode_trunk_report(frame[5], unpack_trunk_report(payload))
