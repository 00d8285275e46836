"""SWARM_SIGNED_RECORD and SWARM_BASE_VECTOR <-> their values. Bytes from outside never raise: what is wrong is None."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from typing import Final

from companion.keys.crypto import SIGNATURE_BYTES
from companion.mavlink import dialect
from companion.mavlink.framing.frames import payload_of
from companion.mavlink.schema.tables.signed_records import BASE_VECTOR, SIGNED_BODY_MAX, SIGNED_RECORD
from companion.records.frames import FULL, made_us_of, pack_entries, record_of, unpack_entries
from companion.records.record import Record, Vector

SIGNED_RECORD_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_SIGNED_RECORD
BASE_VECTOR_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_BASE_VECTOR
RECORD_HEAD: Final = Struct("<QIIBBB")
_RECORD: Final = Struct("<" + "".join(row.code for row in SIGNED_RECORD.on_wire))
_BASE_HEAD: Final = Struct("<QIIB")
_BASE: Final = Struct("<" + "".join(row.code for row in BASE_VECTOR.on_wire))
_RECORD_BYTES: Final = SIGNED_RECORD_ID.to_bytes(3, "little")
_BASE_BYTES: Final = BASE_VECTOR_ID.to_bytes(3, "little")
_RECORD_EXTRA: Final = bytes([dialect.MAVLink_swarm_signed_record_message.crc_extra])
_BASE_EXTRA: Final = bytes([dialect.MAVLink_swarm_base_vector_message.crc_extra])


@dataclass(frozen=True, slots=True)
class BaseVector:
    """A part of the base station's vector; as yet unchecked."""

    vector: Vector
    told: int  # counts its messages
    payload: bytes  # all of it, to be passed on

    @property
    def signed(self) -> bytes:
        """The bytes that are signed."""
        return self.payload[: _BASE_HEAD.size] + self.payload[_BASE_HEAD.size + SIGNATURE_BYTES :]

    @property
    def signature(self) -> bytes:
        """Of them."""
        return self.payload[_BASE_HEAD.size :][:SIGNATURE_BYTES]


def encode_signed_record(record: Record) -> bytes:
    """The payload of SWARM_SIGNED_RECORD, with its trailing zeros."""
    head = (made_us_of(record), record.log_id, record.number, record.vehicle_id, record.kind, len(record.body))
    return _RECORD.pack(*head, record.signature, record.body)


def read_signed_record(frame: bytes) -> Record | None:
    """A whole frame -> the record in it, as yet unchecked; None: it is none, or it makes no sense."""
    payload = payload_of(frame, _RECORD_BYTES, _RECORD_EXTRA, _RECORD.size)
    if payload is None:
        return None
    made_us, log_id, number, vehicle_id, kind, size, signature, body = _RECORD.unpack(payload)
    if size > SIGNED_BODY_MAX:
        return None
    return record_of(made_us, log_id, number, vehicle_id, kind, body[:size], signature)


def encode_base_vector(vector: Vector, told: int, sign: Callable[[bytes], bytes]) -> bytes:
    """The payload of SWARM_BASE_VECTOR, with its trailing zeros; of at most BASE_ENTRIES_MAX entries."""
    flags = FULL if vector.is_full else 0
    head = _BASE_HEAD.pack(told, vector.base_epoch, vector.mission_hash, flags)
    entries = pack_entries(vector.entries).ljust(_BASE.size - len(head) - SIGNATURE_BYTES, b"\0")
    return head + sign(head + entries) + entries


def read_base_vector(frame: bytes) -> BaseVector | None:
    """A whole frame -> what the base station is said to have; None as for `read_signed_record`."""
    payload = payload_of(frame, _BASE_BYTES, _BASE_EXTRA, _BASE.size)
    if payload is None:
        return None
    told, epoch, mission_hash, flags, _, packed = _BASE.unpack(payload)
    entries = unpack_entries(packed)
    if entries is None or epoch == 0:
        return None
    vector = Vector(epoch, 0, is_base=True, is_full=flags & FULL != 0, entries=entries, mission_hash=mission_hash)
    return BaseVector(vector, told, payload)
