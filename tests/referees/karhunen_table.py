"""The section of docs/reference/referees.md that the protocol of Karhunen et al. has."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from scipy.stats import binomtest

from tests.referees.referee import Row, case_of, words_of

TITLE = "Karhunen et al.'s protocol"
THEIRS = {"medium 1 m/s": "12/15", "medium 2 m/s": "12/15", "dense 1 m/s": "15/15", "dense 2 m/s": "5/15"}


def section(flights: Sequence[Row], commit: str) -> str:
    """Its markdown: a row for each forest, speed and sensor, theirs beside ours."""
    lines = [
        f"## {TITLE}",
        "",
        f"`python -m tests.referees karhunen`, flight software of commit {commit}, seeds {words_of(flights, 'seed')}, "
        f"JSBSim, n = {words_of(flights, 'n')}, estimates `{words_of(flights, 'estimates')}`, heights by range finder. "
        "Means ± standard deviations of flights that succeeded; the interval of success is at 95 %.",
        "",
        "| forest | target, m/s | trees/ha, mean diameter | straight to a trunk, mean | theirs | sensor | ours | "
        "contact | not arrived | realised speed, m/s | completion, s |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    alike: dict[tuple[str, str], list[Row]] = {}
    for row in flights:
        alike.setdefault((row["name"], case_of(row).sensor), []).append(row)
    lines += [_line(name, sensor, rows) for (name, sensor), rows in alike.items()]
    return "\n".join(lines) + "\n"


def _line(name: str, sensor: str, rows: Sequence[Row]) -> str:
    forest, speed, _ = name.split()
    good = [row for row in rows if row["grade"] == "clear"]
    interval = binomtest(len(good), len(rows)).proportion_ci(method="wilson")
    dbh_cm, free_m = (statistics.fmean(row[key] for row in rows) for key in ("dbh_m", "free_m"))
    cells = [
        forest,
        speed,
        f"{rows[0]['density_per_ha']:.0f}, {100.0 * dbh_cm:.0f} cm",
        f"{free_m:.0f} m",
        THEIRS.get(name, "none told"),
        f"`{sensor}`",
        f"{len(good)}/{len(rows)} ({interval.low:.0%} to {interval.high:.0%})",
        *(str(sum(row["grade"] == grade for row in rows)) for grade in ("contact", "not arrived")),
        _spread([row["way_m"] / row["time_s"] for row in good], 2),
        _spread([row["time_s"] for row in good], 0),
    ]
    return f"| {' | '.join(cells)} |"


def _spread(values: Sequence[float], digits: int) -> str:
    if len(values) < 2:
        return ", ".join(f"{value:.{digits}f}" for value in values)
    return f"{statistics.fmean(values):.{digits}f} ± {statistics.stdev(values):.{digits}f}"
