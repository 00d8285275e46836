"""What a person sees before, during and after a flight."""

from __future__ import annotations

import io
import threading
from typing import Any

import pytest

from sim_bridge.judge import progress
from sim_bridge.judge.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SILENT_MAX_S", 0.001)


class Told(io.StringIO):
    """Tells when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def write(self, text: str) -> int:
        self.written.set()
        return super().write(text)


def test_a_terminal_sees_each_companion_start() -> None:
    shown = Terminal()
    with Progress(shown) as seen:
        for count in (1, 2, 3):
            seen.stage("starting companions", count, 3)
    for count in (1, 2, 3):
        assert f"starting companions {count}/3" in shown.getvalue()


def test_elsewhere_a_start_that_is_quick_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    now: list[float] = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    shown = io.StringIO()
    with Progress(shown) as seen:
        for count in range(1, 9):
            now[0] += 0.5
            seen.stage("starting companions", count, 8)
    assert shown.getvalue() == "starting companions 6/8\n"


@pytest.mark.usefixtures("hasty")
def test_what_takes_long_gives_signs_of_life() -> None:
    shown = Told()
    with Progress(shown) as seen, seen.working("measuring the flight"):
        assert shown.written.wait(30.0)
    assert shown.getvalue().startswith("measuring the flight: ")
    assert threading.active_count() == 1


def test_what_is_quick_says_nothing() -> None:
    shown = io.StringIO()
    with Progress(shown) as seen, seen.working("measuring the flight"):
        pass
    assert shown.getvalue() == ""


@pytest.mark.usefixtures("hasty")
def test_an_error_in_what_takes_long_ends_its_signs_of_life() -> None:
    seen: Any = Progress(io.StringIO())
    with pytest.raises(OSError, match="full"), seen.working("writing"):
        raise OSError("full")
    assert threading.active_count() == 1
