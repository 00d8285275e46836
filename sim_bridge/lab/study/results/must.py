"""Limits: what a study says that its cases must reach, and whether they do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from rich.box import SIMPLE
from rich.table import Table

from sim_bridge.judge.metrics.figures import MORE
from sim_bridge.lab.study.results.figures import BY_NAME, NOTHING_TO_TELL

STATISTICS = ("mean", "worst", "p95")
ROUNDING = 1e-9


class Group(Protocol):
    """As summary.Group."""

    @property
    def run(self) -> str:
        """The name of its runs."""

    @property
    def flights(self) -> int:
        """All of its rows."""

    @property
    def arrived(self) -> int:
        """Of them."""

    @property
    def figures(self) -> Mapping[str, Any]:
        """Spreads over its seeds, by name."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on one limit of one case. `seen` None: not all flights that must have the figure do, and it is missed."""

    run: str
    case: str
    figure: str
    statistic: str
    must: float
    seen: float | None
    reached: bool

    def as_dict(self) -> dict[str, Any]:
        """Name -> value."""
        return asdict(self)


def judge(group: Group, case: str, must: Mapping[str, Mapping[str, float]]) -> list[Verdict]:
    """Of a case, by what its run must reach.

    A flight that never came so far as to have a figure has the worst one. How many may not arrive is for a limit on
    `arrived` to say, where the run has one.
    """
    found = []
    for figure, limits in must.items():
        spread = group.figures.get(figure)
        for statistic, limit in limits.items():
            seen = None if spread is None else getattr(spread, statistic)
            if statistic != "p95" and _lack(group, figure, must) > 0:  # p95 counts them
                seen = None
            if seen is None:
                reached = False
            elif BY_NAME[figure].better is MORE:
                reached = seen >= limit - ROUNDING
            else:
                reached = seen <= limit + ROUNDING
            found.append(Verdict(group.run, case, figure, statistic, limit, seen, reached))
    return found


def _lack(group: Group, figure: str, must: Mapping[str, Any]) -> int:
    """Flights that should have the figure, and do not."""
    if figure in NOTHING_TO_TELL or figure not in group.figures:
        return 0
    expected = group.arrived if "arrived" in must and figure != "arrived" else group.flights
    return expected - int(group.figures[figure].count)


def table(verdicts: Sequence[Verdict]) -> Table:
    """For people."""
    shown = Table(title="what must be reached", title_justify="left", box=SIMPLE)
    for heading in ("run", "case", "figure", "must", "seen", ""):
        shown.add_column(heading, overflow="fold")
    for v in verdicts:
        sign = ">=" if BY_NAME[v.figure].better is MORE else "<="
        figure = BY_NAME[v.figure]
        seen = "-" if v.seen is None else f"{figure.scale * v.seen:.4g}"
        shown.add_row(
            v.run,
            v.case,
            f"{figure.heading}: {v.statistic}",
            f"{sign} {figure.scale * v.must:.6g}",
            seen,
            "reached" if v.reached else "MISSED",
        )
    return shown
