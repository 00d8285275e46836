"""Summary of a campaign: flights by grade and cause, faults that fired, and the failures, as Markdown."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from sim_bridge.judge.verdict import Grade
from sim_bridge.lab.search.draw import VERSION
from sim_bridge.lab.search.flight import CAUSES
from sim_bridge.lab.study.case import Backend
from sim_bridge.lab.study.results.page import NEVER_ENDED

Row = dict[str, Any]
STILL_AIR = " Flown by point masses, in still air: no wind of theirs was flown, and no fault of wind fired."


def failures(rows: Sequence[Row]) -> list[Row]:
    """Rows that did neither arrive nor are explained by their faults, or never ended; the unsafe ones first."""
    bad = [row for row in rows if row.get("grade") not in (Grade.ARRIVED, Grade.DEGRADED)]
    return sorted(bad, key=lambda row: (row.get("grade") != Grade.UNSAFE, row["seed"]))


def markdown(rows: Sequence[Row]) -> str:
    """All tables."""
    still = STILL_AIR if any(row.get("backend") == Backend.AGENTS for row in rows) else ""
    return "\n".join(
        [
            *_grades(rows),
            "",
            f"Missions as drawn by version {VERSION}.{still}",
            "",
            *_causes(rows),
            "",
            *_faults(rows),
            "",
            *_failures(rows),
            "",
        ]
    )


def _grades(rows: Sequence[Row]) -> Iterator[str]:
    columns = [*(grade.value for grade in Grade), *([NEVER_ENDED] * any("grade" not in row for row in rows))]
    yield "| flights | " + " | ".join(columns) + " | simulated time, median (longest), s |"
    yield "|---|" + "---|" * (len(columns) + 1)
    for name, group in _groups(rows):
        counts = Counter(row.get("grade", NEVER_ENDED) for row in group)
        shares = " | ".join(_share(counts[column], len(group)) for column in columns)
        yield f"| {name}: {len(group)} | {shares} | {_times(group)} |"


def _groups(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    yield "all", list(rows)
    for run in sorted({row["run"] for row in rows}):
        yield run, [row for row in rows if row["run"] == run]
    for attacker in sorted({row.get("attacker", "") for row in rows}):
        yield attacker or "no attacker", [row for row in rows if row.get("attacker", "") == attacker]
    for count in sorted({len(row.get("asked", ())) for row in rows}):
        group = [row for row in rows if len(row.get("asked", ())) == count]
        yield f"{count} fault{'s' * (count != 1)} asked for", group


def _share(count: int, of: int) -> str:
    return f"{count} ({100.0 * count / of:.1f} %)" if of else "0"


def _times(rows: Sequence[Row]) -> str:
    times_s = [row["sim_time_s"] for row in rows if "sim_time_s" in row]
    return f"{statistics.median(times_s):.0f} ({max(times_s):.0f})" if times_s else "-"


def time_of(row: Row) -> str:
    """Simulated time of a flight, s; a dash where it never came to an end."""
    return f"{row['sim_time_s']:.1f}" if "sim_time_s" in row else "-"


def _causes(rows: Sequence[Row]) -> Iterator[str]:
    yield "| first cause | | UNSAFE | INCOMPLETE | DEGRADED | seeds |"
    yield "|---|---|---|---|---|---|"
    causes = Counter(row["causes"][0] for row in rows if row.get("causes"))
    for cause, _ in causes.most_common():
        of_cause = [row for row in rows if row.get("causes", [])[:1] == [cause]]
        counts = Counter(row["grade"] for row in of_cause)
        seeds = [str(row["seed"]) for row in failures(of_cause)]
        shown = ", ".join(seeds[:12]) + (" ..." if len(seeds) > 12 else "")
        counted = " | ".join([str(counts[grade]) for grade in (Grade.UNSAFE, Grade.INCOMPLETE, Grade.DEGRADED)])
        yield f"| {cause} | {CAUSES[cause]} | {counted} | {shown} |"


def _faults(rows: Sequence[Row]) -> Iterator[str]:
    yield "| fault | asked for | fired |"
    yield "|---|---|---|"
    asked = Counter(kind for row in rows for kind in row.get("asked", ()))
    fired: Counter[str] = Counter()
    for row in rows:
        fired.update(row.get("faults", {}))
    for kind, count in sorted(asked.items()):
        yield f"| {kind} | {count} | {fired[kind]} |"


def _failures(rows: Sequence[Row]) -> Iterator[str]:
    yield "| seed | vehicles | simulated time, s | verdict |"
    yield "|---|---|---|---|"
    for row in failures(rows):
        what = row.get("verdict") or f"{NEVER_ENDED}: {row['error']}"
        yield f"| {row['seed']} | {row['n']} | {time_of(row)} | {what} |"
