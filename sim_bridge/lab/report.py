"""`sim-bridge report`: figures and verdict of a run folder again, and the page that replays it; a study's page."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mission.cli.main import EXIT_BAD_FILE
from sim_bridge.errors import StartError
from sim_bridge.judge import page, run_folder
from sim_bridge.judge.outcome import NAME_CHARS, print_figures
from sim_bridge.judge.page.basemap import piece_of
from sim_bridge.judge.page.black_boxes import box_lines, box_section, damage_lines, read_boxes
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.compare import NAMES, compare_figures, comparison, table
from sim_bridge.lab.judged import Judged, judged

ROWS = "rows.jsonl"  # of a study's folder
COMPARISON = "comparison.html"


def run(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 a mission failed, 2 a black box is damaged, and all else is done.

    RunFolderError or MissionError: a folder is not that of a flight.
    """
    folder: Path = args.folder
    if (folder / ROWS).is_file():
        if args.against is not None or args.map is not None:
            raise StartError(f"{folder}: is a study: --against and --map are for flights", EXIT_BAD_FILE)
        return _study(args)
    if args.against is not None:
        return _compare(args)
    with Progress(sys.stderr) as signs:
        with signs.working("measuring the flight"):
            flight = judged(folder)
        with signs.working("writing its replay"):
            boxes = read_boxes(folder)
            document = flight.document() | _chart(args, [flight])
            if args.out is not None:
                document.pop("stand_report", None)  # beside which it is not
            text = page.page(document, flight.title, box_section(boxes))
    file: Path = args.out or folder / page.PAGE_NAME
    run_folder.write(file, text.encode())
    if args.json:
        print(json.dumps(flight.figures))
    else:
        print_figures({key: value for key, value in flight.figures.items() if key != "verdict"})
        for line in box_lines(boxes):
            print(f"  {line}")
        print(f"  {'replay':<{NAME_CHARS}} {file}")
        if flight.verdict.text is not None:
            print(flight.verdict.text)
    damaged = damage_lines(boxes)
    for line in damaged:
        print(f"sim-bridge: {line}", file=sys.stderr)
    if args.open:
        page.show(file)
    if damaged:
        return EXIT_BAD_FILE
    return 1 if flight.verdict.succeeded is False else 0


def _compare(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 a mission of the two failed."""
    with Progress(sys.stderr) as signs:
        with signs.working("measuring the flights"):
            flights = [judged(folder) for folder in (args.folder, args.against)]
        with signs.working("writing their replay"):
            document = comparison(*flights) | _chart(args, flights)
            text = page.page(document, document["title"])
    file: Path = args.out or args.folder / COMPARISON
    run_folder.write(file, text.encode())
    if args.json:
        print(json.dumps(document["comparison"]))
    else:
        for line in document["against"]["notes"]:
            print(line)
        for line in table(compare_figures(*flights)):
            print(line)
        for name, flight in zip(NAMES, flights, strict=True):
            print(f"{name} {flight.folder}: {flight.verdict.text or 'no verdict'}")
        print(f"both: {file}")
    if args.open:
        page.show(file)
    return 1 if any(flight.verdict.succeeded is False for flight in flights) else 0


def _chart(args: argparse.Namespace, flights: Sequence[Judged]) -> dict[str, Any]:
    if args.map is None:
        if args.utm is not None:
            raise StartError(f"--utm {args.utm}: is for an image that --map names", EXIT_BAD_FILE)
        return {}
    return {"chart": piece_of(args.map, args.utm, [(flight.recording, flight.mission) for flight in flights])}


def _study(args: argparse.Namespace) -> int:
    """Exit code: 0, 1 a limit is missed or a flight failed."""
    from sim_bridge.lab.study import engine, program  # what flights need not load
    from sim_bridge.lab.study.results import page as of_study

    folder: Path = args.folder
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
