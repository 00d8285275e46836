"""`sim-bridge fly --autopilots`: companions over the autopilots of a second, separately started bridge."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from interop_kit import serving

from sim_bridge.judge.run_folder import load, load_faults

pytestmark = pytest.mark.interop

MISSION = """
schema = 1
name = "external"
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [20.0, 0.0, 4.0]
vel_leader_mps = 2.0
[coverage]
duration_s = 10.0
radius_m = 12.0
[swarm]
size = 3
"""
FLIGHT_LIMIT_S = 600.0
# The third dies as soon as the others, each with a child of its own, run.
LAUNCHED = """
import os, pathlib, signal, subprocess, sys, time
index, folder = sys.argv[1], pathlib.Path(sys.argv[2])
while index == "2":
    if all((folder / other).exists() for other in "01"):
        sys.exit(7)
    time.sleep(0.01)
below = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
(folder / f"new-{index}").write_text(f"{os.getpid()} {below.pid}")
(folder / f"new-{index}").rename(folder / index)
signal.pause()
"""


def fly_command(folder: Path, *options: str) -> list[str]:
    """`sim-bridge fly`, of the mission that is served, which has no origin of its own."""
    run = ("--out", str(folder / "run"), "--json")
    return [sys.executable, "-m", "sim_bridge.cli", "fly", str(folder / "mission.toml"), *run, *options]


def flown(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = fly_command(folder, *options)
    return subprocess.run(command, capture_output=True, text=True, timeout=FLIGHT_LIMIT_S, check=False)


def free_port_row(length: int) -> int:
    """The first of `length` ports in a row that are free just now, from a random one: tests run side by side."""
    for _ in range(1000):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as picked:
            picked.bind(("127.0.0.1", 0))
            first = picked.getsockname()[1]
        sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(length)]
        try:
            for offset, bound in enumerate(sockets):
                bound.bind(("127.0.0.1", first + offset))
            return first
        except (OSError, OverflowError):
            continue
        finally:
            for bound in sockets:
                bound.close()
    raise AssertionError("no free ports")


def runs(pid: int) -> bool:
    """A process that is no zombie: nobody may be there to reap what a child has left."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def check_arrived(done: subprocess.CompletedProcess[str], folder: Path) -> None:
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["arrived"]
    assert figures["contacts"] == 0
    assert figures["trace_hash"] is None
    assert figures == json.loads((folder / "run" / "metrics.json").read_text())
    assert "still in the air" not in done.stderr
    for k in (1, 2, 3):
        assert (folder / "run" / f"vehicle-{k}.tlog").stat().st_size > 10_000
    assert (folder / "run" / "report.html").is_file()


def test_swarm_arrives_over_autopilots_that_are_sent_to(tmp_path: Path) -> None:
    first = free_port_row(3)
    with serving(tmp_path, MISSION, "--streams", "minimal", "--first-port", str(first)):
        done = flown(tmp_path, "--autopilots", "udpout://127.0.0.1:{port}", "--first-port", str(first))
    check_arrived(done, tmp_path)


def test_swarm_arrives_over_autopilots_that_all_send_to_one_port(tmp_path: Path) -> None:
    port = free_port_row(1)
    with serving(tmp_path, MISSION, "--onboard-to", f"127.0.0.1:{port}"):
        done = flown(tmp_path, "--autopilots", f"udpin://127.0.0.1:{port}")
    check_arrived(done, tmp_path)


# Both bridges grow the same trees about the same origin: one flies among them, the other shows them to the companions.
FOREST = """
[origin]
lat_deg = 47.397742
lon_deg = 8.545594
alt_m = 488.0
[sensing]
[forest]
trees = [
    { base_enu_m = [12.0, 0.3], trunk_radius_m = 0.2, height_m = 20.0 },
    { base_enu_m = [13.0, 6.0], trunk_radius_m = 0.2, height_m = 20.0 },
    { base_enu_m = [13.0, -6.0], trunk_radius_m = 0.2, height_m = 20.0 },
]
"""


def test_swarm_passes_trees_over_autopilots_that_know_of_none(tmp_path: Path) -> None:
    first = free_port_row(3)
    with serving(tmp_path, MISSION + FOREST, "--streams", "minimal", "--first-port", str(first)):
        there = ("--autopilots", "udpout://127.0.0.1:{port}", "--first-port", str(first))
        done = flown(tmp_path, *there, "--blind", "2@30:2")
    check_arrived(done, tmp_path)
    (event,) = load_faults(tmp_path / "run")
    assert event.vehicles == (2,)
    for k in (1, 2, 3):
        log = (tmp_path / "run" / "companions" / f"companion-{k}.log").read_text()
        assert "obstacle sensor 196 (component): heard" in log
        if k == 2:  # the others too, where the machine stands still for 0.3 s
            assert "hold: obstacle scan lost" in log


def test_ctrl_c_lands_all_and_ends_all_children(tmp_path: Path) -> None:
    port = free_port_row(1)
    with serving(tmp_path, MISSION, "--streams", "minimal", "--onboard-to", f"127.0.0.1:{port}"):
        command = fly_command(tmp_path, "--autopilots", f"udpin://127.0.0.1:{port}")
        options = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
        with subprocess.Popen(command, **options) as flight:
            for line in flight.stderr:
                if "leaving for d2" in line:
                    break
            children = psutil.Process(flight.pid).children(recursive=True)
            flight.send_signal(signal.SIGINT)
            shown = flight.stderr.read()
    assert flight.returncode == 1
    assert len(children) == 4  # the program that forks the companions, and three of them
    assert not any(companion.is_running() for companion in children)
    assert "land all: ordered by the operator" in shown
    assert "still in the air" not in shown
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["ended"] == "interrupted"


def test_simulated_faults_strike_companions_of_external_autopilots(tmp_path: Path) -> None:
    port = free_port_row(1)
    faults = {"kill": "3@transit+1", "stop": "2@transit:1", "late": "1@gather:0.1:3", "partition": "2@coverage:1"}
    options = [word for kind, text in faults.items() for word in (f"--{kind}", text)]
    with serving(tmp_path, MISSION, "--streams", "minimal", "--onboard-to", f"127.0.0.1:{port}"):
        done = flown(tmp_path, *options, "--autopilots", f"udpin://127.0.0.1:{port}", "--kill", "1@9999")
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert (figures["ended"], figures["verdict"]) == ("coverage complete", "ARRIVED without 3 (by estimates)")
    assert "vehicle 3 has no companion: its autopilot is told to land" in done.stderr
    assert "still in the air" not in done.stderr
    assert "fault: vehicle 3 killed" in done.stderr
    assert "companion 3: killed by SIGKILL" in done.stderr
    assert "vehicle 2: companion stalled: resynchronising" in done.stderr
    assert "fault over: telemetry of vehicle 1 on time again" in done.stderr
    assert "fault over: vehicle 2 reconnected" in done.stderr
    assert "fault that never happened: kill 1@9999" in done.stderr
    event = {one.kind.value: one for one in load_faults(tmp_path / "run")}
    assert {f"{kind} {text}" for kind, text in faults.items()} == {one.asked for one in event.values()}
    recording = load(tmp_path / "run")
    at = np.searchsorted(recording.time_s, event["stop"].at_s + np.array([0.0, 0.9, 2.5]))
    assert recording.agent_alive[at, 1].tolist() == [True, False, True]
    assert not recording.agent_alive[-1, 2]


def test_launched_autopilot_that_dies_is_named_and_the_others_are_ended(tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(MISSION)
    script = tmp_path / "autopilot.py"
    script.write_text(LAUNCHED)
    launch = f"{sys.executable} {script} {{index}} {tmp_path}"
    done = flown(tmp_path, "--autopilots", "udpin://127.0.0.1:{port}", "--launch", launch)
    assert done.returncode == 3
    assert "launched autopilot 3: ended with exit code 7" in done.stderr
    assert "Traceback" not in done.stderr
    pids = [int(word) for index in "01" for word in (tmp_path / index).read_text().split()]
    assert not any(runs(pid) for pid in pids)


def test_autopilot_that_is_never_heard_is_named(tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(MISSION)
    imports = "import sys; from sim_bridge import cli; from sim_bridge.drive.external import program"
    patched = f"{imports}; program.HEARD_LIMIT_S = 0.5; sys.exit(cli.main())"
    command = [sys.executable, "-c", patched, *fly_command(tmp_path)[3:], "--autopilots", "udpin://127.0.0.1:{port}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=FLIGHT_LIMIT_S, check=False)
    assert done.returncode == 3
    assert "vehicle 1: no autopilot with that system id was heard within 0.5 s" in done.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--launch", "px4"], "want --autopilots"),
        (["--autopilots", "serial:///dev/ttyACM0:57600"], "must be udpin://HOST:PORT or udpout://HOST:PORT"),
        (["--autopilots", "udpin://127.0.0.1:{port}", "--speed", "2"], "real time"),
        (["--autopilots", "udpin://127.0.0.1:{port}", "--first-port", "70000"], "--first-port 70000: must be 1..65535"),
        (["--autopilots", "udpout://127.0.0.1:{port}"], "wants --first-port, or --launch"),
    ],
)
def test_wrong_usage_is_refused_in_words(tmp_path: Path, options: list[str], message: str) -> None:
    (tmp_path / "mission.toml").write_text(MISSION)
    done = flown(tmp_path, *options)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
