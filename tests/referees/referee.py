"""A referee: flights that others thought of, and the section of docs/reference/referees.md that tells how ours fare."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from mission.schema.kinds import SensorClass

Row = dict[str, Any]  # the case's keys, `grade`, and the referee's own figures; plain values, as JSON keeps them


@dataclass(frozen=True, slots=True)
class Case:
    """One flight of a referee."""

    name: str  # of a layout, a line, a forest with a speed ...
    n: int
    seed: int
    estimates: str  # as sim.estimates
    sensor: str = SensorClass.SECTORS.value  # as sensing.sensor

    def row(self, grade: str, **figures: Any) -> Row:
        """How it went: "clear" is as good as can be."""
        return {**asdict(self), "grade": grade, **figures}


def case_of(row: Row) -> Case:
    """The case that `row` is of."""
    return Case(row["name"], row["n"], row["seed"], row["estimates"], row.get("sensor", SensorClass.SECTORS.value))


@dataclass(frozen=True, slots=True)
class Referee:
    """What `python -m tests.referees` knows of one. All are functions of modules: workers must find them."""

    title: str  # of its section
    cases: Callable[[], list[Case]]
    fly: Callable[[Case], Row]
    section: Callable[[Sequence[Row], str], str]  # of flights, and the commit that flew them
    missing: Callable[[], str] = lambda: ""  # what is not installed that it needs; "": nothing


def with_section(page: str, title: str, text: str) -> str:
    """`page` with its section of that title replaced, or with a new one at its end."""
    old = re.compile(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    if old.search(page):
        return old.sub(lambda _: text.rstrip() + "\n\n", page).rstrip() + "\n"
    return page.rstrip() + "\n\n" + text.rstrip() + "\n"


def words_of(flights: Sequence[Row], key: str) -> str:
    """The values of `key` in `flights`, as a table's heading has them: `1`, `1 to 15`, `exact, recorded`."""
    values = sorted({row[key] for row in flights})
    if len(values) > 2 and all(isinstance(value, int) for value in values) and values[-1] - values[0] < len(values):
        return f"{values[0]} to {values[-1]}"
    return ", ".join(map(str, values))
