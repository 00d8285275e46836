"""Records and vectors on the wire."""

from __future__ import annotations

import struct

import pytest

from companion.mavlink import dialect
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector, read_record, read_vector
from companion.records.record import BODY_MAX, Entry, LogKey, Record, RecordKind, Vector

RECORD = Record(3, 0xDEADBEEF, 70_000, RecordKind.TRACK, 12.345678, b"\x83\x01\x02\x00")
ENTRY = Entry(LogKey(3, 0xDEADBEEF), 40, 72, 70_000, 38, 0x80000001)
VECTOR = Vector(1_764_000_000, 2, False, True, (ENTRY, Entry(LogKey(7, 1), 0, 0, 0, 0, 0)), 0xFEEDBEEF)


def framed(message_id: int, payload: bytes) -> bytes:
    return wire.frame(message_id, payload, seq=0, system=3, component=COMPONENT)


def test_a_record_comes_back_as_it_was_with_the_zeros_at_its_end() -> None:
    assert read_record(framed(RECORD_ID, encode_record(RECORD))) == RECORD


@pytest.mark.parametrize("size", [0, 1, BODY_MAX])
def test_a_record_of_any_size_is_one_frame(size: int) -> None:
    record = Record(250, 0, 1, RecordKind.STEM, 0.0, bytes(size))
    frame = framed(RECORD_ID, encode_record(record))
    assert len(frame) <= 267
    assert read_record(frame) == record


def test_a_vector_comes_back_as_it_was() -> None:
    assert read_vector(framed(VECTOR_ID, encode_vector(VECTOR))) == VECTOR


def test_pymavlink_reads_the_same_fields() -> None:
    message = wire.fields(framed(RECORD_ID, encode_record(RECORD)))
    assert (message.log_writer, message.log_number, message.record_kind) == (3, 70_000, RecordKind.TRACK)
    assert bytes(message.record_body[: message.body_size]) == RECORD.body
    message = wire.fields(framed(VECTOR_ID, encode_vector(VECTOR)))
    assert (message.base_epoch, message.base_hops, message.node_flags) == (1_764_000_000, 2, 2)


def test_a_wrong_checksum_or_another_message_is_none() -> None:
    frame = bytearray(framed(RECORD_ID, encode_record(RECORD)))
    frame[20] ^= 1
    assert read_record(bytes(frame)) is None
    assert read_record(framed(VECTOR_ID, encode_vector(VECTOR))) is None
    assert read_vector(framed(RECORD_ID, encode_record(RECORD))) is None
    assert read_record(framed(dialect.MAVLINK_MSG_ID_HEARTBEAT, b"\x01")) is None


@pytest.mark.parametrize(
    "fields",
    [
        (0, 1, 0, 3, 1, 0),  # no number
        (0, 1, 1 << 24, 3, 1, 0),  # one beyond what a vector can tell
        (0, 1, 1, 0, 1, 0),  # no writer
        (0, 1, 1, 251, 1, 0),  # no vehicle's
        (0, 1, 1, 3, 0, 0),  # no kind
        (0, 1, 1, 3, 5, 0),  # an unknown one
        (0, 1, 1, 3, 1, BODY_MAX + 1),  # longer than it is
    ],
)
def test_a_record_that_makes_no_sense_is_none(fields: tuple[int, ...]) -> None:
    payload = struct.pack("<QIIBBB236s", *fields, b"")
    assert read_record(framed(RECORD_ID, payload)) is None


@pytest.mark.parametrize(
    ("vehicle_id", "upto", "window"),
    [(251, 1, 1), (3, 5, 4), (3, 0, (1 << 24) - 1)],
)
def test_a_vector_that_makes_no_sense_is_none(vehicle_id: int, upto: int, window: int) -> None:
    numbers = upto.to_bytes(3, "little") + window.to_bytes(3, "little") + bytes(6)
    entry = struct.pack("<BI", vehicle_id, 1) + numbers + bytes(4)
    assert read_vector(framed(VECTOR_ID, struct.pack("<IIBB231s", 0, 0, 0, 0, entry))) is None


@pytest.mark.parametrize("made_us", [(1 << 52) + 1, (1 << 63) + 1, (1 << 64) - 1])
def test_a_record_made_at_a_time_that_cannot_be_passed_on_is_none(made_us: int) -> None:
    payload = made_us.to_bytes(8, "little") + encode_record(RECORD)[8:]
    assert read_record(framed(RECORD_ID, payload)) is None
    stored = Record(3, 1, 1, RecordKind.STEM, made_us / 1e6, b"")  # by a version that took it
    assert read_record(framed(RECORD_ID, encode_record(stored))) is not None


def test_the_last_time_that_a_record_may_have_comes_back_to_the_microsecond() -> None:
    for made_us in (1 << 52, (1 << 52) - 1):
        frame = framed(RECORD_ID, made_us.to_bytes(8, "little") + encode_record(RECORD)[8:])
        record = read_record(frame)
        assert record is not None
        assert framed(RECORD_ID, encode_record(record)) == frame
