"""`companion watch --orders` as a program, with its page in Chromium: what a finger does there, two vehicles obey."""

from __future__ import annotations

import http.client
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.core.model.states import Order
from tests.programs.operated_kit import LIMIT_S, Vehicles, free_port, make_fleet
from tests.programs.test_watch_browser import tap, text, wait_for
from tests.report import browser_kit
from tests.report.browser_kit import Browser

with_chromium = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
with_axe = pytest.mark.skipif(browser_kit.WHY_NOT_AXE is not None, reason=str(browser_kit.WHY_NOT_AXE))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission, and the keys of its fleet."""
    return make_fleet(tmp_path_factory.mktemp("operator"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        one = Browser(offline=False)
    except OSError as error:  # a container may not let it
        pytest.skip(f"Chromium does not start here: {error}")
    with one:
        one.screen(390, 844, mobile=True)
        yield one


def command(port: int, *options: str, peers: str = "") -> list[str]:
    links = ["--peers", peers or f"udpin://127.0.0.1:{port}", "--listen", "127.0.0.1:0"]
    return [sys.executable, "-m", "companion", "watch", *links, *options]


class Watch:
    """The program, once it has said its addresses."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        assert process.stdout is not None
        self.head = [process.stdout.readline() for _ in range(4)]
        found = [re.fullmatch(r"(?:order|only watch) at (\S+)\n", line) for line in self.head[2:]]
        assert found[0] is not None, self.head
        assert found[1] is not None, self.head
        self.url, self.watch_url = found[0][1], found[1][1]
        self.key = self.url.partition("#orders=")[2]

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()


@contextmanager
def watching(folder: Path, *, airborne: bool = True, deaf: int = 0) -> Iterator[tuple[Watch, Vehicles]]:
    """Ends with the program's own end: no line on stderr, and exit code 0."""
    port = free_port()
    files = ["--mission", str(folder / "m.toml"), "--key", str(folder / "fleet" / "operator.key")]
    process = subprocess.Popen(
        command(port, *files, "--orders"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    vehicles = Vehicles(folder, port, airborne=airborne, deaf=deaf)
    try:
        yield Watch(process), vehicles
        process.send_signal(signal.SIGINT)
        assert process.wait(LIMIT_S) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    finally:
        vehicles.close()
        process.kill()
        process.communicate()


def order(browser: Browser, kind: str) -> None:
    """Tap its button, and confirm once the page lets one."""
    tap(browser, f".order.{kind.lower()}")
    browser.wait("document.querySelector('.confirm').getAttribute('aria-disabled') === 'false'")
    tap(browser, ".confirm")


@with_chromium
def test_start_hold_and_land_on_the_page_are_obeyed_and_told(browser: Browser, folder: Path) -> None:
    with watching(folder, airborne=False) as (watch, vehicles):
        browser.console()
        browser.open(watch.url)
        wait_for(browser, ".order.start", "START")
        tap(browser, ".order.start")
        wait_for(browser, ".question", "Ready, or in the air: 1, 2")
        assert text(browser, ".confirm") == "Start 2 of 2"
        assert browser.run("return document.activeElement.className") == "confirm"
        browser.wait("document.querySelector('.confirm').getAttribute('aria-disabled') === 'false'")
        assert vehicles.obeyed == {1: [], 2: []}
        tap(browser, ".confirm")
        wait_for(browser, ".progress", "START: acting on it: 1, 2")
        assert vehicles.obeyed == {1: [Order.START], 2: [Order.START]}
        assert watch.line() == "START: ordered on the page, from 127.0.0.1\n"
        assert browser.console() == []
    with watching(folder) as (watch, vehicles):
        browser.open(watch.url)
        wait_for(browser, ".summary", "2 heard")
        order(browser, "HOLD")
        wait_for(browser, ".progress", "HOLD: acting on it: 1, 2")
        order(browser, "LAND")
        browser.wait("document.querySelector('.progress').innerText.includes('LAND')")
        assert [watch.line(), watch.line()] == [f"{k}: ordered on the page, from 127.0.0.1\n" for k in ("HOLD", "LAND")]
        browser.wait("document.querySelector('.question').hidden")
        while vehicles.obeyed != {k: [Order.HOLD, Order.LAND] for k in (1, 2)}:
            assert watch.process.poll() is None
            browser.run("return new Promise((done) => requestAnimationFrame(done))")


@with_chromium
def test_abort_is_a_long_press_and_a_short_one_only_asks(browser: Browser, folder: Path) -> None:
    with watching(folder, deaf=2) as (watch, vehicles):
        browser.open(watch.url)
        wait_for(browser, ".summary", "2 heard")
        tap(browser, ".order.abort")
        wait_for(browser, ".question", "Abort? Every vehicle lands where it is, at once.")
        browser.key("Escape")
        browser.wait("document.querySelector('.question').hidden")
        assert vehicles.obeyed == {1: [], 2: []}
        box = browser.run("return document.querySelector('.order.abort').getBoundingClientRect().toJSON()")
        finger = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
        browser.cdp("Input.dispatchTouchEvent", type="touchStart", touchPoints=[finger])
        wait_for(browser, ".progress", "ABORT: acting on it: 1")
        browser.cdp("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        wait_for(browser, ".progress", "ABORT: heard, and not acting on it: 2")
        wait_for(browser, ".alarms", "An operator has ordered all to land")
        assert browser.run("return document.querySelector('.question').hidden")
        assert vehicles.obeyed[1] == [Order.ABORT]


@with_chromium
def test_key_leaves_the_address_and_never_the_tab(browser: Browser, folder: Path) -> None:
    with watching(folder) as (watch, vehicles):
        assert watch.head[1].startswith("orders are taken: whoever has a whole address")
        assert len(watch.key) == 32
        browser.requests()
        browser.open(watch.url)
        wait_for(browser, ".summary", "2 heard")
        assert browser.run("return location.href") == watch.watch_url
        sent = browser.cdp("Page.getNavigationHistory")["entries"]
        assert not any(watch.key in entry["url"] for entry in sent)
        assert browser.run("return [Object.values(localStorage).length, document.cookie, sessionStorage.length]") == [
            *(0, "", 1)
        ]
        posted = browser.run(
            "window.posted = []; const asked = window.fetch;"
            "window.fetch = (...given) => { posted.push(JSON.stringify(given)); return asked(...given); }"
        )
        order(browser, "HOLD")
        wait_for(browser, ".progress", "HOLD: acting on it: 1, 2")
        (posted,) = browser.run("return posted")
        assert watch.key not in posted
        assert json.loads(json.loads(posted)[1]["body"])["kind"] == "HOLD"
        assert not any(watch.key in url for url in browser.requests())
        browser.open(watch.watch_url)  # the tab has it still
        order(browser, "HOLD")
        while vehicles.obeyed[1] != [Order.HOLD, Order.HOLD]:
            assert watch.process.poll() is None
            browser.run("return new Promise((done) => requestAnimationFrame(done))")


@with_chromium
def test_order_that_is_not_given_is_told_and_a_start_asks_again(browser: Browser, folder: Path) -> None:
    with watching(folder) as (watch, vehicles):
        browser.open(watch.url)
        wait_for(browser, ".summary", "2 heard")
        browser.run(
            "window.asked = fetch; const told = JSON.stringify({why: 'other vehicles are ready'});"
            "window.fetch = () => Promise.resolve(new Response(told, {status: 412}))"
        )
        order(browser, "START")
        wait_for(browser, ".progress", "START: not ordered: other vehicles are ready")
        wait_for(browser, ".question", "Ready, or in the air: 1, 2")
        browser.run("window.fetch = asked")
        network = {"latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
        browser.cdp("Network.emulateNetworkConditions", offline=True, **network)
        order(browser, "HOLD")
        wait_for(browser, ".progress", "HOLD: not ordered: the watching computer does not answer")
        browser.cdp("Network.emulateNetworkConditions", offline=False, **network)
        assert vehicles.obeyed == {1: [], 2: []}


@with_chromium
def test_address_without_the_key_only_watches_until_the_whole_one_is_opened(browser: Browser, folder: Path) -> None:
    with watching(folder) as (watch, _):
        for url in (watch.watch_url, f"{watch.watch_url}#orders={'0' * 32}"):  # or of an earlier start
            browser.open(url)
            wait_for(browser, ".progress", "This page only watches")
            assert browser.run("return document.querySelector('.orders .row').hidden")
            assert browser.run("return location.hash") == ""
        browser.run("location.hash = arguments[0]", f"orders={watch.key}")  # of the page that is there
        browser.wait("!document.querySelector('.orders .row').hidden")
        browser.wait("location.hash === ''")


@with_chromium
@with_axe
@pytest.mark.parametrize("size", [(320, 480), (390, 844), (1280, 800)])
def test_buttons_are_within_reach_on_every_screen_and_no_barrier(
    browser: Browser, folder: Path, size: tuple[int, int]
) -> None:
    browser.screen(*size, mobile=size[0] < 900)
    try:
        with watching(folder) as (watch, _):
            browser.open(watch.url)
            wait_for(browser, ".summary", "2 heard")
            tap(browser, ".order.land")
            browser.wait("document.querySelector('.confirm').getAttribute('aria-disabled') === 'false'")
            browser.run("scrollTo(0, 0)")
            boxes = browser.run(
                "return [...document.querySelectorAll('.order, .question button')]"
                ".map((node) => node.getBoundingClientRect().toJSON())"
            )
            assert len(boxes) == 6
            for box in boxes:
                assert box["width"] >= 48
                assert box["height"] >= 48
                assert (box["left"] >= 0, box["right"] <= size[0], box["bottom"] <= size[1]) == (True, True, True)
            assert browser.run("return document.documentElement.scrollWidth") <= size[0]
            assert browser.barriers() == []
    finally:
        browser.screen(390, 844, mobile=True)


def test_terminal_still_orders_beside_the_page(folder: Path) -> None:
    """Both are the operator's: vehicles hear both, and each is told of the other."""
    peers = f"udpbcast://127.255.255.255:{free_port()}"
    files = ["--mission", str(folder / "m.toml"), "--key", str(folder / "fleet" / "operator.key")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command(0, *files, "--orders", peers=peers), **pipes)  # type: ignore[call-overload]
    vehicles = Vehicles(folder, 0, url=peers)
    try:
        watch = Watch(process)
        desk = http.client.HTTPConnection(watch.watch_url.split("/")[2], timeout=LIMIT_S)
        desk.request("GET", "/heard")
        stream, picture = desk.getresponse(), {}
        while picture.get("orders", {}).get("ready") != [1, 2]:
            if (line := stream.readline()).startswith(b"data: "):
                picture = json.loads(line.removeprefix(b"data: "))
        terminal = [sys.executable, "-m", "companion", "order", "abort", *files, "--peers", peers]
        done = subprocess.run(terminal, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        assert done.stdout.endswith("ABORT: acting on it: 1, 2\n")
        assert done.returncode == 0
        assert vehicles.obeyed == {1: [Order.ABORT], 2: [Order.ABORT]}
        stream.close()
        desk.close()
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=LIMIT_S)[1] == "companion watch: another program orders with this key\n"
    finally:
        vehicles.close()
        process.kill()
        process.communicate()


@pytest.mark.parametrize("missing", ["--key", "--mission"])
def test_orders_want_key_and_mission(folder: Path, missing: str) -> None:
    files = {"--mission": str(folder / "m.toml"), "--key": str(folder / "fleet" / "operator.key")}
    options = [word for name, value in files.items() if name != missing for word in (name, value)]
    done = subprocess.run(
        command(free_port(), "--orders", *options), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 2
    assert f"needs {missing} FILE" in done.stderr or f"{missing} FILE, the" in done.stderr


def test_damaged_count_of_orders_is_told_at_the_start_and_keeps_no_stop_back(tmp_path: Path) -> None:
    folder = make_fleet(tmp_path)
    (folder / "fleet" / "operator.key.orders").write_text("x")
    files = ["--mission", str(folder / "m.toml"), "--key", str(folder / "fleet" / "operator.key")]
    options = command(free_port(), "--orders", *files)
    with subprocess.Popen(options, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        Watch(process)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0
    assert "operator.key.orders: is no file of an operator's orders" in told
