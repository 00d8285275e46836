"""`sim-bridge report` on a run folder."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

from mission.load import dump_mission
from mission.model import Mission
from mission.problems import MissionError
from sim_bridge import report
from sim_bridge.recording import Recording
from sim_bridge.report import run_folder
from sim_bridge.report.run_folder import RunFolderError

MISSION = Mission.model_validate(
    {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (50.0, 0.0, 8.0), "vel_leader_mps": 2.0},
        "swarm": {"size": 1},
    }
)


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    report.configure(parser)
    return parser.parse_args(arguments)


def save_flight(folder: Path) -> None:
    """One vehicle arrives after two ticks."""
    one = np.ones((2, 1), dtype=np.bool_)
    recording = Recording(
        time_s=np.array([0.0, 25.0]),
        pos_ned_m=np.array([[[0.0, 0.0, -8.0]], [[0.0, 48.0, -8.0]]]),
        vel_ned_mps=np.zeros((2, 1, 3)),
        on_ground=~one,
        armed=one,
        agent_alive=one,
        range_m=np.where(one, 30.0, 0.0),
        phase=np.full((2, 1), 2, dtype=np.int8),
        acting=one,
        leader=one.astype(np.int16),
    )
    run_folder.save(recording, folder)


def test_it_prints_the_figures_and_draws_the_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_flight(tmp_path)
    (tmp_path / "mission.toml").write_text(dump_mission(MISSION), encoding="utf-8")
    assert report.run(parsed(str(tmp_path))) == 0
    assert "arrival_last_s                 25\n" in capsys.readouterr().out
    assert (tmp_path / "flight.png").is_file()
    assert report.run(parsed(str(tmp_path), "--json")) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["overhead_last"] == pytest.approx(25.0 / 22.5 - 1.0)
    assert figures["min_separation_m"] is None


def test_a_folder_without_a_flight_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match=r"recording\.npz"):
        report.run(parsed(str(tmp_path)))
    save_flight(tmp_path)
    with pytest.raises(MissionError, match=r"mission\.toml"):
        report.run(parsed(str(tmp_path)))
    assert not (tmp_path / "flight.png").exists()
