"""`companion replay` as it is typed: its words and its exit codes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from companion import cli
from companion.journal import segments
from companion.journal.channels import Channel
from companion.journal.reading import Flight
from companion.journal.recorder import files_of
from companion.journal.segments import DirectWriter
from tests.unit.journal.journal_kit import START, Messages, fly_ticks, forge, recorded, recorder_of
from tests.unit.journal.test_journal_chain import change_input
from tests.unit.journal.test_segments import Disk

OPEN = "the box ends without being closed, and may lack ticks"


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    return recorded(tmp_path)


def test_a_flight_that_is_the_same(flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for log in (tmp_path, flight.segments[1]):
        assert cli.main(["replay", str(log)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == "vehicle 3, flight 1, 1 segments"
        assert lines[-1] == "SAME: 40 of 40 ticks, bit for bit"
        assert "  ends: ended at 1.950 s" in lines


def test_ticks_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path)
    assert cli.main(["replay", str(tmp_path), "--from", "0.1", "--to", "0.3", "--ticks"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines[:5]] == [[f"{k}", f"{0.05 * (k - 1):.3f}"] for k in range(3, 8)]
    assert "beacons VERSION of [6]" in lines[0]
    assert "vehicle 6 beacon version 9, not 1: ignored" in lines[0]
    assert "  5 ticks, 0.10 to 0.30 s after the first, which was at 10.00 s of the companion's clock" in lines
    assert lines[-1] == "SAME: 5 of 5 ticks, bit for bit"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--from", "1e9"], "--from 1e+09"),
        (["--from", "10.1", "--to", "10.3"], "--from 10.1 --to 10.3"),  # of the companion's clock
        (["--from", "1", "--to", "0.5"], "--from 1 --to 0.5"),
        (["--to", "-1"], "--to -1"),
    ],
)
def test_a_replay_of_no_tick_is_no_pass(
    options: list[str], named: str, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert flight.segments
    assert cli.main(["replay", str(tmp_path), *options]) == 2
    printed = capsys.readouterr()
    assert "SAME" not in printed.out
    assert printed.err == (
        f"companion: {named}: no tick of vehicle 3, flight 1; it has ticks, 0.00 to 1.95 s after the first, "
        "which was at 10.00 s of the companion's clock\n"
    )


def test_a_flight_that_was_over_before_does_not_fail_those_of_the_same_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for ticks in (10, 40):
        recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
        fly_ticks(recorder, ticks)
        recorder.close("ended")
    assert cli.main(["replay", str(tmp_path), "--from", "1"]) == 0
    printed = capsys.readouterr()
    assert "no tick of vehicle 3, flight 1; it has ticks, 0.00 to 0.45 s" in printed.err
    assert printed.out.count("SAME: 20 of 20 ticks") == 1


def test_a_broken_chain_fails_also_where_no_tick_was_asked_for(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forge(flight.segments[1], change_input)
    assert cli.main(["replay", str(tmp_path), "--from", "100"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "INCOMPLETE: 0 of 0 ticks, bit for bit"


@pytest.mark.parametrize("value", ["nan", "inf", "ten"])
@pytest.mark.parametrize("option", ["--from", "--to"])
def test_a_time_that_is_none_is_refused(option: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        cli.main(["replay", "box", option, value])
    assert refused.value.code == 2
    assert f"argument {option}: '{value}': must be a number of seconds" in capsys.readouterr().err


def test_a_box_that_was_changed(flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forge(flight.segments[1], change_input)
    assert cli.main(["replay", str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "BROKEN CHAIN: tick 17, or what came before it since the last, was changed" in lines
    assert lines[-1] == "INCOMPLETE: 16 of 40 ticks, bit for bit"


def cut_last_entry(messages: Messages) -> Messages:
    return messages[:-1]


def cut_ten_ticks(messages: Messages) -> Messages:
    ends = [k for k, message in enumerate(messages) if message.channel_id == Channel.TICK]
    return messages[: ends[29] + 1]


@pytest.mark.parametrize(("cut", "ticks"), [(cut_last_entry, 40), (cut_ten_ticks, 30)])
def test_a_box_whose_last_entries_were_taken_off_is_told_as_not_closed(
    cut: Callable[[Messages], Messages], ticks: int, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whole entries, and its file closed again: the last one is missing."""
    forge(flight.segments[1], cut)
    assert cli.main(["replay", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"SAME: {ticks} of {ticks} ticks, bit for bit; {OPEN}"
    (ends,) = [line for line in lines if line.startswith("  ends: ")]
    assert ends.startswith(f"  ends: without being closed: {flight.segments[1].name} has no last entry: the next segm")


@pytest.mark.parametrize("count", [1, 8, 50])
def test_a_box_whose_file_is_cut_behind_its_last_entry_is_told_as_that(
    count: int, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its footer is missing, or a part: as little as a byte."""
    file = flight.segments[1]
    file.write_bytes(file.read_bytes()[:-count])
    at = file.stat().st_size - 50 + count
    assert cli.main(["replay", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "SAME: 40 of 40 ticks, bit for bit; the box is cut off behind its last entry"
    assert f"  ends: ended at 1.950 s, and is cut off there: {file.name}, byte {at}: ends without its footer" in lines


def test_a_box_that_a_full_disk_has_cut_is_told_as_not_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(segments.os, "write", Disk(30_000).write)
    recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
    fly_ticks(recorder, 150)
    recorder.close("ended")
    assert recorder.journal.lost > 0
    monkeypatch.undo()
    assert cli.main(["replay", str(tmp_path)]) == 0
    there = 150 - recorder.journal.lost
    assert capsys.readouterr().out.splitlines()[-1] == f"SAME: {there} of {there} ticks, bit for bit; {OPEN}"


def test_what_is_no_box(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err == f"companion: {tmp_path}/none: cannot be read: No such file or directory\n"


def make_folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize(
    ("make", "why"), [(os.mkfifo, "is not a regular file"), (make_folder, "cannot be read: Is a directory")]
)
@pytest.mark.parametrize("vehicle_id", [2, 9])
def test_what_is_no_file_is_named_and_the_other_boxes_are_run(
    vehicle_id: int, make: Callable[[Path], None], why: str, flight: Flight, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before it in the order, or behind; a pipe that nobody writes to is not waited for."""
    box = flight.segments[1].with_name(f"vehicle-{vehicle_id}-flight-0001-0001.mcap")
    make(box)
    assert cli.main(["replay", str(box.parent)]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "SAME: 40 of 40 ticks, bit for bit"
    assert err == f"companion: {box}: {why}\n"


@pytest.mark.parametrize("name", ["renamed", "vehicle-3-flight-0001-0001.mcap"])
def test_a_folder_may_have_any_name(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path / name)
    assert cli.main(["replay", str(tmp_path / name)]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "vehicle 3, flight 1, 1 segments"


def test_a_box_under_another_vehicles_name_is_not_taken_for_its(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight.segments[1].rename(tmp_path / "vehicle-4-flight-0001-0001.mcap")
    assert cli.main(["replay", str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "BROKEN CHAIN: vehicle-4-flight-0001-0001.mcap: is of vehicle 3: its file was renamed" in lines


def test_a_box_whose_file_has_no_such_name_is_told_what_it_must_be(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight.segments[1].rename(tmp_path / "box.mcap")
    for log, why in (
        (tmp_path, "holds no black box: no file is named vehicle-K-flight-F-S.mcap"),
        (tmp_path / "box.mcap", "is no black box: must be a folder, or vehicle-K-flight-F-S.mcap in it"),
    ):
        assert cli.main(["replay", str(log)]) == 2
        assert capsys.readouterr().err == f"companion: {log}: {why}\n"


def test_all_flights_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each start of a companion is one."""
    for _ in range(2):
        recorder, _ = recorder_of(DirectWriter(files_of(tmp_path, START, waits_for_disk=False)))
        fly_ticks(recorder, 10)
        recorder.close("ended")
    assert cli.main(["replay", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "vehicle 3, flight 2" in out
    assert out.count("SAME: ") == 2
