"""Companions forked by `companion.fork_server`, as their launcher sees them: as if each had been executed."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive import children
from sim_bridge.drive.children import Child, ForkClient, Forked, end, fate, signal_group
from sim_bridge.drive.links.ports import bound_socket
from sim_bridge.drive.lockstep.processes import PROGRAM, start_companion
from sim_bridge.errors import StartError
from sim_bridge.world.world import DEFAULT_ORIGIN

LIMIT_S = 30.0  # of wall time, on a busy machine

LAUNCHER = """
import pathlib, signal, sys
from sim_bridge.drive.children import ForkClient
from sim_bridge.drive.lockstep.processes import PROGRAM, start_companion
folder, port = pathlib.Path(sys.argv[1]), int(sys.argv[2])
with ForkClient() as forks:
    for how in (forks, PROGRAM):
        companion = start_companion(
            1, folder / "mission.toml", folder / "log",
            autopilot_port=port, radio_port=port, clock="vehicle", program=how,
        )
        print(companion.pid, flush=True)
    signal.pause()
"""


@pytest.fixture
def autopilot() -> Iterator[socket.socket]:
    with bound_socket("autopilot", 0) as bound:
        bound.settimeout(LIMIT_S)
        yield bound


@pytest.fixture
def forks() -> Iterator[ForkClient]:
    with ForkClient() as client:
        yield client


def write_mission(folder: Path) -> Path:
    file = folder / "mission.toml"
    route = {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0}
    mission = Mission.model_validate({"schema": 1, "name": "forks", "route": route, "swarm": {"size": 1}})
    file.write_text(dump_mission(mission.with_origin(DEFAULT_ORIGIN)))
    return file


def flying(forks: ForkClient, folder: Path, autopilot: socket.socket) -> Child:
    """A companion that has spoken."""
    port = autopilot.getsockname()[1]
    companion = start_companion(
        1, write_mission(folder), folder / "log", autopilot_port=port, radio_port=port, clock="vehicle", program=forks
    )
    autopilot.recv(4096)
    return companion


def wait_for_end_of(process: psutil.Process) -> None:
    """Its parent may be gone, and the one that has inherited it late to reap it."""
    deadline_s = time.monotonic() + LIMIT_S
    with contextlib.suppress(psutil.NoSuchProcess):
        while process.status() != psutil.STATUS_ZOMBIE:
            assert time.monotonic() < deadline_s, process
            with contextlib.suppress(psutil.TimeoutExpired):
                process.wait(0.01)


def test_exit_code_and_errors_of_a_forked_companion_are_its_own(forks: ForkClient, tmp_path: Path) -> None:
    refused = forks.fork(["run", "--id", "none"], tmp_path / "refused.err")
    fine = forks.fork(["--version"], tmp_path / "fine.err")
    assert (refused.wait(), fine.wait()) == (2, 0)
    assert "'none' is no vehicle id" in (tmp_path / "refused.err").read_text()
    assert (tmp_path / "fine.err").read_text() == ""


def test_forked_companion_works_where_its_launcher_does(
    forks: ForkClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad.toml").write_text("schema = 2\n")
    monkeypatch.chdir(tmp_path)
    links = ["--autopilot", "udpout://127.0.0.1:9", "--peers", "udpout://127.0.0.1:9"]
    assert forks.fork(["run", "--id", "1", "--mission", "bad.toml", *links], Path("bad.err")).wait() == 2
    assert "bad.toml:1: schema = 2" in (tmp_path / "bad.err").read_text()


def test_companions_of_one_server_fly_the_mission_that_is_in_the_file_now(forks: ForkClient, tmp_path: Path) -> None:
    file = write_mission(tmp_path)
    links = ["--autopilot", "udpout://127.0.0.1:9", "--peers", "udpout://127.0.0.1:9"]
    command = ["run", "--mission", str(file), "--log", str(tmp_path / "log"), "--unsigned", *links]
    first = forks.fork([*command, "--id", "1"], tmp_path / "first.err")
    assert forks.fork([*command, "--id", "2"], tmp_path / "second.err").wait() == 2
    assert "has the vehicles 1 to 1" in (tmp_path / "second.err").read_text()
    file.write_text("schema = 2\n")
    assert forks.fork([*command, "--id", "1"], tmp_path / "third.err").wait() == 2
    assert "schema = 2" in (tmp_path / "third.err").read_text()
    assert first.poll() is None
    end([first])


def test_a_killed_one_is_known_by_its_signal_and_keeps_its_pid_until_it_is_reaped(
    forks: ForkClient, tmp_path: Path, autopilot: socket.socket
) -> None:
    companion = flying(forks, tmp_path, autopilot)
    assert (fate(companion), companion.poll()) == (None, None)
    assert os.getpgid(companion.pid) == companion.pid
    signal_group(companion, signal.SIGKILL)
    while fate(companion) is None:
        assert psutil.Process(companion.pid).is_running()
    assert fate(companion) == "killed by SIGKILL"
    assert psutil.Process(companion.pid).status() == psutil.STATUS_ZOMBIE
    assert companion.wait() == companion.returncode == -signal.SIGKILL
    deadline_s = time.monotonic() + LIMIT_S
    while psutil.pid_exists(companion.pid):
        assert time.monotonic() < deadline_s


def test_a_stopped_one_is_ended_in_peace(forks: ForkClient, tmp_path: Path, autopilot: socket.socket) -> None:
    companion = flying(forks, tmp_path, autopilot)
    os.kill(companion.pid, signal.SIGSTOP)
    end([companion])
    assert companion.returncode == 0
    assert "stopped by SIGTERM" in (tmp_path / "log").read_text()


def test_closing_ends_all(tmp_path: Path, autopilot: socket.socket) -> None:
    with ForkClient() as forks:
        companion = psutil.Process(flying(forks, tmp_path, autopilot).pid)
        companion.suspend()
    assert not companion.is_running()
    assert "stopped by SIGTERM" in (tmp_path / "log").read_text()


def server() -> psutil.Process:
    (found,) = [child for child in psutil.Process().children() if children.FORK_SERVER[-1] in child.cmdline()]
    return found


def test_a_companion_ends_with_its_server(forks: ForkClient, tmp_path: Path, autopilot: socket.socket) -> None:
    companion = flying(forks, tmp_path, autopilot)
    assert isinstance(companion, Forked)
    victim = psutil.Process(companion.pid)
    server().kill()
    assert companion.wait() == -signal.SIGKILL
    assert fate(companion) == forks.failure == "fork server killed by SIGKILL"
    wait_for_end_of(victim)
    with pytest.raises(StartError, match="companions cannot be started"):
        forks.fork(["--version"], tmp_path / "err")


def test_a_stopped_server_is_ended_with_its_companions_where_it_has_to_answer(
    tmp_path: Path, autopilot: socket.socket
) -> None:
    with ForkClient() as forks:
        companion = flying(forks, tmp_path, autopilot)
        victims = [server(), psutil.Process(companion.pid)]
        victims[0].suspend()
        end([companion])
        assert (companion.returncode, companion.poll()) == (-signal.SIGKILL, -signal.SIGKILL)
        assert forks.failure == "fork server did not answer for 3 s"
    for victim in victims:
        wait_for_end_of(victim)


def test_a_stopped_server_and_what_stands_still_are_ended_on_closing(tmp_path: Path, autopilot: socket.socket) -> None:
    with ForkClient() as forks:
        companion = flying(forks, tmp_path, autopilot)
        victims = [server(), psutil.Process(companion.pid)]
        for victim in victims:
            victim.suspend()
    assert forks.failure == "fork server did not end within 6 s"
    for victim in victims:
        wait_for_end_of(victim)


def test_nothing_is_left_of_a_launcher_that_is_killed_not_even_what_stands_still(
    tmp_path: Path, autopilot: socket.socket
) -> None:
    write_mission(tmp_path)
    command = [sys.executable, "-c", LAUNCHER, str(tmp_path), str(autopilot.getsockname()[1])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        assert launcher.stdout is not None
        started = [psutil.Process(int(launcher.stdout.readline())) for _ in ("forked", "executed")]
        senders = {autopilot.recvfrom(4096)[1]}
        while len(senders) < len(started):
            senders.add(autopilot.recvfrom(4096)[1])
        for companion in started:
            companion.suspend()
        launcher.kill()
    for companion in started:
        wait_for_end_of(companion)


def test_a_server_that_cannot_load_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "FORK_SERVER", (sys.executable, "-c", "raise SystemExit('no such library')"))
    with ForkClient() as forks, pytest.raises(StartError, match="cannot be started: no such library"):
        forks.fork(["--version"], tmp_path / "err")


def test_what_a_companion_needs_at_its_start_is_loaded_before_it_is_forked(tmp_path: Path) -> None:
    """Each loaded 2 MB of its own for its mission."""
    check = (
        "import sys; from companion import fork_server; from mission.document.load import load_mission\n"
        "fork_server.rehearse(); before = set(sys.modules)\n"
        f"load_mission({str(write_mission(tmp_path))!r}); print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_program_is_executed_where_one_is_named(tmp_path: Path, autopilot: socket.socket) -> None:
    port = autopilot.getsockname()[1]
    file = write_mission(tmp_path)
    companion = start_companion(
        1, file, tmp_path / "log", autopilot_port=port, radio_port=port, clock="vehicle", program=PROGRAM
    )
    autopilot.recv(4096)
    command = psutil.Process(companion.pid).cmdline()
    end([companion])
    assert companion.returncode == 0
    assert command[: len(PROGRAM)] == list(PROGRAM)


def test_folders_named_as_the_programs_where_a_user_works_are_not_taken_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("mission", "companion"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    with ForkClient() as forks:
        assert forks.fork(["--version"], tmp_path / "errors").wait() == 0
    assert subprocess.run([*PROGRAM, "--version"], capture_output=True, check=False).returncode == 0
