"""Autopilots that sign, of `sim-bridge serve`: given the key by preflight, seen by it, and flown by a companion.

The ground station here is pymavlink's mavutil: with the passphrase it is answered, and without it is not.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, Served, child, listening, mavlink, serving

from companion.keys.autopilot_link import link_key
from companion.mavlink.endpoint import COMPONENT
from tests.unit.keys.keys_kit import key_file, operator_of, vehicle_of

pytestmark = pytest.mark.interop

ME = 1
LIMIT_S = 300.0
SILENCE_S = 3.0
MISSION = """
schema = 1
name = "signed"
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [60.0, 0.0, 5.0]
vel_leader_mps = 2.0
[swarm]
size = 1
[sim]
placement = "grid"
[sim.personalities]
1 = "ardupilot"
"""
VEHICLE = vehicle_of(operator_of(1), ME)


def preflight(served: Served, key: Path, *options: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The row `signing`, and the report that it stands in."""
    command = [sys.executable, "-m", "companion.cli", "preflight", "--json", "--sign-autopilot", "--key", str(key)]
    command += ["--mission", served.notice["mission"], "--id", str(ME), "--autopilot", served.vehicle(ME)["mavsdk"]]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.stdout, done.stderr
    report = json.loads(done.stdout)
    (row,) = [check for check in report["checks"] if check["name"] == "signing"]
    return row, report


def test_key_given_seen_and_flown(tmp_path: Path) -> None:
    key = key_file(tmp_path / "vehicle.key", VEHICLE)
    report = tmp_path / "report.json"
    with serving(tmp_path, MISSION) as served, listening(served) as station:
        station.until_ready(ME)
        row, _ = preflight(served, key)
        assert (row["verdict"], "not at all" in row["found"]) == ("fail", True), row
        row, found = preflight(served, key, "--apply")
        assert (row["verdict"], found["autopilot"]) == ("pass", "ardupilot"), row  # MAVSDK spoke by the relay
        row, found = preflight(served, key, "--report", str(report))
        assert row["verdict"] == "pass", row
        accepted = ["battery", *(check["name"] for check in found["checks"] if check["verdict"] == "fail")]

        station.command(ME, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        assert not [m for m in station.messages(SILENCE_S) if m.get_type() in ("COMMAND_ACK", "AUTOPILOT_VERSION")]
        station.link.setup_signing(link_key(VEHICLE), sign_outgoing=True)
        station.command(ME, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        station.until(lambda m: m.get_type() == "AUTOPILOT_VERSION", "answer to who has the key")

        log = tmp_path / "flight.log"
        program, *options = served.vehicle(ME)["companion"]
        command = [sys.executable, "-m", f"{program}.cli", *options[: options.index("--waive")]]
        command += ["--key", str(key), "--sign-autopilot", "--preflight", str(report), "--waive", ",".join(accepted)]
        with child([*command, "--log", str(log)], tmp_path, "companion", stdin=subprocess.DEVNULL):
            station.until(
                lambda m: m.get_type() == "STATUSTEXT" and (m.get_srcSystem(), m.get_srcComponent()) == (ME, COMPONENT),
                "the companion's words by the signed link",
                HAPPEN_LIMIT_S,
            )
    text = log.read_text()
    assert "autopilot link signed" in text
    assert "cleared to arm" in text
    assert "refused, unsigned" not in text
