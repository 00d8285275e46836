"""A disk that is full in mid-flight costs files and no flight."""

from __future__ import annotations

import errno
import io
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from companion.journal.reading import find_flights
from companion.journal.segments import SegmentFiles
from companion.journal.summary import summarise_flight
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.document.load import dump_mission
from sim_bridge import cli
from sim_bridge.drive import fly_program
from sim_bridge.judge.outcome import present, write_page
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.tlog import BLOCK_BYTES, TlogWriter
from tests.flights import flown, short_mission

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 12, 29, 0x3040000, 3, 3)
FRAME = wire.pack(HEARTBEAT, seq=0, system=1, component=1)
LOST = ("metrics.json", "recording.npz", "report.html", "faults.json")


class FullDisk(io.RawIOBase):
    """Has room for so many bytes."""

    def __init__(self, room_bytes: int) -> None:
        self.room_bytes = room_bytes

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        if len(data) > self.room_bytes:
            raise FULL
        self.room_bytes -= len(data)
        return len(data)


def fill_segments(room_bytes: int) -> Callable[[SegmentFiles, bytes], None]:
    """Black boxes have so much room, all together."""
    disk, append = FullDisk(room_bytes), SegmentFiles._append

    def append_full(files: SegmentFiles, data: bytes) -> None:
        disk.write(data)
        append(files, data)

    return append_full


@pytest.fixture
def fill(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Files whose names end so have no more room than that from now on."""

    def fill(*endings: str, room_bytes: int = 0) -> None:
        opened = Path.open

        def open_full(path: Path, mode: str = "r", buffering: int = -1, **how: Any) -> Any:
            if "w" not in mode or not path.name.endswith(endings):
                return opened(path, mode, buffering, **how)
            opened(path, "wb").close()
            return io.BufferedWriter(FullDisk(room_bytes), max(buffering, 1))

        def write_bytes(path: Path, data: bytes) -> int:
            with path.open("wb") as file:
                return file.write(data)

        monkeypatch.setattr(Path, "open", open_full)
        monkeypatch.setattr(Path, "write_bytes", write_bytes)

    return fill


@pytest.mark.parametrize("frames", [3, 2 * BLOCK_BYTES // 20])
def test_a_log_that_cannot_be_written_is_given_up_once(frames: int, tmp_path: Path, fill: Callable[..., None]) -> None:
    fill(".tlog")
    said: list[str] = []
    with TlogWriter(tmp_path / "vehicle-1.tlog", said.append) as log:
        for k in range(frames):
            log.write(k, FRAME)
    assert said == [f"{tmp_path}/vehicle-1.tlog: cannot be written: No space left on device; the log ends here"]


def test_a_flight_on_a_full_disk_has_its_verdict_and_names_what_is_missing(
    tmp_path: Path, fill: Callable[..., None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder = tmp_path / "two.toml", tmp_path / "run"
    file.write_text(dump_mission(short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)})))
    fill(".tlog", *LOST)
    monkeypatch.setattr(SegmentFiles, "_append", fill_segments(300_000))
    monkeypatch.setattr(fly_program, "interrupt_once", lambda: None)  # the signals are the test runner's
    code = cli.main(
        ["fly", str(file), "--agents", "in-process", "--black-box", "--kill", "2@9999", "--out", str(folder)]
    )
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].startswith("ARRIVED: "), err
    for name in ("vehicle-1.tlog", "vehicle-2.tlog", *LOST):
        why = "not made: there is no recording.npz" if name == "report.html" else f"cannot be written: {FULL.strerror}"
        assert err.count(f"{folder / name}: {why}") == 1, err
    for k, flight in enumerate(find_flights(folder / "black-box"), start=1):
        there = summarise_flight(flight).ticks
        (line,) = [line for line in err.splitlines() if f"{folder}/black-box: black box of vehicle {k}: " in line]
        lost, flown_ticks = map(int, re.findall(r"(\d+) of (\d+) ticks are LOST, and it is not closed$", line)[0])
        assert f"incomplete: {FULL.strerror}: " in line
        assert there == flown_ticks - lost > 0
        assert lost > 0
    assert code == 3
    assert not [name for name in LOST if (folder / name).exists()]


@pytest.mark.parametrize("kill", [(), ("--kill", "2@20")])
def test_a_flight_whose_black_boxes_are_whole_says_nothing_of_them(
    kill: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder = tmp_path / "two.toml", tmp_path / "run"
    file.write_text(dump_mission(short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)})))
    monkeypatch.setattr(fly_program, "interrupt_once", lambda: None)
    cli.main(["fly", str(file), "--agents", "in-process", "--black-box", *kill, "--out", str(folder)])
    assert "incomplete" not in capsys.readouterr().err
    assert len(find_flights(folder / "black-box")) == 2


def test_a_page_that_cannot_be_written_costs_no_verdict(
    tmp_path: Path, fill: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    mission = short_mission(swarm={"size": 1}, route={"d2_enu_m": (12, 0, 4)})
    outcome, _ = flown(mission, tmp_path)
    fill("report.html")
    progress = Progress(io.StringIO())
    assert present(outcome, tmp_path, write_page(outcome, tmp_path, "title", progress), as_json=False) == 3
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].startswith("ARRIVED: departure to arrival of all ")
    assert err == f"sim-bridge: {tmp_path}/report.html: cannot be written: No space left on device\n"
