"""A flight through trees for whatever is made of one: its leader killed, its name awkward in XML."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.flights import flown, short_mission

FENCE_ENU_M = ((-60, -60), (-60, 60), (100, 60), (100, -60))  # clockwise


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its run folder; copy it before you change anything there."""
    folder = tmp_path_factory.mktemp("run")
    mission = short_mission(
        swarm={"size": 3},
        sensing={},
        forest={"stand": {"density_per_ha": 300.0}},
        fence={"polygon_enu_m": FENCE_ENU_M},
        sim={"seed": 1, "faults": [{"kind": "kill", "at_s": 30.0}]},
    ).model_copy(update={"name": "oak & <beech>"})
    flown(mission, folder)
    return folder
