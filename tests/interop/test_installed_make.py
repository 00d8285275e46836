"""A make of autopilot in a package of its own, as the how-to has it: built, installed, flown over its own simulator."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.installed_kit import pip_install

pytestmark = pytest.mark.interop

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "docs" / "examples" / "meadow_make"
HOW_TO = ROOT / "docs" / "how-to" / "add-an-autopilot-make.md"
FLIGHT_LIMIT_S = 600.0
MISSION = """
schema = 1
name = "meadow"
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [20.0, 0.0, 4.0]
vel_leader_mps = 2.0
[coverage]
duration_s = 5.0
radius_m = 12.0
[swarm]
size = 2
"""


def test_an_installed_make_is_flown_over_its_simulator(tmp_path: Path) -> None:
    site = pip_install(PACKAGE, tmp_path)
    (tmp_path / "mission.toml").write_text(MISSION, encoding="utf-8")
    launch = f"{sys.executable} -m meadow_simulator {{port}} {{sysid}}"
    over = ("--autopilots", "udpin://127.0.0.1:{port}", "--launch", launch)
    command = [sys.executable, "-m", "sim_bridge.cli", "fly", "mission.toml", *over, "--out", "run"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(site), str(ROOT)))}
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=FLIGHT_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    kept = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert kept["verdict"].startswith("ARRIVED")
    logs = "".join(file.read_text(encoding="utf-8") for file in (tmp_path / "run" / "companions").glob("*.log"))
    assert "landed" in logs


def test_the_example_make_stands_in_the_how_to() -> None:
    blocks = re.findall(r"^```\w+\n(.*?)^```$", HOW_TO.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for name in ("pyproject.toml", "meadow_make.py"):
        assert (PACKAGE / name).read_text(encoding="utf-8") in blocks
