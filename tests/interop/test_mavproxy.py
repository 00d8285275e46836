"""MAVProxy flies a vehicle; its telemetry log is read by pymavlink's own tool."""

from __future__ import annotations

import os
import re
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, START_LIMIT_S, Served, child, listening
from pymavlink import mavutil

from companion.mavlink import dialect
from sim_bridge.judge.tlog import TlogWriter

pytestmark = pytest.mark.interop

VEHICLE = 2
ORIGIN_ALT_M = 488.0  # of a mission without [origin]
TAKEOFF_M = 4.0
IN_AIR = 2  # MAV_LANDED_STATE
FAST_CM_S = 80
STAMP = struct.Struct(">Q")


class MavProxy:
    """MAVProxy's prompt: type a line, wait for a word."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self._unread = ""

    def type(self, line: str) -> None:
        """As at the keyboard."""
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def until(self, pattern: str, limit_s: float = HAPPEN_LIMIT_S) -> None:
        """Read on until `pattern` has been printed."""
        output: Any = self._process.stdout
        end_s = time.monotonic() + limit_s
        while not (match := re.search(pattern, self._unread)):
            readable, _, _ = select.select([output], [], [], max(0.0, end_s - time.monotonic()))
            data = os.read(output.fileno(), 65536) if readable else b""
            assert data, f"MAVProxy did not print {pattern!r} in {limit_s} s, but {self._unread!r}"
            self._unread += data.decode(errors="replace")
        self._unread = self._unread[match.end() :]


@contextmanager
def mavproxy(master: str, folder: Path) -> Iterator[MavProxy]:
    """At its prompt, with an empty home, logging to `folder`/it/logs; ends with its input."""
    command = [sys.executable, "-m", "MAVProxy.mavproxy", master, f"--state-basedir={folder}", "--aircraft=it"]
    environment = {**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "env": environment, "cwd": folder}
    with child(command, folder, "mavproxy", **pipes) as process:
        yield MavProxy(process)
        process.communicate(timeout=START_LIMIT_S)


@dataclass(frozen=True, slots=True)
class Flown:
    """The telemetry log of a flight that MAVProxy made: mode changes, arm, takeoff, velocity, land."""

    log: Path
    autopilot: int  # MAV_AUTOPILOT
    takeoff_error_m: float


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """By each personality."""
    folder = tmp_path_factory.mktemp("mavproxy")
    if request.param == "px4":
        return Flown(flown_px4(request.getfixturevalue("fleet"), folder), mavutil.mavlink.MAV_AUTOPILOT_PX4, 0.8)
    log = flown_ardupilot(request.getfixturevalue("copters"), folder)
    return Flown(log, mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0.2)


def flown_ardupilot(copters: Served, folder: Path) -> Path:
    """MAVProxy's own ways work on ArduPilot: modes by name, heights above home, velocities."""
    with listening(copters) as station:
        station.until_position(VEHICLE)
    with mavproxy(copters.vehicle(VEHICLE)["mavproxy"], folder) as prompt:
        prompt.until(f"online system {VEHICLE}")
        prompt.type("set flushlogs True")
        prompt.type("set param_ftp False")  # there is no MAVFTP here
        prompt.type("param fetch")
        prompt.until("Received [0-9]+ parameters")
        prompt.type("long SET_MESSAGE_INTERVAL 245 200000 0 0 0 0 0")
        prompt.until("SET_MESSAGE_INTERVAL: ACCEPTED")
        prompt.type(f"takeoff {TAKEOFF_M}")
        prompt.until("NAV_TAKEOFF: FAILED")
        prompt.type("mode GUIDED")
        prompt.until("Mode GUIDED")
        prompt.type("arm throttle")
        prompt.until(r"\bARMED")
        prompt.type(f"takeoff {TAKEOFF_M}")
        prompt.until("NAV_TAKEOFF: ACCEPTED")
        end_s = time.monotonic() + HAPPEN_LIMIT_S
        while landed_states(log := only_log(folder))[-1:] != [IN_AIR]:
            assert time.monotonic() < end_s
        prompt.type("velocity 2 0 0")
        while max((m.vx for m in of(log, "GLOBAL_POSITION_INT")), default=0) < FAST_CM_S:
            assert time.monotonic() < end_s
            prompt.type("velocity 2 0 0")  # it flies each for GUID_TIMEOUT
        prompt.type("mode LAND")
        prompt.until("Mode LAND")
        prompt.until("DISARMED")
        return ended(folder)


def flown_px4(fleet: Served, folder: Path) -> Path:
    """PX4 takes commands only, and heights above sea level."""
    with listening(fleet) as station:
        station.until_ready(VEHICLE)
    with mavproxy(fleet.vehicle(VEHICLE)["mavproxy"], folder) as prompt:
        prompt.until(f"online system {VEHICLE}")
        prompt.type("set flushlogs True")
        prompt.until("Mode LOITER")  # its name for HOLD
        # MAVProxy 1.8.75 cannot send PX4's modes by name (`mode TAKEOFF`: "required argument is not a float").
        prompt.type("long DO_SET_MODE 1 3 0")
        prompt.until("DO_SET_MODE: ACCEPTED")
        prompt.until("Mode POSCTL")
        prompt.type("arm throttle")
        prompt.until("COMPONENT_ARM_DISARM: TEMPORARILY_REJECTED")  # no sticks
        prompt.type("long DO_SET_MODE 1 4 3")
        prompt.until("Mode LOITER")
        prompt.type("arm throttle")
        prompt.until(r"\bARMED")
        prompt.type(f"takeoff {ORIGIN_ALT_M + TAKEOFF_M}")  # above sea level, to PX4
        prompt.until("NAV_TAKEOFF: ACCEPTED")
        prompt.until("Mode TAKEOFF")
        prompt.until("Mode LOITER")
        prompt.type("long NAV_LAND 0 0 0 0 0 0 0")
        prompt.until("Mode LAND")
        prompt.until("DISARMED")
        return ended(folder)


def only_log(folder: Path) -> Path:
    (log,) = folder.glob("it/logs/*/*/*.tlog")
    return log


def ended(folder: Path) -> Path:
    """The log, once it tells of the end: it lags behind, and what MAVProxy has not written when it ends is lost."""
    log = only_log(folder)
    end_s = time.monotonic() + HAPPEN_LIMIT_S
    while armed(read(log))[-1]:
        assert time.monotonic() < end_s
    return log


def of(log: Path, kind: str) -> list[Any]:
    """What the vehicle's autopilot sent."""
    return [m for m in read(log) if m.get_type() == kind and (m.get_srcSystem(), m.get_srcComponent()) == (VEHICLE, 1)]


def landed_states(log: Path) -> list[int]:
    return changes([m.landed_state for m in of(log, "EXTENDED_SYS_STATE")])


def read(log: Path) -> list[Any]:
    reader = mavutil.mavlink_connection(str(log))
    found = []
    while (message := reader.recv_match()) is not None:
        found.append(message)
    reader.close()
    return found


def armed(messages: list[Any]) -> list[bool]:
    """Of each heartbeat of the vehicle."""
    flag = mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return [
        bool(m.base_mode & flag)
        for m in messages
        if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == mavutil.mavlink.MAV_COMP_ID_AUTOPILOT1
    ]


def test_mavproxy_saw_it_armed_airborne_landed_and_disarmed(flown: Flown) -> None:
    its = [m for m in read(flown.log) if (m.get_srcSystem(), m.get_srcComponent()) == (VEHICLE, 1)]
    assert not [m for m in its if m.get_type() == "BAD_DATA"]
    assert changes(armed(its)) == [False, True, False]
    landed = [m.landed_state for m in its if m.get_type() == "EXTENDED_SYS_STATE"]
    assert changes(landed) == [1, 3, 2, 4, 1]  # ON_GROUND, TAKEOFF, IN_AIR, LANDING, ON_GROUND
    heights_m = [m.relative_alt / 1000.0 for m in its if m.get_type() == "GLOBAL_POSITION_INT"]
    assert max(heights_m) == pytest.approx(TAKEOFF_M, abs=flown.takeoff_error_m)
    assert heights_m[-1] == pytest.approx(0.0, abs=0.2)


def test_mavproxy_got_every_parameter(flown: Flown) -> None:
    values = [m for m in read(flown.log) if m.get_type() == "PARAM_VALUE"]
    assert len({m.param_id for m in values}) == values[0].param_count > 50


def changes(values: list[Any]) -> list[Any]:
    return [value for before, value in zip([None, *values], values, strict=False) if value != before]


def mavlogdump(log: Path, *options: str) -> str:
    tool = Path(sys.executable).with_name("mavlogdump.py")
    done = subprocess.run(
        [sys.executable, str(tool), *options, str(log)],
        capture_output=True,
        text=True,
        timeout=START_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_mavlogdump_reads_the_log_of_mavproxy(flown: Flown) -> None:
    lines = mavlogdump(flown.log, "--types", "HEARTBEAT,HOME_POSITION,BAD_DATA").splitlines()
    assert len([line for line in lines if f": HEARTBEAT {{type : 2, autopilot : {flown.autopilot}," in line]) > 10
    assert [line for line in lines if "HOME_POSITION" in line]
    assert not [line for line in lines if "BAD_DATA" in line]


def test_mavlogdump_reads_a_log_of_ours(tmp_path: Path) -> None:
    codec = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 29, 0x3040000, 3, 3).pack(codec)
    position = dialect.MAVLink_local_position_ned_message(1000, 1.5, -2.5, -3.5, 0, 0, 0).pack(codec)
    with TlogWriter(tmp_path / "ours.tlog") as log:
        log.write(1_750_000_000_000_000, heartbeat + position)
        log.write(1_750_000_000_500_000, heartbeat)
    assert (tmp_path / "ours.tlog").read_bytes().startswith(STAMP.pack(1_750_000_000_000_000) + heartbeat)
    lines = mavlogdump(tmp_path / "ours.tlog", "--show-source").splitlines()
    assert len(lines) == 3
    assert "LOCAL_POSITION_NED" in lines[1]
    assert "x : 1.5, y : -2.5, z : -3.5" in lines[1]
    assert all("srcSystem=7 srcComponent=1" in line for line in lines)
