"""Programs that others wrote, against `sim-bridge serve`: children with a bound on everything they do."""

from __future__ import annotations

import json
import math
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pymavlink import mavutil

mavlink = mavutil.mavlink
# Of wall time, on a busy machine: what takes longer does not happen at all.
START_LIMIT_S = 180.0  # of a child
END_LIMIT_S = 60.0
HAPPEN_LIMIT_S = 180.0  # anything that a vehicle does
HEARTBEAT_S = 1.0

MISSION = """
schema = 1
name = "interop"
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [40.0, 0.0, 5.0]
vel_leader_mps = 2.0
[swarm]
size = 2
[sim]
placement = "grid"
"""


class Served:
    """`sim-bridge serve`, ready. `ports`: what it printed with --json."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        assert process.stdout is not None
        readable, _, _ = select.select([process.stdout], [], [], START_LIMIT_S)
        line = process.stdout.readline() if readable else b""
        assert line, f"serve printed nothing in {START_LIMIT_S} s (exit code {process.poll()})"
        self.notice: dict[str, Any] = json.loads(line)

    @property
    def ground_port(self) -> int:
        port: int = self.notice["ground"]["port"]
        return port

    def vehicle(self, vehicle_id: int) -> dict[str, Any]:
        """The entry of one vehicle: port, mavsdk, mavproxy, companion."""
        entry: dict[str, Any] = self.notice["vehicles"][vehicle_id - 1]
        assert entry["id"] == vehicle_id
        return entry


class Station:
    """A ground station made of pymavlink's mavutil, which nobody here wrote."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, source_component=190)
        self._beat_s = -math.inf

    def command(self, system: int, component: int, command: int, *parameters: float) -> None:
        """COMMAND_LONG."""
        self.link.mav.command_long_send(system, component, command, 0, *parameters, *(0.0,) * (7 - len(parameters)))

    def messages(self, limit_s: float) -> Iterator[Any]:
        """What arrives, until `limit_s` of wall time have passed; keeps its own heartbeat up."""
        end_s = time.monotonic() + limit_s
        while time.monotonic() < end_s:
            if time.monotonic() - self._beat_s > HEARTBEAT_S:
                self._beat_s = time.monotonic()
                self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            message = self.link.recv_match(blocking=True, timeout=HEARTBEAT_S)
            if message is not None:
                yield message

    def until(self, wanted: Callable[[Any], bool], what: str, limit_s: float = HAPPEN_LIMIT_S) -> Any:
        """The first message that is `wanted`."""
        for message in self.messages(limit_s):
            if wanted(message):
                return message
        raise AssertionError(f"not within {limit_s} s: {what}")

    def until_ready(self, system: int) -> None:
        """The vehicle may be armed."""
        self.until(
            lambda m: (
                m.get_type() == "HEARTBEAT"
                and (m.get_srcSystem(), m.get_srcComponent()) == (system, mavlink.MAV_COMP_ID_AUTOPILOT1)
                and m.system_status == mavlink.MAV_STATE_STANDBY
            ),
            f"vehicle {system} ready",
        )

    def until_position(self, system: int) -> None:
        """ArduPilot knows where it is, and so may be armed."""
        local_position, every_us = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 1e6
        self.command(system, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, local_position, every_us)
        self.until(
            lambda m: m.get_type() == "LOCAL_POSITION_NED" and m.get_srcSystem() == system,
            f"vehicle {system}'s position",
        )


@contextmanager
def child(command: Sequence[str], folder: Path, name: str, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that does not outlive the block; its stderr is `folder`/`name`.err."""
    with (folder / f"{name}.err").open("wb") as errors:
        process = subprocess.Popen(command, stderr=errors, **options)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


@contextmanager
def serving(folder: Path, mission: str, *options: str) -> Iterator[Served]:
    """`sim-bridge serve`, which ends when told, with exit code 0 and without a traceback."""
    file = folder / "mission.toml"
    file.write_text(mission)
    command = [sys.executable, "-m", "sim_bridge.cli", "serve", str(file), "--json", *options]
    with child(command, folder, "serve", stdout=subprocess.PIPE, stdin=subprocess.DEVNULL) as process:
        yield Served(process)
    assert process.returncode == 0
    assert "Traceback" not in (folder / "serve.err").read_text()


@contextmanager
def listening(served: Served) -> Iterator[Station]:
    """A ground station at the ground port."""
    station = Station(served.ground_port)
    try:
        yield station
    finally:
        station.link.close()
