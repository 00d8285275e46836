"""A study's `report.html`: its answer in a sentence, how its figures spread over seeds, and its worst flights."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from mission import __version__
from sim_bridge.judge import run_folder
from sim_bridge.judge.metrics.figures import MORE
from sim_bridge.judge.page import PAGE_NAME, page
from sim_bridge.judge.verdict import BAD_FIRST, Grade
from sim_bridge.lab.study.results.figures import BY_NAME, value_of
from sim_bridge.lab.study.results.summary import Group, label, summarise, varying

Row = dict[str, Any]

FORMAT: Final = "understory-study"
VERSION: Final = 1
REPLAYS: Final = "replays"  # folder of flights that were flown again: one for each, by its key
RUNS_NAMED: Final = 6  # in the answer
FAILURES_SHOWN: Final = 20
NEVER_ENDED: Final = "never ended"
MISSED_NAMED: Final = 6  # in the answer


def write(folder: Path, rows: Sequence[Row], verdicts: Sequence[Mapping[str, Any]], title: str) -> Path:
    """The page of a study into its folder; its file. OSError that names it."""
    file = folder / PAGE_NAME
    run_folder.write(file, page(document(folder, rows, verdicts, title), title).encode())
    return file


def document(folder: Path, rows: Sequence[Row], verdicts: Sequence[Mapping[str, Any]], title: str) -> dict[str, Any]:
    """Document of a study, as docs/reference/replay.md defines it. `verdicts`: as must.json has them."""
    groups = summarise(rows)
    varied = varying(groups)
    having = [name for name in drawn() if any(name in group.figures for group in groups)]
    return {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"understory {__version__}",
        "title": title,
        "answer": answer(rows, groups, verdicts),
        "succeeded": all(v["reached"] for v in verdicts) if verdicts else None,
        "must": [_named(v) for v in verdicts],
        "figures": [
            {
                "name": BY_NAME[name].heading,
                "cases": [
                    {
                        "name": f"{group.run} {label(group, varied)}".strip(),
                        "mean": _scaled(name, group.figures[name].mean),
                        "low": _scaled(name, group.figures[name].low),
                        "high": _scaled(name, group.figures[name].high),
                        "seeds": _seeds(folder, rows, group, name),
                    }
                    for group in groups
                    if name in group.figures
                ],
            }
            for name in having
        ],
        "worst": [
            {
                "case": f"{row['run']} {_label(groups, row, varied)}".strip(),
                "seed": row["seed"],
                "why": why,
                "verdict": row.get("verdict") or row.get("error") or "",
                "replay": replay_of(folder, row),
            }
            for row, why in worst(rows)
        ],
    }


def _named(verdict: Mapping[str, Any]) -> dict[str, Any]:
    """A verdict with the figure's name for its key, and values as people see them."""
    name = verdict["figure"]
    shown = {key: None if verdict[key] is None else BY_NAME[name].scale * verdict[key] for key in ("must", "seen")}
    return {**verdict, "figure": BY_NAME[name].heading, **shown}


def drawn() -> list[str]:
    """Names of the figures that the page draws, in this order."""
    return [figure.name for figure in BY_NAME.values() if figure.on_page]


def answer(rows: Sequence[Row], groups: Sequence[Group], verdicts: Sequence[Mapping[str, Any]]) -> str:
    """Finding of a study, in a sentence."""
    flown = [row for row in rows if row["status"] == "flown"]
    runs = list(dict.fromkeys(row["run"] for row in rows))
    parts = []
    for run in runs[:RUNS_NAMED]:
        own = [row for row in flown if row["run"] == run]
        total = sum(1 for row in rows if row["run"] == run)
        members = [group for group in groups if group.run == run]
        words = _of_estimator(own, total, members) if _is_estimator(members) else _of_flights(own, total, members)
        parts.append(f"{run}: {words}" if len(runs) > 1 else words)
    if len(runs) > RUNS_NAMED:
        parts.append(f"and {len(runs) - RUNS_NAMED} more")
    said = "; ".join(parts) + "."
    if not verdicts:
        word = _worst_grade(rows)
        return f"{word}: {said}" if word else said
    missed = [v for v in verdicts if not v["reached"]]
    if not missed:
        reached = f"all {len(verdicts)} limits" if len(verdicts) > 1 else "the limit"
        return f"PASSED: {reached} reached. {said}"
    alike: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for verdict in missed:
        alike.setdefault(tuple(verdict[key] for key in ("run", "figure", "statistic", "must")), []).append(verdict)
    named = "; ".join(_missed(cases) for cases in [*alike.values()][:MISSED_NAMED])
    more = f"; and {len(alike) - MISSED_NAMED} more" if len(alike) > MISSED_NAMED else ""
    return f"FAILED: {len(missed)} of {len(verdicts)} limits missed: {named}{more}. {said}"


def _missed(cases: Sequence[Mapping[str, Any]]) -> str:
    """`ours size=8: least separation, m: worst 4.2, must be at least 5`; of several cases the worst, and how many."""
    figure = BY_NAME[cases[0]["figure"]]
    verdict = min(
        cases, key=lambda v: (v["seen"] is not None, v["seen"] if figure.better is MORE else -(v["seen"] or 0.0))
    )
    seen = "not of every flight" if verdict["seen"] is None else f"{figure.scale * verdict['seen']:.4g}"
    sign = "at least" if figure.better is MORE else "at most"
    place = f"{verdict['run']} {verdict['case']}".strip()
    must = f"must be {sign} {figure.scale * verdict['must']:.6g}"
    count = f" ({len(cases)} cases)" if len(cases) > 1 else ""
    return f"{place}: {figure.heading}: {verdict['statistic']} {seen}, {must}{count}"


def _grade(row: Row) -> str:
    """Verdict on a flight in a word, as `sim-bridge fly` has it; "" for an estimator's."""
    if row["status"] != "flown":
        return NEVER_ENDED
    if row.get("grade"):
        return str(row["grade"])
    if row.get("contacts"):
        return Grade.UNSAFE
    return "" if "arrived" not in row else Grade.ARRIVED if row["arrived"] else Grade.INCOMPLETE


def _worst_grade(rows: Sequence[Row]) -> str:
    """Verdict on a study without limits: that on its worst flight."""
    grades = {_grade(row) for row in rows}
    return "FAILED" if NEVER_ENDED in grades else next((grade for grade in BAD_FIRST if grade in grades), "")


def _of_flights(own: Sequence[Row], total: int, groups: Sequence[Group]) -> str:
    arrived, contacts = sum(bool(row["arrived"]) for row in own), sum(row.get("contacts") or 0 for row in own)
    grades = Counter(_grade(row) for row in own)
    bad = ", ".join(f"{grades[grade]} {grade}" for grade in BAD_FIRST[:-1] if grades[grade])
    words = f"{arrived} of {total} flights arrived{f' ({bad})' * bool(bad)}, "
    words += f"with {contacts or 'no'} contact{'s' * (contacts != 1)}"
    least = [group.figures["min_separation_m"].worst for group in groups if "min_separation_m" in group.figures]
    return words + (f", never nearer than {min(least):.2f} m" if least else "")


def _of_estimator(own: Sequence[Row], total: int, groups: Sequence[Group]) -> str:
    words = f"{len(own)} of {total} flights estimated"
    worst = [group.figures["rmse_m"].worst for group in groups if "rmse_m" in group.figures]
    return words + (f", to {max(worst):.2f} m at worst" if worst else "")


def _is_estimator(groups: Sequence[Group]) -> bool:
    return all(group.backend == "estimator" for group in groups)


def worst(rows: Sequence[Row]) -> list[tuple[Row, str]]:
    """Flights to look at, each with why: those that failed, then the worst of each figure over all cases."""
    found: dict[str, tuple[Row, list[str]]] = {}

    def note(row: Row, why: str) -> None:
        found.setdefault(row["key"], (row, []))[1].append(why)

    failures = 0
    for row in rows:
        why = _failure(row)
        if why and failures < FAILURES_SHOWN:
            failures += 1
            note(row, why)
    flown = [row for row in rows if row["status"] == "flown"]
    for name in drawn():
        figure = BY_NAME[name]
        values = [(value, row) for row in flown if (value := value_of(row, name)) is not None]
        if len({value for value, _ in values}) > 1:
            extreme = figure.worst([value for value, _ in values])
            row = next(row for value, row in values if value == extreme)
            note(row, f"worst of {figure.heading}: {_scaled(name, extreme):.4g}")
    return [(row, "; ".join(why)) for row, why in found.values()]


def _failure(row: Row) -> str:
    if row["status"] != "flown":
        return NEVER_ENDED
    if not row.get("arrived", True):
        return "not arrived"
    contacts = row.get("contacts") or 0
    return f"{contacts} contact{'s' * (contacts > 1)}" if contacts else ""


def replay_of(folder: Path, row: Row) -> str | None:
    """The page of a flight that was flown again, from the study's own."""
    file = Path(REPLAYS, row["key"], PAGE_NAME)
    return file.as_posix() if (folder / file).is_file() else None


def _seeds(folder: Path, rows: Iterable[Row], group: Group, name: str) -> list[list[Any]]:
    """Seed, value and replay of each flight of a case."""
    own = [row for row in rows if _is_of(row, group) and row["status"] == "flown"]
    return [
        [row["seed"], _scaled(name, value), *filter(None, [replay_of(folder, row)])]
        for row in own
        if (value := value_of(row, name)) is not None
    ]


def _is_of(row: Row, group: Group) -> bool:
    same = (row["run"], row["law"], row["backend"]) == (group.run, group.law, group.backend)
    return same and row["settings"] == group.settings


def _label(groups: Sequence[Group], row: Row, varied: Sequence[str]) -> str:
    return next(label(group, varied) for group in groups if _is_of(row, group))


def _scaled(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    return round(BY_NAME[name].scale * value, 4)


def read_verdicts(file: Path) -> list[dict[str, Any]]:
    """must.json; empty where there is none."""
    return list(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else []
