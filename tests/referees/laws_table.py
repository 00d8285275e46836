"""The section of docs/reference/referees.md that third-party guidance laws have."""

from __future__ import annotations

import hashlib
import statistics
from collections.abc import Sequence

from tests.referees.laws import ENTRANT
from tests.referees.referee import Row, words_of

TITLE = "Third-party guidance laws"
HASH_DIGITS = 8
GRADES = ("clear", "late", "contact", "unsafe", "not arrived")


def section(flights: Sequence[Row], commit: str) -> str:
    """Its markdown: a row for each mission, size, law and filter."""
    lines = [
        f"## {TITLE}",
        "",
        f"`python -m tests.referees laws`, flight software of commit {commit}, seeds {words_of(flights, 'seed')}, "
        f"the whole stack on point masses, estimates `{words_of(flights, 'estimates')}`. Velocity obstacles: "
        f"`{ENTRANT}`. *Hash*: of the flights' trace hashes, in the order of seeds: equal for equal flights.",
        "",
        "| mission | n | law | safety filter | flights | clear | late | contact | unsafe else | not arrived | contacts "
        "in all | separation, m, worst | bark, m, worst | leader there after, s, mean | hash |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    alike: dict[tuple[str, int], list[Row]] = {}
    for row in sorted(flights, key=lambda row: row["n"]):
        alike.setdefault((row["name"], row["n"]), []).append(row)
    lines += [_line(name, n, rows) for (name, n), rows in alike.items()]
    return "\n".join(lines) + "\n"


def _line(name: str, n: int, rows: Sequence[Row]) -> str:
    mission, law, how = name.split(", ")
    arrivals = [row["arrival_s"] for row in rows if row["arrival_s"] is not None]
    digest = hashlib.sha256("".join(row["trace_hash"] for row in rows).encode()).hexdigest()
    cells = [
        mission,
        str(n),
        law,
        how,
        str(len(rows)),
        *(str(sum(row["grade"] == grade for row in rows)) for grade in GRADES),
        str(sum(row["contacts"] for row in rows)),
        _least(rows, "min_separation_m"),
        _least(rows, "trunk_clearance_min_m"),
        f"{statistics.fmean(arrivals):.0f} (of {len(arrivals)})" if arrivals else "",
        f"`{digest[:HASH_DIGITS]}`",
    ]
    return f"| {' | '.join(cells)} |"


def _least(rows: Sequence[Row], key: str) -> str:
    values = [row[key] for row in rows if row[key] is not None]
    return f"{min(values):.2f}" if values else ""
