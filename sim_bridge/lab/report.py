"""`sim-bridge report`: figures and verdict of a run folder again, and the page that replays it; of two; of a study."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.cli.main import EXIT_BAD_FILE
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from sim_bridge.errors import StartError
from sim_bridge.judge import page
from sim_bridge.judge.fault_events import FaultEvent, silenced
from sim_bridge.judge.metrics import Metrics, measure
from sim_bridge.judge.page.replay import Verdict, replay
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.report import MISSION_NAME, PICTURE_NAME, picture, print_figures, run_folder
from sim_bridge.judge.verdict import judge

ROWS = "rows.jsonl"  # of a study's folder


@dataclass(frozen=True, slots=True)
class Judged:
    """A flight out of its run folder, measured and judged anew."""

    folder: Path
    title: str
    recording: Recording
    mission: Mission
    stand: Stand
    faults: tuple[FaultEvent, ...]
    metrics: Metrics
    figures: dict[str, Any]
    verdict: Verdict

    def document(self) -> dict[str, Any]:
        """What a page replays."""
        return replay(
            self.recording,
            self.mission,
            self.folder,
            title=self.title,
            metrics=self.metrics,
            verdict=self.verdict,
            figures=self.figures,
            faults=self.faults,
            stand=self.stand,
        )


def run(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 a mission failed. RunFolderError or MissionError: a folder is not that of a flight."""
    folders: list[Path] = args.folders
    if len(folders) == 1 and (folders[0] / ROWS).is_file():
        return _study(args)
    if len(folders) > 2:
        raise StartError(f"report: {len(folders)} folders: must be one or two", EXIT_BAD_FILE)
    with Progress(sys.stderr) as signs:
        with signs.working("measuring the flight"):
            flights = [judged(folder) for folder in folders]
        with signs.working("drawing the flight"):
            for flight in flights:
                title, faults = flight.title, flight.faults
                picture.draw(flight.recording, flight.mission, flight.folder / PICTURE_NAME, title=title, faults=faults)
        with signs.working("writing its replay"):
            documents = [flight.document() for flight in flights]
    file: Path = args.out or folders[0] / page.PAGE_NAME
    if len(flights) == 1:
        text = page.page(documents[0], flights[0].title)
    else:
        file = args.out or folders[0] / f"report-beside-{folders[1].resolve().name}.html"
        text = page.page(beside(flights, documents), " and ".join(flight.title for flight in flights))
    run_folder.write(file, text.encode())
    if args.json:
        print(json.dumps(flights[0].figures if len(flights) == 1 else [flight.figures for flight in flights]))
    else:
        for flight in flights:
            _print(flight)
        print(f"  replay                         {file}")
        for flight in flights:
            if flight.verdict.text is not None:
                print(flight.verdict.text)
    if args.open:
        page.show(file)
    return 0 if all(flight.verdict.succeeded is not False for flight in flights) else 1


def _study(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 a limit is missed or a flight failed."""
    from sim_bridge.lab.study import engine, program  # what flights need not load
    from sim_bridge.lab.study import page as of_study

    folder: Path = args.folders[0]
    try:
        rows = list(engine.read_rows((folder / ROWS).read_bytes(), folder / ROWS).values())
    except engine.RowsError as error:
        raise StartError(str(error), EXIT_BAD_FILE) from None
    verdicts = of_study.read_verdicts(folder / program.MUST)
    title = folder.resolve().name.removeprefix("study-")
    document = of_study.document(folder, rows, verdicts, title)
    file: Path = args.out or folder / page.PAGE_NAME
    run_folder.write(file, page.page(document, title).encode())
    print(json.dumps(document) if args.json else f"{document['answer']}\n{file}")
    if args.open:
        page.show(file)
    return 1 if any(row["status"] != "flown" for row in rows) or document["succeeded"] is False else 0


def beside(flights: list[Judged], documents: list[dict[str, Any]]) -> dict[str, Any]:
    """Two flights in one document; those of the same name are told apart by their folders."""
    if flights[0].title == flights[1].title:
        for flight, document in zip(flights, documents, strict=True):
            document["title"] = f"{flight.title}: {flight.folder.resolve().name}"
    return {"format": "understory-replays", "version": 1, "flights": documents}


def judged(folder: Path) -> Judged:
    """The flight in `folder`. RunFolderError or MissionError: it is not that of a flight."""
    recording = run_folder.load(folder)
    mission = load_mission(folder / MISSION_NAME)
    n = recording.on_ground.shape[1]
    if n != mission.swarm.size and len(recording.time_s):
        place = f"{folder / MISSION_NAME}: swarm.size = {mission.swarm.size}"
        raise run_folder.RunFolderError(f"{place}: must be {n}, as many vehicles as {run_folder.FILE_NAME} has")
    faults = run_folder.load_faults(folder, mission.swarm.size)
    end = run_folder.load_end(folder)
    for name in (PICTURE_NAME, page.PAGE_NAME):
        if (folder / name).is_dir():
            raise run_folder.RunFolderError(f"{folder / name}: is a folder: must be a file, or nothing")
    stand = stand_of(mission, folder)
    metrics = measure(recording, mission, stand)
    figures = metrics.as_dict()
    verdict = Verdict(None, None)
    if end is None:
        _note(
            f"{folder / run_folder.METRICS_NAME}: missing: why the flight ended is not known, and there is no verdict"
        )
    else:
        if end.mission_sha256 not in (None, run_folder.mission_sha256((folder / MISSION_NAME).read_bytes())):
            _note(f"{folder / MISSION_NAME}: was changed after the flight: what follows is by what it says now")
        found = judge(metrics, mission, end.ended, silenced=silenced(faults, metrics.sim_time_s))
        verdict = Verdict(found.text, found.succeeded, end.ended)
        figures |= {"ended": end.ended, "verdict": found.text}
    title = mission.name or folder.resolve().name
    return Judged(folder, title, recording, mission, stand, faults, metrics, figures, verdict)


def _note(text: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"sim-bridge: {text}", file=sys.stderr)


def _print(flight: Judged) -> None:
    print_figures({key: value for key, value in flight.figures.items() if key != "verdict"})
    print(f"  picture                        {flight.folder / PICTURE_NAME}")
