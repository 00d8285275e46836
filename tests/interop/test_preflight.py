"""`companion preflight`, by MAVSDK, on a vehicle of `sim-bridge serve`; and what a companion does with its report."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, Served, Station, child, listening, mavlink, serving

from companion.mavlink.endpoint import COMPONENT
from tests.unit.keys.keys_kit import key_file, operator_of, vehicle_of

pytestmark = pytest.mark.interop

COPTER, ME = 1, 2  # ArduPilot, PX4
LIMIT_S = 300.0  # until all is well: a copter gets ready meanwhile, a busy machine less busy
RATES = {"heartbeat", "link"}  # by the wall clock: a busy machine's own fault
MISSION = """
schema = 1
name = "preflight"
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [60.0, 0.0, 5.0]
vel_leader_mps = 2.0
[swarm]
size = 2
[fence]
polygon_enu_m = [[-40.0, -40.0], [110.0, -45.0], [115.0, 50.0], [-40.0, 40.0]]
[sim]
placement = "grid"
[sim.personalities]
1 = "ardupilot"
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("preflight"), MISSION) as served:
        with listening(served) as station:
            station.until_ready(ME)
        yield served


def preflight(
    served: Served, *options: str, of: int = ME, vehicle_id: int = 0, url: str = "", mission: str = ""
) -> tuple[int, dict[str, Any], str]:
    """Exit code, the report, stderr; of one vehicle, under a false id or mission if one is given."""
    command = [sys.executable, "-m", "companion.cli", "preflight", "--json", *options]
    command += ["--mission", mission or served.notice["mission"]]
    command += ["--id", str(vehicle_id or of), "--autopilot", url or served.vehicle(of)["mavsdk"]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    report = json.loads(done.stdout or "{}")
    if report:
        fails = bool(failed(report, despite=set()))
        assert (done.returncode, report["verdict"] == "fail") == (int(fails), fails)
    return done.returncode, report, done.stderr


def failed(report: dict[str, Any], *, despite: set[str] = RATES) -> set[str]:
    """Names of the checks that fail, but `despite`."""
    return {check["name"] for check in report["checks"] if check["verdict"] == "fail"} - despite


def passes(served: Served, of: int) -> None:
    """All of it, rates too, in one of some looks."""
    until_s = time.monotonic() + LIMIT_S
    while time.monotonic() < until_s:
        code, report, _ = preflight(served, "--apply", of=of)
        if code == 0:
            return
        assert failed(report) <= {"ready", "home", "autopilot"}  # the last: unanswered in time, on a busy machine
    raise AssertionError(report)


def found(report: dict[str, Any], name: str) -> str:
    text: str = next(check["found"] for check in report["checks"] if check["name"] == name)
    return text


def set_parameter(station: Station, name: str, value: int | float) -> None:
    """As PX4 takes it: an int in the bytes of the float."""
    is_int = isinstance(value, int)
    wire = struct.unpack("<f", struct.pack("<i", value))[0] if is_int else value
    kind = mavlink.MAV_PARAM_TYPE_INT32 if is_int else mavlink.MAV_PARAM_TYPE_REAL32
    station.link.mav.param_set_send(ME, 1, name.encode(), wire, kind)
    station.until(
        lambda m: m.get_type() == "PARAM_VALUE" and (m.get_srcSystem(), m.param_id) == (ME, name), f"{name} set"
    )


def test_bad_parameters_fail_are_set_by_apply_and_stay(served: Served, tmp_path: Path) -> None:
    key = str(key_file(tmp_path / "vehicle.key", vehicle_of(operator_of(2), ME)))
    _, report, errors = preflight(served, "--apply", "--key", key)
    assert (failed(report), errors) == (set(), "")
    assert found(report, "key").startswith(f"vehicle {ME}, fleet ")
    assert report["autopilot"] == "px4"
    assert report["version"] == "1.16.0"
    with listening(served) as station:
        set_parameter(station, "NAV_RCL_ACT", 2)
        set_parameter(station, "COM_OF_LOSS_T", 1.0)
    code, report, _ = preflight(served)
    assert (code, failed(report)) == (1, {"NAV_RCL_ACT", "COM_OF_LOSS_T"})
    file = tmp_path / "report.json"
    _, report, _ = preflight(served, "--apply", "--report", str(file))
    assert not failed(report)
    assert report["applied"] == {"NAV_RCL_ACT": 1, "COM_OF_LOSS_T": 0.5}
    assert json.loads(file.read_text()) == report
    _, report, _ = preflight(served)
    assert (failed(report), report["applied"]) == (set(), {})
    passes(served, ME)


def test_wrong_id_fails_and_a_silent_or_taken_port_is_the_environments(served: Served, tmp_path: Path) -> None:
    key = str(key_file(tmp_path / "vehicle.key", vehicle_of(operator_of(2), ME)))
    code, report, _ = preflight(served, "--key", key, vehicle_id=COPTER)
    assert (code, failed(report)) == (1, {"id", "key"})
    assert f"is vehicle {ME}: must be vehicle {COPTER}" in found(report, "key")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, errors = preflight(served, url=f"udpin://127.0.0.1:{port}")
        assert (code, "the port is taken" in errors) == (3, True)
        code, _, errors = preflight(served, url=f"udpout://127.0.0.1:{port}")
        assert (code, "no autopilot is heard" in errors) == (3, True)


@pytest.mark.parametrize("vehicle_id", [ME, COPTER])
def test_fence_that_is_not_the_missions_is_found_and_replaced(served: Served, tmp_path: Path, vehicle_id: int) -> None:
    text = Path(served.notice["mission"]).read_text()
    moved = tmp_path / "moved.toml"
    moved.write_text(text.replace("115.0", "115.1"))  # one vertex, by 10 cm
    assert moved.read_text() != text
    _, report, _ = preflight(served, "--apply", of=vehicle_id, mission=str(moved))
    assert "fence" not in failed(report)
    _, report, _ = preflight(served, of=vehicle_id)
    assert "fence" in failed(report)
    assert "item 3 is inclusion vertex" in found(report, "fence")
    _, report, _ = preflight(served, "--apply", of=vehicle_id)
    assert "fence" not in failed(report)
    assert report["applied"] == {"fence": 4}


def test_ardupilot_passes_once_it_is_truly_ready(served: Served) -> None:
    _, report, _ = preflight(served, "--apply", of=COPTER)
    assert report["autopilot"] == "ardupilot"
    with listening(served) as station:
        for _ in range(3):  # a busy machine's sockets may lose one
            station.link.mav.param_set_send(COPTER, 1, b"FS_THR_ENABLE", 1.0, mavlink.MAV_PARAM_TYPE_INT8)
        station.until(lambda m: m.get_type() == "PARAM_VALUE" and m.param_id == "FS_THR_ENABLE", "set")
    _, report, _ = preflight(served, of=COPTER)
    assert "FS_THR_ENABLE" in failed(report)
    passes(served, COPTER)


def test_companion_without_a_passing_report_does_not_arm_and_says_so(served: Served, tmp_path: Path) -> None:
    program, *options = served.vehicle(ME)["companion"]
    assert options[-3:] == ["--waive", "all", "--unsigned"]
    log = tmp_path / "flight.log"
    command = [sys.executable, "-m", f"{program}.cli", *options[:-3], "--unsigned", "--log", str(log)]
    with listening(served) as station, child(command, tmp_path, "companion", stdin=subprocess.DEVNULL):
        said: set[str] = set()
        for message in station.messages(HAPPEN_LIMIT_S):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            assert not (
                message.get_type() == "HEARTBEAT"
                and sender == (ME, 1)
                and message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            )
            if message.get_type() == "STATUSTEXT" and sender == (ME, COMPONENT):
                said.add(message.text)
                if message.text.startswith("waiting: grounded, no preflight"):
                    station.command(ME, COMPONENT, mavlink.MAV_CMD_MISSION_START)
                if message.text.startswith("grounded, no preflight"):
                    break
    assert any(text.startswith("grounded, no preflight") for text in said)
    assert "GROUNDED, nothing is armed: no preflight" in log.read_text()
