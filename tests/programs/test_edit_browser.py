"""`mission edit` in Chromium: from a stem map to a checked, saved and flown mission by clicks alone; by keys alone."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mission.cli.main import main
from mission.document.load import load_mission
from tests.report import browser_kit
from tests.report.browser_kit import Browser

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
with_axe = pytest.mark.skipif(browser_kit.WHY_NOT_AXE is not None, reason=str(browser_kit.WHY_NOT_AXE))
END_S = 30.0  # of wall time, for the program to end
CLEAR = 18.0  # m about the origin without trees
STEMS = "east_m,north_m,dbh_cm,height_m,crown_base_m,crown_radius_m,species,id\n" + "".join(
    f"{east},{north},{25 + (east * north) % 17},20,7.5,2.5,spruce,T{k}\n"
    for k, (east, north) in enumerate((e, n) for e in range(-30, 91, 10) for n in range(-40, 41, 10))
    if east * east + north * north > CLEAR**2
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        one = Browser(1400, 950, offline=False, arguments=browser_kit.SOFTWARE)
    except OSError as error:  # a container may not let it
        pytest.skip(f"Chromium does not start here: {error}")
    with one:
        yield one


@contextmanager
def program(*arguments: str) -> Iterator[str]:
    """The address that it prints. It ends by SIGINT, with code 0."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mission.cli.main", "edit", *arguments], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        words = process.stdout.readline().split()
        assert words[:2] == ["plan", "at"]
        yield words[2]
        process.send_signal(signal.SIGINT)
        assert process.wait(END_S) == 0
    finally:
        process.kill()
        process.communicate()


class Page:
    """What a reader does on it."""

    def __init__(self, browser: Browser, url: str) -> None:
        self.browser, self.url = browser, url
        self.clicks = 0
        browser.screen(1400, 950)
        browser.dark(False)
        browser.console()
        browser.requests()
        browser.open(url)

    def text(self, selector: str) -> str:
        return str(self.browser.run(f"return document.querySelector('{selector}').innerText"))

    def field(self, key: str) -> str:
        return str(self.browser.run("return document.getElementById(`field-${arguments[0]}`).value", key))

    def place(self, point: str, axis: str) -> str:
        label = f"{point}, {axis}, m"
        return str(self.browser.run("return document.querySelector(`[aria-label='${arguments[0]}']`).value", label))

    @property
    def revision(self) -> int:
        return int(self.browser.run("return Number(document.documentElement.dataset.revision)"))

    def after(self, revision: int) -> None:
        self.browser.wait(f"Number(document.documentElement.dataset.revision) > {revision}")

    def px(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Where that is in the window; the map is brought into view."""
        x, y = self.browser.run(
            "const {map} = planning; map.canvas.scrollIntoView({block: 'center'}); "
            "const box = map.canvas.getBoundingClientRect(); "
            "return [box.x + map.x(arguments[0]), box.y + map.y(arguments[1])]",
            east_m,
            north_m,
        )
        return x, y

    def mouse(self, kind: str, x: float, y: float) -> None:
        held = {} if kind == "mouseMoved" else {"button": "left", "clickCount": 1}
        self.browser.cdp("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=1, **held)

    def click_at(self, x: float, y: float) -> None:
        self.clicks += 1
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def click_map(self, east_m: float, north_m: float) -> None:
        before = self.revision
        self.click_at(*self.px(east_m, north_m))
        self.after(before)

    def drag(self, here: tuple[float, float], there: tuple[float, float]) -> None:
        before = self.revision
        a, b = self.px(*here), self.px(*there)
        self.mouse("mousePressed", *a)
        for share in (0.3, 0.7, 1.0):
            self.mouse("mouseMoved", a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        self.mouse("mouseReleased", *b)
        self.after(before)

    def press(self, text: str) -> None:
        """A button, by what is on it, under the pointer."""
        x, y = self.browser.run(
            "const found = [...document.querySelectorAll('button')].find((one) => one.innerText === arguments[0]); "
            "found.scrollIntoView({block: 'center'}); const box = found.getBoundingClientRect(); "
            "return [box.x + box.width / 2, box.y + box.height / 2]",
            text,
        )
        self.click_at(x, y)

    def change(self, text: str) -> None:
        """As `press`, of one that changes the mission."""
        before = self.revision
        self.press(text)
        self.after(before)

    def type(self, selector: str, text: str) -> None:
        """In place of what stands in a field, by keys."""
        self.browser.run("const one = document.querySelector(arguments[0]); one.focus(); one.select()", selector)
        self.browser.cdp("Input.insertText", text=text)

    def keys(self, key: str, *, ctrl: bool = False, code: int = 0) -> None:
        more = {"key": key, "windowsVirtualKeyCode": code, "modifiers": 2 * ctrl}
        self.browser.cdp("Input.dispatchKeyEvent", type="rawKeyDown", **more)
        self.browser.cdp("Input.dispatchKeyEvent", type="keyUp", **more)

    def set_field(self, key: str, text: str) -> None:
        """A field is typed in, and left."""
        before = self.revision
        self.type(f"[id='field-{key}']", text)
        self.keys("Tab", code=9)
        self.after(before)

    def is_quiet(self) -> None:
        """Nothing was asked for but of this server, and nothing went wrong."""
        own = self.url.partition("?")[0]
        assert [url for url in self.browser.requests() if not url.startswith(own)] == []
        assert self.browser.console() == []


@pytest.fixture
def stems(tmp_path: Path) -> Path:
    file = tmp_path / "stand.csv"
    file.write_text(STEMS)
    return file


@with_axe
def test_from_a_stem_map_to_a_checked_mission_by_clicks_alone_and_it_flies(
    browser: Browser, stems: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = stems.with_name("new.toml")
    with program(str(file), "--stems", str(stems)) as url:
        page = Page(browser, url)
        browser.wait("document.documentElement.dataset.stand")
        assert browser.barriers() == []
        assert page.text(".verdict") == "Does not check: 2 problems"
        assert "d1" in page.text(".hint") or "where the swarm starts" in page.text(".hint")
        page.click_map(0, 0)
        page.click_map(60.6, 0.4)  # beside the tree there
        assert page.text(".verdict") == "Checks"
        page.change("Fence around all")
        page.press("Stop")
        page.click_map(30.3, 20.2)
        assert page.text(".verdict") == "Does not check: 1 problem"
        assert "fence" in page.text(".problems")
        page.change("Fence around all")
        assert page.text(".verdict") == "Checks"
        page.press("Save")
        browser.wait("document.querySelector('.savedstate').innerText === 'saved'")
        assert page.clicks <= 7
        assert page.text(".message") == "saved: new.toml"
        mission = load_mission(file)
        assert main(["check", str(file)]) == 0
        assert "new.toml: ok: new, 8 vehicles" in capsys.readouterr().out
        assert mission.route.d2_enu_m[:2] == (60.0, 0.0)  # the tree
        assert [stop.pos_enu_m[:2] for stop in mission.route.stops] == [(30.0, 20.0)]
        assert mission.fence.polygon_enu_m is not None
        assert "# what each vehicle's own sensor sees" in file.read_text()
        assert browser.barriers() == []
        _fly(page, browser)
        page.is_quiet()


def _fly(page: Page, browser: Browser) -> None:
    """A smaller swarm, for a shorter flight: without its stop, and not saved."""
    page.browser.run("document.querySelector('[aria-label=\"Remove stop 1\"]').click()")
    for key, text in (("swarm.size", "3"), ("coverage.duration_s", "10"), ("route.vel_leader_mps", "3")):
        page.set_field(key, text)
    assert page.text(".verdict") == "Checks"
    page.press("Fly it here")
    browser.wait("document.querySelector('iframe')")
    assert page.text(".said").startswith("ARRIVED: ")
    assert browser.barriers() == []
    browser.frame(0)
    browser.wait("document.documentElement.dataset.ready !== undefined && document.querySelector('.verdict')")
    assert browser.run("return document.querySelector('.verdict').innerText") == "ARRIVED"
    outside = "try { return String(parent.document) } catch (error) { return error.name }"
    assert browser.run(outside) == "SecurityError"
    browser.cdp("Page.bringToFront")
    browser._call("POST", f"{browser._session}/frame", {"id": None})


def test_by_keys_alone(browser: Browser, stems: Path) -> None:
    file = stems.with_name("keys.toml")
    with program(str(file), "--stems", str(stems)) as url:
        page = Page(browser, url)
        browser.wait("document.documentElement.dataset.stand")
        browser.run("planning.map.canvas.focus()")
        before = page.revision
        page.keys("Enter", code=13)  # d1 at the cross
        page.after(before)
        browser.run("document.querySelector('[aria-label=\"d2, east, m\"]').focus()")
        before = page.revision
        for axis, text in (("east", "60"), ("north", "0"), ("up", "5.9")):
            page.type(f'[aria-label="d2, {axis}, m"]', text)
        page.keys("Tab", code=9)
        page.after(before)
        before = page.revision
        browser.run("planning.client.last = new Promise((answer) => { window.answer = answer })")
        for axis, text in (("east", "0"), ("north", "1")):  # the second before the first is answered
            page.type(f'[aria-label="d1, {axis}, m"]', text)
        page.keys("Tab", code=9)
        browser.run("window.answer()")
        page.after(before)
        assert [page.place("d1", axis) for axis in ("east", "north")] == ["0", "1"]
        assert page.text(".verdict") == "Checks"
        page.set_field("swarm.size", "40")
        browser.wait("document.querySelector('.verdict').innerText.startsWith('Does not check')")
        field = "document.getElementById('field-coverage.radius_m')"
        assert browser.run(f"return {field}.getAttribute('aria-invalid')") == "true"
        reason = browser.run(f"return document.getElementById({field}.getAttribute('aria-describedby')).innerText")
        assert "leaves 2.35 m between neighbours" in reason
        browser.run("planning.map.canvas.focus()")
        for key, size in (("z", "8"), ("y", "40"), ("z", "8")):
            before = page.revision
            page.keys(key, ctrl=True, code=ord(key.upper()))
            page.after(before)
            assert page.field("swarm.size") == size
        page.type("[id='field-name']", "typed")  # and not left
        page.keys("s", ctrl=True, code=ord("S"))
        browser.wait("document.querySelector('.savedstate').innerText === 'saved'")
        assert (load_mission(file).route.d2_enu_m, load_mission(file).name) == ((60.0, 0.0, 5.9), "typed")
        page.is_quiet()


def test_handles_are_dragged_and_corners_removed(browser: Browser, stems: Path) -> None:
    file = stems.with_name("my.toml")
    file.write_text(
        "schema = 1\n[route]\nd1_enu_m = [0.0, 0.0, 5.9]\nd2_tree = 'T93'\nvel_leader_mps = 2.0\n"
        "[fence]\naltitude_max_m = 7.0\npolygon_enu_m = [[-40, -40], [90, -40], [120, 0], [90, 40], [-40, 40]]\n"
        "[sensing]\n[forest]\nfile = 'stand.csv' # measured\n"
    )
    with program(str(file)) as url:
        page = Page(browser, url)
        browser.wait("document.documentElement.dataset.stand")
        tree = load_mission(file).route.d2_enu_m
        page.drag((tree[0], tree[1]), (50.4, 10.3))
        page.drag((0, 0), (2, 1))
        before = page.revision
        page.click_at(*page.px(120, 0))
        page.keys("Delete", code=46)
        page.after(before)
        page.change("Undo")
        page.change("Redo")
        page.press("Save")
        browser.wait("document.querySelector('.savedstate').innerText === 'saved'")
        mission = load_mission(file)
        assert mission.route.d2_tree is None
        assert mission.route.d2_enu_m == (50.0, 10.0, 5.9)
        assert mission.route.d1_enu_m[:2] == pytest.approx((2.0, 1.0), abs=0.2)
        assert mission.fence.polygon_enu_m == ((-40, -40), (90, -40), (90, 40), (-40, 40))
        assert "file = 'stand.csv' # measured" in file.read_text()
        page.is_quiet()


def test_what_another_program_writes_is_said_and_not_lost(browser: Browser, stems: Path) -> None:
    file = stems.with_name("my.toml")
    first = "schema = 1\n[route]\nd1_enu_m = [0, 0, 8]\nd2_enu_m = [60, 0, 8]\nvel_leader_mps = 2.0\n"
    file.write_text(first)
    with program(str(file)) as url:
        page = Page(browser, url)
        page.set_field("name", "mine")
        file.write_text(first + "# theirs\n")
        page.press("Save")
        browser.wait("!document.querySelector('.disk').hidden")
        assert "another program has changed it" in page.text(".message")
        assert file.read_text() == first + "# theirs\n"
        page.press("Save over it")
        browser.wait("document.querySelector('.savedstate').innerText === 'saved'")
        assert (stems.with_name("my.other-1.toml")).read_text() == first + "# theirs\n"
        assert load_mission(file).name == "mine"
        file.write_text(first + "# once more\n")
        browser.run("dispatchEvent(new Event('focus'))")  # the reader is back from the editor
        browser.wait("!document.querySelector('.disk').hidden")
        page.change("Load it")
        assert page.field("name") == ""
        assert browser.run("return document.querySelector('.disk').hidden") is True


@with_axe
def test_a_phone_and_the_dark_are_no_barrier(browser: Browser, stems: Path) -> None:
    with program(str(stems.with_name("new.toml")), "--stems", str(stems)) as url:
        page = Page(browser, url)
        browser.wait("document.documentElement.dataset.stand")
        for dark in (False, True):
            browser.dark(dark)
            browser.screen(390, 844, mobile=True)
            assert browser.barriers() == []
            width: Any = browser.run("return document.documentElement.scrollWidth")
            assert width <= 390
        page.is_quiet()
