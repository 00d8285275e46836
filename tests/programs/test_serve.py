"""`sim-bridge serve` as a program."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mission.load import parse_mission
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
        "import argparse, sys; from sim_bridge.drive import serve; "
        "from sim_bridge.options.serve import configure; p = argparse.ArgumentParser(); "
        "configure(p); sys.exit(serve.run(p.parse_args()))"
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
