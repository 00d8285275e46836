"""A plot of each figure of a study, over what was crossed."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from sim_bridge.lab.plot_style import PALETTE, RC
from sim_bridge.lab.study.results.figures import BY_NAME
from sim_bridge.lab.study.results.summary import SIZE, Group, label, varying

LABEL_CHARS = 40  # of the height of an axis
LEGEND_CHARS = 85  # of the width of a figure
LEGEND_LINE_IN = 0.19


def draw(groups: Sequence[Group], folder: Path) -> None:
    """`folder`/FIGURE.png, mean and 95 % interval, for every figure that any group has."""
    folder.mkdir(exist_ok=True)
    axis = _axis(groups)
    for name in BY_NAME:
        having = [group for group in groups if name in group.figures]
        if having:
            _draw(having, name, axis, folder / f"{name}.png")


def draw_costs(costs: Path, file: Path) -> None:
    """Processor time for a simulated second over n, of the flights whose rows have both."""
    lines = [json.loads(line) for line in costs.read_text(encoding="utf-8").splitlines()] if costs.exists() else []
    timed = [line for line in lines if line["sim_time_s"] and line["cpu_s"]]
    if not timed:
        return
    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(7.0, 4.2), dpi=120, layout="constrained")
        axes = figure.add_subplot()
        for index, run in enumerate(sorted({line["run"] for line in timed})):
            points = sorted((line["n"], line["cpu_s"] / line["sim_time_s"]) for line in timed if line["run"] == run)
            axes.loglog(*zip(*points, strict=True), "o-", color=PALETTE[index % len(PALETTE)], label=run)
        axes.set_xlabel("vehicles")
        axes.set_ylabel("processor seconds per simulated second")
        axes.legend()
        figure.savefig(file, metadata={"Software": None})


def _axis(groups: Sequence[Group]) -> str:
    """Key of the x axis: the number of vehicles where it was crossed, else the first that has several numbers."""
    keys = {key: None for group in groups for key in group.settings}
    for key in sorted(keys, key=lambda key: key != SIZE):
        values = {v for group in groups if isinstance(v := group.settings.get(key), int | float)}
        if len(values) > 1:
            return key
    return SIZE


def _at(group: Group, axis: str) -> float:
    value = group.n if axis == SIZE else group.settings.get(axis, 0.0)
    return float(value)


def _draw(groups: Sequence[Group], name: str, axis: str, file: Path) -> None:
    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(7.0, 4.2), dpi=120, layout="constrained")
        axes = figure.add_subplot()
        series: dict[str, list[Group]] = {}
        varied = varying(groups)
        for group in groups:
            others = label(group, [key for key in varied if key != axis])
            series.setdefault(f"{group.run} {others}".strip(), []).append(group)
        for index, (title, members) in enumerate(series.items()):
            members.sort(key=lambda group: _at(group, axis))
            _series(axes, members, name, axis, textwrap.fill(title, LEGEND_CHARS), PALETTE[index % len(PALETTE)])
        axes.set_xlabel("vehicles" if axis == SIZE else axis)
        axes.set_ylabel(textwrap.fill(BY_NAME[name].heading, LABEL_CHARS))
        _place_legend(figure)
        figure.savefig(file, metadata={"Software": None})


def _place_legend(figure: Figure) -> None:
    """Below the axes, and the figure as much taller: names of cases are as long as a study makes them."""
    legend = figure.legend(loc="outside lower center")
    lines = sum(text.get_text().count("\n") + 1 for text in legend.get_texts())
    figure.set_figheight(figure.get_figheight() + LEGEND_LINE_IN * lines)


def _series(axes: Any, members: Sequence[Group], name: str, axis: str, title: str, colour: str) -> None:
    scale = BY_NAME[name].scale
    spreads = [member.figures[name] for member in members]
    means = [scale * s.mean for s in spreads]
    halves = [0.0 if s.high is None else scale * (s.high - s.mean) for s in spreads]
    at = [_at(member, axis) for member in members]
    axes.errorbar(at, means, halves, marker="o", markersize=4, capsize=3, linewidth=1.2, color=colour, label=title)
