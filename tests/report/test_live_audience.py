"""`fly --map` on a terminal: opens the map where there is a browser, waits for the first look, stays until Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from websockets.sync.client import connect

from sim_bridge.judge import page

LONE_TREE = Path(__file__).parents[2] / "mission" / "examples" / "lone_tree.toml"
PLAIN = {name: value for name, value in os.environ.items() if name not in ("CI", "DISPLAY", "WAYLAND_DISPLAY")}


@contextmanager
def flying(folder: Path, *options: str, **environment: str) -> Iterator[tuple[subprocess.Popen[bytes], Iterator[str]]]:
    """`fly` of two to a tree on a terminal of its own, and what it writes there, line by line."""
    near, far = os.openpty()
    command = [sys.executable, "-P", "-m", "sim_bridge.cli", "fly", str(LONE_TREE), "-n", "2", "--map", *options]
    command += ["--agents", "in-process", "--out", str(folder)]
    with subprocess.Popen(command, stdin=far, stdout=far, stderr=far, env=PLAIN | environment) as program:
        os.close(far)
        try:
            yield program, lines(near)
        finally:
            program.kill()
            os.close(near)


def lines(terminal: int) -> Iterator[str]:
    """Each, once it is whole, without what a progress line repaints."""
    rest = b""
    with suppress(OSError):  # EIO: nobody has the other end any more
        while data := os.read(terminal, 4096):
            *whole, rest = re.split(rb"[\r\n]+", rest + data)
            yield from (line.decode() for line in whole)


def told(output: Iterator[str], text: str) -> str:
    return next(line for line in output if text in line)


def test_a_flight_waits_for_the_first_look_and_its_map_stays_with_the_replay(tmp_path: Path) -> None:
    opened = tmp_path / "opened"
    (tmp_path / "browser").write_text(f'#!/bin/sh\nprintf %s "$1" > {opened}\n', encoding="utf-8")
    (tmp_path / "browser").chmod(0o755)
    browser = {"BROWSER": str(tmp_path / "browser")}
    with flying(tmp_path / "run", "--open", **browser) as (program, output):
        url = told(output, "live map: ").split("live map: ")[1]
        assert told(output, "waiting for a look")
        assert opened.read_text(encoding="utf-8") == url
        with connect(f"{url.replace('http', 'ws')}live", max_size=None) as stream:
            assert '"time_s":{' in str(stream.recv())
            stream.send('{"do": "speed", "factor": null}')
            assert told(output, "the map stays, with the replay")
        with urllib.request.urlopen(url, timeout=60) as answer:
            replay = answer.read()
        assert replay == (tmp_path / "run" / page.PAGE_NAME).read_bytes()
        program.send_signal(signal.SIGINT)
        assert program.wait(timeout=60) == 0


def test_a_closed_terminal_ends_a_map_that_stays(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a flight in this process leaves it ignored, as nohup does
    request.addfinalizer(lambda: signal.signal(signal.SIGHUP, before))
    with flying(tmp_path / "run", "--stay", CI="1") as (program, output):
        assert told(output, "the map stays")  # nobody has looked
        program.send_signal(signal.SIGHUP)
        assert program.wait(timeout=60) == 0


@pytest.mark.parametrize("environment", [{}, {"CI": "true"}], ids=["told not to", "in CI"])
def test_nothing_waits_where_it_is_not_to(tmp_path: Path, environment: dict[str, str]) -> None:
    with flying(tmp_path / "run", *([] if environment else ["--no-stay"]), **environment) as (program, output):
        written = list(output)
        assert program.wait(timeout=60) == 0
    assert not any("waiting for a look" in line or "the map stays" in line for line in written)


def test_without_a_display_no_browser_is_started_and_that_is_said(tmp_path: Path) -> None:
    with flying(tmp_path / "run", "--open", "--no-stay") as (program, output):
        assert told(output, "no display here")
        list(output)
        assert program.wait(timeout=60) == 0
