"""The section of docs/reference/referees.md that the real stem maps have."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from tests.referees.referee import Row, case_of, words_of
from tests.referees.stem_maps import PLOTS, UP_M

TITLE = "Real stem maps"
HEADING = (
    "| plot | sensor | n | lines | clear | late | not arrived | contact (crowns) | way over the shortest: mean, worst |"
)


def section(flights: Sequence[Row], commit: str) -> str:
    """Its markdown: each plot, sensor and size in sums, and each line."""
    lines = [
        f"## {TITLE}",
        "",
        f"`python -m tests.referees stem-maps`, flight software of commit {commit}, seed {words_of(flights, 'seed')}, "
        f"JSBSim, estimates `{words_of(flights, 'estimates')}`, {UP_M:g} m up by range finder.",
        "",
        HEADING,
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for plot in PLOTS:
        of_plot = [row for row in flights if row["name"].split()[0] == plot]
        for sensor, n in dict.fromkeys(map(_kind, of_plot)):
            alike = [row for row in of_plot if _kind(row) == (sensor, n)]
            lines.append(f"| {plot} | `{sensor}` | {n} | {_summary(alike)} |")
    kinds = list(dict.fromkeys(map(_kind, flights)))
    lines += [
        "",
        "Each line, and how far its way was over the shortest:",
        "",
        "| line | " + " | ".join(f"n = {n}, `{sensor}`" for sensor, n in kinds) + " |",
        "|---|" + "---|" * len(kinds),
    ]
    by_line: dict[str, dict[tuple[str, int], Row]] = {}
    for row in flights:
        by_line.setdefault(row["name"], {})[_kind(row)] = row
    lines += [
        f"| {name} | " + " | ".join(_cell(of_line.get(kind)) for kind in kinds) + " |"
        for name, of_line in by_line.items()
    ]
    return "\n".join(lines) + "\n"


def over(row: Row) -> float | None:
    """Its way over the shortest, as a share; None: it never arrived, lost somebody on the way, or there is no way."""
    if row["grade"] not in ("clear", "late") or not row["shortest_m"]:
        return None
    return float(row["way_m"] / row["shortest_m"] - 1.0)


def _kind(row: Row) -> tuple[str, int]:
    case = case_of(row)
    return case.sensor, case.n


def _summary(rows: Sequence[Row]) -> str:
    counts = [sum(row["grade"] == grade for row in rows) for grade in ("clear", "late", "not arrived", "contact")]
    crowns = sum(row["grade"] == "contact" and row["contacts_crowns"] > 0 for row in rows)
    overs = [share for share in map(over, rows) if share is not None]
    ways = f"{statistics.fmean(overs):+.1%}, {max(overs):+.1%} (of {len(overs)})" if overs else ""
    return f"{len(rows)} | " + " | ".join(map(str, counts)) + f" ({crowns}) | {ways}"


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    share = over(row)
    return row["grade"] if share is None else f"{row['grade']}, {share:+.1%}"
