"""A fixed slice of `sim-bridge search`: drawn missions, which arrive or are explained by their faults."""

from __future__ import annotations

import pytest

from sim_bridge.judge.verdict import Grade
from sim_bridge.lab.search.draw import draw
from sim_bridge.lab.search.flight import fly_to_row

# Open and among 78 to 448 trees/ha, without satellites, raw scans of one layer and of many, nine faults of six kinds,
# by today's estimates: 33 s of a core together, compiled, or 63 s beside much else
SEEDS = (3, 9, 10, 34, 58)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drawn_mission_is_flown(seed: int) -> None:
    row = fly_to_row(draw(seed, 0.0).mission, on_jsbsim=False)  # attacked ones: test_attackers.py
    assert row["grade"] in (Grade.ARRIVED, Grade.DEGRADED), row["verdict"]
