"""The live map in Chromium: what flies is seen, and a leader killed from the page is followed by another."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_page_browser import colours

from sim_bridge.judge.run_folder import load_faults
from tests.report import browser_kit
from tests.report.browser_kit import SOFTWARE, Browser

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
LONE_TREE = Path(__file__).parents[2] / "mission" / "examples" / "lone_tree.toml"
# When the events were shown that hold a text, by the page's clock, and when the mark was first at another vehicle.
WATCH = """
window.seen = {};
const look = () => {
  const now = performance.now();
  for (const node of document.querySelectorAll(".event.fault, .event.lead")) window.seen[node.textContent] ??= now;
  const leads = /vehicle (\\d+) leads/.exec(document.querySelector(".status").textContent);
  if (leads) window.seen["mark " + leads[1]] ??= now;
  requestAnimationFrame(look);
};
look();
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        one = Browser(offline=False, arguments=SOFTWARE)
    except OSError as error:  # a container may not let it
        pytest.skip(f"Chromium does not start here: {error}")
    with one:
        yield one


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[tuple[str, Path, subprocess.Popen[str]]]:
    """Where the map of a flight is, its run folder, and its program."""
    folder = tmp_path / "run"
    command = [sys.executable, "-P", "-m", "sim_bridge.cli", "fly", str(LONE_TREE), "-n", "4", "--map"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*command, "--out", str(folder)], **pipes) as program:
        try:
            assert program.stderr is not None
            for line in program.stderr:
                if found := re.search(r"live map: (http://\S+)", line):
                    yield found[1], folder, program
                    break
        finally:
            program.kill()


def ended(browser: Browser, program: subprocess.Popen[str]) -> str:
    """The last line of the program."""
    browser.run("document.querySelector('.controls select').value = 'max'")
    browser.run("document.querySelector('.controls select').dispatchEvent(new Event('change'))")
    return program.communicate(timeout=120)[0].strip().splitlines()[-1].partition(":")[0]


def test_a_leader_killed_from_the_page_is_followed_by_another(
    browser: Browser, flight: tuple[str, Path, subprocess.Popen[str]]
) -> None:
    url, folder, program = flight
    browser.open(url)
    browser.wait("/vehicle \\d leads/.test(document.querySelector('.status').textContent)")
    assert colours(browser, "canvas.flat") > 20
    browser.run(WATCH)
    leader = re.search(r"vehicle (\d)", browser.run("return document.querySelector('.status').textContent"))
    assert leader is not None
    browser.run("document.querySelector('.controls .kill').click()")
    browser.wait(f"Object.keys(window.seen).some((name) => name.startsWith('mark') && name !== 'mark {leader[1]}')")
    seen = browser.run("return window.seen")
    marks = {name: at for name, at in seen.items() if name.startswith("mark") and name[-1] != leader[1]}
    ((mark, moved_ms),) = marks.items()
    browser.wait(f"Object.keys(window.seen).some((name) => name.includes('vehicle {mark[-1]} leads'))")
    told_ms = min(at for name, at in browser.run("return window.seen").items() if f"{mark[-1]} leads" in name)
    assert abs(moved_ms - told_ms) < 1000.0
    assert colours(browser, "canvas.flat") > 20
    verdict = ended(browser, program)
    assert verdict == f"ARRIVED without {leader[1]}"
    browser.wait(f"document.querySelector('.verdict').textContent === '{verdict}'")
    assert [fault.vehicles for fault in load_faults(folder)] == [(int(leader[1]),)]
    assert all(asked.startswith(url) for asked in browser.requests())
    assert browser.console() == []


def test_a_flight_is_paused_stepped_and_looked_back_at(
    browser: Browser, flight: tuple[str, Path, subprocess.Popen[str]]
) -> None:
    url, _, program = flight
    newest = "return Number(document.querySelector('.track input').max)"
    browser.open(url)
    browser.wait("Number(document.querySelector('.track input').max) > 5")
    browser.run("document.querySelector('.controls .pause').click()")
    browser.wait("document.querySelector('.controls .pause').textContent === 'Resume flight'")
    browser.run("return new Promise((done) => setTimeout(done, 800))")
    stood = browser.run(newest)
    browser.run("for (let k = 0; k < 4; k++) document.querySelector('.controls .step').click()")
    browser.wait(f"Number(document.querySelector('.track input').max) > {stood} + 0.04")
    assert stood + 0.04 < browser.run(newest) < stood + 0.25
    browser.run("const s = document.querySelector('.track input'); s.value = 2; s.dispatchEvent(new Event('input'))")
    browser.wait("document.querySelector('.time').value.startsWith('2.0 s')")
    assert browser.run("return document.querySelector('.play').textContent") == "Live"
    browser.run("document.querySelector('.play').click()")
    browser.wait("!document.querySelector('.time').value.startsWith('2.')")
    if browser_kit.WHY_NOT_AXE is None:
        assert browser.barriers() == []
    browser.screen(390, 844, mobile=True)
    browser.wait("document.documentElement.scrollWidth <= 390")  # plots are drawn anew first
    browser.screen(1280, 800)
    browser.run("document.querySelector('.controls .pause').click()")
    assert ended(browser, program) == "ARRIVED"
    assert browser.console() == []
