"""How long the site's page takes to load, and how fast it flies, in Chromium: `python -m tests.bench.site dist/site`.

Loads are each of a browser that has never seen the page, from a server on this computer. Speed is simulated time over
the time that ticks took: what the page could fly, were it not asked to fly at real time.
"""

from __future__ import annotations

import statistics
import sys
import threading
from collections.abc import Sequence
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from tests.report.browser_kit import SOFTWARE, Browser

LOADS = 5
FLOWN_S = 60  # simulated: assembly, take-off, transit
FLIGHTS = {
    "8 among 225 trees/ha": "?size=8",
    "8 in the open": "?size=8&density_per_ha=0",
    "12 among 350 trees/ha": "?size=12&density_per_ha=350",
}


class Quiet(SimpleHTTPRequestHandler):
    """As `python -m http.server`."""

    def log_message(self, *_: Any) -> None:
        pass


def main(argv: Sequence[str]) -> int:
    """Print the figures."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=argv[0])) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://127.0.0.1:{server.server_port}/fly/"
        loads_s = [load_s(base) for _ in range(LOADS)]
        least, most = min(loads_s), max(loads_s)
        print(f"to the first tick: {statistics.median(loads_s):.1f} s (median of {LOADS}, {least:.1f} to {most:.1f})")
        for name, query in FLIGHTS.items():
            print(f"{name}: {speed(base + query):.2f} times real time")
        server.shutdown()
    size = sum(file.stat().st_size for file in Path(argv[0], "fly").rglob("*") if file.is_file())
    print(f"the page: {size / 1e6:.1f} MB")
    return 0


def load_s(url: str) -> float:
    """From the request of the page to the beginning of its flight."""
    with Browser(offline=False, arguments=SOFTWARE) as browser:
        browser.run("location.href = arguments[0]", url)
        browser.wait("document.documentElement.dataset.begun !== undefined")
        return float(browser.run("return document.documentElement.dataset.begun")) / 1e3


def speed(url: str) -> float:
    """Times real time, after FLOWN_S."""
    with Browser(offline=False, arguments=SOFTWARE) as browser:
        browser.run("location.href = arguments[0]", url)
        browser.wait("document.documentElement.dataset.flight === 'flies'")
        browser.frame(0)
        chosen = "const it = document.querySelector('.controls select'); it.value = 'max'; "
        browser.run(f"{chosen} it.dispatchEvent(new Event('change'))")
        browser.out_of_frame()
        browser.wait(f"Number(document.getElementById('ticks').textContent) > {20 * FLOWN_S}")
        return float(browser.run("return /([\\d.]+)× real/.exec(document.getElementById('status').textContent)[1]"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
