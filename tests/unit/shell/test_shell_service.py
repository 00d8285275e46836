"""The service manager, played by a socket: it hears that the companion is ready and alive, and hears when it hangs."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion.mavlink.endpoint import Outbox
from companion.shell.runner import Runner
from companion.shell.service import Service
from tests.unit.shell.service_kit import HAPPEN_LIMIT_S, QUIET_S, WATCHDOG_USEC, Manager

PID = 4711


@pytest.fixture
def service(manager: Manager) -> Iterator[Service]:
    service = Service({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(PID)}, PID)
    yield service
    service.close()


def test_first_ready_then_a_word_four_times_a_watchdog_then_stopping(manager: Manager, service: Service) -> None:
    assert service.period_s == 0.5
    for now_s in (100.0, 100.4, 100.5, 100.6, 101.1):
        service.alive(now_s, lambda at_s=now_s: f"at {at_s}")
    service.stopping()
    assert manager.hear() == {"READY": "1", "WATCHDOG": "1", "STATUS": "at 100.0"}
    assert manager.hear() == {"WATCHDOG": "1", "STATUS": "at 100.5"}
    assert manager.hear() == {"WATCHDOG": "1", "STATUS": "at 101.1"}
    assert manager.hear() == {"STOPPING": "1"}
    assert manager.hear(0.0) == {}


@pytest.mark.parametrize(
    ("environment", "period_s"),
    [
        ({}, 1.0),
        ({"WATCHDOG_USEC": "2000000"}, 0.5),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(PID + 1)}, 1.0),
        ({"WATCHDOG_USEC": "60000000"}, 1.0),
        ({"WATCHDOG_USEC": "0"}, 1.0),
        ({"WATCHDOG_USEC": "-1"}, 1.0),
        ({"WATCHDOG_USEC": "soon"}, 1.0),
    ],
)
def test_the_watchdogs_period(tmp_path: Path, environment: dict[str, str], period_s: float) -> None:
    service = Service({"NOTIFY_SOCKET": str(tmp_path / "notify"), **environment}, PID)
    assert service.period_s == period_s
    service.close()


@pytest.mark.parametrize("name", ["", "vsock:2:1234", "notify"])
def test_without_a_service_manager_nothing_is_said(name: str) -> None:
    service = Service({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "2000000"}, PID)
    service.alive(1.0, lambda: pytest.fail("a status that nobody hears"))
    service.stopping()
    service.close()
    assert service.errors == 0


def test_a_manager_that_is_gone_or_full_is_counted_and_ready_is_said_when_it_listens(tmp_path: Path) -> None:
    path = tmp_path / "notify"
    service = Service({"NOTIFY_SOCKET": str(path)}, PID)
    service.alive(1.0, lambda: "nobody listens")
    assert service.errors == 1
    manager = Manager(str(path))
    now_s = 10.0
    while service.errors == 1:  # until its queue is full; a blocking send would never come back
        service.alive(now_s, lambda: "x" * 1000)
        now_s += 1.0
    assert manager.hear()["READY"] == "1"
    assert "READY" not in manager.hear()
    manager.socket.close()
    service.close()


class QuietLink:
    """Nothing comes, all goes."""

    errors = lost = 0
    up = True

    def fileno(self) -> int:
        return -1

    def recv(self) -> None:
        return None

    def send(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def test_an_endpoint_that_blocks_silences_the_watchdog(manager: Manager) -> None:
    hung, released = threading.Event(), threading.Event()
    waker, woken = socket.socketpair()
    stop: Any = SimpleNamespace(reason="", fileno=woken.fileno)
    watch: Any = SimpleNamespace(log_changes=lambda *_: None, log_links=lambda *_: None, status_line=lambda: "")
    service = Service({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": str(WATCHDOG_USEC)}, PID)
    ticks = 0

    def tick(_now_s: float) -> Outbox:
        nonlocal ticks
        ticks += 1
        if ticks == 5:
            hung.set()
            assert released.wait(HAPPEN_LIMIT_S)
        return Outbox()

    endpoint: Any = SimpleNamespace(tick=tick, from_autopilot=lambda *_: None, from_peers=lambda *_: None)
    runner = Runner(endpoint, QuietLink(), QuietLink(), watch, stop, service, {})
    loop = threading.Thread(target=runner.by_monotonic)
    loop.start()
    try:
        assert "READY" in manager.hear()
        assert hung.wait(HAPPEN_LIMIT_S)
        manager.drain()
        assert manager.hear(QUIET_S) == {}
        released.set()
        assert manager.hear()["WATCHDOG"] == "1"
    finally:
        released.set()
        stop.reason = "test"
        waker.send(b"x")
        loop.join()
        for end in (waker, woken, service):
            end.close()
