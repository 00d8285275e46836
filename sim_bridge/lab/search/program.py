"""`sim-bridge search`: flies drawn missions until their number or the time is up, and shrinks those that fail."""

from __future__ import annotations

import argparse
import hashlib
import json
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console

from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.entrant.law import find_law
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.judge.progress import Progress as Signs
from sim_bridge.judge.progress import describe_pace
from sim_bridge.judge.verdict import Grade
from sim_bridge.lab.search import summary
from sim_bridge.lab.search.attackers import ATTACKED_SHARE
from sim_bridge.lab.search.draw import VERSION, draw
from sim_bridge.lab.search.flight import SearchCase, fly_cases
from sim_bridge.lab.search.shrink import MOST_FLIGHTS, shrink
from sim_bridge.lab.study import engine
from sim_bridge.lab.study.case import Backend, Case
from sim_bridge.lab.study.jobs import worker_count
from sim_bridge.lab.study.program import ROWS, cluster
from sim_bridge.lab.study.results import page

BACKENDS = {"jsbsim": Backend.JSBSIM, "point-mass": Backend.AGENTS}
ROUND = 32  # flights that are drawn at once, where a time is given
SUMMARY = "summary.md"
SHOWN = ("seed", "n", "sim_time_s", "grade", "causes", "verdict")  # of each flight, as JSON


def run(args: argparse.Namespace) -> int:
    """Exit code: 0 every flight arrived, or is explained by its faults; 1 not so, or it was interrupted. LawError."""
    entrant = Entrant(None if args.law is None else find_law(args.law))
    entrant.stages()  # a bad law is told before there is a folder
    folder: Path = args.out or Path("runs") / f"search-{args.backend}"
    folder.mkdir(parents=True, exist_ok=True)
    errors = Console(stderr=True)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        rows = _campaign(args, entrant, folder, errors)
        (folder / SUMMARY).write_text(summary.markdown(rows), encoding="utf-8")
        page.write(folder, rows, [], "search")
        failed = summary.failures(rows)
        for row in [row for row in failed if row.get("causes")][: args.shrink]:  # what never ended has none to keep to
            _shrink(row, args, entrant, folder, errors)
    except KeyboardInterrupt:
        errors.print(f"interrupted: the same command goes on from {folder / ROWS}")
        return 1
    except engine.RowsError as error:
        errors.print(f"sim-bridge: {error}", soft_wrap=True, highlight=False)
        return 2
    if args.json:
        print(json.dumps([{key: row.get(key) for key in SHOWN} for row in rows]))
    else:
        print(summary.markdown(rows))
        print(f"{len(rows)} flights, {len(failed)} to look into: {folder}")
    return 1 if failed else 0


class _TimeIsUp(Exception):  # noqa: N818 - it is no error
    """The time that was given is over; flights that have not ended are left."""


def _campaign(args: argparse.Namespace, entrant: Entrant, folder: Path, errors: Console) -> list[engine.Row]:
    began_s, done = time.monotonic(), 0
    found: dict[str, engine.Row] = {}
    with suppress(_TimeIsUp), ExitStack() as stack:
        rows = stack.enter_context(engine.Rows(folder / ROWS))
        if rows.note:
            errors.print(rows.note, soft_wrap=True, highlight=False, markup=False)
        fly = stack.enter_context(_workers(args, errors))
        plain = Signs(errors.file)
        total = args.flights if args.flights or args.hours else 20

        def progress() -> str:
            elapsed_s = time.monotonic() - began_s
            share = done / (total - len(found) + done) if total else elapsed_s / (3600.0 * args.hours)
            flights = f"{len(found)} of {total}" if total else f"{len(found)}"
            return f"search: {flights} flights{describe_pace(done, min(share, 1.0), elapsed_s)}"

        stack.enter_context(plain.working(progress))

        def noted(case: Case, row: engine.Row, _cpu_s: float) -> None:
            nonlocal done
            done += 1
            found[case.key] = row
            if row.get("grade") in (Grade.UNSAFE, Grade.INCOMPLETE) or row["status"] != "flown":
                after = f", after {summary.time_of(row)} s" if "sim_time_s" in row else ""
                errors.print(
                    f"seed {case.seed}{after}: {row.get('verdict') or row['error']}\n  {_replay(args, case.seed)}",
                    soft_wrap=True,
                    highlight=False,
                    markup=False,
                )
            if args.hours is not None and time.monotonic() - began_s > 3600.0 * args.hours:
                raise _TimeIsUp

        seed = args.seed
        while total is None or seed < args.seed + total:
            if args.hours is not None and time.monotonic() - began_s > 3600.0 * args.hours:
                break
            end = seed + ROUND if total is None or args.hours is not None else args.seed + total
            cases = [_case(one, BACKENDS[args.backend], entrant, args.attackers) for one in range(seed, end)]
            found |= {case.key: rows.rows[case.key] for case in cases if case.key in rows.rows}
            engine.run(cases, rows, fly, noted)
            seed = end
    return sorted(found.values(), key=lambda row: int(row["seed"]))


def _case(seed: int, backend: Backend, entrant: Entrant, attacked_share: float) -> SearchCase:
    drawn = draw(seed, attacked_share)
    mission = drawn.mission
    text = f"{VERSION}{backend.value}{'signed' * drawn.signed}{dump_mission(mission)}"
    if not entrant.is_ours:
        text += entrant.note()
    satellites = "only the leader has GNSS" if mission.flies_by_ranges else "satellites"
    place = "trees" if mission.forest.stand is not None else "open"
    key = hashlib.sha256(text.encode()).hexdigest()[:16]
    run = f"{place}, {satellites}"
    case = SearchCase(key, run, entrant.name, backend, mission.swarm.size, seed, {}, mission, entrant)
    return replace(case, signed=drawn.signed, attacker=drawn.attacker)


@contextmanager
def _workers(args: argparse.Namespace, errors: Console) -> Iterator[engine.Fly]:
    if args.scheduler is not None:
        with cluster(args.scheduler, errors, fly_cases) as fly:
            yield fly
        return
    with engine.Pool(args.workers or worker_count()) as pool:
        yield lambda todo: pool.fly(todo, job=fly_cases)


def _shrink(row: engine.Row, args: argparse.Namespace, entrant: Entrant, folder: Path, errors: Console) -> None:
    """Write the mission that was flown, and the smallest that was found to fail in the same way."""
    drawn = draw(row["seed"], args.attackers)

    def print_progress(text: str) -> None:
        errors.print(f"  {text}", soft_wrap=True, highlight=False, markup=False)

    errors.print(f"shrinking seed {row['seed']}: {row['causes'][0]}", highlight=False)
    on_jsbsim = args.backend == "jsbsim"
    flown, began_s = 0, time.monotonic()

    def count() -> None:
        nonlocal flown
        flown += 1

    def progress() -> str:
        pace = describe_pace(flown, flown / MOST_FLIGHTS, time.monotonic() - began_s)
        return f"shrinking seed {row['seed']}: {flown} of at most {MOST_FLIGHTS} flights{pace}"

    with Signs(errors.file).working(progress):
        small, signed = shrink(
            drawn.mission,
            row["grade"],
            row["causes"][0],
            on_jsbsim=on_jsbsim,
            entrant=entrant,
            signed=drawn.signed,
            report_progress=print_progress,
            note_flight=count,
        )
    _write(folder / f"{row['seed']}.toml", drawn.mission, signed=drawn.signed)
    _write(folder / f"{row['seed']}-shrunk.toml", small, signed=signed)


def _write(file: Path, mission: Mission, *, signed: bool) -> None:
    """With how it was flown, where that is not in the mission."""
    file.write_text("# signed: true\n" * signed + dump_mission(mission), encoding="utf-8")


def _replay(args: argparse.Namespace, seed: int) -> str:
    law = "" if args.law is None else f" --law {args.law}"
    share = "" if args.attackers == ATTACKED_SHARE else f" --attackers {args.attackers:g}"
    flown = f"--backend {args.backend}{law}{share} --seed {seed}"
    return f"sim-bridge search {flown} --flights 1 --shrink 1 --out runs/search-{seed}"


def _interrupt(_number: int, _frame: FrameType | None) -> Any:
    raise KeyboardInterrupt
