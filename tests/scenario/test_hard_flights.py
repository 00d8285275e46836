"""Flights in which vehicles fall silent, or do not hear one another: nobody comes too near, and all come down.

The same on full flight dynamics and with many seeds: `python -m tests.bench robustness`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_bridge.judge import run_folder
from tests.flights import flown, short_mission

HARD_M = 5.0
FAULTS: dict[str, list[dict[str, Any]]] = {
    "leader killed at departure": [{"kind": "kill", "phase": "transit", "at_s": 0.0}],
    "follower killed at d1": [{"kind": "kill", "vehicles": [6], "phase": "gather", "at_s": 12.0}],
    "half a ring killed": [{"kind": "kill", "vehicles": [2, 4, 6], "phase": "coverage", "at_s": 8.0}],
    "leader killed while gathering": [{"kind": "kill", "phase": "gather", "at_s": 12.0}],
    "parts of two and four": [
        {"kind": "partition", "vehicles": [1, 2], "phase": "transit", "at_s": 5.0, "for_s": 100.0}
    ],
}


@pytest.mark.parametrize("what", FAULTS)
def test_nobody_flies_into_those_that_are_not_heard(what: str, tmp_path: Path) -> None:
    mission = short_mission(
        route={"at_end": "return"}, swarm={"size": 6}, sim={"faults": FAULTS[what], "time_limit_s": 400.0}
    )
    outcome, shown = flown(mission, tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m >= HARD_M, shown
    recording = run_folder.load(tmp_path)
    alive = recording.agent_alive[-1]
    assert recording.on_ground[-1][alive].all(), shown
    assert np.linalg.norm(recording.vel_ned_mps[-1], axis=1).max() < 0.5  # the dead hang still


def test_part_without_the_majority_waits_for_the_others_and_joins_them(tmp_path: Path) -> None:
    cut = [{"kind": "partition", "vehicles": [1, 2], "phase": "transit", "at_s": 5.0, "for_s": 20.0}]
    mission = short_mission(swarm={"size": 6}, sim={"faults": cut}, coverage={"duration_s": 60.0})
    outcome, shown = flown(mission, tmp_path)
    assert "hold: no quorum, without 3, 4, 5, 6" in shown
    assert outcome.metrics.arrived, shown
    assert outcome.metrics.min_separation_m is not None
    assert outcome.metrics.min_separation_m >= HARD_M
