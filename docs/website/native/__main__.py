"""Fly as the page does, and print ticks and trace: `python -m docs.website.native --size 8 --seed 1 --until 2000`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from docs.website.native import musl


def main(argv: Sequence[str]) -> int:
    """Exit code 0; 1 where musl is asked for and not there."""
    parser = argparse.ArgumentParser(prog="python -m docs.website.native", description=__doc__, allow_abbrev=False)
    parser.add_argument(
        "--settings", default="{}", metavar="JSON", help='as the page shows them: {"size": 8, "seed": 1}'
    )
    parser.add_argument("--kill", action="append", default=[], metavar="TICK:VEHICLE", help="before that tick")
    parser.add_argument("--until", type=int, metavar="TICKS", help="(to the end)")
    parser.add_argument("--positions", type=int, metavar="EVERY", help="print positions every so many ticks, too")
    parser.add_argument(
        "--musl", action="store_true", help="with WebAssembly's mathematics: the trace is then the page's"
    )
    args = parser.parse_args(argv)
    if args.musl:
        if reason := musl.why_not():
            print(reason, file=sys.stderr)
            return 1
        with tempfile.TemporaryDirectory(prefix="understory-") as folder:
            words = [word for word in argv if word != "--musl"]
            command = [sys.executable, "-m", "docs.website.native", *words]
            return subprocess.run(command, env=musl.environment(Path(folder)), check=False).returncode
    musl.sum_as_later_pythons()
    print(json.dumps(flown(args.settings, args.kill, args.until, args.positions)))
    return 0


def flown(settings: str, kills: Sequence[str], until: int | None, every: int | None) -> dict[str, object]:
    """Ticks, trace and why it ended; `positions`: of all vehicles, NED m, every so many ticks."""
    from docs.website.world.flight import PageFlight
    from docs.website.world.settings import Settings

    flight = PageFlight(Settings.read(json.loads(settings)).mission())
    due = [(int(tick), int(vehicle)) for tick, _, vehicle in (text.partition(":") for text in kills)]
    positions = []
    while flight.ended is None and (until is None or flight.ticks < until):
        for tick, vehicle in due:
            if tick == flight.ticks:
                flight.kill(vehicle)
        flight.tick()
        if every and flight.ticks % every == 0:
            positions.append(flight.last.pos_ned_m)
    found: dict[str, object] = {"ticks": flight.ticks, "trace": flight.trace.hexdigest(), "ended": flight.ended}
    return {**found, "positions": positions} if every else found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
