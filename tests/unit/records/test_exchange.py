"""Records on their way to the base station: over loss, splits, restarts, full and lost disks."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.airtime import OVERHEAD_BYTES, USABLE_SHARE
from companion.records.exchange import GIVE_UP_S, LOGS_MAX, RecordExchange
from companion.records.frames import RECORD_ID, VECTOR_ID, encode_record, encode_vector
from companion.records.record import BASE_ID, Entry, LogKey, Record, RecordKind, Vector
from companion.records.store import Batch
from companion.records.write_queue import COPIES_MAX
from tests.unit.records.records_kit import BEACON_BYTES, chain, making, record_in, stem, swarm


def from_peer(message_id: int, payload: bytes, sender: int = 2) -> bytes:
    return wire.frame(message_id, payload, seq=0, system=sender, component=COMPONENT)


def tell_of(node: RecordExchange, *log_ids: int, mission_hash: int = 0) -> None:
    """Vehicle 2 tells of its logs."""
    for log_id in log_ids:
        vector = Vector(0, 255, False, False, (Entry(LogKey(2, log_id), 0, 0, 0, 0, 0),), mission_hash)
        node.receive(from_peer(VECTOR_ID, encode_vector(vector)), 0.0)


def test_all_records_reach_the_base_station_once(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    air.run(30.0, making(air, 1, 2, 3, until_s=20.0))
    assert Counter(air.at_base()) == Counter((me, k, stem(me, k)) for me in (1, 2, 3) for k in range(1, 21))
    assert str(air.nodes[BASE_ID].progress()) == "60 of 60 records delivered"
    assert all(str(air.nodes[me].progress()) == "60 of 60 records delivered" for me in (1, 2, 3))


def test_records_travel_over_others_and_so_does_their_acknowledgement(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    air.links = chain(3, 2, 1, BASE_ID)
    air.run(30.0, making(air, 3, until_s=10.0))
    assert [number for _, number, _ in air.at_base()] == list(range(1, 11))
    assert sum(air.nodes[3].acked.values()) == 10


@pytest.mark.parametrize("seed", range(3))
def test_thirty_percent_of_loss_is_repaired(tmp_path: Path, seed: int) -> None:
    air = swarm(tmp_path, 4, loss=0.3, seed=seed)
    air.links = chain(4, 3, 2, 1, BASE_ID)
    air.run(60.0, making(air, 1, 2, 3, 4, until_s=30.0))
    assert len(air.at_base()) == 4 * 30


def test_a_split_is_made_up_for(tmp_path: Path) -> None:
    air = swarm(tmp_path, 4)
    each_s = making(air, 1, 2, 3, 4, until_s=60.0)
    air.links = {frozenset((1, 2)), frozenset((3, 4)), frozenset((1, BASE_ID))}
    air.run(60.0, each_s)
    assert {vehicle_id for vehicle_id, _, _ in air.at_base()} == {1, 2}
    air.links = None
    air.run(20.0, each_s)
    assert len(air.at_base()) == 4 * 60


def test_a_vehicle_that_falls_has_left_its_records_with_the_others(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    air.links = chain(1, 2, 3)  # no base station in range
    air.run(20.0, making(air, 3, until_s=10.0))
    air.stop(3, with_disk=True)
    air.links = chain(1, BASE_ID) | chain(1, 2)
    air.run(10.0)
    assert [number for _, number, _ in air.at_base()] == list(range(1, 11))


def test_what_only_a_fallen_vehicle_had_is_known_to_be_missing_and_hides_nothing(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.links = set()
    air.run(10.0, making(air, 2, until_s=10.0))
    log = air.nodes[2].store.own_log
    made = (Record(*log, number, RecordKind.STEM, 0.0, stem(2, number)) for number in range(11, 91))
    later = [air.as_made(record) for record in made]
    air.nodes[1].store.write(Batch(others=later))  # it has only heard the end of that log
    air.stop(1)
    air.stop(2, with_disk=True)
    air.start(1)
    air.links = chain(1, BASE_ID)
    air.run(30.0)
    assert [number for _, number, _ in air.at_base()] == list(range(11, 91))
    assert air.nodes[BASE_ID].missing() == {log: [(1, 10)]}


def test_a_restarted_vehicle_goes_on_in_its_log(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    each_s = making(air, 1, 2, until_s=20.0)
    air.run(10.0, each_s)
    air.stop(1)
    air.start(1)
    air.run(20.0, each_s)
    assert Counter(air.at_base()) == Counter((me, k, stem(me, k)) for me in (1, 2) for k in range(1, 21))


def test_a_restarted_base_station_asks_for_nothing_twice(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    each_s = making(air, 1, 2, until_s=30.0)
    air.run(15.0, each_s)
    air.stop(BASE_ID)
    air.run(5.0, each_s)
    air.start(BASE_ID)
    before = len(air.sent)
    air.run(20.0, each_s)
    assert len(air.at_base()) == 60
    resent = [record for _, frame in air.sent[before:] if (record := record_in(frame)) and record.number <= 14]
    assert resent == []


def test_a_base_station_with_a_new_file_is_sent_all_again(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(15.0, making(air, 1, 2, until_s=10.0))
    assert sum(air.nodes[1].acked.values()) == 20
    air.stop(BASE_ID, with_disk=True)
    air.start(BASE_ID, epoch=2)
    air.run(10.0)
    assert len(air.at_base()) == 20
    assert air.nodes[1].store.base_epoch == 2


def test_a_vehicle_that_lost_its_disk_begins_another_log_and_duplicates_nothing(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(10.0, making(air, 1, until_s=10.0))
    air.stop(1, with_disk=True)
    air.start(1)
    counts = iter(range(100, 110))
    air.run(10.0, lambda: air.nodes[1].append(RecordKind.STEM, stem(1, next(counts)), air.now_s))
    air.run(5.0)
    bodies = [body for _, _, body in air.at_base()]
    assert Counter(bodies) == Counter(stem(1, k) for k in (*range(1, 11), *range(100, 110)))
    assert len({key for key in air.nodes[BASE_ID].store.holdings() if key.vehicle_id == 1}) == 2


def test_a_disk_that_lost_the_end_of_its_log_gives_no_number_twice(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(5.0, making(air, 1, until_s=5.0))
    air.stop(1)
    early = (tmp_path / "1.db").read_bytes()  # as it was then: what it was told later is lost at a power cut
    air.start(1)
    counts = iter(range(100, 200))
    air.run(10.0, lambda: air.nodes[1].append(RecordKind.STEM, stem(1, next(counts)), 0.0))
    air.stop(1)
    for file in tmp_path.glob("1.db-*"):
        file.unlink()
    (tmp_path / "1.db").write_bytes(early)
    air.start(1)
    counts = iter(range(200, 300))
    air.run(10.0, lambda: air.nodes[1].append(RecordKind.STEM, stem(1, next(counts)), 0.0))
    air.run(10.0)
    bodies = [body for _, _, body in air.at_base()]
    wanted = [stem(1, k) for k in (*range(1, 6), *range(100, 110), *range(200, 210))]
    assert Counter(bodies) == Counter(wanted)
    assert air.nodes[BASE_ID].dropped["conflicting"] == 0


def test_neighbours_do_not_all_send_the_same_record(tmp_path: Path) -> None:
    air = swarm(tmp_path, 6)
    forwarders = {frozenset((me, other)) for me in (2, 3, 4, 5, 6) for other in (1, BASE_ID)}
    air.links = forwarders | {frozenset((a, b)) for a in range(2, 7) for b in range(2, a)}
    air.run(20.0, making(air, 1, until_s=10.0))
    assert len(air.at_base()) == 10
    sent = Counter(record.number for _, frame in air.sent if (record := record_in(frame)))
    assert max(sent.values()) == 2  # its writer, and one of the five that could pass it on


def test_the_base_station_is_served_before_others(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3, rate_kbps=150.0)
    air.links = chain(1, 2)
    for count in range(1, 201):
        air.nodes[1].append(RecordKind.STEM, stem(1, count), 0.0)
    air.run(2.0)
    air.links = {frozenset((1, other)) for other in (2, 3, BASE_ID)}
    air.run(2.0)
    before = len(air.sent)
    air.run(60.0)
    assert len(air.at_base()) == 200
    numbers = [record.number for _, frame in air.sent[before:] if (record := record_in(frame))]
    assert numbers[:100] == sorted(numbers[:100])  # for the base station, though 2 and 3 lack others


def test_a_vehicle_does_without_what_nobody_sends_and_the_base_station_has(tmp_path: Path) -> None:
    air = swarm(tmp_path, 3)
    air.links = chain(1, BASE_ID)
    air.run(8.0, making(air, 1, until_s=5.0))
    log = air.nodes[1].store.own_log
    air.stop(1, with_disk=True)  # delivered, and gone
    air.links = chain(2, 3) | chain(2, BASE_ID)
    air.run(GIVE_UP_S + 10.0)
    assert air.nodes[2].store.holdings()[log].upto == 5


# --- bounds, and what others say ---


def test_unknown_vehicles_are_not_heard(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    node = air.nodes[1]
    record = encode_record(Record(3, 1, 1, RecordKind.STEM, 0.0, b"x"))
    assert node.receive(from_peer(RECORD_ID, record), 0.0)
    assert node.receive(from_peer(RECORD_ID, encode_record(Record(2, 1, 1, RecordKind.STEM, 0.0, b"x")), sender=3), 0.0)
    air.run(2.0)
    assert node.dropped["of unknown vehicles"] == 2
    assert list(node.store.records(RecordKind.STEM)) == []


def test_nobody_else_writes_the_own_log(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    node = air.nodes[1]
    forged = Record(*node.store.own_log, 1, RecordKind.STEM, 0.0, b"forged")
    node.receive(from_peer(RECORD_ID, encode_record(forged)), 0.0)
    air.run(2.0)
    assert list(node.store.records(RecordKind.STEM)) == []


def test_what_differs_from_a_stored_record_is_counted_and_changes_nothing(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    node = air.nodes[1]
    tell_of(node, 9)
    for body in (b"first", b"first", b"second"):
        node.receive(from_peer(RECORD_ID, encode_record(Record(2, 9, 1, RecordKind.STEM, 0.0, body))), air.now_s)
        air.run(1.0)
    assert [body for _, _, _, body in node.store.records(RecordKind.STEM)] == [b"first"]
    assert node.dropped["conflicting"] == 1


def test_logs_of_one_vehicle_have_a_bound(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    node = air.nodes[1]
    for log_id in range(1000, 1100):
        tell_of(node, log_id)
        node.receive(from_peer(RECORD_ID, encode_record(Record(2, log_id, 1, RecordKind.STEM, 0.0, b"x"))), 0.0)
    air.run(3.0)
    assert len({key for key in node.store.holdings() if key.vehicle_id == 2}) <= LOGS_MAX


def test_a_vehicle_cannot_speak_as_the_base_station(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.links = set()
    air.run(3.0, making(air, 1, until_s=3.0))
    log = air.nodes[1].store.own_log
    vector = Vector(99, 0, True, False, (Entry(log, 3, 3, 3, 3, 0),))
    air.nodes[1].receive(from_peer(VECTOR_ID, encode_vector(vector)), air.now_s)
    assert air.nodes[1].acked == {}


def test_what_an_earlier_file_of_the_base_station_had_counts_no_more(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(5.0, making(air, 1, until_s=3.0))
    node = air.nodes[1]
    assert sum(node.acked.values()) == 3
    for epoch, left in ((1, 3), (2, 0)):
        node.receive(from_peer(VECTOR_ID, encode_vector(Vector(epoch, 0, True, False, ())), sender=BASE_ID), air.now_s)
        assert sum(node.acked.values()) == left


def test_no_more_is_acknowledged_than_there_is(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.links = set()
    air.run(3.0, making(air, 1, until_s=2.5))
    log = air.nodes[1].store.own_log
    vector = Vector(99, 0, True, False, (Entry(log, 9000, 9000, 9000, 9000, 0),))
    air.nodes[1].receive(from_peer(VECTOR_ID, encode_vector(vector), sender=BASE_ID), air.now_s)
    assert air.nodes[1].acked == {log: 3}


def test_bytes_that_are_no_record_are_left_to_others(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    assert not air.nodes[1].receive(b"", 0.0)
    assert not air.nodes[1].receive(b"\xfd" * 40, 0.0)


def test_another_component_of_a_vehicle_is_not_heard(tmp_path: Path) -> None:
    node = swarm(tmp_path, 2).nodes[1]
    payload = encode_record(Record(2, 9, 1, RecordKind.STEM, 0.0, b"x"))
    assert node.receive(wire.frame(RECORD_ID, payload, seq=0, system=2, component=1), 0.0)
    node.frames(0.0, 0)
    assert list(node.store.records(RecordKind.STEM)) == []


def test_a_flood_of_records_waits_in_bounds(tmp_path: Path) -> None:
    node = swarm(tmp_path, 2).nodes[1]
    tell_of(node, 9)
    for number in range(1, COPIES_MAX + 100):
        node.receive(from_peer(RECORD_ID, encode_record(Record(2, 9, number, RecordKind.STEM, 0.0, b"x"))), 0.0)
    node.frames(0.0, 0)
    assert len(list(node.store.records(RecordKind.STEM))) == COPIES_MAX


def test_another_missions_base_station_takes_nothing_and_frees_nothing(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(BASE_ID)
    air.start(BASE_ID, mission_hash=77)
    said: list[str] = []
    made = making(air, 1, 2, until_s=10.0)

    def each_s() -> None:
        made()
        said.extend(air.nodes[BASE_ID].lines())

    air.run(20.0, each_s)
    assert air.at_base() == []
    assert air.nodes[BASE_ID].store.holdings() == {}
    assert said == ["records: ignored: vehicles of another mission"]
    assert air.nodes[BASE_ID].counters()["of another mission"] > 20
    assert (air.nodes[1].acked, air.nodes[1].store.base_epoch) == ({}, 0)
    assert air.nodes[1].lines() == ["records: ignored: vehicles of another mission"]
    assert air.nodes[1].progress().made == 20  # those of its own mission's vehicles are exchanged all the same


def test_a_record_of_a_log_that_no_vector_of_this_mission_told_of_is_not_taken(tmp_path: Path) -> None:
    node = swarm(tmp_path, 2).nodes[1]
    frame = from_peer(RECORD_ID, encode_record(Record(2, 9, 1, RecordKind.STEM, 0.0, b"x")))
    for hears in (lambda: None, lambda: tell_of(node, 9, mission_hash=77)):
        hears()
        node.receive(frame, 0.0)
    node.frames(0.0, 0)
    assert list(node.store.records(RecordKind.STEM)) == []
    tell_of(node, 9)
    node.receive(frame, 1.0)
    node.frames(1.0, 0)
    assert len(list(node.store.records(RecordKind.STEM))) == 1


# --- airtime ---


def told_by(node: RecordExchange, *, is_full: bool = False) -> bytes:
    """A vector of vehicle 2, which has nothing of this node's log."""
    entry = Entry(node.store.own_log, 0, 0, 0, 0, 0)
    return from_peer(VECTOR_ID, encode_vector(Vector(0, 255, False, is_full, (entry,))))


def with_backlog(folder: Path) -> RecordExchange:
    node = swarm(folder, 2).nodes[1]
    for count in range(100):
        node.append(RecordKind.STEM, stem(1, count), 0.0)
    node.frames(0.0, 0)
    return node


def test_records_go_out_between_the_own_beacons_or_behind_them_where_each_tick_has_one(tmp_path: Path) -> None:
    node = with_backlog(tmp_path)
    with_beacon: list[bool] = []
    for tick in range(1, 200):
        if tick % 20 == 0:
            node.receive(told_by(node), tick * 0.05)
        beacon_bytes = 118 if tick % 2 == 0 or tick > 100 else 0
        has_record = any(message_id == RECORD_ID for message_id, _ in node.frames(tick * 0.05, beacon_bytes))
        if has_record:
            with_beacon.append(beacon_bytes > 0)
            assert tick > 100 or not with_beacon[-1]
    assert True in with_beacon
    assert False in with_beacon


def test_nothing_is_sent_to_a_node_that_has_no_room(tmp_path: Path) -> None:
    node = with_backlog(tmp_path)
    for tick in range(1, 100):
        node.receive(told_by(node, is_full=True), tick * 0.05)
        assert all(message_id != RECORD_ID for message_id, _ in node.frames(tick * 0.05, 0))


def test_a_slow_channel_is_never_filled(tmp_path: Path) -> None:
    rate_kbps = 150.0
    air = swarm(tmp_path, 3, rate_kbps=rate_kbps)
    for me in (1, 2, 3):
        for count in range(250):
            air.nodes[me].append(RecordKind.STEM, stem(me, count, 200), 0.0)
    air.run(3.0)
    before = len(air.sent)
    air.run(6.0)
    records_bps = sum(len(frame) + OVERHEAD_BYTES for _, frame in air.sent[before:]) / 6.0
    beacons_bps = 3 * 10 * (BEACON_BYTES + OVERHEAD_BYTES)
    assert records_bps > 500.0
    assert records_bps + beacons_bps < rate_kbps * 125.0 * USABLE_SHARE
