"""Records of a search's flights: those that are lacking though no fault took them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mission.schema.kinds import FaultKind
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.lab.search import flight
from sim_bridge.lab.search.kept_records import find_lacking_records
from tests.flights import short_mission

RECORDS = {
    "grade": "ARRIVED",
    "sim_time_s": 120.0,
    "records_made": 90,
    "records_delivered": 80,
    "records_lost": {},
    "records_waiting": {"3": 10},
    "records_unwritten": {},
}


@pytest.mark.parametrize(
    ("changes", "at_end", "faults", "lacking"),
    [
        ({}, "return", [], "10 records still on vehicle 3, at the base station"),
        ({}, "return", [(FaultKind.BASE_LOST, 1, None)], ""),
        ({}, "return", [(FaultKind.BASE_LOST, 1, 130.0)], ""),  # not back when all was over
        ({}, "return", [(FaultKind.BASE_LOST, 1, 50.0)], "10 records still on vehicle 3, at the base station"),
        ({}, "land", [], ""),  # far from the base station
        ({"grade": "DEGRADED"}, "return", [], ""),
        ({"records_waiting": {}}, "return", [], ""),
        ({"records_delivered": 91}, "land", [], "91 records delivered of 90 made"),
        ({"records_unwritten": {"2": 4}}, "land", [], "4 records of vehicle 2 were not written"),
        ({"records_unwritten": {"2": 4}}, "land", [(FaultKind.DISK_FULL, 2, 9.0)], ""),
        ({"records_unwritten": {"2": 4}}, "land", [(FaultKind.KILL, 2, None)], ""),
        (
            {"records_unwritten": {"2": 4}},
            "land",
            [(FaultKind.DISK_FULL, 1, 9.0)],
            "4 records of vehicle 2 were not written",
        ),
    ],
)
def test_records_that_no_fault_took_are_looked_for(
    changes: dict[str, Any], at_end: str, faults: list[tuple[FaultKind, int, float | None]], lacking: str
) -> None:
    mission = short_mission(route={"at_end": at_end}, sensing={"sensor": "scan-1deg"}, survey={})
    struck = [FaultEvent(kind, (k,), 1.0, until_s) for kind, k, until_s in faults]
    assert find_lacking_records(RECORDS | changes, mission, struck) == lacking


def test_a_flight_that_is_worse_keeps_its_grade_and_its_first_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = {"grade": "UNSAFE", "causes": ["contact"], "verdict": "UNSAFE: 1 contact"}
    monkeypatch.setattr(flight, "fly_stack", lambda *_, **__: SimpleNamespace(ended="all landed", summary=dict(flown)))
    monkeypatch.setattr(flight, "find_lacking_records", lambda *_: "3 records of vehicle 2 were not written")
    row = flight.fly_to_row(short_mission(), on_jsbsim=False)
    assert row["verdict"] == "UNSAFE: 3 records of vehicle 2 were not written; UNSAFE: 1 contact"
    assert (row["grade"], row["causes"]) == ("UNSAFE", ["contact", "records"])
