"""Vehicles of a flight in Chromium: their table, who is followed, colours, coordinates, and a phone that scrolls."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from test_page_browser import browser, pixels  # noqa: F401  (a fixture)

from sim_bridge import cli
from sim_bridge.judge.page import page as made
from sim_bridge.lab.judged import judged
from sim_bridge.lab.plot_style import colours
from tests.flights import flown, short_mission
from tests.report import browser_kit
from tests.report.browser_kit import Browser

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
SETTLE = "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture
def page(browser: Browser, run: Path, tmp_path: Path) -> Browser:  # noqa: F811
    cli.main(["report", str(run), "--out", str(tmp_path / "report.html")])
    browser.dark(False)
    browser.screen(1280, 800)
    browser.open(tmp_path / "report.html", "#t=40")
    return browser


def swipe(page: Browser) -> None:
    """A finger goes up, by 240 px."""
    page.cdp("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": 195, "y": 300}])
    for y in range(280, 40, -20):
        page.cdp("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": 195, "y": y}])
    page.cdp("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def cells(page: Browser) -> list[list[str]]:
    found: list[list[str]] = page.run(
        "return [...document.querySelectorAll('.by-vehicle tbody tr')].map((row) =>"
        " [...row.children].map((cell) => cell.textContent))"
    )
    return found


def test_each_vehicle_has_a_row_with_names_and_units(page: Browser, run: Path) -> None:
    rows = cells(page)
    assert [row[0] for row in rows] == ["1", "2", "3"]
    document = judged(run).document()
    for row, told in zip(rows, document["by_vehicle"], strict=True):
        assert row[1] == f"{math.floor(told['way_m'] + 0.5)} m"  # a half as JavaScript rounds it: up
        assert row[2].startswith(f"{told['nearest_m']:.2f} m to {told['nearest_id']} at ")
        assert re.fullmatch(r"\d+\.\d\d m at \d+\.\d s", row[3])
        assert row[4] == ("never there" if told["behind_s"] is None else f"{told['behind_s']:.1f} s")
        assert re.fullmatch(r"\d+(\.\d)? %", row[6])
        assert told["last_text"] in row[8]


def test_a_click_on_a_row_follows_its_vehicle_from_above_and_in_space(page: Browser) -> None:
    page.run("document.querySelectorAll('.by-vehicle tbody button')[1].click()")
    page.run(SETTLE)
    assert page.run("return document.querySelector('input[name=follow]').checked")
    assert page.run("return document.querySelector('.roster [aria-pressed=true]').textContent") == "2"
    assert "2: " in page.run("return document.querySelector('.status').textContent")
    middle = pixels(page, "canvas.flat")
    chosen = [int(colours(3)[1][at : at + 2], 16) for at in (1, 3, 5)]
    high, wide = middle.shape[0] // 2, middle.shape[1] // 2
    near = middle[high - 8 : high + 8, wide - 8 : wide + 8].reshape(-1, 3).astype(int)
    assert (np.abs(near - chosen).max(axis=1) < 40).any()  # it is drawn in the middle, in its colour
    page.run("document.querySelectorAll('.tabs button')[1].click()")
    page.wait("document.querySelector('.space canvas')")
    page.run(SETTLE)
    first = pixels(page, ".space canvas").copy()
    page.run("document.querySelectorAll('.by-vehicle tbody button')[2].click()")
    page.run(SETTLE)
    assert (pixels(page, ".space canvas") != first).any()
    page.run("document.querySelectorAll('.by-vehicle tbody button')[2].click()")
    page.run(SETTLE)  # what is pressed is drawn with the next frame
    assert page.run("return document.querySelectorAll('.by-vehicle [aria-pressed=true]').length") == 0


def test_where_the_pointer_is_stands_in_metres_and_degrees(page: Browser) -> None:
    page.cdp("Input.dispatchMouseEvent", type="mouseMoved", x=400, y=400)
    page.wait("!document.querySelector('.pointer').hidden")
    shown = r"-?\d+\.\d m east, -?\d+\.\d m north · 47\.\d{6}, 8\.\d{6}"
    assert re.fullmatch(shown, page.run("return document.querySelector('.pointer').value"))
    page.run("document.querySelectorAll('.tabs button')[1].click()")
    page.wait("document.querySelector('.space canvas')")
    page.cdp("Input.dispatchMouseEvent", type="mouseMoved", x=420, y=520)
    page.wait("!document.querySelector('.pointer').hidden")
    assert re.fullmatch(shown, page.run("return document.querySelector('.pointer').value"))


@pytest.mark.parametrize("view", ["map", "space"])
def test_a_finger_that_goes_up_scrolls_a_phones_page(page: Browser, view: str) -> None:
    page.screen(390, 844, mobile=True)
    if view == "space":
        page.run("document.querySelectorAll('.tabs button')[1].click()")
        page.wait("document.querySelector('.space canvas')")
    shown = "canvas.flat" if view == "map" else ".space canvas"
    page.run("document.querySelector(arguments[0]).scrollIntoView()", shown)
    page.run(SETTLE)
    before = page.run("return scrollY")
    swipe(page)
    page.wait(f"scrollY > {before} + 100")


def test_twelve_vehicles_have_their_colours_in_space(browser: Browser, tmp_path: Path) -> None:  # noqa: F811
    run = tmp_path / "run"
    flown(short_mission(swarm={"size": 12}, sim={"time_limit_s": 30.0}), run)
    flight = judged(run)
    (tmp_path / "report.html").write_text(made(flight.document(), flight.title), encoding="utf-8")
    browser.dark(False)
    browser.screen(1280, 800)
    browser.open(tmp_path / "report.html", "#t=15")
    browser.run("document.querySelectorAll('.tabs button')[1].click()")
    browser.wait("document.querySelector('.space canvas')")
    browser.run(SETTLE)
    seen = pixels(browser, ".space canvas").reshape(-1, 3).astype(float)
    seen = seen[seen.max(axis=1) - seen.min(axis=1) > 25]  # what has a colour
    for colour in colours(12):
        wanted = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)], dtype=float)
        shade = seen @ wanted / (np.linalg.norm(seen, axis=1) * np.linalg.norm(wanted))  # cones are lit from one side
        assert (shade > 0.985).sum() > 5, colour
    assert browser.console() == []
