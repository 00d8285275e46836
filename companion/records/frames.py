"""SWARM_RECORD_VECTOR and SWARM_RECORD <-> their values. Bytes from outside never raise: what is wrong is None."""

from __future__ import annotations

from collections.abc import Iterable
from struct import Struct
from typing import Final

from companion.mavlink import dialect
from companion.mavlink.framing.frames import payload_of
from companion.mavlink.schema.tables.measurements import ENTRIES_MAX, ENTRY_BYTES, RECORD, RECORD_VECTOR
from companion.records.record import BITMAP, BODY_MAX, NUMBER_MAX, Entry, LogKey, Record, RecordKind, Vector

VECTOR_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_RECORD_VECTOR
RECORD_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_RECORD
VEHICLE_MAX: Final = 250
HOPS_UNKNOWN: Final = 255
MADE_MAX_US: Final = 1 << 52  # 142 years, and to the microsecond in a float: later, it could not be passed on
_VECTOR: Final = Struct("<" + "".join(row.code for row in RECORD_VECTOR.on_wire))
_RECORD: Final = Struct("<" + "".join(row.code for row in RECORD.on_wire))
_ENTRY: Final = Struct("<BI3s3s3s3sI")
_VECTOR_BYTES: Final = VECTOR_ID.to_bytes(3, "little")
_RECORD_BYTES: Final = RECORD_ID.to_bytes(3, "little")
_VECTOR_EXTRA: Final = bytes([dialect.MAVLink_swarm_record_vector_message.crc_extra])
_RECORD_EXTRA: Final = bytes([dialect.MAVLink_swarm_record_message.crc_extra])
_BASE: Final = 1
FULL: Final = 2  # of a vector's flags
_IDS: Final = frozenset(
    {
        *(_VECTOR_BYTES, _RECORD_BYTES),
        dialect.MAVLINK_MSG_ID_SWARM_SIGNED_RECORD.to_bytes(3, "little"),
        dialect.MAVLINK_MSG_ID_SWARM_BASE_VECTOR.to_bytes(3, "little"),
    }
)
assert _ENTRY.size == ENTRY_BYTES


def encode_record(record: Record) -> bytes:
    """The payload of SWARM_RECORD, with its trailing zeros. struct.error when a number does not fit its field.

    A time that no record has, as an older version may have stored it, is the nearest that one can have.
    """
    head = (made_us_of(record), record.log_id, record.number, record.vehicle_id, record.kind, len(record.body))
    return _RECORD.pack(*head, record.body)


def made_us_of(record: Record) -> int:
    """Time at which it was made, us, as it is sent."""
    return min(MADE_MAX_US, max(0, round(record.made_s * 1e6)))


def encode_vector(vector: Vector) -> bytes:
    """The payload of SWARM_RECORD_VECTOR, with its trailing zeros; of at most ENTRIES_MAX entries."""
    flags = (_BASE if vector.is_base else 0) | (FULL if vector.is_full else 0)
    entries = pack_entries(vector.entries[:ENTRIES_MAX])
    return _VECTOR.pack(vector.base_epoch, vector.mission_hash, vector.hops, flags, entries)


def pack_entries(entries: Iterable[Entry]) -> bytes:
    """Of a vector, as they are sent."""
    return b"".join(
        _ENTRY.pack(*entry.key, *map(_three_bytes, (entry.upto, entry.window, entry.last, entry.acked)), entry.bits)
        for entry in entries
    )


def is_record_frame(frame: bytes) -> bool:
    """A whole MAVLink 2 frame of one of the messages of records, signed ones among them, by its header alone."""
    return frame[7:10] in _IDS


def read_record(frame: bytes) -> Record | None:
    """A whole frame -> the record in it; None: it is none, its checksum is wrong, or it makes no sense."""
    payload = payload_of(frame, _RECORD_BYTES, _RECORD_EXTRA, _RECORD.size)
    if payload is None:
        return None
    made_us, log_id, number, vehicle_id, kind, size, body = _RECORD.unpack(payload)
    return None if size > BODY_MAX else record_of(made_us, log_id, number, vehicle_id, kind, body[:size])


def record_of(
    made_us: int, log_id: int, number: int, vehicle_id: int, kind: int, body: bytes, signature: bytes = b""
) -> Record | None:
    """Of the fields as they are sent; None: they make no sense."""
    if not (1 <= vehicle_id <= VEHICLE_MAX and 1 <= number <= NUMBER_MAX) or made_us > MADE_MAX_US:
        return None
    if kind not in RecordKind._value2member_map_:
        return None
    return Record(vehicle_id, log_id, number, RecordKind(kind), made_us / 1e6, body, signature)


def read_vector(frame: bytes) -> Vector | None:
    """A whole frame -> the part of a vector in it; None as for `read_record`."""
    payload = payload_of(frame, _VECTOR_BYTES, _VECTOR_EXTRA, _VECTOR.size)
    if payload is None:
        return None
    epoch, mission_hash, hops, flags, packed = _VECTOR.unpack(payload)
    entries = unpack_entries(packed)
    if entries is None:
        return None
    return Vector(epoch, hops, flags & _BASE != 0, flags & FULL != 0, entries, mission_hash)


def unpack_entries(packed: bytes) -> tuple[Entry, ...] | None:
    """As they are sent -> the entries of a vector; None: they make no sense."""
    entries: list[Entry] = []
    for vehicle_id, log_id, *numbers, bits in _ENTRY.iter_unpack(packed):
        if vehicle_id == 0:
            break
        upto, window, last, acked = (int.from_bytes(three, "little") for three in numbers)
        if vehicle_id > VEHICLE_MAX or window < upto or window + BITMAP > NUMBER_MAX:
            return None
        entries.append(Entry(LogKey(vehicle_id, log_id), upto, window, last, acked, bits))
    return tuple(entries)


def _three_bytes(number: int) -> bytes:
    return number.to_bytes(3, "little")
