"""`sim-bridge study`: the flights of a study file, a row of each, and what they show together."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

from mission.document.model import Estimates
from sim_bridge.judge.page import show
from sim_bridge.judge.progress import Progress as Signs
from sim_bridge.judge.progress import describe_pace
from sim_bridge.lab.study import engine, replays, spec
from sim_bridge.lab.study.case import Case, LoadedStudy
from sim_bridge.lab.study.jobs import Done, fly_batch, worker_count
from sim_bridge.lab.study.load import load_study
from sim_bridge.lab.study.results import must, page, plots, summary

CONNECT_S = 10.0  # wall time until a scheduler must have answered
ESTIMATES = ".".join(spec.ESTIMATES)
ROWS, COSTS, MUST = "rows.jsonl", "costs.jsonl", "must.json"


def run(args: argparse.Namespace) -> int:
    """Exit code: 0 all flights have figures, and reach what they must; 1 not so, or it was interrupted."""
    study = load_study(args.study, most_seeds=args.seeds)
    folder: Path = args.out or Path("runs") / f"study-{args.study.stem}"
    folder.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGTERM, _interrupt)
    errors = Console(stderr=True)
    if wrong := dict.fromkeys(case.run for case in study.cases if case.settings.get(ESTIMATES) == Estimates.RECORDED):
        note = f'{ESTIMATES} = "recorded" (as wrong as real autopilots; "exact" for the truth): {", ".join(wrong)}'
        errors.print(note, soft_wrap=True, highlight=False, markup=False)
    try:
        rows = fly(study, folder, errors, scheduler=args.scheduler, workers=args.workers, retry=args.retry)
    except KeyboardInterrupt:
        errors.print(f"interrupted: the same command goes on from {folder / ROWS}")
        return 1
    except engine.RowsError as error:
        errors.print(f"sim-bridge: {error}", soft_wrap=True, highlight=False)
        return 2
    with Signs(sys.stderr) as signs, signs.working("drawing the plots"):
        groups = summary.summarise(rows)
        summary.write(groups, folder)
        plots.draw(groups, folder / "plots")
        plots.draw_costs(folder / COSTS, folder / "plots" / "cost.png")
    verdicts = _verdicts(study, groups)
    if verdicts:
        (folder / MUST).write_text(json.dumps([v.as_dict() for v in verdicts], indent=1) + "\n", encoding="utf-8")
    if args.replay:
        by_key = {case.key: case for case in study.cases}
        again = replays.fly_worst(by_key, rows, folder, args.replay)
        began_s, count = time.monotonic(), 0
        while True:
            pace = describe_pace(count, count / args.replay, time.monotonic() - began_s)
            what = f"flying the worst again: {count} of at most {args.replay} are flown{pace}"
            with Signs(sys.stderr) as signs, signs.working(what):
                flown = next(again, None)
            if flown is None:
                break
            case, note = flown
            count += 1
            errors.print(f"replayed: {case.run}, seed {case.seed}{note and ': ' + note}", highlight=False)
    with Signs(sys.stderr) as signs, signs.working("writing the report"):
        report = page.write(folder, rows, [v.as_dict() for v in verdicts], study.study.name or args.study.stem)
    if args.json:
        print(json.dumps([group.as_dict() for group in groups]))
    else:
        print(page.answer(rows, groups, [v.as_dict() for v in verdicts]))
        summary.print_table(groups, Console())
        if verdicts:
            Console().print(must.table(verdicts))
        print(f"{len(rows)} flights: {folder}")
        print(f"report: {report}")
    if args.open:
        show(report)
    failed = [row for row in rows if row["status"] != "flown"]
    for row in failed[:5]:
        errors.print(f"failed: {row['run']}, n = {row['n']}, seed {row['seed']}: {row['error']}", highlight=False)
    return 1 if failed or not all(v.reached for v in verdicts) else 0


def _verdicts(study: LoadedStudy, groups: list[summary.Group]) -> list[must.Verdict]:
    varied = summary.varying(groups)
    wanted = {run.name: run.must for run in study.study.run}
    return [v for group in groups for v in must.judge(group, summary.label(group, varied), wanted[group.run])]


def fly(
    study: LoadedStudy,
    folder: Path,
    console: Console,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    retry: bool = False,
) -> list[engine.Row]:
    """The rows of all of the study's cases, in their order; flown as far as `folder` does not hold them yet.

    OSError when there is no scheduler at that address, or no library to talk to it.
    """
    with ExitStack() as stack:
        rows = stack.enter_context(engine.Rows(folder / ROWS, retry=retry))
        if rows.note:
            console.print(rows.note, soft_wrap=True, highlight=False, markup=False)
        engine.cut_unfinished(folder / COSTS)
        todo = [case for case in study.cases if case.key not in rows.rows]
        if todo:
            flies: engine.Fly
            if scheduler is None:
                flies = stack.enter_context(engine.Pool(min(workers or worker_count(), len(todo)))).fly
            else:
                flies = stack.enter_context(cluster(scheduler, console))
            costs = stack.enter_context((folder / COSTS).open("a", encoding="utf-8"))
            bar = stack.enter_context(_bar(console))
            name = study.study.name or "study"
            task = bar.add_task(name, total=sum(map(engine.cost, study.cases)), flights=len(todo), pace="")
            bar.advance(task, sum(engine.cost(case) for case in study.cases) - sum(map(engine.cost, todo)))
            left, costs_left = len(todo), sum(map(engine.cost, todo))
            all_costs, began_s = costs_left, time.monotonic()

            def pace() -> str:
                return describe_pace(len(todo) - left, 1.0 - costs_left / all_costs, time.monotonic() - began_s)

            plain = Signs(console.file)
            if not console.is_terminal:  # where the bar is not drawn
                stack.enter_context(plain.working(lambda: f"{name}: {left} of {len(todo)} flights to go{pace()}"))

            def noted(case: Case, row: engine.Row, cpu_s: float) -> None:
                nonlocal left, costs_left
                left -= 1
                costs_left -= engine.cost(case)
                cost = {key: row.get(key) for key in ("key", "run", "n", "sim_time_s")} | {"cpu_s": round(cpu_s, 4)}
                costs.write(json.dumps(cost) + "\n")
                costs.flush()
                bar.update(task, advance=engine.cost(case), flights=left, pace=pace())

            engine.run(study.cases, rows, flies, noted)
        return [rows.rows[case.key] for case in study.cases]


@contextmanager
def cluster(address: str, console: Console, job: Callable[[Any], Done] = fly_batch) -> Iterator[engine.Fly]:
    """A Dask cluster that does `job` for each batch. OSError when there is no scheduler at that address."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise OSError("distributed is not installed: in the checkout, pip install -e '.[sim,cluster]'") from None
    try:
        client = Client(address, timeout=CONNECT_S)  # TimeoutError is an OSError
    except TypeError as error:  # TLS without its keys
        raise OSError(f"{address}: {error}") from None
    with client:
        if not client.nthreads():
            console.print(f"waiting for workers of {address}", soft_wrap=True, highlight=False, markup=False)
            client.wait_for_workers(1)
        workers = sum(client.nthreads().values())
        yield engine.fly_on_cluster(client.get_executor(), workers, job)


def _bar(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(),  # a sign of life during a long flight
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %  {task.fields[flights]} flights to go{task.fields[pace]}"),
        console=console,
        transient=True,
    )


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
