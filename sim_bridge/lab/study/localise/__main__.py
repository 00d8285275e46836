"""`python -m sim_bridge.lab.study.localise FILE`: the runs of a study of relative localisation, and what they show."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from mission.common.problems import MissionError
from sim_bridge.lab.study.jobs import start_worker, worker_count
from sim_bridge.lab.study.localise import figures, jobs, spec
from sim_bridge.lab.study.localise.jobs import Row
from sim_bridge.lab.study.summary import Spread

ROWS = "rows.jsonl"
SHOWN = (
    "rmse_m",
    "rmse_own_m",
    "p95_m",
    "first_m",
    "bound_m",
    "smoothed_m",
    "rotation_deg",
    "rotation_sd_deg",
    "nees",
    "nis",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code: 0 flown, 2 the file is wrong."""
    parser = argparse.ArgumentParser(prog="python -m sim_bridge.lab.study.localise", description=__doc__)
    parser.add_argument("study", type=Path, metavar="FILE", help="study file (TOML)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of rows; what is there is not flown again")
    parser.add_argument("--seeds", type=int, metavar="K", help="at most so many of each run: a quick look")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: as many as processors)")
    args = parser.parse_args(argv)
    try:
        study = spec.load(args.study)
    except MissionError as error:
        print(error, file=sys.stderr)
        return 2
    folder: Path = args.out or Path("runs") / f"study-{args.study.stem}"
    folder.mkdir(parents=True, exist_ok=True)
    seeds = range(study.first_seed, study.first_seed + min(study.seeds, args.seeds or study.seeds))
    cases = [spec.Case(study, run, seed) for run in study.run for seed in seeds]
    rows = _fly(cases, folder, args.workers or worker_count())
    _show(study, {run.name: [rows[case.key] for case in cases if case.run is run] for run in study.run}, folder)
    return 0


def _fly(cases: Sequence[spec.Case], folder: Path, workers: int) -> dict[str, Row]:
    """By key; each row is written as its flight ends."""
    file = folder / ROWS
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    rows: dict[str, Row] = {row["key"]: row for row in map(json.loads, lines)}
    todo = {case.key: case for case in cases if case.key not in rows}
    if not todo:
        return rows
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        file.open("a", encoding="utf-8") as out,
        ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=start_worker) as pool,
    ):
        # Flights among trees first, each once: further seeds take them from the folder.
        trees = {jobs.path_file(case, folder): case for case in todo.values() if case.run.motion.kind == "trees"}
        for done in as_completed([pool.submit(jobs.fly_among_trees, case, path) for path, case in trees.items()]):
            done.result()
        for future in as_completed([pool.submit(jobs.flown, case, folder) for case in todo.values()]):
            row = future.result()
            rows[row["key"]] = row
            out.write(json.dumps(row) + "\n")
            out.flush()
    return rows


def _show(study: spec.Study, runs: dict[str, list[Row]], folder: Path) -> None:
    """Tables, and the same in must.json and summary.json."""
    shown = Table(title="mean ± 95 % interval of the mean (worst)", title_justify="left", box=SIMPLE)
    for heading in ("run", "n", *SHOWN, "NEES inside", "core, %"):
        shown.add_column(heading)
    verdicts, summary = [], []
    for run in study.run:
        rows = runs[run.name]
        found = figures.spreads(rows)
        inside, low, high = figures.nees_inside(rows, 2 * (study.size - 1))
        cpu = found["cpu_share"].mean
        told = [_told(found.get(name)) for name in SHOWN]
        shown.add_row(run.name, str(len(rows)), *told, f"{inside:.0%} of [{low:.2f}, {high:.2f}]", f"{100.0 * cpu:.2f}")
        verdicts += list(figures.judge(run.name, run.must, found, inside))
        means = {name: one.mean for name, one in found.items()}
        summary.append({"run": run.name, "seeds": len(rows), **means, figures.NEES_INSIDE: inside})
    console = Console(width=None if sys.stdout.isatty() else 240)
    console.print(shown)
    musts = Table(title="what must be reached", title_justify="left", box=SIMPLE)
    for heading in ("run", "figure", "must", "seen", ""):
        musts.add_column(heading)
    for v in verdicts:
        sign = ">=" if v.figure == figures.NEES_INSIDE else "<="
        seen = "-" if v.seen is None else f"{v.seen:.3g}"
        word = "reached" if v.reached else "MISSED"
        musts.add_row(v.run, f"{v.figure}, {v.statistic}", f"{sign} {v.must:g}", seen, word)
    if verdicts:
        console.print(musts)
    (folder / "must.json").write_text(json.dumps([v.as_dict() for v in verdicts], indent=1) + "\n", encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")


def _told(one: Spread | None) -> str:
    if one is None:
        return "-"
    half = "" if one.high is None else f" ± {one.high - one.mean:.2g}"
    return f"{one.mean:.3g}{half} ({one.worst:.3g})"


if __name__ == "__main__":
    sys.exit(main())
