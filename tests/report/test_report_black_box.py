"""Cuts and beacons of black boxes, in the page and on the terminal."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sim_bridge.judge.page.black_boxes import FOLDER_NAME, box_section, read_boxes
from sim_bridge.lab import report
from tests.flights import flown, short_mission
from tests.report.test_report import parsed


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
