"""report.html in Chromium, without a network: it is drawn, it is played, and it can be read by everybody."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim_bridge import cli
from sim_bridge.judge.page import page as made
from sim_bridge.lab.judged import judged
from sim_bridge.lab.study.results import page as study_page
from tests.report import browser_kit
from tests.report.browser_kit import Browser

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
with_axe = pytest.mark.skipif(browser_kit.WHY_NOT_AXE is not None, reason=str(browser_kit.WHY_NOT_AXE))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        one = Browser()
    except OSError as error:  # a container may not let it
        pytest.skip(f"Chromium does not start here: {error}")
    with one:
        yield one


@pytest.fixture(scope="module")
def file(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    cli.main(["report", str(run), "--out", str(path)])
    return path


@pytest.fixture
def page(browser: Browser, file: Path) -> Iterator[Browser]:
    """The page of the flight, opened at 40 s; afterwards nothing was asked for, and nothing went wrong."""
    browser.dark(False)
    browser.screen(1280, 800)
    browser.open(file, "#t=40")
    yield browser
    assert browser.requests() == []
    assert browser.console() == []


def pixels(browser: Browser, selector: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """What is on the screen in the box of an element."""
    box = browser.run(f"return document.querySelector('{selector}').getBoundingClientRect().toJSON()")
    whole = np.asarray(Image.open(io.BytesIO(browser.screenshot())).convert("RGB"))
    top, left = int(box["top"]), int(box["left"])
    return whole[max(0, top) : int(top + box["height"]), max(0, left) : int(left + box["width"])]


def colours(browser: Browser, selector: str) -> int:
    return len(np.unique(pixels(browser, selector).reshape(-1, 3), axis=0))


def shown_s(browser: Browser) -> float:
    return float(browser.run("return document.querySelector('.time').value").split(" s")[0])


def press(browser: Browser, key: str) -> None:
    """On the page itself."""
    browser.run("document.activeElement.blur()")
    browser.run(
        "const told = {key: arguments[0], bubbles: true, cancelable: true};"
        "document.body.dispatchEvent(new KeyboardEvent('keydown', told))",
        key,
    )
    browser.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def test_the_browser_of_these_tests_would_tell_of_a_request_and_of_an_error(browser: Browser, tmp_path: Path) -> None:
    loud = "<html data-ready='1'><img src='http://example.org/x.png'><script>throw new Error('broken')</script>"
    (tmp_path / "loud.html").write_text(loud, encoding="utf-8")
    browser.open(tmp_path / "loud.html")
    browser.wait("document.images[0].complete")
    assert browser.requests() == ["http://example.org/x.png"]
    assert "broken" in "\n".join(browser.console())


def test_the_page_opens_from_disk_with_its_verdict_and_draws_its_map(page: Browser) -> None:
    assert page.run("return document.querySelector('h1').textContent") == "oak & <beech>"
    assert re.match(r"ARRIVED|INCOMPLETE", page.run("return document.querySelector('.verdict').textContent"))
    assert colours(page, "canvas.flat") > 30
    assert page.run("return document.querySelectorAll('.plot canvas').length") >= 6


def test_a_killed_leaders_mark_moves_to_the_next(page: Browser) -> None:
    leads = page.run("return [...document.querySelectorAll('.event.lead span')].map((e) => e.textContent)")
    assert leads[0].endswith("leads: first election")
    assert re.search(r"leads: leader \d killed at 30 s$", leads[1])
    told = []
    for index in (0, 1):
        page.run("document.querySelectorAll('.event.lead')[arguments[0]].click()", index)
        page.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        told.append(page.run("return document.querySelector('.status').textContent"))
    assert [re.search(r"vehicle (\d) leads", text) is not None for text in told] == [True, True]
    assert told[0] != told[1]


def test_space_plays_arrows_step_and_brackets_go_from_event_to_event(page: Browser) -> None:
    assert shown_s(page) == 40.0
    press(page, "ArrowRight")
    assert shown_s(page) == 40.1
    press(page, "ArrowLeft")
    assert shown_s(page) == 40.0
    press(page, "[")
    before = shown_s(page)
    assert before < 40.0
    press(page, "]")
    assert shown_s(page) >= 40.0
    press(page, " ")
    page.wait("parseFloat(document.querySelector('.time').value) > 41")
    press(page, " ")
    assert page.run("return document.querySelector('.play').textContent") == "Play"
    stood = shown_s(page)
    page.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert shown_s(page) == stood


def test_the_flight_in_space_is_drawn_and_moves(page: Browser) -> None:
    page.run("document.querySelectorAll('.tabs button')[1].click()")
    page.wait("document.querySelector('.space canvas')")
    press(page, "ArrowRight")
    first = pixels(page, ".space canvas").copy()
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100
    page.run("const s = document.querySelector('.track input'); s.value = 20; s.dispatchEvent(new Event('input'))")
    page.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert (pixels(page, ".space canvas") != first).any()


def test_a_browser_without_webgl_says_so_and_shows_the_rest(page: Browser) -> None:
    page.run(
        "const made = HTMLCanvasElement.prototype, old = made.getContext; made.getContext = function (kind, ...more) {"
        " return kind.startsWith('webgl') ? null : old.call(this, kind, ...more); }"
    )
    page.run("document.querySelectorAll('.tabs button')[1].click()")
    page.wait("document.querySelector('.space p')")
    assert "no 3D" in page.run("return document.querySelector('.space p').textContent")
    page.run("document.querySelectorAll('.tabs button')[0].click()")
    assert colours(page, "canvas.flat") > 30
    page.console()  # three.js says so, too


def test_the_page_is_light_or_dark_as_its_reader_prefers(page: Browser, file: Path) -> None:
    for dark in (False, True):
        page.dark(dark)
        page.open(file)
        assert (pixels(page, "canvas.flat")[5, 5].mean() < 80) == dark


@with_axe
@pytest.mark.parametrize("view", ["map", "space"])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_nothing_on_the_page_is_a_barrier(page: Browser, file: Path, dark: bool, view: str) -> None:
    """Contrast and names among it: WCAG 2.2 A and AA, as axe checks them."""
    page.dark(dark)
    page.open(file)
    page.run(
        "for (const d of document.querySelectorAll('details')) d.open = true;"
        "document.querySelector('.events').classList.remove('quiet')"
    )
    if view == "space":
        page.run("document.querySelectorAll('.tabs button')[1].click()")
        page.wait("document.querySelector('.space canvas')")
    assert page.barriers() == []


@with_axe
def test_a_barrier_would_be_found(browser: Browser, tmp_path: Path) -> None:
    page = "<html lang='en' data-ready='1'><title>t</title><body style='color: #ccc'><main>pale<button></button></main>"
    (tmp_path / "pale.html").write_text(page, encoding="utf-8")
    browser.dark(False)
    browser.open(tmp_path / "pale.html")
    assert {barrier.split(":")[0] for barrier in browser.barriers()} == {"color-contrast", "button-name"}


def test_every_control_is_reached_by_the_keyboard(page: Browser) -> None:
    reached = page.run(
        "return [...document.querySelectorAll('button, input, select, summary, canvas.flat')]"
        ".filter((node) => node.checkVisibility() && node.tabIndex < 0).length"
    )
    assert reached == 0


def test_a_phone_shows_it_without_scrolling_sideways(page: Browser, file: Path) -> None:
    page.screen(390, 844, mobile=True)
    page.open(file)
    assert page.run("return document.documentElement.scrollWidth") <= 390
    assert colours(page, "canvas.flat") > 30
    small = page.run(
        "return [...document.querySelectorAll('.timebar button, .tabs button, .zoom button, .theme')].map((node) =>"
        " node.getBoundingClientRect()).filter((box) => box.width < 40 || box.height < 40).length"
    )
    assert small == 0


def test_a_window_of_another_size_shows_all_again_but_not_after_its_reader_has_moved_the_map(page: Browser) -> None:
    settle = "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"

    def small() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        page.screen(390, 844, mobile=True)
        page.run(settle)
        return pixels(page, "canvas.flat").copy()

    turned = small()
    page.run("document.querySelector('[aria-label=\"show all\"]').click()")
    page.run(settle)
    assert (pixels(page, "canvas.flat") == turned).all()
    page.screen(1280, 800)
    page.run("document.querySelector('[aria-label=\"zoom in\"]').click()")
    page.run(settle)
    assert (small() != turned).any()


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_study_shows_its_answer_and_a_dot_for_each_flight(browser: Browser, tmp_path: Path, dark: bool) -> None:
    common = {"law": "ours", "backend": "agents", "n": 8, "settings": {}, "status": "flown", "error": "", "contacts": 0}
    rows = [
        {
            **common,
            "key": f"{run}{seed}",
            "run": run,
            "seed": seed,
            "arrived": seed != 3,
            "min_separation_m": 5.0 + seed,
        }
        for run in ("near", "far")
        for seed in range(1, 6)
    ]
    replayed = tmp_path / "replays" / "near3"
    replayed.mkdir(parents=True)
    (replayed / "report.html").write_text("", encoding="utf-8")
    file = study_page.write(tmp_path, rows, [], "two distances")
    browser.dark(dark)
    browser.screen(390, 844, mobile=True)
    browser.open(file)
    assert browser.run("return document.querySelector('.verdict').textContent").startswith(
        "INCOMPLETE: near: 4 of 5 flights arrived"
    )
    assert browser.run("return document.querySelectorAll('.dot').length") == 10
    links = browser.run("return [...document.querySelectorAll('a')].map((a) => a.getAttribute('href'))")
    assert links == ["replays/near3/report.html"] * 2  # in the table, and its dot
    assert browser.run("return document.documentElement.scrollWidth") <= 390
    if browser_kit.WHY_NOT_AXE is None:
        assert browser.barriers() == []
    assert (browser.requests(), browser.console()) == ([], [])


def test_what_a_mission_is_called_is_text_and_no_script(browser: Browser, run: Path, tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=document.title='hit'><b>"
    document = judged(run).document() | {"title": evil}
    (tmp_path / "evil.html").write_text(made(document, evil), encoding="utf-8")
    browser.open(tmp_path / "evil.html")
    assert browser.run("return document.querySelector('h1').textContent") == evil
    assert browser.run("return document.title") == evil
    assert browser.run("return document.querySelectorAll('img').length") == 0
    assert browser.requests() == []
