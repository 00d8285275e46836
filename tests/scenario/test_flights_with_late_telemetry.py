"""Flights among trees in which the telemetry of all is late for spells: nobody touches anything, or comes too near.

More seeds, and JSBSim: `sim-bridge search` draws the same fault.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_bridge.judge.verdict import Grade
from tests.flights import flown, short_mission

SIZE = 8
SALT = 0x1A7E
GATHERS_S = 45.0  # until the swarm covers: its spells are over by then


def draw_spells(seed: int) -> tuple[dict[str, Any], ...]:
    """Of each vehicle, 1 to 6 s long with 3 to 12 s between them, from when the swarm gathers: 0.5 to 1 s late."""
    rng = np.random.default_rng([SALT, seed])
    spells = []
    for vehicle in range(1, SIZE + 1):
        at_s = rng.uniform(3.0, 12.0)
        while at_s < GATHERS_S:
            for_s = rng.uniform(1.0, 6.0)
            spell = {"at_s": round(at_s, 1), "for_s": round(for_s, 1), "late_s": round(rng.uniform(0.5, 1.0), 2)}
            spells.append({"kind": "late", "vehicles": (vehicle,), "phase": "gather", **spell})
            at_s += for_s + rng.uniform(3.0, 12.0)
    return tuple(spells)


@pytest.mark.parametrize("seed", [1, 2])
def test_nobody_is_hit_where_all_are_late_now_and_then(seed: int, tmp_path: Path) -> None:
    spells = draw_spells(seed)
    assert {vehicle for spell in spells for vehicle in spell["vehicles"]} == set(range(1, SIZE + 1))
    mission = short_mission(
        swarm={"size": SIZE},
        coverage={"radius_m": 15.0, "duration_s": 10.0},
        fence={"altitude_max_m": 8.0},
        sensing={"range_m": 8.0},
        forest={"stand": {"density_per_ha": 300.0}},
        sim={"seed": seed, "faults": spells},
    )
    outcome, shown = flown(mission, tmp_path)
    assert "telemetry" in shown
    assert outcome.metrics.contacts == 0, shown
    assert outcome.summary["grade"] != Grade.UNSAFE, shown
    assert outcome.metrics.arrived, shown
