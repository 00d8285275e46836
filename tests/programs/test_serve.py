"""`sim-bridge serve` as a program."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from websockets.sync.client import connect

from mission.document.load import parse_mission
from sim_bridge.world.world import DEFAULT_ORIGIN

MISSION = """
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [60.0, 0.0, 8.0]
vel_leader_mps = 2.0
"""


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_it_names_where_to_connect_runs_and_ends_when_told(tmp_path: Path, ending: signal.Signals) -> None:
    mission_file = tmp_path / "mission.toml"
    mission_file.write_text(MISSION, encoding="utf-8")
    out = tmp_path / "flown.toml"
    code = (
        "import argparse, sys; from sim_bridge.drive.serve import program; "
        "from sim_bridge.options.serve import configure; p = argparse.ArgumentParser(); "
        "configure(p); sys.exit(program.run(p.parse_args()))"
    )
    command = [sys.executable, "-c", code, str(mission_file), "-n", "2", "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert "2 vehicles" in process.stdout.readline()
        process.send_signal(ending)
        printed, errors = process.stdout.read(), process.stderr.read()
    assert (process.returncode, errors) == (0, "")
    assert printed.count("--master=udpout:127.0.0.1:") == 3
    assert f"companion run --mission {out} --id 2 --autopilot udpout://127.0.0.1:" in printed
    assert parse_mission(out.read_text()).origin == DEFAULT_ORIGIN


def test_its_map_shows_the_world_and_takes_a_radio_away_but_kills_no_companion(tmp_path: Path) -> None:
    mission_file = tmp_path / "mission.toml"
    mission_file.write_text(MISSION, encoding="utf-8")
    command = [sys.executable, "-P", "-m", "sim_bridge.cli", "serve", str(mission_file), "-n", "2", "--map", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["map"]
        with connect(url.replace("http", "ws") + "live", max_size=None) as viewer:
            first = json.loads(viewer.recv(timeout=60))
            assert first["controls"] == ["radio", "wind"]
            assert len(first["replay"]["vehicles"]) == 2
            viewer.send(json.dumps({"do": "kill", "vehicle": 1}))
            viewer.send(json.dumps({"do": "radio", "vehicle": 9}))
            viewer.send(json.dumps({"do": "radio", "vehicle": 2, "for_s": 0.3}))
            said: list[str] = []
            rows = 0
            while len(said) < 3 or rows < 5:
                told = json.loads(viewer.recv(timeout=60))
                said += [event["text"] for event in told.get("events", [])]
                rows += len(told.get("rows", []))
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert said[0].startswith("not done: the map: sim.faults[0].vehicles = [9]")
    assert said[1:3] == ["vehicle 2 cut off from the others for 0.3 s", "fault over: vehicle 2 reconnected"]
    assert "killed" not in errors
