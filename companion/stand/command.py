"""`companion stand`: a stand's files and report from a store of records."""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from companion.cloud.returns_reader import ReturnsFileError
from companion.stand.fusion.fuse import TooManyError
from companion.stand.products.write import describe_products, write_products
from companion.stand.records import RecordsError, count_set_apart, read_records
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.problems import MissionError
from mission.document.load import load_mission


def stand(arguments: argparse.Namespace) -> int:
    """The exit code."""
    if arguments.cloud and find_spec("laspy") is None:  # before anything is written
        print("companion: stand: laspy is not installed: in the checkout, pip install -e '.[stand]'", file=sys.stderr)
        return EXIT_ENVIRONMENT
    try:
        mission = load_mission(arguments.mission)
        records = read_records(Path(arguments.records))
        out = Path(arguments.out)
        written = write_products(records, mission, out, form_height_m=arguments.form_height_m)
        lines = [*(f"wrote {file}" for file in written.files), describe_products(written)]
        if arguments.cloud:
            from companion.stand.cloud.write import describe_cloud, write_cloud  # laspy

            cloud = write_cloud([Path(file) for file in arguments.cloud], written, mission, out)
            lines += [f"wrote {cloud.file}", describe_cloud(cloud)]
    except (MissionError, RecordsError, TooManyError, ReturnsFileError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except OSError as error:
        print(f"companion: {error}", file=sys.stderr)
        return EXIT_ENVIRONMENT
    print("\n".join(lines))
    apart = count_set_apart(Path(arguments.records))
    if apart:
        print(f"left out: {apart} records that were there before the swarm had keys, and that nobody has signed")
    return EXIT_DONE
