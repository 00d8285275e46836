"""`companion watch` with a key shows of the records what their writers, and the base station, have signed."""

from __future__ import annotations

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BASE_ID, Entry, LogKey, Record, RecordKind, Vector
from companion.records.signed.intake import BURST_S, CHECKS_HZ
from companion.records.signed.messages import (
    BASE_VECTOR_ID,
    SIGNED_RECORD_ID,
    encode_base_vector,
    encode_signed_record,
)
from companion.records.summary import StandSummary, encode_summary
from companion.watch.harvest_heard import HarvestHeard
from tests.unit.records.signed_kit import keys_of

LIAR = 3


def frame(message_id: int, payload: bytes, sender: int) -> bytes:
    return wire.frame(message_id, payload, seq=0, system=sender, component=COMPONENT)


def summary(stems: int, number: int, *, by: int) -> Record:
    body = encode_summary(StandSummary(stems, stems, None, 0.9, None, None))
    return keys_of(by).sign(Record(2, 9, number, RecordKind.SUMMARY, 1.0, body))


def base(upto: int, told: int, *, by: int) -> bytes:
    vector = Vector(7, 0, True, False, (Entry(LogKey(2, 9), upto, upto, upto, upto, 0),))
    return frame(BASE_VECTOR_ID, encode_base_vector(vector, told, keys_of(by).sign_base), BASE_ID)


def test_records_and_deliveries_count_when_they_are_signed_by_whose_they_are() -> None:
    heard = HarvestHeard(keys_of(BASE_ID))
    assert heard.take_frame(frame(SIGNED_RECORD_ID, encode_signed_record(summary(12, 4, by=2)), LIAR), 0.0)
    assert heard.take_frame(base(3, 1, by=BASE_ID), 0.0)
    shown = "3 of 4 records delivered; 12 stems"
    assert heard.text(2) == shown
    forged = summary(900, 5, by=LIAR)
    false = Vector(7, 1, False, False, (Entry(LogKey(2, 9), 90, 90, 90, 90, 0),))
    for one in (
        frame(SIGNED_RECORD_ID, encode_signed_record(forged), 2),
        frame(RECORD_ID, encode_record(forged), 2),
        frame(VECTOR_ID, encode_vector(false), 2),
        frame(VECTOR_ID, encode_vector(Vector(8, 0, True, False, false.entries)), BASE_ID),
        base(90, 2, by=LIAR),
    ):
        heard.take_frame(one, 1.0)
    assert heard.text(2) == shown
    assert not heard.take_frame(b"\xfd" * 40, 1.0)


def test_flood_of_forged_records_is_checked_for_as_many_as_one_could_send() -> None:
    heard = HarvestHeard(keys_of(BASE_ID))
    for _ in range(int(BURST_S * CHECKS_HZ)):
        heard.take_frame(frame(SIGNED_RECORD_ID, encode_signed_record(summary(900, 5, by=LIAR)), LIAR), 0.0)
    genuine = encode_signed_record(summary(12, 4, by=2))
    heard.take_frame(frame(SIGNED_RECORD_ID, genuine, LIAR), 0.0)
    assert heard.text(2) == ""
    heard.take_frame(frame(SIGNED_RECORD_ID, genuine, 4), 0.5)
    assert heard.text(2) == "0 of 4 records delivered; 12 stems"
