"""Stand files of a flight: where they are on Earth, and what is said of it."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

from sim_bridge.drive.lockstep.harvest import BASE_FILE
from sim_bridge.drive.stand_files import PLACED, STAND_FOLDER, write_stand
from tests.unit.stand.test_products import ORIGIN, mission


def empty_store(folder: Path) -> None:
    with sqlite3.connect(folder / BASE_FILE) as database:
        database.execute("CREATE TABLE record (vehicle_id, log_id, number, kind, made_s, body)")
    database.close()


def test_a_mission_without_an_origin_is_said_to_be_at_the_simulators(tmp_path: Path) -> None:
    empty_store(tmp_path)
    assert write_stand(mission(), tmp_path)[0].endswith(f"; {PLACED}")
    assert "placed at the simulator&#x27;s default origin" in (tmp_path / STAND_FOLDER / "report.html").read_text()


def test_a_mission_with_an_origin_is_there_and_nothing_is_said(tmp_path: Path) -> None:
    empty_store(tmp_path)
    assert not any("[origin]" in line for line in write_stand(mission(origin=ORIGIN), tmp_path))
    told = json.loads((tmp_path / STAND_FOLDER / "stand.json").read_text())
    assert told["origin"] == ORIGIN
