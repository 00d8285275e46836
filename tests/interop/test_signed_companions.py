"""A served swarm with keys: companions that are programs, and orders of the operator's key by `companion order`."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from interop_kit import HAPPEN_LIMIT_S, Served, child, listening, mavlink, serving

from companion.keys.fleet_folder import make_fleet
from tests.unit.watch.page_orders_kit import body

pytestmark = pytest.mark.interop

MISSION = """
schema = 1
name = "two with keys"
[route]
d1_enu_m = [0.0, 0.0, 10.0]
d2_enu_m = [60.0, 0.0, 10.0]
vel_leader_mps = 2.0
[swarm]
size = 2
start_timeout_s = 2.0
[sim]
placement = "grid"
"""
AIRBORNE_MM = 5_000


def order(served: Served, kind: str, *words: str) -> subprocess.CompletedProcess[str]:
    program, *options = served.notice["orders"][kind]
    command = [sys.executable, "-m", Path(program).name, *options, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=HAPPEN_LIMIT_S, check=False)


def test_served_swarm_with_keys_obeys_the_operators_orders_and_no_command(tmp_path: Path) -> None:
    make_fleet(tmp_path / "fleet", 2)
    with ExitStack() as stack:
        served = stack.enter_context(serving(tmp_path, MISSION, "--keys", str(tmp_path / "fleet")))
        for k in (1, 2):
            program, *options = served.vehicle(k)["companion"]
            command = [sys.executable, "-m", Path(program).name, *options]
            stack.enter_context(child(command, tmp_path, f"companion-{k}", stdin=subprocess.DEVNULL, cwd=tmp_path))
        station = stack.enter_context(listening(served))
        ready: set[int] = set()
        for message in station.messages(HAPPEN_LIMIT_S):
            if message.get_type() == "STATUSTEXT" and message.text == "ready":
                ready.add(message.get_srcSystem())
            if ready == {1, 2}:
                break
        assert ready == {1, 2}
        station.command(1, 191, mavlink.MAV_CMD_MISSION_START)
        answer = station.until(lambda m: m.get_type() == "COMMAND_ACK" and m.get_srcComponent() == 191, "an answer")
        assert answer.result == mavlink.MAV_RESULT_DENIED
        started = order(served, "start", "--yes")
        assert started.returncode == 0, started.stdout + started.stderr
        assert started.stdout.splitlines()[-1] == "START: acting on it: 1, 2"
        airborne: set[int] = set()
        for message in station.messages(HAPPEN_LIMIT_S):
            if message.get_type() == "GLOBAL_POSITION_INT" and message.relative_alt > AIRBORNE_MM:
                airborne.add(message.get_srcSystem())
            if airborne == {1, 2}:
                break
        assert airborne == {1, 2}
        held = order(served, "hold")
        assert held.returncode == 0, held.stdout + held.stderr


def test_served_swarm_with_keys_starts_and_holds_by_the_page(tmp_path: Path) -> None:
    """As the page does: the nonce of a picture, and an HMAC by the key of the address."""
    make_fleet(tmp_path / "fleet", 2)
    with ExitStack() as stack:
        served = stack.enter_context(serving(tmp_path, MISSION, "--keys", str(tmp_path / "fleet")))
        commands = [served.vehicle(k)["companion"] for k in (1, 2)]
        for k, (program, *options) in enumerate(commands, start=1):
            command = [sys.executable, "-m", Path(program).name, *options]
            stack.enter_context(child(command, tmp_path, f"companion-{k}", stdin=subprocess.DEVNULL, cwd=tmp_path))
        program, *options = served.notice["page"]
        command = [sys.executable, "-m", Path(program).name, *options, "--listen", "127.0.0.1:0"]
        watch = stack.enter_context(child(command, tmp_path, "watch", stdout=subprocess.PIPE))
        assert watch.stdout is not None
        stack.enter_context(watch.stdout)
        address = next(line for line in watch.stdout if line.startswith(b"order at ")).decode().split()[2]
        host, _, key = address.removeprefix("http://").partition("/#orders=")
        looking = http.client.HTTPConnection(host, timeout=HAPPEN_LIMIT_S)
        stack.callback(looking.close)
        looking.request("GET", "/heard")
        stream = stack.enter_context(looking.getresponse())
        pictures = (json.loads(line[6:]) for line in stream if line.startswith(b"data: "))

        def until(is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
            end_s = time.monotonic() + HAPPEN_LIMIT_S
            return next(picture for picture in pictures if is_so(picture) or time.monotonic() > end_s)

        def press(kind: str, nonce: str) -> None:
            posting = http.client.HTTPConnection(host, timeout=HAPPEN_LIMIT_S)
            headers = {"Origin": f"http://{host}", "Content-Type": "application/json"}
            posting.request("POST", "/order", body(key, nonce, kind), headers)
            assert posting.getresponse().status == 200
            posting.close()

        picture = until(lambda p: p["orders"]["ready"] == [1, 2])
        assert picture["orders"]["missing"] == {}
        press("START", picture["orders"]["nonce"])
        picture = until(lambda p: [v["state"] for v in p["vehicles"]] == ["transit", "transit"])
        assert all(v["airborne"] for v in picture["vehicles"])
        press("HOLD", picture["orders"]["nonce"])
        picture = until(lambda p: p["orders"]["sent"]["kind"] == "HOLD" and p["orders"]["sent"]["acting"] == [1, 2])
        assert [v["state"] for v in picture["vehicles"]] == ["hold", "hold"]
        aborted = order(served, "abort")  # at the terminal, while the page goes on
        assert aborted.returncode == 0, aborted.stdout + aborted.stderr
        assert aborted.stdout.splitlines()[-1] == "ABORT: acting on it: 1, 2"


def test_keys_that_are_not_there_are_named_before_anything_starts(tmp_path: Path) -> None:
    make_fleet(tmp_path / "fleet", 1)
    (tmp_path / "m.toml").write_text(MISSION)
    command = [sys.executable, "-m", "sim_bridge.cli", "serve", str(tmp_path / "m.toml"), "--keys"]
    done = subprocess.run([*command, str(tmp_path / "fleet")], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.strip().endswith("vehicle-2.key: no such file (companion key new FLEET --vehicles 2)")
