"""`sim-bridge export`: a flight in the formats of other tools, out of its run folder."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Iterator
from pathlib import Path

from mission.cli.main import EXIT_BAD_FILE, EXIT_ENVIRONMENT
from sim_bridge.errors import StartError
from sim_bridge.judge.export import geojson, gpx, kml
from sim_bridge.judge.export.flown import Flown, load
from sim_bridge.judge.run_folder import write
from sim_bridge.options.export import BAG, NAME, WHAT

DOCUMENTS: dict[str, Callable[[Flown], Iterator[str]]] = {
    "kml": kml.document,
    "gpx": gpx.document,
    "geojson": geojson.document,
}


def run(args: argparse.Namespace) -> int:
    """Exit code 0. RunFolderError, MissionError: the folder is not that of a flight. OSError: a file is not written."""
    kinds = [kind for kind in WHAT if getattr(args, kind)]
    bag: Path | None = args.ros2bag
    if not kinds and bag is None:
        flags = ", ".join(f"--{kind}" for kind in (*WHAT, BAG))
        raise StartError(f"export: must be told what: {flags}", EXIT_BAD_FILE)
    flight = load(args.folder)
    if bag is not None:
        _write_bag(flight, bag)
    folder: Path = args.out or args.folder
    for kind in kinds:
        path = folder / f"{NAME}.{kind}"
        if kind == "mcap":
            from sim_bridge.judge.export import mcap_file  # the others need no library

            packed = io.BytesIO()
            counts = mcap_file.write(flight, packed)
            write(path, packed.getbuffer())
            print(f"{path}: {counts.total()} messages on {len(counts)} topics")
        elif kind == "rrd":
            try:
                from sim_bridge.judge.export import rerun_file
            except ModuleNotFoundError as error:
                why = f"--rrd: {error.name} is not installed: in the checkout, pip install -e '.[sim,rerun]'"
                raise StartError(why, EXIT_ENVIRONMENT) from None
            data, count = rerun_file.recorded(flight)
            write(path, data)
            print(f"{path}: {count} messages")
        else:
            text = "\n".join(DOCUMENTS[kind](flight)) + "\n"
            write(path, text.encode())
            print(path)
    return 0


def _write_bag(flight: Flown, bag: Path) -> None:
    try:
        from sim_bridge.judge.export.ros2 import bag as ros2_bag
    except ModuleNotFoundError as error:
        why = f"--{BAG}: {error.name} is not installed: in the checkout, pip install -e '.[sim,ros2]'"
        raise StartError(why, EXIT_ENVIRONMENT) from None
    if bag.exists() or bag.is_symlink():
        raise StartError(f"--{BAG}: {bag} is there already: must be a new folder", EXIT_BAD_FILE)
    counts = ros2_bag.write(flight, bag)
    print(f"{bag}: {counts.total()} messages on {len(counts)} topics")
    if not any(topic.endswith("/scan") for topic in counts):
        print(f"{bag}: no scans: the flight's telemetry logs hold none")
