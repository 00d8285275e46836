"""Options of `sim-bridge report`."""

from __future__ import annotations

import argparse
from pathlib import Path

PAGE_NAME = "report.html"
BOXES_NAME = "black-box"  # folder of a run folder


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge report`."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of a flight, or of a study")
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"the page (default: {PAGE_NAME} in the folder)")
    parser.add_argument("--open", action="store_true", help="show the page in the browser")
    parser.add_argument("--json", action="store_true", help="the figures as JSON on standard output")
