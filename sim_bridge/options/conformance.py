"""Options of `sim-bridge conformance`."""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge conformance`."""
    parser.add_argument(
        "recordings", nargs="*", type=Path, metavar="RECORDING", help="*.tlog or *.tlog.xz (default: tests/recordings)"
    )
    parser.add_argument("--json", action="store_true", help="the report as JSON on standard output")
    parser.add_argument("--write", type=Path, metavar="FILE", help="the report as Markdown, too")
