"""Options of `sim-bridge search`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from sim_bridge.options.study import positive, scheduler


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge search`."""
    parser.add_argument("--flights", type=positive, metavar="N", help="how many (default: 20 without --hours)")
    parser.add_argument("--hours", type=_hours, metavar="H", help="until this time is up")
    parser.add_argument(
        "--backend",
        choices=("jsbsim", "point-mass"),
        default="jsbsim",
        help="what the autopilots fly (default: jsbsim); point masses fly in still air, whatever the missions say",
    )
    parser.add_argument(
        "--law",
        metavar="LAW",
        help="law in place of ours, as for fly: a .py file, the name of an installed one",
    )
    parser.add_argument(
        "--seed", type=as_seed, default=1, metavar="S", help="of the first flight; the others follow (1)"
    )
    parser.add_argument(
        "--attackers",
        type=_share,
        default=0.5,
        metavar="SHARE",
        help="of flights with an attacker, 0 to 1: an insider, an outsider, or a spoofer (0.5)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the rows; what is there already is not flown again"
    )
    parser.add_argument("--shrink", type=as_count, default=0, metavar="K", help="make K failing missions smaller (0)")
    parser.add_argument("--workers", type=positive, metavar="N", help="processes (default: as many as processors)")
    parser.add_argument(
        "--scheduler", type=scheduler, metavar="ADDRESS", help="fly on the Dask cluster of this scheduler instead"
    )
    parser.add_argument("--json", action="store_true", help="a row of each flight on standard output")


def _hours(text: str) -> float:
    try:
        hours = float(text)
    except ValueError:
        hours = math.nan
    if not 0.0 < hours <= 10_000.0:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a number of hours above 0")
    return hours


def _share(text: str) -> float:
    try:
        share = float(text)
    except ValueError:
        share = math.nan
    if not 0.0 <= share <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a number from 0 to 1")
    return share


def as_seed(text: str) -> int:
    """A seed. ArgumentTypeError."""
    if not text.isdigit() or not 0 <= int(text) <= 2**32 - 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number from 0 to {2**32 - 1}")
    return int(text)


def as_count(text: str) -> int:
    """A whole number, 0 among them. ArgumentTypeError."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number")
    return int(text)
