"""`sim-bridge report`: the figures of a run folder again, and its picture drawn anew."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from mission.load import load_mission
from sim_bridge.metrics import measure
from sim_bridge.report import picture, run_folder

MISSION_NAME = "mission.toml"  # as it was flown
PICTURE_NAME = "flight.png"


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge report`."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder of a flight")
    parser.add_argument("--json", action="store_true", help="the figures as JSON on standard output")


def run(args: argparse.Namespace) -> int:
    """Exit code 0. RunFolderError or MissionError: the folder is not that of a flight."""
    folder: Path = args.folder
    recording = run_folder.load(folder)
    mission = load_mission(folder / MISSION_NAME)
    n = recording.on_ground.shape[1]
    if n != mission.swarm.size and len(recording.time_s):
        place = f"{folder / MISSION_NAME}: swarm.size = {mission.swarm.size}"
        raise run_folder.RunFolderError(f"{place}: must be {n}, as many vehicles as {run_folder.FILE_NAME} has")
    figures = measure(recording, mission).as_dict()
    faults = run_folder.load_faults(folder)
    title = mission.name or folder.resolve().name
    picture.draw(recording, mission, folder / PICTURE_NAME, title=title, faults=faults)
    if args.json:
        print(json.dumps(figures))
    else:
        print_figures(figures)
        print(f"  picture                        {folder / PICTURE_NAME}")
    return 0


def print_figures(figures: dict[str, Any]) -> None:
    """One a line, with the digits that mean something; metrics.json has them all."""
    for key, value in figures.items():
        shown = "-" if value is None else f"{value:.4g}" if isinstance(value, float) else value
        print(f"  {key:<30} {shown}")
