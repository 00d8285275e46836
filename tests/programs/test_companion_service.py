"""`companion run` under a service manager: it says that it is ready and alive, and is silent when it hangs."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.programs.companion_kit import MISSION
from tests.unit.shell.service_kit import HAPPEN_LIMIT_S, QUIET_S, WATCHDOG_USEC, Manager


@pytest.fixture
def companion(manager: Manager, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts `companion run` as a service manager does."""
    (tmp_path / "mission.toml").write_text(MISSION)
    started: list[subprocess.Popen[bytes]] = []

    def start(*options: str) -> subprocess.Popen[bytes]:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            autopilot.bind(("127.0.0.1", 0))
            port = autopilot.getsockname()[1]
        started.append(
            subprocess.Popen(
                [
                    *(sys.executable, "-m", "companion.cli", "run", "--mission", str(tmp_path / "mission.toml")),
                    *("--id", "2", "--log", str(tmp_path / "log"), "--unsigned", *options),
                    *("--autopilot", f"udpout://127.0.0.1:{port}", "--peers", f"udpout://127.0.0.1:{port}"),
                ],
                env={**os.environ, "NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": str(WATCHDOG_USEC)},
            )
        )
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.parametrize("clock", ["monotonic", "vehicle"])
def test_a_stopped_companion_silences_the_watchdog(
    manager: Manager, companion: Callable[..., subprocess.Popen[bytes]], clock: str
) -> None:
    process = companion("--clock", clock)
    words = manager.hear()
    assert (words["READY"], words["WATCHDOG"]) == ("1", "1")
    assert words["STATUS"].startswith("vehicle 2: state waiting, leader none, UNSIGNED, GROUNDED: no preflight")
    assert manager.hear()["WATCHDOG"] == "1"
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)
    manager.drain()
    assert manager.hear(QUIET_S) == {}
    process.send_signal(signal.SIGCONT)
    assert manager.hear()["WATCHDOG"] == "1"
    process.send_signal(signal.SIGTERM)
    while "STOPPING" not in (words := manager.hear()):
        assert words
    assert process.wait(HAPPEN_LIMIT_S) == 0


def test_a_hung_companion_that_the_watchdog_ends_leaves_a_trace_of_where_it_was(
    manager: Manager, companion: Callable[..., subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    process = companion()
    assert "READY" in manager.hear()
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)
    process.send_signal(signal.SIGABRT)
    process.send_signal(signal.SIGCONT)
    assert process.wait(HAPPEN_LIMIT_S) == -signal.SIGABRT
    log = (tmp_path / "log").read_text()
    assert "Aborted" in log
    assert "by_monotonic" in log


def test_a_companion_that_cannot_start_is_never_ready(
    manager: Manager, companion: Callable[..., subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    (tmp_path / "mission.toml").write_text("schema = 1\n")
    assert companion().wait(HAPPEN_LIMIT_S) == 2
    assert manager.hear(0.0) == {}
