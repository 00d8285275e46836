"""Power that is lost at any write: what was synced is there, the next flight begins, and nothing is written over."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from companion.journal.reading import find_flights
from companion.journal.recorder import head_of
from companion.journal.replay import replay_flight
from companion.journal.segments import DirectWriter, SegmentFiles
from tests.unit.journal.journal_kit import START, fly_ticks, recorder_of

TICKS = 140
LOST_TICKS = 26  # a second between two syncs, a chunk of a quarter, and the tick that is written


@dataclass(frozen=True, slots=True)
class Moment:
    """After one call of the system: the files' bytes, how many of each are on the disk, and the tick."""

    files: Mapping[str, bytes]
    synced: Mapping[str, int]
    tick: int


def writer_in(folder: Path) -> DirectWriter:
    files = SegmentFiles(folder, START["vehicle"], head_of(START), segment_bytes=40_000)
    return DirectWriter(files)


def fly_onto(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Moment]:
    """A short flight, over several segments."""
    moments: list[Moment] = []
    synced: dict[str, int] = {}
    recorder, _ = recorder_of(writer_in(folder))
    write, fsync = os.write, os.fsync

    def note() -> None:
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        moments.append(Moment(files, dict(synced), recorder.journal.ticks))

    def write_half(fd: int, data: Any) -> int:
        """As the system may: not all at once."""
        count = write(fd, data[: max(1, len(data) // 2)])
        note()
        return count

    def sync(fd: int) -> None:
        fsync(fd)
        path = Path(os.readlink(f"/proc/self/fd/{fd}"))
        if path.is_file():
            synced[path.name] = path.stat().st_size
        note()

    with monkeypatch.context() as change:
        change.setattr(os, "write", write_half)
        change.setattr(os, "fsync", sync)
        fly_ticks(recorder, TICKS)
        recorder.close("ended")
    return moments


def leave(moment: Moment, folder: Path, aftermath: str) -> None:
    """What is found after the power came back: of bytes that were not synced all, none, or zeros in their place."""
    folder.mkdir()
    for name, data in moment.files.items():
        safe = moment.synced.get(name, 0)
        tail = {"all": data[safe:], "none": b"", "zeros": bytes(len(data) - safe)}[aftermath]
        (folder / name).write_bytes(data[:safe] + tail)


@pytest.mark.parametrize("aftermath", ["all", "none", "zeros"])
def test_power_is_lost_at_any_write(aftermath: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    moments = fly_onto(tmp_path / "whole", monkeypatch)
    assert len(moments) > 40
    assert len(moments[-1].files) > 2
    # Writes come in halves of halves; each call that syncs, and every fifth of the others.
    chosen = [m for k, m in enumerate(moments) if k % 5 == 0 or m.synced != moments[k - 1].synced]
    for k, moment in enumerate(chosen):
        folder = tmp_path / f"{k}"
        leave(moment, folder, aftermath)
        before = {path.name: path.read_bytes() for path in folder.iterdir()}
        recorder, _ = recorder_of(writer_in(folder))
        fly_ticks(recorder, 8)
        recorder.close("ended")
        cut, again = find_flights(folder)
        assert (again.number, replay_flight(again).is_same) == (2, True)
        assert before == {path.name: path.read_bytes() for path in cut.segments.values()}
        replayed = replay_flight(cut)
        assert (replayed.difference, replayed.breaks) == ([], [])
        assert replayed.same >= moment.tick - LOST_TICKS
        assert replayed.is_same or (replayed.same, replayed.stopped) == (0, "the beginning is missing")
        assert replayed.ends.startswith("ended at 6.950 s") or replayed.ends.startswith("without being closed: ")
