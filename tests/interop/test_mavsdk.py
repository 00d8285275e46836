"""MAVSDK 4.1 takes the bridge for a PX4, and for an ArduPilot."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from interop_kit import Served, child

pytestmark = pytest.mark.interop

PILOT = Path(__file__).with_name("mavsdk_pilot.py")
FENCE = Path(__file__).with_name("mavsdk_fence.py")
FLIGHT_LIMIT_S = 600.0


def test_mavsdk_uploads_a_fence_and_reads_it_back(vehicles: Served, tmp_path: Path) -> None:
    command = [sys.executable, str(FENCE), vehicles.vehicle(2)["mavsdk"]]
    with child(command, tmp_path, "fence", stdout=subprocess.PIPE) as client:
        printed, _ = client.communicate(timeout=FLIGHT_LIMIT_S)
    assert client.returncode == 0, (tmp_path / "fence.err").read_text()
    seen = json.loads(printed.splitlines()[-1])
    assert seen == {
        "items": [
            [5001, 4.0, 473980000, 85450000],
            [5001, 4.0, 473980000, 85470000],
            [5001, 4.0, 473970000, 85470000],
            [5001, 4.0, 473970000, 85450000],
            [5004, 3.5, 473980000, 85450000],
        ],
        "left": 0,
    }


def test_mavsdk_takes_off_flies_offboard_and_lands(vehicles: Served, personality: str, tmp_path: Path) -> None:
    command = [sys.executable, str(PILOT), personality, vehicles.vehicle(1)["mavsdk"]]
    with child(command, tmp_path, "pilot", stdout=subprocess.PIPE) as pilot:
        printed, _ = pilot.communicate(timeout=FLIGHT_LIMIT_S)
    assert pilot.returncode == 0, (tmp_path / "pilot.err").read_text()
    seen = json.loads(printed.splitlines()[-1])  # MAVSDK logs there too
    assert seen["takeoff_altitude_m"] == 3.0
    assert seen["height_m"] == pytest.approx(3.0, abs=0.8)
    north_m, east_m, down_m = seen["moved_ned_m"]
    assert north_m == pytest.approx(-2.0 * east_m, rel=0.15)  # as commanded: 1 m/s north, 0.5 m/s west
    assert abs(down_m) < 0.8
    assert seen["vel_ned_mps"] == pytest.approx([1.0, -0.5, 0.0], abs=0.15)
