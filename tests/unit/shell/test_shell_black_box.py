"""A black box of a real flight: written beside the loop, where the service has a place for it."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from companion.journal.journal import Batch, Outcome
from companion.journal.mcap import chunk, end
from companion.journal.reading import find_flights
from companion.journal.recorder import files_of
from companion.journal.replay import replay_flight
from companion.journal.segments import SegmentFiles
from companion.mavlink.endpoint import Endpoint
from companion.shell.box.opening import box_folder, file_in_the_way, open_black_box, read_mission_file
from companion.shell.box.threaded_chunks import ThreadedChunks
from companion.shell.service import STATE
from tests.unit.journal.journal_kit import MISSION, START, fly_ticks, recorder_of
from tests.unit.mavlink.endpoint_kit import ME

LIMIT_S = 30.0
CHUNK = chunk(bytes(100), 0, 0)
ONE = Batch((CHUNK,), is_synced=False)


class HeldFiles(SegmentFiles):
    """A disk that takes as long as the test wants."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, 3, files_of(folder, START, waits_for_disk=False)._head, waits_for_disk=False)
        self.go, self.entered = threading.Event(), threading.Event()

    def write(self, batch: Batch) -> Outcome:
        self.entered.set()
        assert self.go.wait(LIMIT_S)
        return super().write(batch)


def test_ticks_do_not_wait_for_a_disk_that_hangs_and_nothing_is_lost(tmp_path: Path) -> None:
    files = HeldFiles(tmp_path)
    recorder, _ = recorder_of(ThreadedChunks(files))
    fly_ticks(recorder, 60)  # would hang here
    assert files.entered.wait(LIMIT_S)
    assert list(tmp_path.iterdir()) == []
    files.go.set()
    fly_ticks(recorder, 60, first=60)
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert (replayed.same, replayed.is_same, replayed.ends) == (120, True, "ended at 5.950 s")


def test_one_batch_is_under_way_at_most(tmp_path: Path) -> None:
    files = HeldFiles(tmp_path)
    writer = ThreadedChunks(files)
    assert writer.submit(ONE)
    assert files.entered.wait(LIMIT_S)
    assert not writer.submit(ONE)
    files.go.set()
    while writer.take_outcome() is None:
        pass
    assert writer.submit(ONE)
    writer.finish(ONE)


def test_the_file_is_closed_though_nobody_has_asked_how_the_batch_before_ended(tmp_path: Path) -> None:
    files = HeldFiles(tmp_path)
    files.go.set()
    writer = ThreadedChunks(files)
    assert writer.submit(ONE)
    assert files.entered.wait(LIMIT_S)
    writer.finish(ONE)
    (path,) = tmp_path.iterdir()
    assert path.read_bytes().endswith(2 * CHUNK + end())


def test_the_end_of_a_flight_is_written_and_synced(tmp_path: Path) -> None:
    box = open_black_box(tmp_path / "state" / "black-box", START, beside_loop=True)
    endpoint = Endpoint(MISSION, ME, guard=box.record_guard(None))
    endpoint.agent.waive("all")
    recorder = box.record_endpoint(endpoint)
    fly_ticks(recorder, 21)
    recorder.close("stopped by SIGTERM")
    (flight,) = find_flights(tmp_path / "state" / "black-box")
    replayed = replay_flight(flight)
    assert (replayed.same, replayed.ends) == (21, "stopped by SIGTERM at 1.000 s")
    assert recorder.take_lines()[0] == f"black box: {flight.segments[1]}"


def test_it_is_kept_where_the_service_has_its_state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(STATE, raising=False)
    assert box_folder(None) is None
    assert box_folder("here") == Path("here")
    monkeypatch.setenv(STATE, str(tmp_path))
    assert box_folder(None) == tmp_path / "black-box"
    assert box_folder("none") is None


def test_a_file_that_is_in_the_way_is_told_from_a_folder_that_is_not_there_yet(tmp_path: Path) -> None:
    file, unmounted = tmp_path / "file", tmp_path / "card"
    file.touch()
    unmounted.symlink_to(tmp_path / "gone")
    assert [file_in_the_way(path) for path in (file, file / "a" / "b")] == [file, file]
    assert not any(map(file_in_the_way, (tmp_path, tmp_path / "a" / "b", unmounted, unmounted / "a", Path("a"))))


def test_the_missions_file_is_kept_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_bytes(b"# \xff\n")
    text, digest = read_mission_file(str(path))
    assert text == "# \ufffd\n"
    assert len(digest) == 64
    assert read_mission_file(str(tmp_path / "none")) == ("", "")
