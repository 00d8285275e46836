"""Records are written beside the loop."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from companion.records.record import Draft, RecordKind
from companion.records.store import Batch, RecordStore, StoreError, Written
from companion.shell.record_writer import ThreadedWriter
from companion.shell.records import records_of, records_path
from companion.shell.service import STATE
from mission.document.model import Mission
from tests.unit.core.core_kit import mission

BATCH = Batch(own=[Draft(RecordKind.STEM, 0.0, b"x")])
LIMIT_S = 30.0


class Held(RecordStore):
    """A disk that takes as long as the test wants."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, 1, lambda: 1)
        self.go = threading.Event()
        self.done = threading.Event()
        self.is_full = False

    def write(self, batch: Batch) -> Written:
        assert self.go.wait(LIMIT_S)
        self.go.clear()
        try:
            if self.is_full:
                raise StoreError("disk full")
            return super().write(batch)
        finally:
            self.done.set()


def outcome_of(writer: ThreadedWriter, store: Held) -> Written | StoreError:
    store.go.set()
    assert store.done.wait(LIMIT_S)
    store.done.clear()
    while (outcome := writer.take_outcome()) is None:
        pass
    return outcome


def test_the_loop_does_not_wait_for_the_disk_and_learns_of_it_later(tmp_path: Path) -> None:
    store = Held(tmp_path / "a.db")
    writer = ThreadedWriter(store)
    assert writer.submit(BATCH)
    assert writer.take_outcome() is None
    outcome = outcome_of(writer, store)
    assert isinstance(outcome, Written)
    assert [record.number for record in outcome.own] == [1]
    assert writer.take_outcome() is None
    writer.close()


def test_a_write_that_fails_does_not_end_the_thread(tmp_path: Path) -> None:
    store = Held(tmp_path / "a.db")
    writer = ThreadedWriter(store)
    store.is_full = True
    writer.submit(BATCH)
    assert isinstance(outcome_of(writer, store), StoreError)
    store.is_full = False
    writer.submit(BATCH)
    assert isinstance(outcome_of(writer, store), Written)
    writer.close()


def test_what_was_submitted_is_written_before_the_end(tmp_path: Path) -> None:
    store = Held(tmp_path / "a.db")
    writer = ThreadedWriter(store)
    writer.submit(BATCH)
    store.go.set()
    writer.close()
    assert len(list(store.records(RecordKind.STEM))) == 1


def test_records_of_a_real_vehicle_are_written_by_a_thread_that_ends_with_the_flight(tmp_path: Path) -> None:
    before = threading.active_count()
    with ExitStack() as opened:
        records = records_of(
            surveying(), 1, tmp_path / "a.db", opened, mission_file=tmp_path / "m.toml", beside_loop=True
        )
        assert threading.active_count() == before + 1
        records.append(RecordKind.STEM, b"x", 1.0)
        records.frames(1.0, 0)
    assert threading.active_count() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.db"]  # closed: nothing lies beside it
    assert len(list(RecordStore(tmp_path / "a.db", 1, lambda: 1).records(RecordKind.STEM))) == 1


def test_a_file_that_cannot_be_opened_is_said_and_the_companion_flies_on(tmp_path: Path) -> None:
    with ExitStack() as opened:
        path, file = tmp_path / "none" / "a.db", tmp_path / "m.toml"
        records = records_of(surveying(), 1, path, opened, mission_file=file, beside_loop=False)
        assert records.lines() == ["records: unable to open database file: in memory"]
        assert records.unstored == "unable to open database file"
        records.append(RecordKind.STEM, b"x", 1.0)
        records.frames(1.0, 0)
        assert records.progress().made == 1


def surveying(name: str = "a wood") -> Mission:
    flown = mission(sensing={"sensor": "scan-1deg"})
    return Mission.model_validate({**flown.model_dump(by_alias=True), "survey": {}, "name": name})


def test_the_file_lies_beside_the_log_or_where_the_service_keeps_its_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(STATE, raising=False)
    beside_log = records_path(None, str(tmp_path / "flight.log"), surveying(), 3)
    assert beside_log.parent == tmp_path
    assert beside_log.name.startswith("records-3-")
    monkeypatch.setenv(STATE, "/var/lib/understory")
    assert records_path(None, None, surveying(), 3) == Path("/var/lib/understory") / beside_log.name
    assert records_path("given.db", "flight.log", surveying(), 3) == Path("given.db")


def test_another_mission_is_another_file(tmp_path: Path) -> None:
    log = str(tmp_path / "flight.log")
    assert records_path(None, log, surveying("a wood"), 3) != records_path(None, log, surveying("another"), 3)
