"""The built site in Chromium: its page flies, its leader is killed by a click, its trace is the native one.

`make site-check` builds the site and names it to these tests; elsewhere they are skipped. Whatever is asked for goes to
the server of these tests, or to a proxy that takes all that would leave this computer, and answers nothing. Chromium
itself asks its maker; that a page does is refused by its policy, which the console would tell.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

import pytest

from docs.website.browser import STARTED, modules
from docs.website.native import musl
from tests.report import browser_kit
from tests.report.browser_kit import SOFTWARE, Browser

ROOT = Path(__file__).parents[2]
SITE = Path(os.environ.get("SITE") or "/nonexistent")
WHY_NOT = browser_kit.WHY_NOT or (None if SITE.is_dir() else "no site is named: make site-check")
pytestmark = pytest.mark.skipif(WHY_NOT is not None, reason=str(WHY_NOT))
FLIES: Final = "document.documentElement.dataset.flight === 'flies'"
CHROMIUMS_OWN: Final = re.compile(r"(?:[\w-]+\.)*(?:google|googleapis|gstatic|gvt1|gvt2)\.com")
TICKS: Final = "Number(document.getElementById('ticks').textContent)"
COMMAND: Final = (
    "return document.getElementById('command').textContent + '|' + document.getElementById('hash').textContent"
)


class Files(SimpleHTTPRequestHandler):
    """As `python -m http.server`, and notes what was asked for."""

    asked: Final = list[str]()

    def log_message(self, *_: Any) -> None:
        self.asked.append(self.path)


class Outside(BaseHTTPRequestHandler):
    """Everything beyond this computer: nothing comes back, and what was asked for is kept."""

    asked: Final = list[str]()

    def do_GET(self) -> None:
        self.asked.append(re.sub(r"[:/].*", "", re.sub(r"^\w+://", "", self.path)))  # the host
        self.send_error(502)

    do_CONNECT = do_POST = do_GET  # noqa: N815

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def base() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Files, directory=str(SITE))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Outside) as proxy:
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        quiet = ("--disable-component-update", "--disable-sync", "--no-pings", "--disable-features=OptimizationHints")
        arguments = (*SOFTWARE, *quiet, f"--proxy-server=http://127.0.0.1:{proxy.server_port}")
        try:
            one = Browser(offline=False, arguments=arguments)
        except OSError as error:  # a container may not let it
            pytest.skip(f"Chromium does not start here: {error}")
        with one:
            yield one
        proxy.shutdown()


@pytest.fixture(autouse=True)
def nothing_leaves() -> Iterator[None]:
    Outside.asked.clear()
    yield
    assert [host for host in Outside.asked if not CHROMIUMS_OWN.fullmatch(host)] == []


def open_page(browser: Browser, url: str, until: str) -> None:
    """A page that says by another sign that it is drawn."""
    browser.console()
    browser.run("location.href = arguments[0]", url)
    browser.wait(f"location.href.startsWith({json.dumps(url.partition('#')[0])}) && document.readyState === 'complete'")
    browser.wait(until)


def ours(asked: str) -> str:
    return f"[...document.querySelectorAll('.event')].some((one) => /{asked}/i.test(one.textContent))"


def test_the_sources_in_the_page_are_those_of_the_checkout() -> None:
    with zipfile.ZipFile(SITE / "fly" / "sources.zip") as archive:
        names = {name for name in archive.namelist() if name.endswith(".py")}
        for file in modules():
            name = file.relative_to(ROOT).as_posix()
            assert archive.read(name) == file.read_bytes(), f"{name}: the site is of other sources: make site"
            names.discard(name)
    assert STARTED == "docs.website.world.here"
    assert {name.partition("/")[0] for name in names} == {"numpy", "fastcrc", "cryptography"}


def test_a_leader_is_killed_by_a_click_and_the_trace_is_the_native_one(browser: Browser, base: str) -> None:
    Files.asked.clear()
    open_page(browser, f"{base}fly/", f"{FLIES} && {TICKS} > 0")
    assert browser.run("return [...document.querySelectorAll('output')].map((one) => one.textContent)")[0] == "8"
    browser.frame(0)
    browser.run(
        "const it = document.querySelector('.controls select'); it.value = 'max'; it.dispatchEvent(new Event('change'))"
    )
    browser.wait(ours("vehicle 1 leads"))
    browser.wait(ours("Transit"))
    browser.run("document.querySelector('.controls .kill').click()")
    browser.wait(ours("companion of vehicle 1 killed"))
    browser.wait(ours("vehicle [2-8] leads"))
    assert browser.run("return document.querySelector('.verdict').textContent") == "under way"
    browser.run("document.querySelector('.controls .pause').click()")
    browser.wait("document.querySelector('.controls .pause').textContent === 'Resume flight'")
    browser.out_of_frame()
    browser.asked("const done = arguments[0]; setTimeout(done, 1500, null)")  # the page tells figures twice a second
    command, trace = str(browser.run(COMMAND)).split("|")
    assert browser.console() == []
    words = shlex.split(command)
    assert words[:3] == ["python", "-m", "docs.website.native"]
    assert any(word.endswith(":1") for word in words)
    assert "--musl" in words
    if reason := musl.why_not():
        pytest.skip(f"the trace was not compared with the native one: {reason}")
    run = subprocess.run([sys.executable, *words[1:]], cwd=ROOT, check=True, capture_output=True, text=True)
    flown = json.loads(run.stdout)
    assert flown["trace"] == trace
    assert flown["ticks"] == int(words[words.index("--until") + 1]) > 500
    assert {path.partition("?")[0].split("/")[1] for path in Files.asked} == {"fly"}


def test_settings_are_in_the_address_and_fly_again(browser: Browser, base: str) -> None:
    open_page(browser, f"{base}fly/?size=3&density_per_ha=0&loss=0.5&seed=9", f"{FLIES} && {TICKS} > 0")
    command = str(browser.run(COMMAND))
    assert '{"size":3,"range_m":30,"loss":0.5,"density_per_ha":0,"seed":9}' in command
    browser.run("document.querySelector('[name=seed]').value = 10; document.querySelector('form button').click()")
    browser.wait('document.getElementById("command").textContent.includes(\'"seed":10}\')')
    assert "seed=10" in browser.run("return location.search")


@pytest.mark.parametrize("width", [390, 1280])
def test_no_page_is_wider_than_its_window(browser: Browser, base: str, width: int) -> None:
    browser.screen(width, 844, mobile=width < 500)
    try:
        loaded = "document.readyState === 'complete'"
        for path, until in (
            ("fly/?size=2&density_per_ha=0", FLIES),
            ("", loaded),
            ("docs/how-to/fly-in-the-browser/", loaded),
        ):
            open_page(browser, base + path, until)
            assert browser.run("return document.documentElement.scrollWidth") <= width, path
            assert browser.console() == []
    finally:
        browser.screen(1280, 800)


def test_the_pages_can_be_searched(browser: Browser, base: str) -> None:
    open_page(browser, base, "document.querySelector('.md-search__button') !== null")
    Files.asked.clear()
    browser.run("document.querySelector('.md-search__button').click()")
    field = "[...document.querySelectorAll('*')].map((e) => e.shadowRoot?.querySelector('input')).find(Boolean)"
    browser.wait(f"{field} !== undefined")
    browser.run(
        f"const it = {field}; it.value = 'black box'; it.dispatchEvent(new Event('input', {{ bubbles: true }}))"
    )
    links = f"[...{field}.getRootNode().querySelectorAll('a')].map((a) => a.href)"
    browser.wait(f"{links}.some((href) => href.includes('black-box'))")
    assert all(str(href).startswith(base) for href in browser.run(f"return {links}"))


def test_diagrams_are_drawn(browser: Browser, base: str) -> None:
    drawn = "document.querySelectorAll('div.mermaid').length === 2 && document.querySelector('pre.mermaid') === null"
    open_page(browser, f"{base}docs/reference/flight-states/", drawn)
    browser.wait("[...document.querySelectorAll('div.mermaid')].every((one) => one.clientHeight > 100)")
    assert browser.console() == []


@pytest.mark.skipif(browser_kit.WHY_NOT_AXE is not None, reason=str(browser_kit.WHY_NOT_AXE))
@pytest.mark.parametrize("dark", [False, True])
def test_pages_have_no_barriers(browser: Browser, base: str, dark: bool) -> None:
    browser.dark(dark)
    try:
        for path in (
            "fly/?size=2&density_per_ha=0",
            "",
            "docs/how-to/fly-in-the-browser/",
            "docs/reference/flight-states/",
        ):
            open_page(browser, base + path, FLIES if path.startswith("fly") else "document.readyState === 'complete'")
            assert browser.barriers() == [], path
    finally:
        browser.dark(False)


def test_no_page_names_anything_elsewhere_to_load() -> None:
    loads = re.compile(
        r"<(?:script|link|img|iframe|source|video|audio)\b[^>]*?\b(?:src|href)=[\"']?(https?:[^\s\"'>]+)"
    )
    found = {str(page): loads.findall(page.read_text(encoding="utf-8")) for page in SITE.rglob("*.html")}
    assert len(found) > 80
    assert {page: names for page, names in found.items() if names} == {}
    assert [
        str(page) for page in SITE.rglob("*.html") if "Content-Security-Policy" not in page.read_text("utf-8")
    ] == []
