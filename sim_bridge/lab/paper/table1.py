"""The paper's Table I and Figures 4 and 5 beside ours: `make table1`, or `python -m sim_bridge.lab.paper.table1`."""

from __future__ import annotations

import argparse
import io
import json
import os
import platform
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from rich.console import Console

from mission.document.load import load_mission
from sim_bridge.drive import fly
from sim_bridge.judge import run_folder
from sim_bridge.judge.progress import Progress
from sim_bridge.lab.paper import stages
from sim_bridge.lab.plot_style import ALARM, INK, PALETTE, RC
from sim_bridge.lab.study.load import load_study
from sim_bridge.lab.study.program import COSTS
from sim_bridge.lab.study.program import fly as fly_study
from sim_bridge.lab.study.results import plots, summary
from sim_bridge.lab.study.results.summary import Group, Spread
from sim_bridge.world.world import DEFAULT_ORIGIN

STUDY = Path("sim_bridge/lab/study/examples/table1.toml")
MISSION = Path("mission/examples/paper.toml")
SIZES = (4, 8, 12)
PAPER_RUNS = {4: (190, 195, 192, 196, 193), 8: (190, 199, 199, 194, 201), 12: (263, 283, 225, 234, 218)}
PAPER_STRAIGHT_S = 185.57  # to d2 itself: 129.9 m at 0.7 m/s
IN_FIGURE_5 = ("paper mode", "paper mode, parallel", "ours", "ours, JSBSim")
COLOURS = PALETTE[:4]
OVERHEADS = ("overhead_leader", "overhead_last", "over_alone_last")
COLUMNS = 13
WITHIN = 0.08  # of the paper's means: what the reading has to reach


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: all flown, and paper mode within 8 % of the paper."""
    parser = argparse.ArgumentParser(
        prog="python -m sim_bridge.lab.paper.table1", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--out", type=Path, default=Path("runs/table1"), metavar="DIR", help="rows and summary")
    parser.add_argument("--docs", type=Path, metavar="DIR", help="also put the table and the pictures there")
    parser.add_argument("--again", action="store_true", help="forget the flights that --out holds already")
    args = parser.parse_args(argv)
    began_s = time.perf_counter()
    if args.again and args.out.exists():
        shutil.rmtree(args.out)
    args.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as beside:
        drawn = beside.submit(draw_figure_4, args.out / "figure4.png")
        rows = fly_study(load_study(STUDY), args.out, Console(stderr=True))
        with Progress(sys.stderr) as signs, signs.working("flying the paper's flight for Figure 4"):
            drawn.result()
    with Progress(sys.stderr) as signs, signs.working("drawing the plots"):
        groups = summary.summarise(rows)
        summary.write(groups, args.out)
        plots.draw(groups, args.out / "plots")
        draw_figure_5(groups, args.out / "figure5.png")
    text = "\n".join([*table(groups), ""])
    (args.out / "table1.md").write_text(text, encoding="utf-8")
    print(text)
    print(_timing(args.out, time.perf_counter() - began_s))
    if args.docs is not None:
        args.docs.mkdir(exist_ok=True)
        machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
        head = f"# Table I\n\nWritten by `make table1` on {datetime.now(UTC):%Y-%m-%d} ({machine}).\n"
        page = f"{head}\n{text}\n{_timing(args.out, time.perf_counter() - began_s)}\n"
        (args.docs / "table1.md").write_text(page, encoding="utf-8")
        for name in ("figure4.png", "figure5.png"):
            shutil.copyfile(args.out / name, args.docs / name)
    return 0 if reached(groups) and all(group.failed == 0 for group in groups) else 1


def reached(groups: Sequence[Group]) -> bool:
    """Paper mode's means of all flights, with their intervals, are within 8 % of the paper's."""
    found = [g for g in groups if g.run == "paper mode"]
    return len(found) == len(SIZES) and all(_is_near(group) for group in found)


def _is_near(group: Group) -> bool:
    mean, s = paper_mean(group.n), group.figures.get("arrival_leader_s")
    if s is None or s.count < group.flights or s.low is None or s.high is None:
        return False
    return max(abs(s.low / mean - 1.0), abs(s.high / mean - 1.0)) <= WITHIN


def paper_mean(n: int) -> float:
    """Table I's average."""
    return sum(PAPER_RUNS[n]) / len(PAPER_RUNS[n])


def table(groups: Sequence[Group]) -> Iterator[str]:
    """Markdown: the paper's rows, then a row for each run and n."""
    yield "Time: of the leader's arrival, in steps for Algorithm 1 and in seconds for ours; ± is the 95 % interval of"
    yield "the mean (Student's t). Overhead: over the straight flight to the same arrival, 5 m short of d2; in the"
    yield f"paper's own rows over its {PAPER_STRAIGHT_S} s to d2 itself. Over one alone: of the last, beside one UAV."
    yield "Arrived, and of last: gathered, which for Algorithm 1 is in one piece and within full range of d2, so that"
    yield "where it is gathered both overheads are the same. A leader alone has a time, but its flight no arrival."
    yield ""
    yield _markdown(
        *("run", "n", "arrived", "time", "sd", "worst", "time / the paper's", "overhead of leader", "of last"),
        *("over one alone", "least separation, m", "contacts a flight", "least connected"),
    )
    yield _markdown(*["---"] * COLUMNS)
    for n, times in PAPER_RUNS.items():
        mean = paper_mean(n)
        sd = f"{statistics.stdev(times):.1f}"
        yield _markdown(
            "the paper", n, "5/5", f"{mean:.1f}", sd, max(times), 1, _percent(mean / PAPER_STRAIGHT_S - 1.0)
        )
    for group in groups:
        yield _row(group)


def _row(group: Group) -> str:
    figures = group.figures
    arrived = f"{group.arrived}/{group.flights}"
    separation, contacts, connected = (
        figures.get(name) for name in ("min_separation_m", "contacts", "connected_fraction_transit")
    )
    rest = (
        "-" if separation is None else f"{separation.worst:.2f}",
        "-" if contacts is None else f"{contacts.mean:.1f}",
        "-" if connected is None else f"{100.0 * connected.worst:.1f} %",
    )
    time_s = figures.get("arrival_leader_s")
    if time_s is None:
        return _markdown(group.run, group.n, arrived, *["-"] * 7, *rest)
    same = group.n in SIZES and "3 m/s" not in group.run
    return _markdown(
        *(group.run, group.n, arrived, _mean(time_s), "-" if time_s.sd is None else f"{time_s.sd:.1f}"),
        *(f"{time_s.worst:.1f}", f"{time_s.mean / paper_mean(group.n):.3f}" if same else "-"),
        *(_mean(figures[name], 100.0) + " %" if name in figures else "-" for name in OVERHEADS),
        *rest,
    )


def _mean(found: Spread, scale: float = 1.0) -> str:
    half = "" if found.high is None else f" ± {round(scale * (found.high - found.mean), 3):.2g}"
    return f"{scale * found.mean:.1f}{half}" if scale == 1.0 else f"{scale * found.mean:.2f}{half}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _markdown(*cells: object) -> str:
    return "| " + " | ".join(map(str, [*cells, *["-"] * (COLUMNS - len(cells))])) + " |"


def _timing(folder: Path, wall_s: float) -> str:
    costs = [json.loads(line) for line in (folder / COSTS).read_text().splitlines()]
    masses_s = sum(cost["cpu_s"] for cost in costs if "JSBSim" not in cost["run"])
    jsbsim_s = sum(cost["cpu_s"] for cost in costs if "JSBSim" in cost["run"])
    return (
        f"Processor time: point-mass flights {masses_s:.0f} s, JSBSim flights {jsbsim_s:.0f} s, over as many processes "
        f"as there are processors; {wall_s:.0f} s in all."
    )


def draw_figure_5(groups: Sequence[Group], file: Path) -> None:
    """Time over n: the paper's runs, and the means of ours with their intervals."""
    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(7.5, 4.6), dpi=130, layout="constrained")
        axes = figure.add_subplot()
        axes.axhline(PAPER_STRAIGHT_S, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.annotate("theoretical time of the paper, to d2", (9.0, PAPER_STRAIGHT_S + 1.5), fontsize=8)
        for n, times in PAPER_RUNS.items():
            axes.plot([n] * len(times), times, "x", color=ALARM, markersize=5, alpha=0.7)
        means = [paper_mean(n) for n in SIZES]
        axes.plot(SIZES, means, color=ALARM, linewidth=1.6, label="the paper: five runs and their mean")
        for colour, run in zip(COLOURS, IN_FIGURE_5, strict=True):
            found = sorted((g for g in groups if g.run == run and g.n in SIZES), key=lambda g: g.n)
            spreads: list[Any] = [g.figures["arrival_leader_s"] for g in found]
            halves = [s.high - s.mean if s.high is not None else 0.0 for s in spreads]
            label = f"{run}: {found[0].flights} seeds"
            axes.errorbar([g.n for g in found], [s.mean for s in spreads], halves, capsize=3, color=colour, label=label)
        axes.set_xlim(2.5, 13.5)
        axes.set_xticks(SIZES)
        axes.set_xlabel("number of UAVs n")
        axes.set_ylabel("leader arrives after, steps or s")
        axes.legend(loc="upper left")
        figure.savefig(file, metadata={"Software": None})


def draw_figure_4(file: Path) -> None:
    """The paper's flight with 8 on JSBSim, in four stages."""
    mission = load_mission(MISSION).with_size(8).with_seed(1).with_origin(DEFAULT_ORIGIN)
    with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
        fly.fly(mission, Path(folder), progress, in_process=True)
        stages.draw(run_folder.load(Path(folder)), mission, file)


if __name__ == "__main__":
    sys.exit(main())
