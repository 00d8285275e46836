"""The studies of swarms of which only the leader has GNSS: what they fly, and what they ask for."""

from __future__ import annotations

from pathlib import Path

import pytest

import mission
from sim_bridge.lab.study.case import Backend
from sim_bridge.lab.study.load import load_study

STUDIES = sorted((Path(mission.__file__).parent / "studies").glob("ranges_*.toml"))


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_all_fly_by_ranges_on_seeds_of_reports_and_none_may_touch_anything(path: Path) -> None:
    loaded = load_study(path)
    assert loaded.cases
    for case in loaded.cases:
        assert case.mission.flies_by_ranges
        assert case.mission.sim.seed >= 1000
        assert case.backend is not Backend.POINT_MASS  # which knows no odometers
    for run in loaded.study.run:
        assert run.must["contacts"] == {"worst": 0}
        assert run.must["min_separation_m"]["worst"] >= 4.5


def test_two_hundred_flights_of_a_vehicle_are_asked_for() -> None:
    flights = dict.fromkeys((4, 8, 12), 0)
    for path in STUDIES:
        if path.stem in ("ranges_lone_tree", "ranges_forest"):
            for case in load_study(path).cases:
                flights[case.mission.swarm.size] += case.mission.swarm.size
    assert sum(flights.values()) >= 200
    assert min(flights.values()) > 0
