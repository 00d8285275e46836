"""Stand files of a flight: where they are on Earth, and what is said of it."""

from __future__ import annotations

import errno
import json
import os
import sqlite3
from pathlib import Path
from unittest.mock import Mock

import pytest

from mission.stand.stand import stand_of
from sim_bridge.drive.lockstep.harvest import BASE_FILE, Harvest
from sim_bridge.drive.stand_files import PLACED, STAND_FOLDER, write_stand
from sim_bridge.errors import StartError
from sim_bridge.world.radio import radio_of
from tests.unit.stand.test_products import ORIGIN, mission


def empty_store(folder: Path) -> None:
    with sqlite3.connect(folder / BASE_FILE) as database:
        database.execute("CREATE TABLE record (vehicle_id, log_id, number, kind, made_s, body)")
    database.close()


def test_a_mission_without_an_origin_is_said_to_be_at_the_simulators(tmp_path: Path) -> None:
    empty_store(tmp_path)
    assert write_stand(mission(), tmp_path).lines[0].endswith(f"; {PLACED}")
    assert "placed at the simulator&#x27;s default origin" in (tmp_path / STAND_FOLDER / "report.html").read_text()


def test_a_mission_with_an_origin_is_there_and_nothing_is_said(tmp_path: Path) -> None:
    empty_store(tmp_path)
    assert not any("[origin]" in line for line in write_stand(mission(origin=ORIGIN), tmp_path).lines)
    told = json.loads((tmp_path / STAND_FOLDER / "stand.json").read_text())
    assert told["origin"] == ORIGIN


def test_a_file_that_cannot_be_written_is_named_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty_store(tmp_path)
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr(Path, "write_bytes", Mock(side_effect=full))
    lines, unwritten = write_stand(mission(), tmp_path)
    place = tmp_path / STAND_FOLDER / "stems.gpkg"
    assert (lines, unwritten) == ([], [f"{place}: cannot be written: No space left on device"])
    assert list((tmp_path / STAND_FOLDER).iterdir()) == []


def test_a_base_station_without_room_for_its_file_is_named(tmp_path: Path) -> None:
    (tmp_path / BASE_FILE).mkdir()
    with pytest.raises(StartError, match=f"{BASE_FILE}: cannot be written: is no file") as refused:
        Harvest(surveyed := mission(), stand_of(surveyed), radio_of(surveyed, stand_of(surveyed)), tmp_path)
    assert refused.value.exit_code == 3
