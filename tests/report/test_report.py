"""`sim-bridge report` on a run folder."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import numpy as np
import pytest

from mission.common.problems import MissionError
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.judge import run_folder
from sim_bridge.judge.outcome import NAME_CHARS
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.run_folder import RunFolderError, load
from sim_bridge.lab import report
from sim_bridge.options import report as report_options

MISSION = Mission.model_validate(
    {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (50.0, 0.0, 8.0), "vel_leader_mps": 2.0},
        "swarm": {"size": 1},
    }
)


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    report_options.configure(parser)
    return parser.parse_args(arguments)


def save_flight(folder: Path, *, alive_at_end: bool = True) -> None:
    """One vehicle arrives after two ticks."""
    one = np.ones((2, 1), dtype=np.bool_)
    recording = Recording(
        time_s=np.array([0.0, 25.0]),
        pos_ned_m=np.array([[[0.0, 0.0, -8.0]], [[0.0, 48.0, -8.0]]]),
        vel_ned_mps=np.zeros((2, 1, 3)),
        on_ground=~one,
        armed=one,
        touched=np.zeros((2, 1), np.int8),
        agent_alive=np.array([[True], [alive_at_end]]),
        range_m=np.where(one, 30.0, 0.0),
        phase=np.full((2, 1), 2, dtype=np.int8),
        acting=one,
        leader=one.astype(np.int16),
    )
    run_folder.save(recording, folder)


def test_it_prints_the_figures_and_writes_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_flight(tmp_path)
    (tmp_path / "mission.toml").write_text(dump_mission(MISSION), encoding="utf-8")
    assert report.run(parsed(str(tmp_path))) == 0
    assert f"  {'departure to arrival of all, s':<{NAME_CHARS}} 25\n" in capsys.readouterr().out
    assert (tmp_path / "report.html").is_file()
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
    assert not (tmp_path / "report.html").exists()


def save_end(folder: Path, ended: str, mission: Mission = MISSION) -> None:
    """What `fly` leaves besides the recording."""
    text = dump_mission(mission)
    (folder / "mission.toml").write_text(text, encoding="utf-8")
    kept = {"ended": ended, "mission_sha256": run_folder.mission_sha256(text.encode())}
    (folder / "metrics.json").write_text(json.dumps(kept), encoding="utf-8")


NO_COVERAGE = Mission.model_validate({**MISSION.model_dump(by_alias=True), "coverage": {"duration_s": 0.0}})


@pytest.mark.parametrize(
    ("mission", "ended", "verdict", "code"),
    [
        (NO_COVERAGE, "coverage complete", "ARRIVED", 0),
        (MISSION, "coverage complete", "INCOMPLETE: no coverage", 1),
        (NO_COVERAGE, "time limit of 20 s reached", "INCOMPLETE: time limit of 20 s reached", 1),
    ],
)
def test_it_judges_the_flight_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mission: Mission, ended: str, verdict: str, code: int
) -> None:
    save_flight(tmp_path)
    save_end(tmp_path, ended, mission)
    assert report.run(parsed(str(tmp_path))) == code
    shown = capsys.readouterr()
    assert shown.out.endswith(f"\n{verdict}\n")
    assert f"  {'ended':<{NAME_CHARS}} {ended}\n" in shown.out
    assert shown.err == ""
    assert report.run(parsed(str(tmp_path), "--json")) == code
    figures = json.loads(capsys.readouterr().out)
    assert (figures["ended"], figures["verdict"]) == (ended, verdict)


def test_one_that_a_fault_killed_is_excused_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_flight(tmp_path, alive_at_end=False)
    save_end(tmp_path, "no companion left", NO_COVERAGE)
    report.run(parsed(str(tmp_path)))
    assert "lost vehicle 1" in capsys.readouterr().out
    row = {"kind": "kill", "vehicles": [1], "at_s": 9.0, "until_s": None, "late_s": None, "asked": "kill 1@9"}
    (tmp_path / "faults.json").write_text(json.dumps([row]), encoding="utf-8")
    report.run(parsed(str(tmp_path)))
    shown = capsys.readouterr().out
    assert "lost vehicle 1" not in shown
    assert "\nDEGRADED without 1: " in shown


def test_a_fault_is_recent_by_the_end_of_the_flight_not_of_its_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A survey is recorded for as long as records are on their way to the base station."""
    save_flight(tmp_path)
    save_end(tmp_path, "time limit of 4 s reached", NO_COVERAGE)
    last_s = float(load(tmp_path).time_s[-1])
    row = {"kind": "blind", "vehicles": [1], "at_s": -40.0, "until_s": last_s - 31.0, "asked": "blind 1@0"}
    (tmp_path / "faults.json").write_text(json.dumps([row]), encoding="utf-8")
    report.run(parsed(str(tmp_path)))
    assert "\nINCOMPLETE: " in capsys.readouterr().out
    end = json.loads((tmp_path / "metrics.json").read_text())
    (tmp_path / "metrics.json").write_text(json.dumps(end | {"end_s": last_s - 2.0}), encoding="utf-8")
    report.run(parsed(str(tmp_path)))
    assert "\nDEGRADED: " in capsys.readouterr().out


def test_without_metrics_json_there_is_no_verdict_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_flight(tmp_path)
    (tmp_path / "mission.toml").write_text(dump_mission(MISSION), encoding="utf-8")
    assert report.run(parsed(str(tmp_path))) == 0
    assert "metrics.json: missing: why the flight ended is not known" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "has no ended"),
        ("[]", r"is \[\]: must be an object"),
        ("", "line 1: is no JSON"),
        ("\n{", "line 2: is no JSON"),
        ("\xff", "is no UTF-8 text"),
        ("[" * 100_000, "is nested too deep"),
        ('{"ended": 7}', "ended = 7: must be text"),
        ('{"ended": "all landed", "end_s": "late"}', r'end_s = "late": must be a number, at most 1e\+07, or null'),
        ('{"ended": "all landed", "mission_sha256": [1]}', r"mission_sha256 = \[1\]: must be text"),
    ],
    ids=lambda text: text[:20],
)
def test_a_damaged_metrics_json_is_refused_in_a_line(tmp_path: Path, text: str, words: str) -> None:
    save_flight(tmp_path)
    save_end(tmp_path, "all landed")
    (tmp_path / "metrics.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(RunFolderError, match=rf"metrics\.json: must be the figures of a flight: {words}"):
        report.run(parsed(str(tmp_path)))


def test_what_ended_a_flight_is_shown_without_control_characters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_flight(tmp_path)
    save_end(tmp_path, "\x1b[2J\nARRIVED")
    report.run(parsed(str(tmp_path)))
    assert "\x1b" not in (shown := capsys.readouterr().out)
    assert "\nARRIVED" not in shown


def test_a_mission_that_is_not_the_one_flown_is_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_flight(tmp_path)
    save_end(tmp_path, "coverage complete")
    (tmp_path / "mission.toml").write_text(dump_mission(NO_COVERAGE), encoding="utf-8")
    report.run(parsed(str(tmp_path)))
    assert "mission.toml: was changed after the flight" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["metrics.json", "faults.json"])
def test_a_named_pipe_in_a_files_place_is_refused_and_not_waited_for(name: str, tmp_path: Path) -> None:
    save_flight(tmp_path)
    (tmp_path / "mission.toml").write_text(dump_mission(MISSION), encoding="utf-8")
    os.mkfifo(tmp_path / name)
    with pytest.raises(RunFolderError, match=rf"{name}: must be the \w+ of a flight: is no regular file"):
        report.run(parsed(str(tmp_path)))


def test_a_folder_in_the_pages_place_is_refused_by_name(tmp_path: Path) -> None:
    save_flight(tmp_path)
    save_end(tmp_path, "coverage complete")
    (tmp_path / "report.html").mkdir()
    with pytest.raises(RunFolderError, match=r"report\.html: is a folder: must be a file") as caught:
        report.run(parsed(str(tmp_path)))
    assert caught.value.exit_code == 2
