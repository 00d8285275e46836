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
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FOLDER",
        help="another flight, B: both in one page (comparison.html), one over the other, their figures side by side",
    )
    parser.add_argument(
        "--map",
        type=Path,
        metavar="FILE",
        help="of yours, to lie under the flight: MBTiles, or an image with a world file; what is about the flight of "
        "it is put into the page",
    )
    parser.add_argument("--utm", metavar="ZONE", help="of an image whose world file is in UTM: 32N, or EPSG:32632")
    parser.add_argument("--open", action="store_true", help="show the page in the browser")
    parser.add_argument("--json", action="store_true", help="the figures as JSON on standard output")
