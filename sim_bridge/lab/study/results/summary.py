"""The rows of a study put together: for each case over its seeds, mean, spread, worst and the interval of the mean."""

from __future__ import annotations

import csv
import json
import math
import statistics
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from sim_bridge.judge.metrics.figures import Figure
from sim_bridge.lab.study.results.figures import BY_NAME, CONFIDENCE, NOTHING_TO_TELL, figures_of

SIZE = "swarm.size"
UNLIMITED = 10_000  # characters
FILE_WIDTH = 100  # characters, of what is no terminal and says no width
NAME_WIDTH = 18  # characters of a run or a case, where there is not room for all figures beside each other
HEADING_WIDTH = 20  # characters of a line: as wide as "43.86 ± 0.92 (44.23)"

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Spread:
    """One figure over the seeds that have it. `low`, `high`: 95 % interval of the mean, Student's t; None below two.

    `p95`: what 95 % of the seeds keep, rounded to the worse: of all, those without the figure too; None: fewer have it.
    """

    count: int
    mean: float
    sd: float | None
    worst: float
    p95: float | None
    low: float | None
    high: float | None


def spread(values: Sequence[float], worst: Any = max, lacking: int = 0) -> Spread | None:
    """None without values. `lacking`: so many flights besides should have one."""
    if not values:
        return None
    mean = statistics.fmean(values)
    rank = math.ceil(CONFIDENCE * (len(values) + lacking)) - 1
    kept = sorted(values, reverse=worst is min)[rank] if rank < len(values) else None
    if len(values) < 2:
        return Spread(1, mean, None, worst(values), kept, None, None)
    from scipy import stats  # a second to import

    sd = statistics.stdev(values)
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, len(values) - 1)) * sd / math.sqrt(len(values))
    return Spread(len(values), mean, sd, worst(values), kept, mean - half, mean + half)


@dataclass(frozen=True, slots=True)
class Group:
    """One case over its seeds."""

    run: str
    law: str
    backend: str
    n: int
    settings: dict[str, Any]
    flights: int
    failed: int  # rows without figures
    arrived: int  # where there is nothing to arrive at: that came to their end
    figures: dict[str, Spread]

    def as_dict(self) -> Row:
        """Flat: `arrival_leader_s_mean`, ..."""
        flat: Row = {
            "run": self.run,
            "law": self.law,
            "backend": self.backend,
            "n": self.n,
            "settings": self.settings,
            "seeds": self.flights,
            "failed": self.failed,
            "arrived": self.arrived,
        }
        for figure in figures_of(self.backend):
            found = self.figures.get(figure.name)
            for part in ("mean", "sd", "worst", "p95", "low", "high"):
                flat[f"{figure.name}_{part}"] = None if found is None else getattr(found, part)
        return flat


def summarise(rows: Iterable[Row]) -> list[Group]:
    """Groups in the order in which their first rows come.

    `over_alone_*`: overhead over that of one vehicle alone, where the run crosses swarm.size and 1 is among its
    values: (1 + overhead) / (1 + mean overhead of the leader at size 1) - 1.
    """
    groups: dict[str, list[Row]] = {}
    alone: dict[str, list[float]] = {}
    for row in rows:
        groups.setdefault(_name(row, row["settings"]), []).append(row)
        if row["n"] == 1 and row.get("overhead_leader") is not None:
            alone.setdefault(_name_but_size(row), []).append(1.0 + row["overhead_leader"])
    return [_group(members, alone.get(_name_but_size(members[0]))) for members in groups.values()]


def _name(row: Row, settings: Row) -> str:
    return json.dumps([row["run"], row["law"], row["backend"], settings], sort_keys=True)


def _name_but_size(row: Row) -> str:
    return _name(row, {key: value for key, value in row["settings"].items() if key != SIZE})


def _group(rows: list[Row], alone: list[float] | None) -> Group:
    first = rows[0]
    if alone:
        by = statistics.fmean(alone)
        rows = [
            row
            | {
                f"over_alone_{who}": (1.0 + row[f"overhead_{who}"]) / by - 1.0
                for who in ("leader", "last")
                if row.get(f"overhead_{who}") is not None
            }
            for row in rows
        ]
    flown = [row for row in rows if row["status"] == "flown"]
    figures = {}
    for figure in figures_of(first["backend"]):
        found = _spread_of(figure, flown, len(rows))
        if found is not None:
            figures[figure.name] = found
    return Group(
        run=first["run"],
        law=first["law"],
        backend=first["backend"],
        n=first["n"],
        settings=first["settings"],
        flights=len(rows),
        failed=len(rows) - len(flown),
        arrived=sum(row.get("arrived", True) for row in flown),
        figures=figures,
    )


def _spread_of(figure: Figure, flown: Sequence[Row], flights: int) -> Spread | None:
    if figure.of_case is not None:  # one value of all flights together
        value = figure.of_case(flown)
        return None if value is None else Spread(len(flown), value, None, value, value, None, None)
    values = [value for row in flown if (value := figure.of(row)) is not None]
    return spread(values, figure.worst, 0 if figure.name in NOTHING_TO_TELL else flights - len(values))


def write(groups: Sequence[Group], folder: Path) -> None:
    """summary.json and summary.csv."""
    flat = [group.as_dict() for group in groups]
    (folder / "summary.json").write_text(json.dumps(flat, indent=1) + "\n", encoding="utf-8")
    settings = sorted({key for group in groups for key in group.settings})
    with (folder / "summary.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        columns = [key for key in dict.fromkeys(key for values in flat for key in values) if key != "settings"]
        writer.writerow([*columns, *settings])
        for group, values in zip(groups, flat, strict=True):
            writer.writerow([values.get(key) for key in columns] + [group.settings.get(key, "") for key in settings])


def print_table(groups: Sequence[Group], console: Console) -> None:
    """The figures that matter most, mean and 95 % interval, and the worst.

    In as many tables as it takes for the figures to stand beside each other; summary.csv has all of them in one.
    """
    if not console.is_terminal:
        console.width = max(console.width, FILE_WIDTH)
    left = shown_in_table(groups)
    folded = _width(_table(groups, left), console) > console.width
    while left:
        count = len(left)
        while count > 1 and _width(_table(groups, left[:count], folded=folded), console) > console.width:
            count -= 1
        console.print(_table(groups, left[:count], folded=folded))
        left = left[count:]


def shown_in_table(groups: Sequence[Group]) -> list[str]:
    """Names of the figures that the table has."""
    having = dict.fromkeys(figure for group in groups for figure in figures_of(group.backend))
    return [figure.name for figure in having if figure.in_table]


def _width(table: Table, console: Console) -> int:
    return console.measure(table, options=console.options.update(max_width=UNLIMITED)).maximum


def _table(groups: Sequence[Group], names: Sequence[str], *, folded: bool = False) -> Table:
    """`folded`: names of runs and cases are."""
    table = Table(title="mean ± 95 % interval of the mean, Student's t (worst)", title_justify="left", box=SIMPLE)
    for heading in ("run", "case"):
        table.add_column(heading, overflow="fold", max_width=NAME_WIDTH if folded else None)
    for heading in ("arrived", *(BY_NAME[name].heading for name in names)):
        table.add_column("\n".join(textwrap.wrap(heading, HEADING_WIDTH)), no_wrap=True)
    varied = varying(groups)
    for group in groups:
        case = label(group, varied)
        flights = f"{group.arrived}/{group.flights}" + (f", {group.failed} failed" if group.failed else "")
        table.add_row(group.run, case, flights, *(shown(name, group.figures.get(name)) for name in names))
    return table


def varying(groups: Sequence[Group]) -> list[str]:
    """The settings that tell cases apart: those with more than one value in the whole study."""
    values: dict[str, set[str]] = {}
    for group in groups:
        for key, value in group.settings.items():
            values.setdefault(key, set()).add(json.dumps(value))
    return [key for key, found in values.items() if len(found) > 1]


def label(group: Group, keys: Iterable[str]) -> str:
    """`size=4 transit_range_m=30.0`."""
    settings = group.settings
    return " ".join(f"{key.rpartition('.')[2]}={settings[key]}" for key in keys if key in settings)


def shown(name: str, found: Spread | None) -> str:
    """In words, without the unit, which the heading has."""
    if found is None:
        return "-"
    scale = BY_NAME[name].scale
    if found.high is None:
        return f"{scale * found.mean:.4g}"
    half = scale * (found.high - found.mean)
    return f"{scale * found.mean:.4g} ± {half:.2g} ({scale * found.worst:.4g})"
