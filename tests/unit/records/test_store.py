"""Records on one disk: what is written stays, and what may go when there is no room."""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.records.record import BASE_ID, Draft, LogKey, Record, RecordKind
from companion.records.store import Batch, RecordStore, StoreError, open_store

OTHER = LogKey(2, 77)


@pytest.fixture
def draw() -> Callable[[], int]:
    return itertools.count(100).__next__


def drafts(*counts: int, kind: RecordKind = RecordKind.STEM) -> list[Draft]:
    return [Draft(kind, count / 2.0, b"own %d" % count) for count in counts]


def copies(*numbers: int, key: LogKey = OTHER) -> list[Record]:
    return [Record(*key, number, RecordKind.STEM, number / 4.0, b"other %d" % number) for number in numbers]


def test_own_records_are_numbered_without_a_gap_over_a_restart(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    assert [record.number for record in store.write(Batch(own=drafts(1, 2))).own] == [1, 2]
    store.close()
    again = RecordStore(tmp_path / "a.db", 1, draw)
    assert again.own_log == store.own_log
    assert [record.number for record in again.write(Batch(own=drafts(3))).own] == [3]
    assert [(number, body) for _, number, _, body in again.records(RecordKind.STEM)] == [
        (1, b"own 1"),
        (2, b"own 2"),
        (3, b"own 3"),
    ]


def test_a_disk_that_was_lost_begins_another_log(tmp_path: Path, draw: Callable[[], int]) -> None:
    assert RecordStore(tmp_path / "a.db", 1, draw).own_log != RecordStore(tmp_path / "b.db", 1, draw).own_log


def test_what_is_stored_is_never_overwritten(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(others=copies(1)))
    store.write(Batch(others=[Record(*OTHER, 1, RecordKind.TRACK, 9.0, b"forged")]))
    kept = store.find_record(OTHER, 1)
    assert kept is not None
    assert kept.body == b"other 1"
    assert list(store.records(RecordKind.TRACK)) == []


def test_holdings_and_acknowledgements_come_back_from_the_disk(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(own=drafts(1), others=copies(1, 2, 5), acked={OTHER: 1}, epoch=9))
    store.close()
    again = RecordStore(tmp_path / "a.db", 1, draw)
    assert again.holdings()[OTHER].upto == 2
    assert again.holdings()[OTHER].last == 5
    assert (again.acked(), again.base_epoch) == ({OTHER: 1}, 9)


def test_another_file_of_the_base_station_has_acknowledged_nothing_yet(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(others=copies(1, 2), acked={OTHER: 2}, epoch=9))
    store.write(Batch(epoch=9))
    assert store.acked() == {OTHER: 2}
    store.write(Batch(epoch=10))
    assert store.acked() == {}


def test_when_full_what_is_delivered_goes_first(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw, records_max=6)
    store.write(Batch(own=drafts(1, 2, 3), others=copies(1, 2, 3)))
    store.write(Batch(acked={store.own_log: 2}))
    written = store.write(Batch(own=drafts(4)))
    assert written.refused == 0
    assert [number for vehicle_id, number, _, _ in store.records(RecordKind.STEM) if vehicle_id == 2] == [1, 2, 3]
    assert store.find_record(store.own_log, 3) is not None  # its own that is not delivered
    assert written.given_up == {store.own_log: 2}


def test_then_copies_of_others_go_and_own_records_that_are_not_delivered_never(
    tmp_path: Path, draw: Callable[[], int]
) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw, records_max=6)
    store.write(Batch(own=drafts(1, 2, 3), others=copies(1, 2, 3)))
    assert store.write(Batch(own=drafts(4, 5, 6))).refused == 0
    written = store.write(Batch(own=drafts(7, 8)))
    assert (written.refused, len(written.own)) == (2, 0)
    assert [number for _, number, _, _ in store.records(RecordKind.STEM)] == [1, 2, 3, 4, 5, 6]


def test_others_copies_take_no_room_from_others_that_are_not_delivered(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw, records_max=4)
    store.write(Batch(others=copies(1, 2, 3, 4)))
    assert list(store.write(Batch(others=copies(5))).others) == []
    store.write(Batch(acked={OTHER: 2}))
    assert [record.number for record in store.write(Batch(others=copies(5))).others] == [5]


def test_the_number_goes_on_after_the_last_own_record_was_delivered_and_went(
    tmp_path: Path, draw: Callable[[], int]
) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw, records_max=4)
    store.write(Batch(own=drafts(1, 2, 3, 4)))
    store.write(Batch(acked={store.own_log: 4}))
    store.write(Batch(own=drafts(5)))
    store.close()
    again = RecordStore(tmp_path / "a.db", 1, draw, records_max=4)
    again.write(Batch(acked={again.own_log: 5}))
    again.write(Batch(others=copies(1, 2, 3, 4)))  # the last own one has gone, too
    again.close()
    third = RecordStore(tmp_path / "a.db", 1, draw, records_max=40)
    assert [record.number for record in third.write(Batch(own=drafts(6))).own] == [6]


def test_the_base_station_deletes_nothing(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", BASE_ID, draw, records_max=3)
    store.write(Batch(others=copies(1, 2, 3), acked={OTHER: 3}))
    assert list(store.write(Batch(others=copies(4))).others) == []
    assert len(list(store.records(RecordKind.STEM))) == 3


def test_a_log_whose_end_was_lost_goes_on_in_another(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(own=drafts(1, 2)))
    store.close()
    again = RecordStore(tmp_path / "a.db", 1, draw)
    again.write(Batch(own=drafts(3, 4)))
    written = again.write(Batch(own=drafts(5), begins_log=True))
    assert (written.moved, [record.number for record in written.own]) == (2, [3])
    assert again.own_log != store.own_log
    assert (again.holdings()[store.own_log].upto, again.holdings()[again.own_log].upto) == (2, 3)


def test_a_write_that_fails_changes_nothing(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(own=drafts(1)))
    store._writing.execute("PRAGMA max_page_count = 1")  # a full disk, as SQLite tells of it
    with pytest.raises(StoreError, match="full"):
        store.write(Batch(own=[Draft(RecordKind.STEM, 0.0, bytes(236))] * 400))
    store._writing.execute("PRAGMA max_page_count = 100000")
    assert [record.number for record in store.write(Batch(own=drafts(2))).own] == [2]


def test_a_file_of_another_vehicle_is_refused(tmp_path: Path, draw: Callable[[], int]) -> None:
    RecordStore(tmp_path / "a.db", 1, draw).close()
    with pytest.raises(StoreError, match="records of vehicle 1, not 2"):
        open_store(tmp_path / "a.db", 2, draw)
    assert [file.name for file in tmp_path.glob("*damaged*")] == []


def test_a_file_of_another_mission_is_refused_and_may_be_read_by_any(tmp_path: Path, draw: Callable[[], int]) -> None:
    RecordStore(tmp_path / "a.db", 1, draw).close()  # of before files had a mission: it becomes that of the first
    open_store(tmp_path / "a.db", 1, draw, mission_hash=5)[0].close()
    with pytest.raises(StoreError, match="holds the records of another mission"):
        open_store(tmp_path / "a.db", 1, draw, mission_hash=6)
    open_store(tmp_path / "a.db", 1, draw, mission_hash=5)[0].close()
    RecordStore(tmp_path / "a.db", 1, draw).close()


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path, draw: Callable[[], int]) -> None:
    with pytest.raises(StoreError, match="unable to open"):
        open_store(tmp_path / "none" / "a.db", 1, draw)


def damaged_store(path: Path, draw: Callable[[], int]) -> bytes:
    """A store of ours, of which all behind the header is gone."""
    RecordStore(path, 1, draw).close()
    whole = path.read_bytes()
    path.write_bytes(whole[:100] + bytes(len(whole) - 100))
    return path.read_bytes()


def test_a_damaged_store_is_set_aside_and_said(tmp_path: Path, draw: Callable[[], int]) -> None:
    damage = damaged_store(tmp_path / "a.db", draw)
    store, said = open_store(tmp_path / "a.db", 1, draw)
    assert said == "a.db was damaged: set aside as a.db.damaged-1"
    assert (tmp_path / "a.db.damaged-1").read_bytes() == damage
    assert store.write(Batch(own=drafts(1))).own


def test_a_damaged_store_without_a_header_is_known_by_its_wal(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)  # open, as at a power cut
    (tmp_path / "cut.db").write_bytes(bytes(4096))
    (tmp_path / "cut.db-wal").write_bytes((tmp_path / "a.db-wal").read_bytes()[:40])  # no whole page in it
    store.close()
    _, said = open_store(tmp_path / "cut.db", 1, draw)
    assert said == "cut.db was damaged: set aside as cut.db.damaged-1"


def test_an_empty_file_becomes_a_store(tmp_path: Path, draw: Callable[[], int]) -> None:
    (tmp_path / "a.db").touch()
    store, said = open_store(tmp_path / "a.db", 1, draw)
    assert said == ""
    assert store.write(Batch(own=drafts(1))).own


def test_a_store_of_before_it_had_an_application_id_goes_on(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    store.write(Batch(own=drafts(1)))
    store._writing.execute("PRAGMA application_id = 0")
    store.close()
    again, said = open_store(tmp_path / "a.db", 1, draw)
    assert said == ""
    assert [record.number for record in again.write(Batch(own=drafts(2))).own] == [2]
    again.close()
    assert (tmp_path / "a.db").read_bytes()[68:72] == b"Urec"


def test_a_new_store_is_known_by_its_header_while_all_else_is_in_the_wal(
    tmp_path: Path, draw: Callable[[], int]
) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    assert (tmp_path / "a.db").read_bytes()[68:72] == b"Urec"
    store.close()


def write_database(path: Path, application_id: int, *tables: str) -> None:
    """A database of another program's."""
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA application_id = {application_id}")
    for table in tables:
        database.execute(f"CREATE TABLE {table} (a)")
    database.commit()
    database.close()


def test_what_is_no_store_of_records_is_refused_and_left_as_it_is(tmp_path: Path, draw: Callable[[], int]) -> None:
    (tmp_path / "mission.toml").write_text("[swarm]\nsize = 4\n" * 20)
    (tmp_path / "short.txt").write_text("x")
    (tmp_path / "zeros.bin").write_bytes(b"SQLite format 3\0" + bytes(5000))
    write_database(tmp_path / "trees.gpkg", 0x47504B47, "gpkg_contents")
    write_database(tmp_path / "tagged.db", 0x47504B47, "meta", "record", "log")
    write_database(tmp_path / "other.db", 0, "meta", "record", "log", "trees")
    write_database(tmp_path / "log.db", 0, "log")
    reasons = {
        "mission.toml": "is no store of records",
        "short.txt": "is no store of records",
        "zeros.bin": "is a damaged database, not known",
        "trees.gpkg": "another program's database .*47504b47",
        "tagged.db": "another program's database",
        "other.db": "something else .*table trees",
        "log.db": "something else .*table log",
    }
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    for name, reason in reasons.items():
        with pytest.raises(StoreError, match=reason):
            open_store(tmp_path / name, 1, draw)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_folder_is_refused(tmp_path: Path, draw: Callable[[], int]) -> None:
    with pytest.raises(StoreError, match="is no file"):
        open_store(tmp_path, 1, draw)


def test_the_file_is_in_wal_mode_and_synced_in_full(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    assert store._writing.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert store._writing.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL


def test_others_may_read_the_file_meanwhile(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = RecordStore(tmp_path / "a.db", 1, draw)
    reader = sqlite3.connect(f"file:{tmp_path / 'a.db'}?mode=ro", uri=True)
    store.write(Batch(own=drafts(1)))
    assert reader.execute("SELECT count(*) FROM record").fetchone() == (1,)
    store.write(Batch(own=drafts(2)))
    assert reader.execute("SELECT count(*) FROM record").fetchone() == (2,)
    reader.close()
