"""`companion stand`: a stand's files and report from a store of records."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from companion.stand.fusion.fuse import TooManyError
from companion.stand.products.write import describe_products, write_products
from companion.stand.records import RecordsError, count_set_apart, read_records
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
    print("\n".join([*(f"wrote {file}" for file in written.files), describe_products(written)]))
    apart = count_set_apart(Path(arguments.records))
    if apart:
        print(f"left out: {apart} records that were there before the swarm had keys, and that nobody has signed")
    return EXIT_DONE
