"""`sim-bridge report`: the figures and the verdict of a run folder again, and its picture drawn anew."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from pathlib import Path
from typing import Any

from mission.load import load_mission
from mission.stand import stand_of
from sim_bridge.judge.fault_events import silenced
from sim_bridge.judge.metrics import measure
from sim_bridge.judge.report import picture, run_folder
from sim_bridge.judge.verdict import judge

MISSION_NAME = "mission.toml"  # as it was flown
PICTURE_NAME = "flight.png"


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge report`."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder of a flight")
    parser.add_argument("--json", action="store_true", help="the figures as JSON on standard output")


def run(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 the mission failed. RunFolderError or MissionError: the folder is not that of a flight."""
    folder: Path = args.folder
    recording = run_folder.load(folder)
    mission = load_mission(folder / MISSION_NAME)
    n = recording.on_ground.shape[1]
    if n != mission.swarm.size and len(recording.time_s):
        place = f"{folder / MISSION_NAME}: swarm.size = {mission.swarm.size}"
        raise run_folder.RunFolderError(f"{place}: must be {n}, as many vehicles as {run_folder.FILE_NAME} has")
    faults = run_folder.load_faults(folder, mission.swarm.size)
    end = run_folder.load_end(folder)
    picture_file = folder / PICTURE_NAME
    if picture_file.is_dir():
        raise run_folder.RunFolderError(f"{picture_file}: is a folder: must be a file, or nothing")
    metrics = measure(recording, mission, stand_of(mission, folder))
    figures = metrics.as_dict()
    verdict = None
    if end is None:
        _note(
            f"{folder / run_folder.METRICS_NAME}: missing: why the flight ended is not known, and there is no verdict"
        )
    else:
        if end.mission_sha256 not in (None, run_folder.mission_sha256((folder / MISSION_NAME).read_bytes())):
            _note(f"{folder / MISSION_NAME}: was changed after the flight: what follows is by what it says now")
        verdict = judge(metrics, mission, end.ended, silenced=silenced(faults, metrics.sim_time_s))
        figures |= {"ended": end.ended, "verdict": verdict.text}
    title = mission.name or folder.resolve().name
    picture.draw(recording, mission, picture_file, title=title, faults=faults)
    if args.json:
        print(json.dumps(figures))
    else:
        print_figures({key: value for key, value in figures.items() if key != "verdict"})
        print(f"  picture                        {picture_file}")
        if verdict is not None:
            print(verdict.text)
    return 0 if verdict is None or verdict.succeeded else 1


def _note(text: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"sim-bridge: {text}", file=sys.stderr)


def print_figures(figures: dict[str, Any]) -> None:
    """One a line, with the digits that mean something; metrics.json has them all."""
    for key, value in figures.items():
        shown = "-" if value is None else f"{value:.4g}" if isinstance(value, float) else value
        print(f"  {key:<30} {shown}")
