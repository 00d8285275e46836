"""What a live map costs its flight, watched and not, and how fast its page draws."""

from __future__ import annotations

import io
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mission.document.load import dump_mission, load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.live.live import Live
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.live.pace import Pace
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.table import Row
from tests.report.browser_kit import SOFTWARE, WHY_NOT, Browser

LONE_TREE = Path("mission/examples/lone_tree.toml")
STAND = Path("mission/examples/natural_stand.toml")
LOOPBACK = ("127.0.0.1", 0)
STINT = 20  # ticks: a second of flight with the map, a second without, in turns
FLYING_FROM_S = 8.0
CROWD_S = 20.0  # of flight: a hundred take their time
MOST = 1.05  # times what it costs without
FRAMES_S = 6.0
COUNT = """
const done = arguments[arguments.length - 1];
let frames = 0;
const began = performance.now();
const tick = (now) => {
  frames += 1;
  if (now - began < arguments[0]) requestAnimationFrame(tick);
  else done((1000 * frames) / (now - began));
};
requestAnimationFrame(tick);
"""
RENDERER = """
const gl = document.createElement("canvas").getContext("webgl");
return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
"""
READ_ALL = """
import asyncio, sys, websockets
async def main():
    async with websockets.connect(sys.argv[1], max_size=None) as stream:
        async for _ in stream:
            pass
asyncio.run(main())
"""


def live_map() -> Iterator[Row]:
    """The requirements of a live map."""
    yield _cost(load_mission(LONE_TREE), math.inf, viewers=0)
    yield _cost(crowd(), CROWD_S, viewers=1)
    if WHY_NOT is not None:
        yield Row("the page in Chromium", "", WHY_NOT, False)
        return
    yield _first_picture()
    yield from _frames()


def crowd() -> Mission:
    """A hundred vehicles among 400 trees/ha: the natural stand, wide enough for them."""
    tables = load_mission(STAND).model_dump(by_alias=True)
    tables["swarm"]["size"] = 100
    tables["coverage"] |= {"radius_m": 100.0, "duration_s": 240.0}
    tables["fence"]["polygon_enu_m"] = ((-200.0, -200.0), (350.0, -200.0), (350.0, 200.0), (-200.0, 200.0))
    return Mission.model_validate(tables)


class _InTurns(Map):
    """A map that is told nothing every other second."""

    told = True

    def due(self, now_s: float) -> bool:
        return self.told and super().due(now_s)


def _cost(mission: Mission, for_s: float, *, viewers: int) -> Row:
    """CPU time of the flight, agents in process, in stints with and without its map; and of the map's own process."""
    mission = mission.with_origin(DEFAULT_ORIGIN)
    stints: dict[bool, list[float]] = {True: [], False: []}
    map_ = _InTurns(LOOPBACK, ())
    ticks, began_s = 0, 0.0

    def watch(flight: fly.Flight) -> None:
        nonlocal ticks, began_s
        ticks += 1
        if ticks % STINT == 0:
            if flight.world.now_s > FLYING_FROM_S:
                stints[map_.told].append(time.process_time() - began_s)
            map_.told = not map_.told
            began_s = time.process_time()
        if flight.world.now_s >= for_s:
            raise KeyboardInterrupt

    command = [sys.executable, "-c", READ_ALL, map_.urls[0].replace("http", "ws") + "live"]
    watching = [subprocess.Popen(command, stderr=subprocess.DEVNULL) for _ in range(viewers)]
    try:
        with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
            live = Live(map_, Pace(1000.0), "bench")
            fly.fly(mission, Path(folder), progress, in_process=True, live=live, watch=watch)
        beside_s = _cpu_s(map_.pid)
    finally:
        map_.close()
        for viewer in watching:
            viewer.wait(10.0)
    pairs = list(zip(stints[True], stints[False], strict=False))
    ratio = sum(on for on, _ in pairs) / sum(off for _, off in pairs)
    share = beside_s / (2.0 * sum(off for _, off in pairs))
    n = mission.swarm.size
    looks = "one viewer" if viewers else "no viewer"
    seen = f"{ratio:.3f}x over {len(pairs)} pairs of stints (median {statistics.median(a / b for a, b in pairs):.3f}x)"
    what = f"CPU time of a flight with its map over that without, {looks}, n = {n}, {mission.name}, seed 1"
    return Row(what, f"<= {MOST:g}x", f"{seen}; the map's own process {100 * share:.0f} % of the flight", ratio <= MOST)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _first_picture() -> Row:
    """From the command to the first row that a browser has drawn, in wall time."""
    with tempfile.TemporaryDirectory() as folder, Browser(1280, 720, offline=False, arguments=SOFTWARE) as browser:
        began_s = time.monotonic()
        command = [sys.executable, "-m", "sim_bridge.cli", "fly", str(LONE_TREE), "--map", "--out", f"{folder}/run"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as program:
            assert program.stderr is not None
            url = next(found[1] for line in program.stderr if (found := re.search(r"live map: (\S+)", line)))
            told_s = time.monotonic() - began_s
            browser.open(url)
            browser.wait("Number(document.querySelector('.track input').max) > 0")
            moved_s = time.monotonic() - began_s
            program.terminate()
            program.stderr.read()
    load = f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    seen = f"{moved_s:.1f} s, its address after {told_s:.1f} s ({load})"
    return Row(
        "sim-bridge fly --map, n = 8: wall time to the first moving picture in Chromium", "<= 10 s", seen, moved_s <= 10
    )


def _frames() -> Iterator[Row]:
    with (
        tempfile.TemporaryDirectory() as folder,
        _fed(Path(folder)) as url,
        Browser(1280, 720, offline=False, arguments=SOFTWARE) as browser,
    ):
        browser.open(url)
        browser.wait("Number(document.querySelector('.track input').max) > 3")
        renderer = re.sub(r" \(0x[0-9A-F]+\)", "", browser.run(RENDERER))
        for view, name in enumerate(("from above", "in space")):
            browser.run("document.querySelectorAll('.tabs button')[arguments[0]].click()", view)
            browser.run("return new Promise((done) => setTimeout(done, 2000))")
            rate = max(browser.asked(COUNT, 1000 * FRAMES_S) for _ in range(3))
            what = f"the page, n = 100 at 10 Hz, 400 trees/ha (8800), 1280 x 720, {name}: frames a second, best of 3"
            seen = f"{rate:.0f} ({renderer}; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)"
            yield Row(what, ">= 30", seen, rate >= 30)


@contextmanager
def _fed(folder: Path) -> Iterator[str]:
    """The map of a hundred that move, ten rows a second of wall time; its address."""
    mission = crowd()
    (folder / "mission.toml").write_text(dump_mission(mission.with_origin(DEFAULT_ORIGIN)), encoding="utf-8")
    n = mission.swarm.size
    map_ = Map(LOOPBACK, ())
    map_.begin(folder / "mission.toml", "a hundred", n)
    starts = np.random.default_rng(1).uniform(-45.0, 45.0, (n, 2)).tolist()
    over = threading.Event()

    def feed() -> None:
        began_s, k = time.monotonic(), 0
        while not over.wait(max(0.0, began_s + 0.1 * k - time.monotonic())):
            map_.asked()
            map_.row(_row(0.1 * k, starts), [90.0] * n, [0.05] * n)
            k += 1

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        yield map_.urls[0]
    finally:
        over.set()
        feeder.join()
        map_.close()


def _row(time_s: float, starts: list[list[float]]) -> tuple[Any, ...]:
    """All on their way to the east, each swaying by itself."""
    n = len(starts)
    places = [(y + 2.0 * math.sin(time_s + k), x + 1.5 * time_s % 130.0, -4.0) for k, (x, y) in enumerate(starts)]
    rest = [(0.0, 0.0, 0.0)] * n
    acting = [k == 0 for k in range(n)]
    return (time_s, places, rest, [False] * n, [True] * n, [True] * n, [0] * n, [20.0] * n, [2] * n, acting, [1] * n)
