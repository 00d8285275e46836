"""Segments: named, appended to, closed, bounded; a disk that refuses a write tears nothing that is there."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from companion.journal import segments
from companion.journal.journal import Batch
from companion.journal.mcap import begin, chunk, end
from companion.journal.reading import find_flights
from companion.journal.recorder import files_of, head_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter, SegmentFiles
from tests.unit.journal.journal_kit import START, fly_ticks, recorder_of

HEAD = begin("", "")
CHUNK = chunk(bytes(1000), 0, 0)
ONE = Batch((CHUNK,), is_synced=False)


def files(folder: Path, **limits: Any) -> SegmentFiles:
    return SegmentFiles(folder, 3, HEAD, waits_for_disk=False, **limits)


def names(folder: Path) -> list[str]:
    return sorted(path.name.removeprefix("vehicle-").removesuffix(".mcap") for path in folder.iterdir())


def test_a_full_segment_is_closed_and_the_next_one_begun(tmp_path: Path) -> None:
    one = files(tmp_path, segment_bytes=2500)
    assert one.write(Batch((CHUNK,) * 5, is_synced=False)).written == 5
    one.close()
    assert names(tmp_path) == [f"3-flight-0001-000{k}" for k in (1, 2, 3)]
    sizes = [path.stat().st_size for path in sorted(tmp_path.iterdir())]
    closed = len(HEAD) + len(end())
    assert sizes == [closed + 2 * len(CHUNK), closed + 2 * len(CHUNK), closed + len(CHUNK)]


def test_a_flight_over_several_segments_is_one(tmp_path: Path) -> None:
    made = SegmentFiles(tmp_path, 3, head_of(START), segment_bytes=12_000, waits_for_disk=False)
    recorder, _ = recorder_of(DirectWriter(made))
    fly_ticks(recorder, 100)
    recorder.close("ended")
    (flight,) = find_flights(tmp_path)
    assert len(flight.segments) > 3
    assert replay_flight(flight).same == 100


def test_the_next_start_is_another_flight(tmp_path: Path) -> None:
    for _ in range(2):
        one = files(tmp_path)
        one.write(ONE)
        one.close()
    files(tmp_path).close()  # one that wrote nothing leaves nothing
    assert names(tmp_path) == ["3-flight-0001-0001", "3-flight-0002-0001"]


def test_whole_files_of_earlier_flights_go_first_and_it_is_said(tmp_path: Path) -> None:
    for _ in range(2):
        one = files(tmp_path, segment_bytes=1500, bytes_max=100_000)
        one.write(Batch((CHUNK,) * 2, is_synced=False))
        one.close()
    (tmp_path / "vehicle-4-flight-0001-0001.mcap").write_bytes(bytes(1 << 20))  # another's, and counts nothing
    one = files(tmp_path, segment_bytes=1500, bytes_max=5000)
    lines = one.write(Batch((CHUNK,), is_synced=False)).lines
    assert names(tmp_path) == [
        *("3-flight-0001-0002", "3-flight-0002-0001", "3-flight-0002-0002", "3-flight-0003-0001"),
        "4-flight-0001-0001",
    ]
    assert lines[0] == "black box: no room for more: given up vehicle-3-flight-0001-0001.mcap"


def test_a_companion_that_is_started_again_and_again_makes_so_many_files_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segments, "FILES_MAX", 3)
    for _ in range(6):
        one = files(tmp_path)
        one.write(ONE)
        one.close()
    assert names(tmp_path) == [f"3-flight-000{k}-0001" for k in (4, 5, 6)]


@pytest.mark.parametrize("make", [Path.mkdir, lambda path: path.symlink_to("nowhere")])
def test_what_is_no_file_keeps_no_box_from_being_written(make: Callable[[Path], None], tmp_path: Path) -> None:
    make(tmp_path / "vehicle-3-flight-0001-0001.mcap")
    for k in range(2, 5):
        one = files(tmp_path, segment_bytes=1500, bytes_max=3000)
        outcome = one.write(ONE)
        one.close()
        assert (outcome.written, outcome.error) == (1, "")
        assert f"3-flight-000{k}-0001" in names(tmp_path)
    assert names(tmp_path) == [f"3-flight-000{k}-0001" for k in (1, 3, 4)]


def test_then_the_beginning_of_this_flight_goes_which_is_then_not_replayed(tmp_path: Path) -> None:
    limits = {"segment_bytes": 12_000, "bytes_max": 40_000}
    made = SegmentFiles(tmp_path, 3, head_of(START), waits_for_disk=False, **limits)
    recorder, _ = recorder_of(DirectWriter(made))
    fly_ticks(recorder, 200)
    recorder.close("ended")
    assert any("the beginning of this flight" in line for line in recorder.take_lines())
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 40_000
    (flight,) = find_flights(tmp_path)
    replayed = replay_flight(flight)
    assert replayed.breaks[0].endswith("are missing")
    assert (replayed.same, replayed.is_same) == (0, False)
    assert replayed.summary.ticks > 30  # cuts and beacons are told all the same


class Disk:
    """`os.write` that has room for so many bytes, and takes them in pieces."""

    def __init__(self, room_bytes: int) -> None:
        self.room_bytes = room_bytes
        self._write = os.write

    def write(self, fd: int, data: Any) -> int:
        if not self.room_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self._write(fd, bytes(data[: min(self.room_bytes, 700)]))
        self.room_bytes -= count
        return count


def test_what_a_full_disk_tears_stays_and_the_flight_goes_on_in_the_next_segment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = files_of(tmp_path, START, waits_for_disk=False)
    disk = Disk(30_000)
    monkeypatch.setattr(segments.os, "write", disk.write)
    recorder, _ = recorder_of(DirectWriter(made))
    fly_ticks(recorder, 150)
    assert recorder.take_lines()[-1] == "black box: No space left on device: kept in memory"
    before = sorted(tmp_path.iterdir())
    torn = before[0].read_bytes()
    assert len(before) == 1  # a segment of which not even the head can be written leaves no file
    disk.room_bytes = 1 << 30
    fly_ticks(recorder, 150, first=150)
    recorder.close("ended")
    assert recorder.journal.lost == 0
    assert sorted(tmp_path.iterdir())[0].read_bytes() == torn
    (flight,) = find_flights(tmp_path)
    assert sorted(flight.segments) == [1, 2]
    replayed = replay_flight(flight)
    assert (replayed.same, replayed.is_same) == (300, True)


def test_a_disk_that_is_full_from_the_start_refuses_no_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = files_of(tmp_path / "new", START, waits_for_disk=True)
    monkeypatch.setattr(segments.os, "write", Disk(0).write)
    recorder, _ = recorder_of(DirectWriter(made))
    fly_ticks(recorder, 20)
    recorder.close("ended")
    lines = recorder.take_lines()
    assert lines[0] == "black box: No space left on device: kept in memory"
    assert lines[-1].startswith("black box: incomplete: No space left on device")
    assert list((tmp_path / "new").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    outcome = files(tmp_path / "file" / "folder").write(ONE)
    why = f"{tmp_path / 'file' / 'folder'}: {os.strerror(errno.ENOTDIR)}"
    assert (outcome.written, outcome.error) == (0, why)


def test_the_file_is_open_for_appending_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flags: list[int] = []
    opened = os.open
    monkeypatch.setattr(segments.os, "open", lambda path, how, *mode: (flags.append(how), opened(path, how, *mode))[1])
    one = files(tmp_path)
    one.write(ONE)
    one.close()
    assert flags[0] & os.O_APPEND
    assert flags[0] & os.O_EXCL
