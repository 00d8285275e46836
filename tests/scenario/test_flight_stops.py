"""Missions of several trees on the whole stack, on full flight dynamics."""

from __future__ import annotations

from pathlib import Path

from sim_bridge.judge import run_folder
from tests.flights import flown, short_mission

STOPS = [{"pos_enu_m": (40.0, 0.0, 4.0), "duration_s": 12.0}]


def test_leader_that_is_killed_between_two_trees_changes_nothing(tmp_path: Path) -> None:
    """d1 -> tree -> tree -> home. It is killed 5 s after it has left the first."""
    mission = short_mission(
        route={"stops": STOPS, "d2_enu_m": (40.0, 45.0, 4.0), "at_end": "return"},
        coverage={"duration_s": 30.0},
        sim={"faults": [{"kind": "kill", "phase": "coverage", "at_s": 17.0}]},
    )
    outcome, shown = flown(mission, tmp_path, point_mass=False)
    assert outcome.summary["verdict"].startswith("ARRIVED without"), shown
    figures = outcome.metrics
    assert figures.visited == 2
    assert figures.contacts == 0
    assert figures.leader_changes == 1
    assert figures.coverage_gap_deg is not None
    assert figures.coverage_gap_deg <= 1.3 * 120.0
    recording = run_folder.load(tmp_path)
    alive = recording.agent_alive[-1]
    assert recording.on_ground[-1][alive].all()
