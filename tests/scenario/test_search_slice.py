"""A fixed slice of `sim-bridge search`: drawn missions, which arrive or are explained by their faults."""

from __future__ import annotations

import pytest

from mission.document.model import Estimates
from sim_bridge.judge.verdict import Grade
from sim_bridge.lab.search.draw import draw
from sim_bridge.lab.search.flight import fly_to_row

SEEDS = (2, 3, 15)  # open and among trees, with faults: about half a minute of a core each


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drawn_mission_is_flown(seed: int) -> None:
    mission = draw(seed).mission
    if mission.sim.estimates is Estimates.RECORDED:  # by these vehicles touch trunks still
        mission = mission.with_estimates(Estimates.RECORDED_2026_11)
    row = fly_to_row(mission, on_jsbsim=False)
    assert row["grade"] in (Grade.ARRIVED, Grade.DEGRADED), row["verdict"]
