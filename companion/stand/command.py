"""`companion stand`: a stand's files and report from a store of records."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from companion.stand.fusion.fuse import TooManyError
from companion.stand.products.write import Products, write_products
from companion.stand.records import RecordsError, read_records
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.problems import MissionError
from mission.document.load import load_mission


def stand(arguments: argparse.Namespace) -> int:
    """The exit code."""
    try:
        mission = load_mission(arguments.mission)
        records = read_records(Path(arguments.records))
        written = write_products(records, mission, Path(arguments.out), form_height_m=arguments.form_height_m)
    except (MissionError, RecordsError, TooManyError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except OSError as error:
        print(f"companion: {error}", file=sys.stderr)
        return EXIT_ENVIRONMENT
    print("\n".join([*(f"wrote {file}" for file in written.files), _verdict(written)]))
    return EXIT_DONE


def _verdict(written: Products) -> str:
    """The finding in a line."""
    found = f"{len(written.fusion.stems)} stems"
    figures = written.ground.figures
    if figures is None:
        return f"{found}; too little ground was seen, or too few stems found, for figures per hectare"
    basal = figures.basal_area_m2_per_ha
    spread = "" if basal.low is None or basal.high is None else f" ({basal.low:.1f} to {basal.high:.1f})"
    return f"{found}; {figures.seen_ha:.2f} ha seen; basal area {basal.value:.1f} m2/ha{spread}"
