"""The page of `companion watch` in Chromium: on a phone, by touch and by keyboard, and when all is lost."""

from __future__ import annotations

import io
import math
import struct
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from companion.core.model.beacon import Candidate, PeerReport, RelativeReport
from companion.core.model.states import FlightState
from companion.mavlink.beacon import NOWHERE_DEG
from companion.mavlink.own_messages import encode_relative_report
from companion.mavlink.relative import RELATIVE_ID
from companion.watch.command import about, view
from companion.watch.heard import Heard
from companion.watch.server import Stream, WatchServer
from mission.basemap.charts import open_chart
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Mission
from tests.flights import short_mission
from tests.report import browser_kit
from tests.report.browser_kit import Browser
from tests.unit.watch.watch_kit import LEADS, beacon, frame, mbtiles

pytestmark = pytest.mark.skipif(browser_kit.WHY_NOT is not None, reason=str(browser_kit.WHY_NOT))
with_axe = pytest.mark.skipif(browser_kit.WHY_NOT_AXE is not None, reason=str(browser_kit.WHY_NOT_AXE))
SQUARE = ((-50, -70), (-50, 70), (70, 70), (70, -70))
MISSION = short_mission(fence={"polygon_enu_m": SQUARE})
assert MISSION.origin is not None
FRAME = LocalFrame(MISSION.origin.wgs84)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        one = Browser(offline=False)
    except OSError as error:  # a container may not let it
        pytest.skip(f"Chromium does not start here: {error}")
    with one:
        yield one


class Watching:
    """A server whose swarm and whose time are this test's."""

    def __init__(self, mission: Mission | None = MISSION, chart: Path | None = None) -> None:
        self.heard, self.now_s, self.mission = Heard(), 0.0, mission
        self.chart = None if chart is None else open_chart(chart)
        self.still = about(mission, self.chart)
        self.stream = Stream()
        self.server = WatchServer(("127.0.0.1", 0), self.stream, self.chart)
        self._lock, self._over = threading.Lock(), threading.Event()
        self.still_there = True  # pictures come
        self._threads = [threading.Thread(target=run) for run in (self.server.serve_forever, self._go_on)]
        for thread in self._threads:
            thread.start()

    def _go_on(self) -> None:
        while not self._over.wait(0.2):
            if self.still_there:
                self.show()

    def swarm(self, ids: tuple[int, ...] = (1, 2, 3)) -> None:
        """Each of these says something now: 1 leads, in a row to the north."""
        for k in ids:
            here = FRAME.to_wgs84((12.0 * (k - 1), 10.0, -8.0))
            seen = PeerReport(6, (-20.0, 15.0, 0.0), 4.0, silent=True) if k == 2 else None
            own = Candidate(k, 0, 6) if k == 3 else None
            parent = max(0, k - 1)
            told = beacon(k, here, hop=k - 1, parent=parent, sighting=seen, candidate=own, present=0b1011111)
            with self._lock:
                self.heard.receive_datagram(told, self.now_s)
        self.show()

    def show(self, after_s: float = 0.0) -> None:
        with self._lock:
            self.now_s += after_s
            self.stream.show({"about": self.still, **view(self.heard, self.mission, self.now_s)})

    def close(self) -> None:
        self._over.set()
        self.stream.close()
        self.server.shutdown()
        for thread in self._threads:
            thread.join()
        self.server.server_close()
        if self.chart is not None:
            self.chart.close()


@pytest.fixture
def watching() -> Iterator[Watching]:
    one = Watching()
    yield one
    one.close()


@pytest.fixture
def page(browser: Browser, watching: Watching) -> Iterator[Browser]:
    """Opened on a phone; afterwards nothing was asked for but of this server, and nothing went wrong."""
    browser.screen(390, 844, mobile=True)
    browser.dark(False)
    watching.swarm()
    browser.console()
    browser.requests()
    browser.open(watching.server.urls[0])
    yield browser
    assert all(url.startswith(watching.server.urls[0]) for url in browser.requests())
    assert browser.console() == []


def text(browser: Browser, selector: str) -> str:
    return str(browser.run(f"return document.querySelector('{selector}').innerText"))


def wait_for(browser: Browser, selector: str, words: str) -> None:
    browser.wait(f"document.querySelector('{selector}').innerText.includes({words!r})")


def test_it_says_who_leads_where_all_are_and_what_nobody_knows(page: Browser, watching: Watching) -> None:
    assert text(page, ".summary") == "Leader 1 · transit · 3 heard"
    cards = page.run("return [...document.querySelectorAll('.card')].map((node) => node.innerText)")
    assert [words.split()[:2] for words in cards] == [["1", "leads"], ["2", "follows"], ["3", "follows"]]
    assert "8 m up" in cards[0]
    assert "battery 60 to 69 %" in cards[2]
    assert "Vehicle 6: link lost in the air, last 4.0 s ago; reported by 2." in text(page, ".reports")
    assert "Never received, named by peers: 4, 5, 7." in text(page, ".unknown")
    assert "Battery not reported: 1, 2." in text(page, ".unknown")
    assert text(page, ".alarms") == ""
    assert watching.server.token == ""


def test_a_swarm_of_which_only_the_leader_has_satellites_is_drawn_as_it_estimates(
    page: Browser, watching: Watching
) -> None:
    nowhere = Wgs84(NOWHERE_DEG, NOWHERE_DEG, FRAME.origin.alt_m + 8.0)
    word = encode_relative_report(RelativeReport(2, 1000, (0.0, 0.0), (10.0, -20.0), 1.5))
    watching.heard.receive_datagram(beacon(1, FRAME.to_wgs84((0.0, 10.0, -8.0))), watching.now_s)
    watching.heard.receive_datagram(frame(RELATIVE_ID, word, 2) + beacon(2, nowhere), watching.now_s)
    watching.show()
    wait_for(page, ".vehicles li:nth-child(2)", "leader estimated 22 m away, ± 1.5 m")
    assert "8 m up" in text(page, ".vehicles li:nth-child(2)")
    assert "drawn where estimated from their leader: 2." in text(page, ".unknown")
    apart = page.run(
        "const [a, b] = watching.map.picture.vehicles.map((one) => watching.map.plane.enu(one.place ?? one.reckoned));"
        "return [b[0] - a[0], b[1] - a[1]]"
    )
    assert apart == pytest.approx([20.0, -10.0], abs=0.02)


def test_a_lost_link_is_told_by_banner_and_sound_until_somebody_is_quiet_about_it(
    page: Browser, watching: Watching
) -> None:
    watching.show(4.0)
    watching.swarm((1, 2))
    wait_for(page, ".alarms", "Vehicle 3: link lost in the air, last heard 4 s ago")
    wait_for(page, ".summary", "2 heard, 1 silent")
    assert "last heard 4.0 s ago" in text(page, ".card.ghost")
    page.wait("watching.sound.heard > 0")
    assert page.run("return watching.sound.wanted") is True
    tap(page, ".quiet")
    page.wait("watching.sound.wanted === false")
    wait_for(page, ".alarms", "Vehicle 3: link lost")  # still to be read
    watching.swarm()
    page.wait("document.querySelector('.alarms').innerText === ''")
    assert text(page, "[role=alert]") == ""  # what is over is not read to anybody who comes now
    watching.show(4.0)
    watching.swarm((1, 3))
    wait_for(page, ".alarms", "Vehicle 2: link lost")
    page.wait("watching.sound.wanted")  # of another vehicle: it sounds again


def test_a_lost_leader_the_fence_and_a_low_battery_are_told(page: Browser, watching: Watching) -> None:
    unled = LEADS.__class__(1, 7, 0, 9, established=False)
    for _ in range(6):
        watching.show(0.5)
        outside = FRAME.to_wgs84((80.0, 0.0, -8.0))
        watching.heard.receive_datagram(beacon(2, outside, lease=unled, candidate=Candidate(2, 0, 1)), watching.now_s)
    watching.show()
    for words in ("No leader for 3 s", "Vehicle 2: 10 m outside the fence", "Vehicle 2: battery at 19 % or less"):
        wait_for(page, ".alarms", words)


def test_a_computer_that_is_not_reached_any_more_is_told_and_ages_go_on(page: Browser, watching: Watching) -> None:
    watching.still_there = False
    wait_for(page, ".alarms", "Link to the watching computer lost")
    wait_for(page, ".card", "last heard")
    spoken = "document.querySelector('[role=alert]').innerText"
    page.wait(f"{spoken}.startsWith('Link to the watching computer lost')")
    watching.still_there = True
    page.wait("document.querySelector('.alarms').innerText === ''")
    assert page.run(f"return {spoken}") == "Link to the watching computer regained"


def test_nothing_that_is_told_is_shown_on_the_ground_as_a_loss(page: Browser, watching: Watching) -> None:
    here = FRAME.to_wgs84((0.0, 0.0, 0.0))
    landed = {"airborne": False, "state": FlightState.LANDED}
    for k in (1, 2, 3):
        watching.heard.receive_datagram(beacon(k, here, **landed), watching.now_s)
    watching.show(60.0)
    wait_for(page, ".summary", "Nothing heard for 60 s")
    assert page.run("return document.querySelectorAll('.alarms .grave').length") == 0


def tap(browser: Browser, selector: str) -> None:
    """With a finger, in the middle."""
    box = browser.run(
        f"const node = document.querySelector('{selector}'); node.scrollIntoView({{block: 'center'}});"
        "return node.getBoundingClientRect().toJSON()"
    )
    touch(browser, box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def touch(browser: Browser, x: float, y: float) -> None:
    browser.cdp("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    browser.cdp("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def test_what_a_finger_is_on_stays_there_while_pictures_come(page: Browser, watching: Watching) -> None:
    watching.show(4.0)
    watching.swarm((1, 2))
    wait_for(page, ".alarms", "link lost")
    page.run("window.before = [...document.querySelectorAll('.card, .quiet, .alarms p')]")
    watching.show(1.0)
    watching.swarm((1, 2))
    wait_for(page, ".alarms", "last heard 5 s ago")
    page.wait("document.querySelector('.card.ghost').innerText.includes('5.0 s')")
    same = page.run(
        "return [...document.querySelectorAll('.card, .quiet, .alarms p')].map((node, k) => node === before[k])"
    )
    assert same == [True] * 5
    assert text(page, "[role=alert]") == "Vehicle 3: link lost in the air, last heard 4 s ago"  # said once


def test_a_phone_shows_it_without_scrolling_sideways_and_fingers_meet_every_button(page: Browser) -> None:
    assert page.run("return document.documentElement.scrollWidth") <= 390
    small = page.run(
        "return [...document.querySelectorAll('button')].filter((node) => node.checkVisibility())"
        ".map((node) => node.getBoundingClientRect()).filter((box) => box.width < 48 || box.height < 48).length"
    )
    assert small == 0
    assert page.run("return parseFloat(getComputedStyle(document.documentElement).fontSize)") >= 18
    assert (
        page.run(
            "return [...document.styleSheets].flatMap((s) => [...s.cssRules]).some((r) => /:hover/.test(r.cssText))"
        )
        is False
    )


# Draws the map anew, and says where each of its labels is: left, right and middle height, in CSS pixels
LABELS = """
const pen = CanvasRenderingContext2D.prototype, fill = pen.fillText, found = [];
pen.fillText = function (text, x, y) {
  const width = this.measureText(text).width, left = this.textAlign === "center" ? x - width / 2 : x;
  if (/[a-z]/.test(text)) found.push([text, left, left + width, y]);
  return fill.call(this, text, x, y);
};
watching.map.draw();
pen.fillText = fill;
return found;
"""


def test_the_smallest_phone_shows_every_banner_whole_and_every_label_beside_the_others(
    browser: Browser, watching: Watching
) -> None:
    def hear(k: int, seen: PeerReport | None = None) -> None:
        here = FRAME.to_wgs84((12.0 * (k - 1), 10.0, -8.0))
        watching.heard.receive_datagram(beacon(k, here, hop=k - 1, parent=k - 1, sighting=seen), watching.now_s)

    browser.screen(320, 480, mobile=True)
    for k in (1, 2, 3):
        hear(k)
    watching.show(4.0)
    hear(1)
    hear(2, PeerReport(3, (19.0, 10.0, -8.0), 4.0, silent=True))  # 5 m from where it was heard here
    watching.show()
    browser.open(watching.server.urls[0])
    wait_for(browser, ".alarms", "Vehicle 3: link lost")
    labels = browser.run(LABELS)
    assert {"4.0 s ago", "3, reported by 2", "d1"} <= {label[0] for label in labels}
    for k, (_, left, right, y) in enumerate(labels):
        for _, other_left, other_right, other_y in labels[:k]:
            assert right <= other_left or other_right <= left or abs(y - other_y) >= 16.0, labels
    watching.still_there = False
    wait_for(browser, ".alarms", "Link to the watching computer lost")
    cut = browser.run(
        "const rows = document.querySelector('.alarms > div'); return rows.scrollHeight - rows.clientHeight"
    )
    assert cut == 0
    assert browser.run("return document.documentElement.scrollWidth") <= 320


def test_a_finger_drags_the_map_picks_a_vehicle_and_turns_the_sound_on(page: Browser) -> None:
    box = page.run("return document.querySelector('canvas').getBoundingClientRect().toJSON()")
    x, y = box["x"] + 100, box["y"] + 200
    before = page.run("return watching.map.view.east")
    page.cdp("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    for k in range(1, 6):
        page.cdp("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x + 12 * k, "y": y}])
    page.cdp("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert page.run("return watching.map.view.east") < before - 1.0
    tap(page, ".zoom [aria-label^=Follow]")
    there = page.run(
        "const one = watching.map.picture.vehicles[2], [e, n] = watching.map.plane.enu(one.place);"
        "return [watching.map.x(e), watching.map.y(n)]"
    )
    touch(page, box["x"] + there[0], box["y"] + there[1])
    page.wait("document.querySelector('.card[aria-pressed=true]')?.dataset.id === '3'")
    tap(page, ".switches button")
    page.wait("watching.sound.on")
    assert text(page, ".switches button") == "Sound on"


def test_the_keyboard_reaches_everything_and_moves_the_map(page: Browser, watching: Watching) -> None:
    unreached = page.run(
        "return [...document.querySelectorAll('button, canvas')].filter((node) => node.tabIndex < 0).length"
    )
    assert unreached == 0
    page.run("document.querySelector('canvas').focus()")
    scale, east = page.run("return [watching.map.view.scale, watching.map.view.east]")
    page.key("ArrowRight")
    page.key("+")
    page.wait(f"watching.map.view.scale > {scale} && watching.map.view.east > {east}")
    page.key("0")  # the fence is 140 m wide, and 120 m high
    page.wait("140 * watching.map.view.scale < watching.map.width")
    page.wait("140 * watching.map.view.scale > watching.map.width / 2")
    watching.show(4.0)
    watching.swarm((1, 2))
    wait_for(page, ".alarms", "link lost")
    page.key("q")
    page.wait("watching.sound.wanted === false")


def test_it_is_light_or_dark_as_its_reader_prefers_or_says(page: Browser) -> None:
    def brightness() -> float:
        return float(np.asarray(Picture.open(io.BytesIO(page.screenshot())).convert("L"))[840, 3])

    light = brightness()
    page.dark(True)
    page.wait("getComputedStyle(document.documentElement).backgroundColor === 'rgb(11, 16, 19)'")
    assert brightness() < 40 < 200 < light
    tap(page, ".switches button:nth-child(2)")
    page.wait("getComputedStyle(document.documentElement).backgroundColor === 'rgb(255, 255, 255)'")
    page.run("localStorage.clear()")


@with_axe
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_nothing_on_the_page_is_a_barrier(page: Browser, watching: Watching, dark: bool) -> None:
    page.dark(dark)
    watching.show(4.0)
    watching.swarm((1, 2))
    wait_for(page, ".alarms", "link lost")
    assert page.barriers() == []


def png(width: int, height: int, color: tuple[int, int, int]) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = (b"\0" + bytes(color) * width) * height
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def colour_at(browser: Browser, east_m: float, north_m: float) -> list[int]:
    """Of the map, so far from where vehicle 1 is drawn."""
    found: list[int] = browser.run(
        "const m = watching.map, [a, b] = m.plane.enu(m.picture.vehicles[0].place), r = devicePixelRatio;"
        "const [x, y] = [r * m.x(a + arguments[0]), r * m.y(b + arguments[1])];"
        "return [...m.canvas.getContext('2d').getImageData(x, y, 1, 1).data].slice(0, 3)",
        east_m,
        north_m,
    )
    return found


def test_tiles_lie_where_they_say(browser: Browser, tmp_path: Path) -> None:
    """Two of zoom 18, 100 m wide here: green, and red to the east of it. The edge is told by web Mercator's formula."""
    side = 2**18
    x = int((FRAME.origin.lon_deg + 180.0) / 360.0 * side)
    y = int((1.0 - math.asinh(math.tan(math.radians(FRAME.origin.lat_deg))) / math.pi) / 2.0 * side)
    edge_lon_deg = (x + 1) / side * 360.0 - 180.0
    top_lat_deg = math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * y / side))))
    tiles = {(18, x, y): png(256, 256, (20, 140, 60)), (18, x + 1, y): png(256, 256, (200, 30, 30))}
    watching = Watching(None, mbtiles(tmp_path / "m.mbtiles", tiles))
    try:
        corner = FRAME.to_ned(Wgs84(top_lat_deg, edge_lon_deg, 0.0))
        watching.heard.receive_datagram(beacon(1, FRAME.to_wgs84((corner[0] - 25.0, corner[1], -8.0))), 0.0)
        watching.heard.receive_datagram(beacon(2, FRAME.to_wgs84((corner[0] - 25.0, corner[1] + 30.0, -8.0))), 0.0)
        watching.show()
        browser.dark(False)
        browser.screen(390, 844, mobile=True)
        browser.console()
        browser.open(watching.server.urls[0])
        shown = "[...watching.map.chart.tiles.values()].filter((tile) => tile.naturalWidth).length === 2"
        browser.wait(shown)
        browser.run("watching.map.draw()")
        assert [colour_at(browser, east_m, 12.0) for east_m in (-5.0, -1.0)] == [[20, 140, 60]] * 2
        assert [colour_at(browser, east_m, 12.0) for east_m in (1.0, 20.0)] == [[200, 30, 30]] * 2
        assert colour_at(browser, -5.0, 24.0) == [20, 140, 60]
        assert colour_at(browser, -5.0, 26.0) == [255, 255, 255]  # above the tile
        told = ("404", "getImageData")  # tiles that the file has not, and that this test looks at pixels
        assert [line for line in browser.console() if not any(word in line for word in told)] == []
    finally:
        watching.close()


def test_an_image_with_a_world_file_lies_where_it_says(browser: Browser, tmp_path: Path) -> None:
    """A green one, from 10 m east of the origin to 40 m, as wide as high."""
    corner, opposite = FRAME.to_wgs84((15.0, 10.0, 0.0)), FRAME.to_wgs84((-15.0, 40.0, 0.0))
    per_px = [(opposite.lon_deg - corner.lon_deg) / 30, (opposite.lat_deg - corner.lat_deg) / 30]
    middle = [corner.lon_deg + per_px[0] / 2, corner.lat_deg + per_px[1] / 2]
    (tmp_path / "map.png").write_bytes(png(30, 30, (20, 140, 60)))
    (tmp_path / "map.pgw").write_text("\n".join(f"{v:.12f}" for v in (per_px[0], 0.0, 0.0, per_px[1], *middle)))
    watching = Watching(None, tmp_path / "map.png")
    try:
        watching.heard.receive_datagram(beacon(1, FRAME.to_wgs84((0.0, 0.0, -8.0))), 0.0)
        watching.heard.receive_datagram(beacon(2, FRAME.to_wgs84((0.0, 60.0, -8.0))), 0.0)
        watching.show()
        browser.dark(False)
        browser.screen(390, 844, mobile=True)
        browser.open(watching.server.urls[0])
        browser.wait("watching.map.chart.whole.complete")
        browser.run("watching.map.draw()")
        assert "No mission given" in text(browser, ".unknown")

        for inside in ((12.0, 10.0), (38.0, 10.0), (12.0, -13.0), (25.0, 13.0)):
            assert colour_at(browser, *inside) == [20, 140, 60]
        for outside in ((8.0, 10.0), (42.0, 10.0), (25.0, 17.0), (25.0, -17.0)):
            assert colour_at(browser, *outside) != [20, 140, 60]
    finally:
        watching.close()
