"""`companion stand`: a stand's files and report from stores of records."""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from companion.cloud.returns_reader import ReturnsFileError
from companion.stand.fusion.fuse import TooManyError
from companion.stand.products.write import describe_products, write_products
from companion.stand.records import RecordsError, check_mission, count_set_apart, read_stores
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.files import os_words
from mission.common.problems import MissionError
from mission.document.load import load_mission


def stand(arguments: argparse.Namespace) -> int:
    """The exit code."""
    if arguments.cloud and find_spec("laspy") is None:  # before anything is written
        print("companion: stand: laspy is not installed: in the checkout, pip install -e '.[stand]'", file=sys.stderr)
        return EXIT_ENVIRONMENT
    try:
        mission = load_mission(arguments.mission)
        stores, clouds = [Path(file) for file in arguments.records], [Path(file) for file in arguments.cloud]
        records = read_stores(stores)
        doubts = [doubt for store in stores if (doubt := check_mission(store, mission))]
        for file in clouds:
            if not file.is_file() or clouds.count(file) > 1:
                raise ReturnsFileError(f"{file}: {'given twice' if file.is_file() else 'no such file'}")
        returns = []
        if clouds:
            from companion.stand.cloud.write import check_flight, describe_cloud, read_files, write_cloud  # laspy

            returns = read_files(clouds)
            doubts += [doubt for file in returns if (doubt := check_flight(file, records))]
        out = Path(arguments.out)
        written = write_products(records, mission, out, form_height_m=arguments.form_height_m)
        lines = [*(f"wrote {file}" for file in written.files), describe_products(written)]
        if clouds:
            cloud = write_cloud(returns, written, mission, out)
            lines += [f"wrote {cloud.file}", describe_cloud(cloud)]
    except (MissionError, RecordsError, TooManyError, ReturnsFileError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_FILE
    except OSError as error:
        print(f"companion: {os_words(error)}", file=sys.stderr)
        return EXIT_ENVIRONMENT
    print("\n".join([*lines, *doubts]))
    apart = sum(count_set_apart(store) for store in stores)
    if apart:
        print(f"left out: {apart} records that were there before the swarm had keys, and that nobody has signed")
    return EXIT_DONE
