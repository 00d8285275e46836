"""The moving picture at the top of README: `python -m tests.screenshot RUN` draws docs/images/replay.webp of a flight.

sim-bridge fly mission/examples/natural_stand.toml --seed 3 --kill leader@45 --out runs/readme
python -m tests.screenshot runs/readme --at 38 --until 60
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from sim_bridge.judge.page import page
from sim_bridge.lab.judged import judged
from tests.report.browser_kit import WHY_NOT, Browser

FILE = Path(__file__).parent.parent / "docs" / "images" / "replay.webp"
SIZE_PX = (1280, 790)
STEP_S = 0.5  # of the flight, between two frames
FRAME_MS = 125  # four times as fast as it was flown
LAST_MS = 2000
SHARE = 0.75  # of the page's size
QUALITY = 45


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of a flight")
    parser.add_argument("--at", type=float, default=60.0, metavar="S", help="its moment (60)")
    parser.add_argument("--until", type=float, metavar="S", help="move from there to here")
    parser.add_argument("--space", action="store_true", help="in space, not from above")
    parser.add_argument("--out", type=Path, default=FILE, metavar="FILE")
    args = parser.parse_args()
    if WHY_NOT is not None:
        print(WHY_NOT, file=sys.stderr)
        return 3
    flight = judged(args.run)
    with tempfile.TemporaryDirectory() as folder, Browser(*SIZE_PX) as browser:
        file = Path(folder) / "page.html"
        file.write_text(page(flight.document(), flight.title), encoding="utf-8")
        browser.dark(False)
        browser.open(file, f"#t={args.at:g}")
        if args.space:
            browser.run("document.querySelectorAll('.tabs button')[1].click()")
            browser.wait("document.querySelector('.space canvas')")
            browser.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        drawn_ms = browser.run("return document.documentElement.dataset.ready")
        size = file.stat().st_size
        frames = [_frame(browser)]
        until_s = args.at if args.until is None else args.until
        for k in range(1, int((until_s - args.at) / STEP_S) + 1):
            browser.run("location.hash = arguments[0]", f"#t={args.at + STEP_S * k:g}")
            browser.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            frames.append(_frame(browser))
    times_ms = [FRAME_MS] * (len(frames) - 1) + [LAST_MS]
    frames[0].save(
        args.out, save_all=True, append_images=frames[1:], duration=times_ms, loop=0, quality=QUALITY, method=6
    )
    print(f"{args.out}: {len(frames)} frames of a page of {size} bytes, drawn after {drawn_ms} ms")
    return 0


def _frame(browser: Browser) -> Image.Image:
    whole = Image.open(io.BytesIO(browser.screenshot())).convert("RGB")
    return whole.resize((int(SHARE * whole.width), int(SHARE * whole.height)), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    sys.exit(main())
