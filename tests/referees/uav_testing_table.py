"""The section of docs/reference/referees.md that the UAV Testing Competition's layouts have."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from tests.referees.referee import Row, words_of
from tests.referees.uav_testing import SOFT_M, UP_M

TITLE = "UAV Testing Competition"
THEIRS = 30  # layouts on which PX4-Avoidance failed softly: all that are here were published for it


def section(flights: Sequence[Row], commit: str) -> str:
    """Its markdown: all flights in sums, and each of those with the first kind of estimates."""
    kinds = list(dict.fromkeys((flown["estimates"], flown["n"]) for flown in flights))
    shown = flights[0]["estimates"]
    sizes = [n for estimates, n in kinds if estimates == shown]
    lines = [
        f"## {TITLE}",
        "",
        f"`python -m tests.referees uav-testing`, commit {commit}, seed {words_of(flights, 'seed')}, JSBSim, PX4 as "
        f"the bridge has it, {UP_M:g} m up.",
        "",
        f"| | layouts | clear | late | soft fail (< {SOFT_M:g} m) | hard fail (contact) | nearest, m | "
        "way over the shortest: mean, worst |",
        "|---|---|---|---|---|---|---|---|",
        f"| PX4-Avoidance (as published) | {THEIRS} | 0 | | {THEIRS} | not told apart | below {SOFT_M:g} | |",
    ]
    for estimates, n in kinds:
        alike = [flown for flown in flights if (flown["estimates"], flown["n"]) == (estimates, n)]
        lines.append(_summary(f"ours, n = {n}, estimates `{estimates}`", alike))
    lines += [
        "",
        f"With estimates `{shown}`, each:",
        "",
        "| layout | shortest, m | " + " | ".join(f"n = {n} | nearest, m | way, m (over)" for n in sizes) + " |",
        "|---|---|" + "---|---|---|" * len(sizes),
    ]
    by_layout: dict[str, dict[int, Row]] = {}
    for flown in flights:
        if flown["estimates"] == shown:
            by_layout.setdefault(flown["name"], {})[flown["n"]] = flown
    for layout, of_size in by_layout.items():
        shortest_m = next(iter(of_size.values()))["shortest_m"]
        cells = " | ".join(_cells(of_size.get(n)) for n in sizes)
        lines.append(f"| {layout} | {shortest_m:.1f} | {cells} |")
    return "\n".join(lines) + "\n"


def over(flown: Row) -> float | None:
    """Its way over the shortest, as a share; None: it never arrived."""
    return None if flown["way_m"] is None else flown["way_m"] / flown["shortest_m"] - 1.0


def _summary(who: str, flights: Sequence[Row]) -> str:
    counts = [
        sum(flown["grade"] == grade for flown in flights) for grade in ("clear", "late", "soft fail", "hard fail")
    ]
    overs = [share for share in map(over, flights) if share is not None]
    ways = f"{statistics.fmean(overs):+.0%}, {max(overs):+.0%} (of {len(overs)})" if overs else ""
    nearest_m = min(flown["clearance_m"] for flown in flights)
    told = " | ".join(map(str, (len(flights), *counts)))
    return f"| {who} | {told} | {nearest_m:.2f} | {ways} |"


def _cells(flown: Row | None) -> str:
    if flown is None:
        return "| | "
    share = over(flown)
    way = "not arrived" if share is None else f"{flown['way_m']:.0f} ({share:+.0%})"
    return f"{flown['grade']} | {flown['clearance_m']:.2f} | {way}"
