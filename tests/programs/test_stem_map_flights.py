"""Missions with a stem map beside them: flown, reported, served, and refused before anything is written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mission.common.problems import MissionError
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.schema.trees import StandTree
from mission.stems.write import to_csv
from sim_bridge.lab.study.load import load_study
from tests.flights import short_mission


@pytest.fixture
def mapped(tmp_path: Path) -> Path:
    """A vehicle alone to a tree 20 m off, past one beside the way."""
    mission = short_mission(swarm={"size": 1}, route={"d2_enu_m": (20, 0, 4)}, sensing={}, forest={"file": "stems.csv"})
    file = tmp_path / "mapped.toml"
    file.write_text(dump_mission(mission))
    trees = [StandTree(20.0, 0.0, 0.2, 18.0, 9.0, 3.0), StandTree(9.0, 5.0, 0.15, 15.0, 8.0, 3.0)]
    (tmp_path / "stems.csv").write_text(to_csv(trees))
    return file


def sim_bridge(*args: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sim_bridge.cli", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_flight_among_measured_trees_leaves_a_run_folder_that_reports_the_same(mapped: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = sim_bridge("fly", mapped, "--agents", "in-process", "--json", "--out", folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "stems.csv").read_text() == mapped.with_name("stems.csv").read_text()
    flown = json.loads(done.stdout)
    assert 1.0 < flown["trunk_clearance_min_m"] < 5.5

    mapped.with_name("stems.csv").unlink()  # the run folder has its own
    again = sim_bridge("report", "--json", folder)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["trunk_clearance_min_m"] == flown["trunk_clearance_min_m"]


def test_a_bad_map_is_refused_before_there_is_a_run_folder(mapped: Path, tmp_path: Path) -> None:
    with mapped.with_name("stems.csv").open("a") as file:
        file.write("0.2,0.1,30,20,12,3,spruce\n")
    folder = tmp_path / "run"
    for command in (("fly", mapped, "--out", folder), ("serve", mapped)):
        done = sim_bridge(*command)
        assert done.returncode == 2
        assert "stems.csv:4: the tree at 0.20 east, 0.10 north: stands 0.1 m from d1" in done.stderr
    assert not folder.exists()


def test_studies_do_not_fly_measured_stands(mapped: Path) -> None:
    study = mapped.with_name("study.toml")
    study.write_text('schema = 1\nmissions = ["mapped.toml"]\n[[run]]\nname = "ours"\n')
    with pytest.raises(MissionError, match=r"has a stem map: studies fly stands that are grown, \[forest.stand\]"):
        load_study(study)


def test_a_companions_mission_needs_no_map(mapped: Path, tmp_path: Path) -> None:
    """It is read alone, and is as small as any."""
    from mission.document.load import MAX_FILE_BYTES, load_mission

    alone = tmp_path / "elsewhere.toml"
    alone.write_text(dump_mission(load_mission(mapped)))
    assert isinstance(load_mission(alone), Mission)
    assert alone.stat().st_size < MAX_FILE_BYTES / 10
