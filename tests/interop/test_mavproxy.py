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
from pathlib import Path
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, START_LIMIT_S, Served, child, listening
from pymavlink import mavutil

from companion.mavlink import dialect
from sim_bridge.tlog import TlogWriter

pytestmark = pytest.mark.interop

VEHICLE = 2
ORIGIN_ALT_M = 488.0  # of a mission without [origin]
TAKEOFF_M = 4.0
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


@pytest.fixture(scope="module")
def flown(fleet: Served, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The telemetry log of a flight that MAVProxy made: mode changes, arm, takeoff, land."""
    folder = tmp_path_factory.mktemp("mavproxy")
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
        (log,) = folder.glob("it/logs/*/*/*.tlog")
        end_s = time.monotonic() + HAPPEN_LIMIT_S
        while armed(read(log))[-1]:  # its log lags behind, and what it has not written when it ends is lost
            assert time.monotonic() < end_s
    return log


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


def test_mavproxy_saw_it_armed_airborne_landed_and_disarmed(flown: Path) -> None:
    its = [m for m in read(flown) if (m.get_srcSystem(), m.get_srcComponent()) == (VEHICLE, 1)]
    assert not [m for m in its if m.get_type() == "BAD_DATA"]
    assert changes(armed(its)) == [False, True, False]
    landed = [m.landed_state for m in its if m.get_type() == "EXTENDED_SYS_STATE"]
    assert changes(landed) == [1, 3, 2, 4, 1]  # ON_GROUND, TAKEOFF, IN_AIR, LANDING, ON_GROUND
    heights_m = [m.relative_alt / 1000.0 for m in its if m.get_type() == "GLOBAL_POSITION_INT"]
    assert max(heights_m) == pytest.approx(TAKEOFF_M, abs=0.8)
    assert heights_m[-1] == pytest.approx(0.0, abs=0.2)


def test_mavproxy_got_every_parameter(flown: Path) -> None:
    values = [m for m in read(flown) if m.get_type() == "PARAM_VALUE"]
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


def test_mavlogdump_reads_the_log_of_mavproxy(flown: Path) -> None:
    lines = mavlogdump(flown, "--types", "HEARTBEAT,HOME_POSITION,BAD_DATA").splitlines()
    assert len([line for line in lines if ": HEARTBEAT {type : 2, autopilot : 12" in line]) > 10
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
