"""Tools that others wrote, on the logs of a flight."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from interop_kit import START_LIMIT_S

from tests.flights import flown, short_mission

pytestmark = pytest.mark.interop


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    outcome, shown = flown(short_mission(swarm={"size": 2}, sim={"personality": request.param}), folder)
    assert outcome.succeeded, shown
    return folder


def tool(name: str, *arguments: str | Path) -> str:
    program = Path(sys.executable).with_name(name)
    command = [sys.executable, program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=START_LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_mavtogpx_makes_a_track(run: Path) -> None:
    said = tool("mavtogpx.py", run / "vehicle-1.tlog")
    (count,) = re.findall(r"with (\d+) points", said)
    gpx = (run / "vehicle-1.tlog.gpx").read_text()
    assert int(count) == gpx.count("<trkpt") > 100


def test_mavsummarize_knows_how_far_and_how_long_it_flew(run: Path) -> None:
    said = tool("mavsummarize.py", run / "vehicle-1.tlog")
    assert "No GPS data" not in said
    distance_m = re.findall(r"Total distance : ([\d.]+)m", said)[0]
    assert 30.0 < float(distance_m) < 150.0


def test_mavlogdump_finds_what_ground_stations_show(run: Path) -> None:
    said = tool("mavlogdump.py", run / "vehicle-1.tlog")
    kinds = re.findall(r": ([A-Z0-9_]+) \{", said)
    assert {"GLOBAL_POSITION_INT", "GPS_RAW_INT", "ATTITUDE", "BATTERY_STATUS", "STATUSTEXT"} <= set(kinds)
