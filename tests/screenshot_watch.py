"""The picture of docs/how-to/watch-in-the-field.md: `python -m tests.screenshot_watch` draws docs/images/watch.png.

A flight of five, whose leader is killed on the way, as `companion watch` hears it 8 s later on a phone.
"""

from __future__ import annotations

import io
import sys
import threading
from pathlib import Path

from PIL import Image

from companion.watch.command import about, view
from companion.watch.heard import Heard
from companion.watch.server import Stream, WatchServer
from mission.document.load import load_mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.report.browser_kit import WHY_NOT, Browser

ROOT = Path(__file__).parents[1]
FILE = ROOT / "docs" / "images" / "watch.png"
KILLED_S, SHOWN_S = 40.0, 48.0
SIZE_PX = (390, 1180)
COLOURS = 64


class _SeenEnoughError(Exception):
    pass


def main() -> int:
    if WHY_NOT is not None:
        print(WHY_NOT, file=sys.stderr)
        return 3
    mission = load_mission(ROOT / "mission" / "examples" / "lone_tree.toml").with_size(5).with_origin(DEFAULT_ORIGIN)
    mission = mission.with_faults([{"kind": "kill", "at_s": KILLED_S}])
    heard = Heard()

    def listen(flight: fly.Flight) -> None:
        now_s = flight.world.now_s
        for frames in flight.last.frames.values():
            for frame in frames:
                heard.receive_datagram(frame, now_s)
        if now_s >= SHOWN_S:
            raise _SeenEnoughError

    try:
        with Progress(io.StringIO()) as progress:
            fly.fly(mission, None, progress, in_process=True, watch=listen)
    except _SeenEnoughError:
        pass
    stream = Stream()
    server = WatchServer(("127.0.0.1", 0), stream)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    over = threading.Event()

    def show() -> None:
        while not over.wait(0.1):
            stream.show({"about": about(mission, None), **view(heard, mission, SHOWN_S)})

    threading.Thread(target=show, daemon=True).start()
    with Browser(*SIZE_PX, offline=False) as browser:
        browser.screen(*SIZE_PX, mobile=True)
        browser.dark(False)
        browser.open(server.urls[0])
        browser.wait("document.querySelectorAll('.card.ghost').length === 1")
        shot = Image.open(io.BytesIO(browser.screenshot())).convert("RGB")
    over.set()
    stream.close()
    server.shutdown()
    server.server_close()
    shot.quantize(COLOURS).save(FILE, optimize=True)
    print(f"{FILE.relative_to(ROOT)}: {FILE.stat().st_size / 1024:.0f} KiB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
