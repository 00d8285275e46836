"""The studies of swarms of which only the leader has GNSS: what they fly, and what they ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mission
from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.lab.study.case import Backend
from sim_bridge.lab.study.forest.flight import alone
from sim_bridge.lab.study.load import load_study

FOLDER = Path(mission.__file__).parent / "studies"
STUDIES = sorted(FOLDER.glob("ranges_*.toml"))
RAW = {"sensor": "scan-0.5deg", "range_m": 20.0}


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


def test_trunks_alone_are_flown_without_a_range_radio_by_the_lidars_that_see_enough_of_them() -> None:
    loaded = load_study(FOLDER / "trunks_alone.toml")
    for case in loaded.cases:
        flown = case.mission
        assert flown.flies_by_ranges
        assert not flown.has_range_radios
        assert flown.sensing is not None
        assert (flown.sensing.sensor, flown.sensing.range_m) == ("scan-0.5deg", 20.0)
        assert (flown.sim.estimates, case.backend) == ("recorded", Backend.JSBSIM)
        assert flown.sim.seed >= 2000
    assert {
        (case.n, case.mission.forest.stand and case.mission.forest.stand.density_per_ha) for case in loaded.cases
    } == {
        (4, 200.0),
        (4, 400.0),
        (8, 200.0),
        (8, 400.0),
    }
    (run,) = loaded.study.run
    assert run.must == {"contacts": {"worst": 0}, "relative_error_m": {"mean": 0.25}}


def test_two_hundred_flights_of_a_vehicle_are_asked_for() -> None:
    flights = dict.fromkeys((4, 8, 12), 0)
    for path in STUDIES:
        if path.stem in ("ranges_lone_tree", "ranges_forest"):
            for case in load_study(path).cases:
                flights[case.mission.swarm.size] += case.mission.swarm.size
    assert sum(flights.values()) >= 200
    assert min(flights.values()) > 0


@pytest.mark.parametrize(
    ("swarm", "tables"),
    [
        ({}, {"ranging": {"radio": False}, "sensing": RAW}),
        ({"leader_priority": [3, 1]}, {}),
        ({"gnss": [2, 3], "leader_priority": [2]}, {}),
        ({}, {"sim": {"satellites": {"crowns": "shade"}}}),
    ],
)
def test_the_one_alone_that_times_are_held_against_needs_no_others(swarm: Any, tables: dict[str, Any]) -> None:
    by_ranges = load_mission(FOLDER / "by_ranges.toml").model_dump(by_alias=True)
    for table, keys in {"swarm": swarm, **tables}.items():
        by_ranges[table] |= keys
    one = alone(Mission.model_validate(by_ranges))
    assert (one.swarm.size, one.flies_by_ranges, one.ranging) == (1, False, None)
    assert one.route == load_mission(FOLDER / "by_ranges.toml").route
