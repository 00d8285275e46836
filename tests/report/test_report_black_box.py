"""Cuts and beacons of black boxes, in the page and on the terminal."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.journal.recorder import files_of
from companion.journal.segments import DirectWriter
from sim_bridge.judge.page.black_boxes import FOLDER_NAME, box_lines, box_section, damage_lines, read_boxes
from sim_bridge.lab import report
from tests.flights import flown, short_mission
from tests.report.test_report import parsed
from tests.unit.journal.journal_kit import START, fly_ticks, forge, recorder_of
from tests.unit.journal.test_journal_chain import change_input

SUMMED = "  10 ticks, 0.00 to 0.45 s after the first, which was at 10.00 s of the companion's clock"


def change_one(path: Path) -> None:
    forge(path, change_input)


def change_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def make_random(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 10)


def make_empty(path: Path) -> None:
    path.write_bytes(b"")


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def make_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def make_dangling(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def cut_end(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def flights(folder: Path, ticks: int = 10) -> list[Path]:
    """Three of one vehicle; the files of their boxes."""
    for _ in range(3):
        recorder, _ = recorder_of(DirectWriter(files_of(folder / FOLDER_NAME, START, waits_for_disk=False)))
        fly_ticks(recorder, ticks)
        recorder.close("ended")
    return sorted((folder / FOLDER_NAME).iterdir())


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize(
    ("damage", "what"),
    [
        (make_random, "broken chain: NAME, byte 0: no MCAP file"),
        (make_empty, "its beginning is missing"),
        (make_folder, "cannot be read: Is a directory"),
        (make_pipe, "is not a regular file"),
        (make_dangling, "cannot be read: No such file or directory"),
    ],
)
def test_what_is_no_box_is_named_and_the_others_are_summed(
    damage: Callable[[Path], None], what: str, at: int, tmp_path: Path
) -> None:
    file = flights(tmp_path)[at]
    damage(file)
    boxes = read_boxes(tmp_path)
    what = what.replace("NAME", file.name)
    assert damage_lines(boxes) == [f"{file}: is a damaged black box: {what}"]
    lines = box_lines(boxes)
    assert lines[lines.index(f"black box of vehicle 3, flight {at + 1}") + 1] == f"  DAMAGED: {what}"
    assert lines.count(SUMMED) == 2
    page = box_section(boxes)
    assert f'<td>3</td><td>{at + 1}</td><td colspan="4">DAMAGED: {what}</td>' in page
    assert page.count("<td>beacons kept</td>") == 2


@pytest.mark.parametrize("damage", [change_one, change_byte])
def test_a_box_that_was_changed_is_not_summed_without_a_word(damage: Callable[[Path], None], tmp_path: Path) -> None:
    file = flights(tmp_path, ticks=40)[1]
    damage(file)
    boxes = read_boxes(tmp_path)
    (line,) = damage_lines(boxes)
    assert line.startswith(f"{file}: is a damaged black box: broken chain: ")
    assert sum(line.startswith("  DAMAGED: broken chain: ") for line in box_lines(boxes)) >= 1
    assert box_section(boxes).count("DAMAGED") >= 1


def test_a_box_that_ends_without_being_closed_is_told_and_is_no_damage(tmp_path: Path) -> None:
    """As a kill leaves it."""
    cut, torn, _ = flights(tmp_path)
    cut_end(cut)
    forge(torn, lambda messages: messages[:-1])
    boxes = read_boxes(tmp_path)
    assert damage_lines(boxes) == []
    lines = box_lines(boxes)
    assert lines.count(SUMMED) == 3
    told = [line for line in lines if line.startswith("  ends without being closed, ")]
    assert [line.split(": ")[0] for line in told] == [
        "  ends without being closed, behind its last entry",
        "  ends without being closed, and may lack ticks",
    ]
    assert box_section(boxes).count('<td colspan="4">ends without being closed') == 2


def test_a_box_may_be_damaged_in_many_places_and_say_what_it_likes(tmp_path: Path) -> None:
    file = flights(tmp_path)[0]
    forge(file, lambda messages: [message for message in messages for _ in range(9)])
    (box, *_) = read_boxes(tmp_path)
    assert len(box.damages) == 21
    assert box.damages[-1] == "and more"
    (line,) = damage_lines([box])
    assert line.endswith(" (and more)")


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path) -> None:
    file = tmp_path / FOLDER_NAME
    file.write_bytes(b"")
    (line,) = damage_lines(read_boxes(tmp_path))
    assert line.startswith(f"{file}: is a damaged black box: is no black box: must be a folder")
    assert FOLDER_NAME in box_section(read_boxes(tmp_path))


def test_a_report_of_a_damaged_box_is_made_and_its_exit_code_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)})
    flown(mission, tmp_path, black_box=True)
    file = tmp_path / FOLDER_NAME / "vehicle-1-flight-0001-0001.mcap"
    change_byte(file)
    for options in ([], ["--json"]):
        assert report.run(parsed(str(tmp_path), *options)) == 2
        out, err = capsys.readouterr()
        assert f"sim-bridge: {file}: is a damaged black box: broken chain: " in err
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "DAMAGED: broken chain" in page
    assert "<td>2</td><td>1</td><td>beacons kept</td>" in page
    file.unlink()
    assert report.run(parsed(str(tmp_path))) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-1].startswith("ARRIVED")
    assert err == ""


def test_a_report_shows_the_cuts_and_the_beacons_heard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mission = short_mission(swarm={"size": 2}, route={"d2_enu_m": (12, 0, 4)}, sim={"radio_loss": 0.3, "seed": 2})
    flown(mission, tmp_path, black_box=True)
    assert report.run(parsed(str(tmp_path))) == 0
    out = capsys.readouterr().out
    assert re.search(r"black box of vehicle 1, flight 1\n +\d+ ticks, 0.00 to \d+", out)
    assert re.search(r"cut by ACCELERATION +\d+\.\d % of ticks, at most \d\.\d\d m/s", out)
    assert re.search(r"of   2: kept \d+", out)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<td>cut by acceleration</td>") == 2
    assert page.count("<td>beacons kept</td>") == 2


def test_a_flight_without_black_boxes_has_no_such_table(tmp_path: Path) -> None:
    assert box_section(read_boxes(tmp_path)) == ""


def test_a_folder_of_something_else_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / FOLDER_NAME).mkdir()
    (tmp_path / FOLDER_NAME / "notes.txt").write_text("")
    assert read_boxes(tmp_path) == []
