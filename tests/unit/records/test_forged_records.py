"""A member with the group's key forges records, acknowledgements and vectors: nothing is taken, freed or held out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from companion.base.station import BaseStation
from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.exchange import RecordExchange
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BASE_ID, Entry, LogKey, Record, RecordKind, Vector
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.intake import ALL_CHECKS_HZ, BURST_S, CHECKS_HZ, FORGED, NOT_CHECKED
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import (
    BASE_VECTOR_ID,
    SIGNED_RECORD_ID,
    encode_base_vector,
    encode_signed_record,
    read_base_vector,
)
from companion.records.store import MEMORY, Batch, RecordStore
from companion.records.summary import StandSummary, encode_summary
from companion.records.write_queue import DirectWriter
from tests.unit.mavlink.signing_kit import keyring
from tests.unit.records import records_kit
from tests.unit.records.records_kit import Air, chain, making, stem, swarm
from tests.unit.records.signed_kit import keys_of

LIAR = 3
LOG = LogKey(2, 9)


@pytest.fixture(autouse=True)
def _with_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    def keys(me: int, mission_hash: int) -> RecordKeys:
        return keys_of(me, mission_hash=mission_hash)

    monkeypatch.setattr(records_kit, "KEYS", keys)


def node(me: int = 1, ring: Keyring | None = None) -> SignedExchange:
    keys = keys_of(me, ring=ring)
    store = RecordStore(MEMORY, me, lambda: 7, keys=keys)
    return SignedExchange(*(store, DirectWriter(store), me, 6, 1000.0), keys=keys, epoch=1)


def sent(message_id: int, payload: bytes, sender: int) -> bytes:
    return wire.frame(message_id, payload, seq=0, system=sender, component=COMPONENT)


def made(number: int = 1, body: bytes = b"a stem", key: LogKey = LOG, *, by: int | None = None) -> Record:
    """A record of this log, signed by its writer or by another."""
    return keys_of(by or key.vehicle_id).sign(Record(*key, number, RecordKind.STEM, 12.25, body))


def record_frame(record: Record, sender: int = LIAR) -> bytes:
    return sent(SIGNED_RECORD_ID, encode_signed_record(record), sender)


def base_frame(
    *entries: Entry, sender: int = BASE_ID, by: int = BASE_ID, told: int = 1 << 40, epoch: int = 1, full: bool = False
) -> bytes:
    vector = Vector(epoch, 0, True, full, entries)
    return sent(BASE_VECTOR_ID, encode_base_vector(vector, told, keys_of(by).sign_base), sender)


def has(key: LogKey, upto: int) -> Entry:
    return Entry(key, upto, upto, upto, upto, 0)


def stored(one: RecordExchange) -> list[tuple[int, bytes]]:
    one.frames(100.0, 0)
    return [(number, body) for _, number, _, body in one.store.records(RecordKind.STEM)]


# --- records ---


def test_record_forged_in_anothers_name_is_refused_and_said_once_and_the_genuine_one_is_taken() -> None:
    one = node()
    for number in (1, 1, 2):
        assert one.receive(record_frame(made(number, b"forged", by=LIAR)), 0.0)
    assert one.receive(record_frame(made()), 0.5)  # whoever passes it on
    assert stored(one) == [(1, b"a stem")]
    assert one.dropped[FORGED] == 3
    assert one.lines() == ["records: forged as vehicle 2's: refused"]


@pytest.mark.parametrize(
    "change",
    [
        lambda r: replace(r, body=b"a stom"),
        lambda r: replace(r, body=b"a stem\0"),
        lambda r: replace(r, number=2),
        lambda r: replace(r, log_id=10),
        lambda r: replace(r, vehicle_id=4),
        lambda r: replace(r, kind=RecordKind.TRACK),
        lambda r: replace(r, made_s=12.5),
        lambda r: replace(r, signature=bytes(64)),
        lambda r: keys_of(2, mission_hash=5).sign(r),  # for another mission
    ],
)
def test_record_that_was_changed_on_its_way_is_refused(change: Callable[[Record], Record]) -> None:
    one = node()
    one.receive(record_frame(change(made())), 0.0)
    assert stored(one) == []
    assert one.dropped[FORGED] == 1


def test_records_and_the_base_stations_vectors_without_a_signature_are_not_taken() -> None:
    one = node()
    one.receive(sent(RECORD_ID, encode_record(made()), 2), 0.0)
    one.receive(sent(VECTOR_ID, encode_vector(Vector(1, 0, True, False, (has(LOG, 3),))), BASE_ID), 0.0)
    assert (stored(one), one.dropped["unsigned"], one.acked) == ([], 2, {})


def test_second_record_of_one_number_by_the_same_writer_is_not_taken_and_said() -> None:
    one = node()
    one.receive(record_frame(made()), 0.0)
    stored(one)
    one.receive(record_frame(made(body=b"another stem")), 0.0)
    one.receive(record_frame(made(body=b"forged", by=LIAR)), 0.0)
    assert stored(one) == [(1, b"a stem")]
    assert (one.dropped["conflicting"], one.dropped[FORGED]) == (1, 1)
    assert one.lines() == ["records: vehicle 2 gave a number twice", "records: forged as vehicle 2's: refused"]


def test_summary_in_anothers_name_is_not_shown_at_the_base_station() -> None:
    records = node(BASE_ID)
    station = BaseStation(records)
    for by, stems in ((LIAR, 900), (2, 12)):
        summary = encode_summary(StandSummary(stems, stems, None, 0.9, None, None))
        record = keys_of(by).sign(Record(*LOG, 1, RecordKind.SUMMARY, 1.0, summary))
        station.receive(record_frame(record), 0.0)
        station.tick(1.0)
    assert station.text == "1 of 1 records delivered; 12 stems"


def test_forger_that_floods_holds_no_record_out(tmp_path: Path) -> None:
    """Each tick, forged first: the next number of every log, and what speaks against its being asked for."""
    air = swarm(tmp_path, 4)
    air.links = chain(1, 2, 4, BASE_ID) | chain(LIAR, 2) | chain(LIAR, 4) | chain(LIAR, BASE_ID)
    plain = making(air, 1, 2, 4, until_s=20.0)

    def flood() -> None:
        for me, one in air.nodes.items():
            logs = {key: holding.last for key, holding in one.store.holdings().items()}
            logs[air.nodes[1].store.own_log] = logs.get(air.nodes[1].store.own_log, 0)
            if frozenset((me, LIAR)) not in (air.links or ()):
                continue
            for key, last in logs.items():
                false = Vector(1, 1, False, False, (has(key, last + 500),))
                one.receive(sent(VECTOR_ID, encode_vector(false), LIAR), air.now_s)
                one.receive(base_frame(has(key, last + 500), by=LIAR), air.now_s)
                for number in (last + 1, last + 2):
                    one.receive(record_frame(made(number, b"forged", key, by=LIAR)), air.now_s)

    for _ in range(30 * 20):
        flood()
        air.run(0.05, plain)
    assert Counter(air.at_base()) == Counter((me, k, stem(me, k)) for me in (1, 2, 4) for k in range(1, 21))
    assert sum(air.nodes[1].acked.values()) >= 20


def test_flood_costs_a_bounded_number_of_signatures_and_no_other_vehicles() -> None:
    one = node()
    for k in range(1000):
        one.receive(record_frame(made(k % 40 + 1, b"forged", by=LIAR)), k / 1000.0)
    assert one.dropped[FORGED] == pytest.approx((1.0 + BURST_S) * CHECKS_HZ, abs=2)
    assert one.dropped[FORGED] + one.dropped[NOT_CHECKED] == 1000
    one.receive(record_frame(made(1), sender=4), 1.0)
    one.receive(record_frame(made(2)), 1.02)
    assert [number for number, _ in stored(one)] == [1, 2]


def test_flood_in_all_names_costs_a_bounded_number_of_signatures() -> None:
    one = node()
    for k in range(2000):
        one.receive(record_frame(made(k % 40 + 1, b"forged", by=LIAR), sender=(2, 3, 4, 5, 6, BASE_ID)[k % 6]), 0.0)
    assert one.dropped[FORGED] <= ALL_CHECKS_HZ * BURST_S


def test_record_that_comes_again_costs_no_second_signature() -> None:
    one = node()
    for _ in range(200):
        one.receive(record_frame(made(1)), 0.0)
    one.receive(record_frame(made(2)), 0.0)
    assert [number for number, _ in stored(one)] == [1, 2]
    for _ in range(200):
        one.receive(record_frame(made(1)), 2.0)
    one.receive(record_frame(made(3)), 2.0)
    one.frames(200.0, 0)
    assert [number for number, _ in stored(one)] == [1, 2, 3]
    assert one.dropped[NOT_CHECKED] == 0


def test_revoked_vehicles_records_are_neither_taken_nor_sent() -> None:
    whole = keyring(1, 6)
    revoked = replace(whole, vehicles={k: public for k, public in whole.vehicles.items() if k != 2})
    one = node(ring=revoked)
    one.receive(record_frame(made()), 0.0)
    assert (stored(one), one.dropped["of unknown vehicles"]) == ([], 1)
    one.store.write(Batch(others=[made()]))  # of before it was revoked
    again = SignedExchange(*(one.store, DirectWriter(one.store), 1, 6, 1000.0), keys=keys_of(1, ring=revoked), epoch=1)
    for k in range(100):
        if k % 20 == 0:
            again.receive(sent(VECTOR_ID, encode_vector(Vector(0, 255, False, False, ())), LIAR), k / 20)
        assert not [1 for message_id, _ in again.frames(k / 20, 0) if message_id == SIGNED_RECORD_ID]


# --- vectors ---


def test_logs_are_opened_by_records_and_no_vector_crowds_them_out(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    base = air.nodes[BASE_ID]

    def lie() -> None:
        for k in range(50):
            false = Vector(0, 255, False, False, (has(LogKey(2, 1000 + k), 5000),))
            base.receive(sent(VECTOR_ID, encode_vector(false), LIAR), air.now_s)

    lie()
    air.run(10.0, making(air, 1, 2, until_s=5.0))
    assert len(air.at_base()) == 10
    assert str(base.progress()) == "10 of 10 records delivered"
    assert base.missing() == {}


def test_no_word_of_others_begins_a_new_log(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(5.0, making(air, 1, until_s=5.0))
    log = air.nodes[1].store.own_log
    air.stop(1)
    one = air.start(1)
    air.run(0.1)
    one.receive(sent(VECTOR_ID, encode_vector(Vector(1, 1, False, False, (has(log, 900),))), 2), air.now_s)
    one.receive(base_frame(has(log, 900), by=LIAR), air.now_s)
    one.receive(record_frame(made(900, key=log, by=LIAR), sender=2), air.now_s)
    air.run(10.0)
    assert one.dropped[FORGED] == 2
    assert one.store.own_log == log


# --- acknowledgements ---


def full_of(folder: Path) -> tuple[Air, RecordExchange, LogKey]:
    """A vehicle whose disk has room for 20 records, and 20 of its own that nobody has heard."""
    air = swarm(folder, 2)
    air.stop(1)
    one = air.start(1, records_max=20)
    air.links = set()
    air.run(21.0, making(air, 1, until_s=20.0))
    return air, one, one.store.own_log


def test_forged_acknowledgement_frees_no_full_disk(tmp_path: Path) -> None:
    air, one, log = full_of(tmp_path)
    false = has(log, 20)
    for frame in (
        base_frame(false, by=LIAR),
        base_frame(false, by=LIAR, sender=LIAR),
        sent(VECTOR_ID, encode_vector(Vector(1, 1, False, False, (false,))), LIAR),
        sent(VECTOR_ID, encode_vector(Vector(1, 0, True, False, (false,))), BASE_ID),
    ):
        one.receive(frame, air.now_s)
    air.run(5.0, lambda: one.append(RecordKind.STEM, b"more", air.now_s))
    assert [number for number, _ in stored(one)] == list(range(1, 21))
    one.receive(base_frame(has(log, 20), sender=2), air.now_s)  # the genuine one, passed on
    air.run(5.0, lambda: one.append(RecordKind.STEM, b"more", air.now_s))
    assert max(number for number, _ in stored(one)) > 20


def test_forged_file_of_the_base_station_takes_no_acknowledgement_back(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(5.0, making(air, 1, until_s=3.0))
    one = air.nodes[1]
    one.receive(base_frame(epoch=2**32 - 1, by=LIAR), air.now_s)
    one.receive(sent(VECTOR_ID, encode_vector(Vector(2**32 - 1, 1, False, False, ())), 2), air.now_s)
    assert sum(one.acked.values()) == 3


def test_copy_of_what_the_base_station_told_before_keeps_nothing_from_it() -> None:
    one = node()
    for k in range(10):
        one.append(RecordKind.STEM, b"stem %d" % k, 0.0)
    one.frames(0.0, 0)
    one.receive(base_frame(told=10), 0.0)
    one.receive(base_frame(told=9, full=True), 0.1)  # it was full, once
    sends = [message_id for k in range(20) for message_id, _ in one.frames(0.1 + k / 20, 0)]
    assert SIGNED_RECORD_ID in sends
    one.receive(base_frame(told=11, full=True), 1.2)
    sends = [message_id for k in range(20) for message_id, _ in one.frames(1.2 + k / 20, 0)]
    assert SIGNED_RECORD_ID not in sends


def test_acknowledgement_is_passed_on_as_it_was_told_and_not_without_end(tmp_path: Path) -> None:
    air = swarm(tmp_path, 4)
    air.links = chain(4, 3, 2, 1, BASE_ID)
    air.run(30.0, making(air, 4, until_s=10.0))
    assert sum(air.nodes[4].acked.values()) == 10
    told = {base.payload for sender, frame in air.sent if sender == BASE_ID and (base := read_base_vector(frame))}
    passed_on = [base for sender, frame in air.sent if sender != BASE_ID and (base := read_base_vector(frame))]
    assert {base.payload for base in passed_on} <= told
    before = len(air.sent)
    air.run(20.0)
    assert not [1 for sender, frame in air.sent[before:] if sender != BASE_ID and read_base_vector(frame)]


def test_acknowledgements_arrive_while_more_and_more_is_acknowledged(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    air.links = chain(3, 2, 1, BASE_ID)
    air.run(40.0, making(air, 1, 2, 3, until_s=60.0))
    assert air.nodes[3].acked[air.nodes[3].store.own_log] >= 20


def test_acknowledgements_of_a_new_file_reach_those_that_knew_more_of_the_old_one(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.links = chain(2, 1, BASE_ID)
    air.run(25.0, making(air, 1, 2, until_s=10.0))
    assert sum(air.nodes[2].acked.values()) == 20
    air.stop(BASE_ID, with_disk=True)
    air.start(BASE_ID, epoch=2)
    air.run(25.0)
    assert (air.nodes[2].store.base_epoch, sum(air.nodes[2].acked.values())) == (2, 20)


def test_nobody_passes_on_what_all_hear_from_the_base_station_itself(tmp_path: Path) -> None:
    air = swarm(tmp_path, 4, loss=0.3)
    air.run(30.0, making(air, 1, 2, 3, 4, until_s=30.0))
    assert sum(sender != BASE_ID and read_base_vector(frame) is not None for sender, frame in air.sent) <= 4


def test_one_passes_on_what_several_could(tmp_path: Path) -> None:
    air = swarm(tmp_path, 5)
    pairs = {frozenset((a, b)) for a in range(1, 6) for b in range(1, a)}
    air.links = pairs | {frozenset((me, BASE_ID)) for me in (1, 2, 3, 4)}
    air.run(30.0, making(air, 1, 5, until_s=30.0))
    assert air.nodes[5].acked[air.nodes[5].store.own_log] >= 20
    assert sum(sender != BASE_ID and read_base_vector(frame) is not None for sender, frame in air.sent) <= 30 / 3 + 2


def test_more_logs_than_one_message_holds_are_acknowledged(tmp_path: Path) -> None:
    air = Air(tmp_path, members=6, seed=1)
    for me in (*range(1, 7), BASE_ID):
        air.start(me)
    for me in (1, 2, 3, 4):  # each has lost its disk once: ten logs
        air.run(3.0, making(air, me, until_s=air.now_s + 2.0))
        air.stop(me, with_disk=True)
        air.start(me)
    each_s = making(air, *range(1, 7), until_s=air.now_s + 4.0)
    air.run(15.0, each_s)
    held = air.nodes[BASE_ID].store.holdings()
    assert len(held) == 10
    for me in range(1, 7):
        own = air.nodes[me].store.own_log
        assert air.nodes[me].acked[own] == held[own].upto == 4


def test_operators_key_signs_for_the_base_station_alone() -> None:
    one = node()
    one.receive(record_frame(keys_of(BASE_ID).sign(Record(*LOG, 1, RecordKind.STEM, 0.0, b"x")), sender=BASE_ID), 0.0)
    assert stored(one) == []
    assert keyring(OPERATOR, 6).vehicles.get(BASE_ID) is None
