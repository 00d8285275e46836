"""The table of hazards: what it names exists, and a name that does not is told."""

from __future__ import annotations

import copy
import importlib.util
import json
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def page() -> ModuleType:
    sys.path.insert(0, str(ROOT / "docs"))
    spec = importlib.util.spec_from_file_location("docs_hazard_pages", ROOT / "docs" / "hazard_pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def table(page: ModuleType) -> dict[str, Any]:
    return tomllib.loads(page.HAZARDS.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def flown(page: ModuleType) -> dict[str, Any]:
    counted: dict[str, Any] = json.loads(page.FLOWN.read_text(encoding="utf-8"))
    return counted


def test_all_that_the_table_names_exists(page: ModuleType, table: dict[str, Any], flown: dict[str, Any]) -> None:
    assert list(page.find_problems(table, flown)) == []


def test_each_hazard_has_a_test_and_says_how_often_it_came_up_or_what_is_lacking(table: dict[str, Any]) -> None:
    for row in table["hazard"]:
        assert row["tests"], row["hazard"]
        assert row.keys() & {"events", "measured", "lacks", "taken_out"}, row["hazard"]


def _rename(key: str, name: str) -> Callable[[dict[str, Any]], None]:
    def change(row: dict[str, Any]) -> None:
        row[key] = [name]

    return change


def _take_out_nothing(row: dict[str, Any]) -> None:
    row["taken_out"] = {"file": "companion/core/swarm/election.py", "old": "no such line", "new": ""}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_rename("code", "companion.core.swarm.election:Election.gone"), "Election.gone: is not in the code"),
        (_rename("code", "companion.core.swarm.gone:Election"), "gone:Election: is not in the code"),
        (_rename("code", "companion.core.vehicle.failsafe:Cause.GONE"), "Cause.GONE: is not in the code"),
        (_rename("tests", "unit/core/swarm/test_election.py::test_gone"), "test_gone: is no test"),
        (_rename("tests", "unit/core/swarm/test_gone.py::test_gone"), "test_gone: is no test"),
        (_rename("events", "failsafe: gone"), "failsafe: gone: is no event"),
        (_rename("events", "fault: gone"), "fault: gone: is no event"),
        (_rename("events", "text: a text that nobody says"), "is no event"),
        (_rename("colour", "red"), "colour: is no key"),
        (_take_out_nothing, "'no such line' does not stand once"),
    ],
)
def test_what_does_not_exist_is_named(
    page: ModuleType,
    table: dict[str, Any],
    flown: dict[str, Any],
    change: Callable[[dict[str, Any]], None],
    said: str,
) -> None:
    changed = copy.deepcopy(table)
    change(changed["hazard"][0])
    (problem,) = page.find_problems(changed, flown)
    assert problem.startswith(repr(table["hazard"][0]["hazard"]))
    assert problem.endswith(said) or said in problem


def test_counts_are_of_flights_that_were_flown(flown: dict[str, Any]) -> None:
    assert sum(flown["grades"].values()) == flown["flights"]
    assert all(0 < flights <= flown["flights"] and flights <= times for flights, times in flown["events"].values())
