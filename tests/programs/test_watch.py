"""`companion watch` as a program: from datagrams to pictures, and how it ends."""

from __future__ import annotations

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.programs.companion_kit import MISSION
from tests.unit.keys.keys_kit import key_file, operator_of, vehicle_of
from tests.unit.watch.watch_kit import beacon

LIMIT_S = 60.0


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


def command(*options: str) -> list[str]:
    return [sys.executable, "-m", "companion", "watch", *options]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_it_shows_what_it_hears_until_it_is_told_to_end(ending: signal.Signals, tmp_path: Path) -> None:
    mission = tmp_path / "m.toml"
    mission.write_text(MISSION)
    port = free_port()
    options = ["--peers", f"udpin://127.0.0.1:{port}", "--listen", "127.0.0.1:0", "--mission", str(mission)]
    with subprocess.Popen(command(*options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == f"watching udpin://127.0.0.1:{port}\n"
            found = re.fullmatch(r"open http://127\.0\.0\.1:(\d+)/\n", process.stdout.readline())
            assert found is not None
            connection = http.client.HTTPConnection("127.0.0.1", int(found[1]), timeout=LIMIT_S)
            connection.request("GET", "/heard")
            stream = connection.getresponse()
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
                vehicle.bind(("127.0.0.1", 0))
                vehicle.setblocking(False)
                ids: list[int] = []
                while ids != [1, 2]:
                    for k in (1, 2):
                        vehicle.sendto(beacon(k), ("127.0.0.1", port))
                    line = stream.readline()
                    if line.startswith(b"data: "):
                        picture = json.loads(line.removeprefix(b"data: "))
                        ids = [one["id"] for one in picture["vehicles"]]
                with pytest.raises(BlockingIOError):
                    vehicle.recv(100)  # nobody answered
            assert picture["about"]["mission"]["vehicles"] == 2
            process.send_signal(ending)
            assert process.wait(LIMIT_S) == 0
            assert process.stderr is not None
            assert process.stderr.read() == ""
            connection.close()
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("options", "code", "why"),
    [
        (["--peers", "udpout://127.0.0.1:14660"], 2, "'udpout' is not for this link"),
        (["--peers", "udpin://127.0.0.1:1", "--listen", "tablet"], 2, "must be an IPv4 address of this computer"),
        (["--peers", "udpin://127.0.0.1:1", "--listen", "[::]:8661"], 2, "'[::]:8661': must be an IPv4 address"),
        (["--peers", "udpin://127.0.0.1:1", "--listen", "::1"], 2, "localhost, as 192.168.4.10 or 192.168.4.10:8650\n"),
        (["--peers", "udpin://203.0.113.7:14660"], 3, "no interface of this computer has that address"),
        (["--peers", "PEERS", "--listen", "203.0.113.7:0"], 3, "--listen 203.0.113.7:0: "),
        (["--peers", "PEERS", "--mission", "/nowhere/m.toml"], 2, "/nowhere/m.toml: no such file"),
        (["--peers", "PEERS", "--map", "/nowhere/m.mbtiles"], 2, "/nowhere/m.mbtiles: no such file"),
        (["--peers", "PEERS", "--map", "/dev/null"], 2, "/dev/null: is not a file"),
        (["--peers", "PEERS", "--utm", "32N"], 2, "--utm 32N: is for an image that --map names"),
        (["--peers", "PEERS", "--map", "m.png", "--utm", "99Z"], 2, "--utm 99Z: must be a zone"),
    ],
)
def test_what_cannot_be_is_said(options: list[str], code: int, why: str) -> None:
    options = [f"udpin://127.0.0.1:{free_port()}" if word == "PEERS" else word for word in options]
    done = subprocess.run(command(*options), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == code
    assert why in done.stderr
    assert "Traceback" not in done.stderr


def test_a_mission_without_an_origin_is_nowhere_on_a_map(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(re.sub(r"\[origin\]\n(.+\n){3}", "", MISSION))
    options = ["--peers", f"udpin://127.0.0.1:{free_port()}", "--mission", str(tmp_path / "m.toml")]
    done = subprocess.run(command(*options), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 2
    where = f"companion: --mission {tmp_path / 'm.toml'}: must have an [origin]: where on Earth is it?\n"
    assert done.stderr == where
    key = key_file(tmp_path / "vehicle.key", vehicle_of(operator_of(2), 1))
    done = subprocess.run(
        command(*options, "--key", str(key)), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.stderr.startswith(f"{where}companion: --key {key}: ")  # all that is wrong, at once
    assert "must be the operator" in done.stderr


def test_a_mission_that_is_not_there_is_named_with_its_option() -> None:
    options = ["--peers", f"udpin://127.0.0.1:{free_port()}", "--mission", "nope"]
    done = subprocess.run(command(*options), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 2
    assert done.stderr == "companion: --mission: the mission is refused\nnope: no such file\n"


def test_it_loads_neither_what_steers_nor_what_speaks_to_autopilots() -> None:
    kept_out = (
        *(
            "companion.core.agent",
            "companion.core.swarm.swarm",
            "companion.core.guidance.movement",
            "companion.mavlink.codec",
        ),
        *("companion.mavlink.endpoint", "companion.shell.runner", "companion.run_command", "mavsdk", "numpy"),
        *("sim_bridge", "websockets", "psutil"),
    )
    check = f"import sys, companion.watch.command; print([m for m in {kept_out} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, timeout=LIMIT_S, check=True)
    assert done.stdout.strip() == "[]"


def test_with_the_operators_key_what_is_unsigned_is_told_and_not_shown(tmp_path: Path) -> None:
    mission, key = tmp_path / "m.toml", key_file(tmp_path / "operator.key", operator_of(2))
    mission.write_text(MISSION)
    port = free_port()
    options = ["--peers", f"udpin://127.0.0.1:{port}", "--listen", "127.0.0.1:0"]
    options += ["--mission", str(mission), "--key", str(key)]
    vehicle_key = key_file(tmp_path / "vehicle.key", vehicle_of(operator_of(2), 1))
    for wrong, why in (
        ([*options[:4], "--key", str(key)], "needs --mission FILE"),
        ([*options[:6], "--key", str(vehicle_key)], "must be the operator"),
    ):
        done = subprocess.run(command(*wrong), capture_output=True, text=True, timeout=LIMIT_S, check=False)
        assert done.returncode == 2
        assert why in done.stderr
    with subprocess.Popen(command(*options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            process.stdout.readline()
            address = re.search(r"127\.0\.0\.1:\d+", process.stdout.readline())
            assert address is not None
            connection = http.client.HTTPConnection(address[0], timeout=LIMIT_S)
            connection.request("GET", "/heard")
            stream = connection.getresponse()
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                picture: dict[str, Any] = {"alarms": []}
                while not picture["alarms"]:
                    stranger.sendto(beacon(1), ("127.0.0.1", port))
                    line = stream.readline()
                    if line.startswith(b"data: "):
                        picture = json.loads(line.removeprefix(b"data: "))
            assert picture["vehicles"] == []
            assert picture["alarms"][0]["text"] == "Vehicle 1: sends unsigned frames, which are not shown"
            connection.close()
        finally:
            process.kill()
