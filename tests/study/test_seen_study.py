"""The study of vehicles that see trunks and believe wrong estimates: what it flies, and what it asks for."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import mission
from mission.schema.kinds import SensorClass
from sim_bridge.lab.study.case import Backend
from sim_bridge.lab.study.load import load_study

STUDY = Path(mission.__file__).parent / "studies" / "seen_trunks.toml"


def test_it_flies_wrong_estimates_on_jsbsim_and_no_steered_vehicle_may_touch_anything() -> None:
    loaded = load_study(STUDY, most_seeds=2)
    assert {case.backend for case in loaded.cases} == {Backend.JSBSIM}
    assert {case.mission.sim.estimates for case in loaded.cases} == {"recorded"}
    assert all(run.must["contacts_steered"] == {"worst": 0} for run in loaded.study.run)
    assert {case.mission.sensing.sensor for case in loaded.cases if case.mission.sensing} == {
        SensorClass.SCAN_1DEG,
        SensorClass.SECTORS,
    }


def test_it_asks_for_a_thousand_flights_of_a_vehicle_and_four_hundred_of_each_disturbance() -> None:
    flights: Counter[str] = Counter()
    for case in load_study(STUDY).cases:
        flights[case.run] += case.mission.swarm.size
    assert flights["rays of 1 degree, 12 m"] >= 1000
    assert flights["turbulent wind of 5 m/s across"] >= 400
    assert flights["leader killed"] >= 400
