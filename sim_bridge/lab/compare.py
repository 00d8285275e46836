"""Two flights over one another: both replays in one page, their figures side by side with the difference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from sim_bridge.judge.metrics import FIGURES
from sim_bridge.judge.metrics.figures import Better
from sim_bridge.lab.judged import Judged

NAMES = ("A", "B")
SAME = 1e-9  # of sums of ticks, in the units that people see


class Row(NamedTuple):
    """A figure of both flights. `better`: A or B, empty where neither is; None: the flight never came to that."""

    name: str
    a: float | None
    b: float | None
    difference: float | None
    better: str


def compare_figures(a: Judged, b: Judged) -> list[Row]:
    """Every figure that has a name for people, in units that they see."""
    rows = []
    for figure in FIGURES:
        if not figure.title or figure.name == "arrived":  # which the verdicts say
            continue
        values = [figure.of(flight.figures) for flight in (a, b)]
        scaled = [None if value is None else figure.scale * value for value in values]
        difference, better = None, ""
        if scaled[0] is not None and scaled[1] is not None:
            same = math.isclose(scaled[0], scaled[1], rel_tol=SAME, abs_tol=SAME)
            difference = 0.0 if same else scaled[1] - scaled[0]
            if difference and figure.better is not None:
                better = NAMES[(difference < 0.0) is (figure.better is Better.LESS)]
        if any(value is not None for value in scaled):
            rows.append(Row(figure.heading, scaled[0], scaled[1], difference, better))
    return rows


def comparison(a: Judged, b: Judged) -> dict[str, Any]:
    """The document of a page: A's replay, with B's beside it."""
    first, second = a.document(), b.document()
    return {
        **first,
        "title": f"{a.title}: A and B",
        "against": {**second, "notes": notes(a, b)},
        "comparison": {
            "flights": [
                {
                    "name": name,
                    "folder": flight.folder.resolve().name,
                    "verdict": flight.verdict.text,
                    "seed": flight.mission.sim.seed,
                }
                for name, flight in zip(NAMES, (a, b), strict=True)
            ],
            "figures": [row._asdict() for row in compare_figures(a, b)],
        },
    }


def notes(a: Judged, b: Judged) -> list[str]:
    """Differences of stand, route and size, which a reader must know of before comparing."""
    found = []
    if (a.stand.trees, a.stand.bushes, a.stand.boxes) != (b.stand.trees, b.stand.bushes, b.stand.boxes):
        found.append("They flew in different stands: trees are those of A.")
    if a.mission.route != b.mission.route or a.mission.fence != b.mission.fence:
        found.append("They had different routes or fences: those of A are drawn.")
    if a.mission.swarm.size != b.mission.swarm.size:
        found.append(f"A flew {a.mission.swarm.size} vehicles, B {b.mission.swarm.size}.")
    return found


def table(rows: Sequence[Row]) -> list[str]:
    """For the terminal: a figure a line."""
    wide = max((len(row.name) for row in rows), default=0)
    lines = [f"  {'':<{wide}} {'A':>10} {'B':>10} {'B - A':>10}  better"]
    for row in rows:
        a, b, difference = ("-" if value is None else f"{value:.4g}" for value in (row.a, row.b, row.difference))
        lines.append(f"  {row.name:<{wide}} {a:>10} {b:>10} {difference:>10}  {row.better}".rstrip())
    return lines
