"""Obstacle sensors over real sockets: a driver made of pymavlink alone on a companion's link; the bridge's scans."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, Served, child, listening, serving
from pymavlink.dialects.v20 import ardupilotmega, common

pytestmark = pytest.mark.interop

MISSION = """
schema = 1
name = "sensors"
[route]
d1_enu_m = [0.0, 0.0, 5.0]
d2_enu_m = [40.0, 0.0, 5.0]
vel_leader_mps = 2.0
[swarm]
size = 2
[sensing]
[forest]
trees = [{ base_enu_m = [0.0, 9.0], trunk_radius_m = 0.3, height_m = 20.0 }]
[sim]
placement = "grid"
"""
DRIVER_COMPONENT = 93
# As docs/how-to/connect-an-obstacle-sensor.md has it, ten times a second.
DRIVER = """
import os, sys, time
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
link = mavutil.mavlink_connection(
    f"udpout:127.0.0.1:{sys.argv[1]}", source_system=1, source_component=93, dialect="common"
)
while True:
    link.mav.obstacle_distance_send(
        time_usec=0,
        sensor_type=mavutil.mavlink.MAV_DISTANCE_SENSOR_LASER,
        distances=[801] * 72,
        increment=5,
        min_distance=20,
        max_distance=800,
        increment_f=5.0,
        angle_offset=0.0,
        frame=mavutil.mavlink.MAV_FRAME_BODY_FRD,
    )
    time.sleep(0.1)
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("sensors"), MISSION) as served:
        yield served


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        port: int = bound.getsockname()[1]
        return port


@contextmanager
def driving(port: int, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    with child([sys.executable, "-c", DRIVER, str(port)], folder, "driver", stdin=subprocess.DEVNULL) as process:
        yield process


def until(happened: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + HAPPEN_LIMIT_S
    while not happened():
        assert time.monotonic() < end_s, what
        time.sleep(0.05)


def test_companion_takes_the_scans_of_a_driver_that_knows_only_pymavlink(served: Served, tmp_path: Path) -> None:
    port, log = free_port(), tmp_path / "companion.log"
    program, *options = served.vehicle(1)["companion"]
    at = options.index("--sensor") + 1
    options[at] = f"obstacles=udpin://127.0.0.1:{port}"
    command = [sys.executable, "-m", f"{program}.cli", *options, "--log", str(log)]

    def logged(*lines: str) -> bool:
        text = log.read_text() if log.exists() else ""
        return all(line in text for line in lines)

    sensor = f"obstacle sensor {DRIVER_COMPONENT} (component)"
    with listening(served) as station, child(command, tmp_path, "companion", stdin=subprocess.DEVNULL):
        station.until(
            lambda m: m.get_type() == "STATUSTEXT" and m.text == "waiting: no obstacle scan",
            "a companion that waits for scans",
        )
        with driving(port, tmp_path):
            until(lambda: logged(f"{sensor}: heard\n", "state waiting -> ready\n"), "a companion that hears the driver")
        until(lambda: logged(f"{sensor}: lost"), "the driver lost")
        with driving(port, tmp_path):
            until(lambda: logged(f"{sensor}: heard again"), "the driver heard again")


@pytest.mark.parametrize("dialect", [common, ardupilotmega], ids=["common", "ardupilotmega"])
def test_bridges_scans_are_parsed_by_pymavlinks_dialects(served: Served, dialect: ModuleType) -> None:
    vehicle = served.vehicle(2)
    parser = dialect.MAVLink(None)
    parser.robust_parsing = False  # a frame that is not valid raises
    scans: list[Any] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
        agent.settimeout(HAPPEN_LIMIT_S)
        agent.sendto(b"here", ("127.0.0.1", vehicle["obstacles"]["port"]))
        while len(scans) < 20:
            scans += parser.parse_buffer(bytearray(agent.recv(65536))) or []
    for scan in scans:
        assert scan.get_type() == "OBSTACLE_DISTANCE"
        assert (scan.get_srcSystem(), scan.get_srcComponent()) == (2, dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE)
        assert (scan.frame, scan.sensor_type) == (dialect.MAV_FRAME_BODY_FRD, dialect.MAV_DISTANCE_SENSOR_LASER)
        assert len(scan.distances) == 72
        assert all(scan.min_distance <= cm <= scan.max_distance + 1 or cm == 0xFFFF for cm in scan.distances)
    assert any(min(scan.distances) < 800 for scan in scans)  # the tree, or the other vehicle
