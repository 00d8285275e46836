"""The picture at the top of README: `python -m tests.screenshot RUN` draws docs/images/replay.png of a run folder.

sim-bridge fly mission/examples/natural_stand.toml --kill leader@45 --out runs/readme
python -m tests.screenshot runs/readme --at 62
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from sim_bridge.judge.page import page
from sim_bridge.lab.report import judged
from tests.browser_kit import WHY_NOT, Browser

FILE = Path(__file__).parent.parent / "docs" / "images" / "replay.png"
SIZE_PX = (1280, 790)
COLOURS = 256  # a palette: a third of the size, and hardly anybody sees it


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of a flight")
    parser.add_argument("--at", type=float, default=60.0, metavar="S", help="its moment (60)")
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
        picture = Image.open(io.BytesIO(browser.screenshot())).convert("RGB")
    picture.quantize(COLOURS).save(args.out, optimize=True)
    print(f"{args.out}: of a page of {size} bytes, drawn after {drawn_ms} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
