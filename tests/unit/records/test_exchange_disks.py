"""Records of a node whose disk is full, slow or lost, and of a base station's."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from companion.records.exchange import RecordExchange
from companion.records.record import BASE_ID, BODY_MAX, LogKey, RecordKind
from companion.records.store import Batch, RecordStore, StoreError, Written
from companion.records.write_queue import DRAFTS_MAX, DirectWriter
from tests.unit.records.records_kit import Air, chain, making, record_in, stem, swarm


class Switched(DirectWriter):
    """A disk that can be full."""

    full = False

    def submit(self, batch: Batch) -> bool:
        """Write it, if there is room."""
        if self.full:
            self._outcome = StoreError("disk full")
            return True
        return super().submit(batch)


def with_switch(air: Air, me: int) -> tuple[RecordExchange, Switched]:
    made: list[Switched] = []

    def writer(store: RecordStore) -> Switched:
        made.append(Switched(store))
        return made[0]

    return air.start(me, writer=writer), made[0]


def test_a_full_disk_is_said_once_and_nothing_of_a_minute_is_lost(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(1)
    node, disk = with_switch(air, 1)
    said: list[str] = []

    def each_s() -> None:
        made()
        said.extend(node.lines())

    made = making(air, 1, until_s=60.0)
    disk.full = True
    air.run(60.0, each_s)
    assert air.at_base() == []
    assert said == ["records: disk full: kept in memory"]
    assert node.unwritten == (60, 0)
    assert node.counters()["own ones waiting for the disk"] == 60
    disk.full = False
    air.run(30.0, each_s)
    assert said[1:] == ["records: the disk takes them again"]
    assert node.unwritten == (0, 0)
    assert [number for _, number, _ in air.at_base()] == list(range(1, 61))


def test_what_does_not_fit_in_memory_either_is_counted_and_said(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(1)
    node, disk = with_switch(air, 1)
    disk.full = True
    for count in range(DRAFTS_MAX + 5):
        node.append(RecordKind.STEM, stem(1, count), 0.0)
    assert node.counters()["own ones lost"] == 5
    assert node.lines() == ["records: no room: new ones are LOST"]


def test_a_body_that_fits_no_frame_is_refused(tmp_path: Path) -> None:
    node = swarm(tmp_path, 2).nodes[1]
    node.append(RecordKind.STEM, bytes(BODY_MAX + 1), 0.0)
    assert node.counters()["own ones lost"] == 1


def test_no_record_is_told_of_or_sent_before_it_is_on_the_disk(tmp_path: Path) -> None:
    class Slow(DirectWriter):
        """A disk that never comes back."""

        def take_outcome(self) -> Written | StoreError | None:
            return None

    air = swarm(tmp_path, 2)
    air.stop(1)
    air.start(1, writer=Slow)
    air.run(10.0, making(air, 1, until_s=10.0))
    assert not any(sender == 1 and record_in(frame) for sender, frame in air.sent)
    assert air.nodes[2].progress().made == 0


def test_a_full_base_station_says_so_and_gets_the_rest_when_it_has_room(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(BASE_ID)
    base = air.start(BASE_ID, records_max=10)
    air.run(30.0, making(air, 1, 2, until_s=20.0))
    assert len(air.at_base()) == 10
    assert base.lines() == ["records: no room for more: they wait on the vehicles"]
    air.stop(BASE_ID)
    air.start(BASE_ID)
    air.run(20.0)
    assert len(air.at_base()) == 40


def test_a_disk_of_the_base_station_that_takes_nothing_is_said_once_and_made_up_for(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(BASE_ID)
    base, disk = with_switch(air, BASE_ID)
    disk.full = True
    each_s = making(air, 1, until_s=20.0)
    air.run(20.0, each_s)
    assert (air.at_base(), air.nodes[1].acked) == ([], {})
    assert base.lines() == ["records: disk full: none is taken"]
    disk.full = False
    air.run(20.0, each_s)
    assert [number for _, number, _ in air.at_base()] == list(range(1, 21))


def test_a_full_vehicle_passes_on_what_it_has_and_deletes_only_what_is_delivered(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(1)
    air.start(1, records_max=20)
    air.links = chain(2, 1, BASE_ID)
    air.run(120.0, making(air, 1, 2, until_s=60.0))
    assert Counter(air.at_base()) == Counter((me, k, stem(me, k)) for me in (1, 2) for k in range(1, 61))
    assert len(list(air.nodes[1].store.records(RecordKind.STEM))) <= 20


def test_one_vehicles_log_is_not_anothers(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.run(5.0, making(air, 1, 2, until_s=5.0))
    assert {key.vehicle_id for key in air.nodes[BASE_ID].store.holdings()} == {1, 2}
    assert LogKey(1, 1) not in air.nodes[BASE_ID].store.holdings()


def test_what_waits_at_the_end_is_written_at_once(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    node = air.nodes[1]
    for count in range(16):
        node.append(RecordKind.STEM, stem(1, count), 0.05 * count)
        node.frames(0.05 * count, 0)
    assert node.unwritten == (0, 5)
    assert node.finish(0.8) == 0
    assert len(list(node.store.records(RecordKind.STEM))) == 16


def test_a_disk_that_failed_is_tried_again_at_the_end(tmp_path: Path) -> None:
    air = swarm(tmp_path, 2)
    air.stop(1)
    node, disk = with_switch(air, 1)
    disk.full = True
    node.append(RecordKind.STEM, stem(1, 1), 0.0)
    node.frames(0.0, 0)
    assert node.finish(0.1) == 1
    disk.full = False
    assert node.finish(0.1) == 0
    assert len(list(node.store.records(RecordKind.STEM))) == 1
