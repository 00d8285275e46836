"""Swarms that fly among trees by raw scans, of each class of lidar: in lockstep, by what a driver would send."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.core.vehicle.failsafe import Cause
from mission.document.model import Mission
from sim_bridge.judge.run_folder import load_faults
from tests.flights import flown, short_mission
from tests.scenario.test_scan_flights import BLIND, Watch

CLASSES: dict[str, dict[str, Any]] = {
    "scan-1deg": {"range_m": 12.0},
    "scan-0.5deg": {"range_m": 20.0},
    "multi-layer": {"range_m": 12.0},
}


def among_trees(sensor: str, seed: int = 1, **changes: Any) -> Mission:
    """400 trees/ha, with undergrowth beside the way."""
    sim = changes.pop("sim", {})
    return short_mission(
        sensing={"sensor": sensor, **CLASSES[sensor], **changes.pop("sensing", {})},
        forest={"stand": {"density_per_ha": 400.0, "undergrowth_per_ha": 200.0}},
        swarm={"size": 3},
        sim={"seed": seed, **sim},
        **changes,
    )


@pytest.mark.parametrize(
    ("sensor", "seed", "sensing"),
    [
        ("scan-1deg", 1, {}),
        ("scan-1deg", 2, {}),
        ("scan-0.5deg", 1, {}),
        ("multi-layer", 1, {}),
        ("multi-layer", 2, {"upside_down": True}),
    ],
)
def test_a_swarm_arrives_among_trees_by_raw_scans(
    sensor: str, seed: int, sensing: dict[str, Any], tmp_path: Path
) -> None:
    outcome, shown = flown(among_trees(sensor, seed, sensing=sensing), tmp_path)
    assert outcome.metrics.arrived, shown
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.trunk_clearance_min_m is not None
    assert outcome.metrics.trunk_clearance_min_m > 0.35 + 0.2  # a hull, and most of the margin
    assert "no obstacle scan" not in shown


def test_flight_by_raw_scans_is_the_same_to_the_bit_in_one_process_and_in_many(tmp_path: Path) -> None:
    mission = among_trees("scan-1deg", sim={"time_limit_s": 30.0})
    one, _ = flown(mission, tmp_path / "one")
    many, _ = flown(mission, tmp_path / "many", in_process=False)
    assert one.summary["trace_hash"] == many.summary["trace_hash"]


def test_vehicle_whose_lidar_falls_silent_brakes_and_flies_on_with_the_next_scan(tmp_path: Path) -> None:
    watch = Watch()
    flown(among_trees("scan-1deg", sim={"faults": (BLIND,), "time_limit_s": 40.0}), tmp_path, watch=watch)
    (event,) = load_faults(tmp_path)
    assert event.until_s is not None
    stale = [now_s for now_s, _, cause, _, _ in watch.seen if cause is Cause.OBSTACLES_STALE]
    assert event.at_s + 0.2 <= stale[0] <= event.at_s + 0.5
    assert event.until_s - 0.1 <= stale[-1] <= event.until_s + 0.3
    at_rest = [mps for now_s, _, _, _, mps in watch.seen if stale[0] + 1.5 < now_s < stale[-1]]
    assert max(at_rest) < 0.3


def test_noise_and_delay_of_a_fault_reach_raw_scans(tmp_path: Path) -> None:
    errors = {"kind": "scan-errors", "vehicles": (2,), "at_s": 5.0, "for_s": 2.0, "noise_m": 0.0, "delay_s": 0.2}
    watch = Watch()
    mission = among_trees("scan-1deg", sim={"faults": (errors,), "time_limit_s": 30.0})
    flown(mission, tmp_path, watch=watch)
    ages_s = {now_s: age_s for now_s, _, _, age_s, _ in watch.seen}
    assert max(age_s for now_s, age_s in ages_s.items() if 5.5 < now_s < 7.0) > 0.3
    assert max(age_s for now_s, age_s in ages_s.items() if 8.0 < now_s < 10.0) < 0.3
