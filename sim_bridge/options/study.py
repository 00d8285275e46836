"""Options of `sim-bridge study`."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

SCHEDULER = re.compile(r"(?:(?:tcp|tls)://)?(?:[\w.-]+|\[[0-9A-Fa-f:.]+\]):(\d{1,5})")


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge study`."""
    parser.add_argument("study", type=Path, metavar="FILE", help="study file (TOML)")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of rows and summary; what is there already is not flown again"
    )
    parser.add_argument("--workers", type=positive, metavar="N", help="processes (default: as many as processors)")
    parser.add_argument(
        "--scheduler", type=scheduler, metavar="ADDRESS", help="fly on the Dask cluster of this scheduler instead"
    )
    parser.add_argument("--seeds", type=positive, metavar="K", help="at most so many of each case: a quick look")
    parser.add_argument("--retry", action="store_true", help="fly those that failed again")
    parser.add_argument(
        "--replay", type=positive, metavar="K", help="fly the K worst flights again, to be replayed (agents, jsbsim)"
    )
    parser.add_argument("--json", action="store_true", help="summary.json's content on standard output")
    parser.add_argument("--open", action="store_true", help="show the study's page in the browser")


def scheduler(text: str) -> str:
    """HOST:PORT. ArgumentTypeError."""
    found = SCHEDULER.fullmatch(text)
    if found is None or not 0 < int(found[1]) < 2**16:
        raise argparse.ArgumentTypeError(f"{text!r}: must be HOST:PORT, tcp://HOST:PORT or tls://HOST:PORT")
    return text


def positive(text: str) -> int:
    """A whole number. ArgumentTypeError."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number of at least 1")
    return int(text)
