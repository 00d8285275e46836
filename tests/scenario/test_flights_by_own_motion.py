"""Among trees, by estimates as wrong as PX4's: what is seen corrects them. By reports alone one touches a trunk."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import mission
from sim_bridge import fly
from sim_bridge.judge.tick import TOUCHED

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
HULL_M = 0.35


def tables(seed: int) -> dict[str, Any]:
    """Four vehicles, 80 m through 400 trees/ha, errors as recorded, heights by range finders."""
    flown: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
    flown["swarm"]["size"] = 4
    flown["route"]["d2_enu_m"][0] = 80.0
    flown["coverage"]["duration_s"] = 2.0
    flown["sim"] |= {"seed": seed, "estimates": "recorded", "range_finder": True}
    return flown


@pytest.mark.parametrize("seed", [1, 2])
def test_estimates_as_wrong_as_px4s_touch_no_trunk(seed: int) -> None:
    """By reported motion alone both ended at a trunk (bark at 0.43 and 0.37 m before)."""
    result = fly(tables(seed))
    assert {TOUCHED[number] for number in result.recording.touched[-1].tolist()} == {""}
    assert result.metrics.trunk_clearance_min_m is not None
    assert result.metrics.trunk_clearance_min_m > HULL_M + 0.15
    assert result.summary["contacts"] == 0
