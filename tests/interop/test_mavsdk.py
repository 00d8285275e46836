"""MAVSDK 4.1 takes the bridge for a PX4, and for an ArduPilot."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from interop_kit import Served, child

from mission.cli.main import main
from mission.common.frames import LocalFrame, Wgs84

pytestmark = pytest.mark.interop

PILOT = Path(__file__).with_name("mavsdk_pilot.py")
FENCE = Path(__file__).with_name("mavsdk_fence.py")
PLAN = Path(__file__).with_name("mavsdk_plan.py")
FLIGHT_LIMIT_S = 600.0
PLANNED = """
schema = 1
[origin]
lat_deg = 47.0
lon_deg = 8.0
alt_m = 400.0
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [90.0, 0.0, 7.0]
vel_leader_mps = 2.0
at_end = "return"
[[route.stops]]
pos_enu_m = [40.0, 30.0, 6.0]
duration_s = 12.0
[fence]
polygon_enu_m = [[-50.0, -50.0], [130.0, -50.0], [130.0, 80.0], [-50.0, 80.0]]
"""


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


def test_mavsdk_reads_a_plan_that_we_exported(fleet: Served, tmp_path: Path) -> None:
    mission = tmp_path / "my.toml"
    mission.write_text(PLANNED, encoding="utf-8")
    assert main(["export", str(mission), "--out", str(tmp_path / "my.plan")]) == 0
    command = [sys.executable, str(PLAN), fleet.vehicle(2)["mavsdk"], str(tmp_path / "my.plan")]
    with child(command, tmp_path, "plan", stdout=subprocess.PIPE) as client:
        printed, _ = client.communicate(timeout=FLIGHT_LIMIT_S)
    assert client.returncode == 0, (tmp_path / "plan.err").read_text()
    seen = json.loads(printed.splitlines()[-1])
    frame = LocalFrame(Wgs84(47.0, 8.0, 400.0))

    def degrees_e7(east_m: float, north_m: float) -> list[int]:
        at = frame.to_wgs84((north_m, east_m, 0.0))
        return [round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)]

    relative, mission_frame = 3, 2  # MAV_FRAME_GLOBAL_RELATIVE_ALT, MAV_FRAME_MISSION
    takeoff, speed, stop, d2, home = seen["mission"]
    assert takeoff == [22, relative, 0.0, *degrees_e7(0.0, 0.0), 5.0]
    assert speed[:3] == [178, mission_frame, 1.0]
    assert stop == [19, relative, 12.0, *degrees_e7(40.0, 30.0), 6.0]
    assert d2 == [19, relative, 60.0, *degrees_e7(90.0, 0.0), 7.0]
    assert home[0] == 20
    corners = ((-50.0, -50.0), (130.0, -50.0), (130.0, 80.0), (-50.0, 80.0))
    assert seen["fence"] == [[5001, 4.0, *degrees_e7(*corner)] for corner in corners]


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
