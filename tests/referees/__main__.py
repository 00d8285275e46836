"""Tests that others wrote, flown by ours, beside their figures: `make referees`, or `python -m tests.referees`."""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from sim_bridge.lab.study.jobs import worker_count
from tests.referees.table import TITLE, section
from tests.referees.uav_testing import Flown, as_row, fly_layout, layouts

SIZES = (1, 4)
ESTIMATES = ("recorded", "2026-11")


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 where a flight was not clear."""
    parser = argparse.ArgumentParser(prog="python -m tests.referees", description=__doc__)
    parser.add_argument("--only", action="append", choices=list(layouts()), metavar="LAYOUT", help="m1_test_0, ...")
    parser.add_argument("-n", type=int, action="append", choices=SIZES, help="vehicles (default: 1, and 4)")
    parser.add_argument("--seed", type=int, default=1, help="of estimates and sensors (1)")
    parser.add_argument("--estimates", action="append", choices=ESTIMATES, help="of autopilots (default: both)")
    parser.add_argument("--workers", type=int, default=worker_count(), help="processes")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="a line for each flight; what is there is not flown")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into its section of this page")
    args = parser.parse_args(argv)
    kinds = args.estimates or ESTIMATES
    wanted = [(name, n, args.seed, kind) for kind in kinds for n in args.n or SIZES for name in args.only or layouts()]
    found = {_case(flown): flown for flown in _rows(args.rows)}
    with ProcessPoolExecutor(args.workers) as pool:
        futures = [pool.submit(fly_layout, *case) for case in wanted if case not in found]
        for future in as_completed(futures):
            flown = future.result()
            found[_case(flown)] = flown
            told = f"{flown.layout}, n = {flown.n}, {flown.estimates}: {flown.grade}, {flown.clearance_m:.2f} m"
            print(told, file=sys.stderr)
            if args.rows is not None:
                with args.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(as_row(flown)) + "\n")
    flights = [found[case] for case in wanted]
    text = section(flights, commit=_commit())
    print(text)
    if args.write is not None:
        page = args.write.read_text(encoding="utf-8")
        args.write.write_text(_with_section(page, text), encoding="utf-8")
    return 0 if all(flown.grade == "clear" for flown in flights) else 1


def _case(flown: Flown) -> tuple[str, int, int, str]:
    return flown.layout, flown.n, flown.seed, flown.estimates


def _rows(path: Path | None) -> list[Flown]:
    if path is None or not path.exists():
        return []
    return [Flown(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def _commit() -> str:
    told = subprocess.run(["git", "describe", "--always"], capture_output=True, text=True, check=False)
    return told.stdout.strip() or "unknown"


def _with_section(page: str, text: str) -> str:
    """`page` with its section of that title replaced, or with a new one at its end."""
    old = re.compile(rf"^## {re.escape(TITLE)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    if old.search(page):
        return old.sub(lambda _: text.rstrip() + "\n\n", page).rstrip() + "\n"
    return page.rstrip() + "\n\n" + text.rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main())
