"""Own positions that jump, freeze or are led astray, in whole flights: in truth nobody touches, or leaves the fence.

Without what holds them these flights end in a contact, 72 m outside of the fence, on the ground, 5.3 and 3.8 m outside,
and two vehicles 1.4 and 2.5 m apart.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import mission
from mission.document.model import Mission
from sim_bridge.judge.verdict import Grade
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.flights import flown, short_mission
from tests.referees import swarmfuzz
from tests.referees.referee import Case

EXAMPLES = Path(mission.__file__).parent / "examples"
FENCE_M = 0.1


def with_fault(kind: str, *vehicles: int, range_finder: bool = True, **numbers: Any) -> Mission:
    fault: dict[str, Any] = {"kind": kind, "phase": "transit", "at_s": 5.0, **numbers}
    if vehicles:
        fault["vehicles"] = vehicles
    return short_mission(
        route={"d1_enu_m": (0, 0, 6), "d2_enu_m": (80, 0, 6), "vel_leader_mps": 3.0},
        fence={
            "altitude_min_m": 2.0,
            "altitude_max_m": 12.0,
            "polygon_enu_m": [[-30, -30], [110, -30], [110, 30], [-30, 30]],
        },
        swarm={"size": 5},
        sim={
            "seed": 11,
            "estimates": "recorded",
            "range_finder": range_finder,
            "time_limit_s": 200.0,
            "faults": [fault],
        },
    )


def of_example(name: str, fault: dict[str, Any], limit_s: float = 250.0, **changes: Any) -> Mission:
    tables = tomllib.loads((EXAMPLES / name).read_text())
    for table, keys in changes.items():
        tables[table] |= keys
    tables.setdefault("sim", {})["seed"] = 11
    tables["sim"] |= {"time_limit_s": limit_s, "faults": [{"phase": "transit", "at_s": 5.0, **fault}]}
    return Mission.model_validate(tables).with_origin(DEFAULT_ORIGIN)


def test_a_leader_whose_position_jumps_20_m_is_passed_by_nobody(tmp_path: Path) -> None:
    outcome, shown = flown(with_fault("position-jump", jump_m=(0.0, 20.0)), tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert "vehicle 1: hold: position jumped" in shown
    assert "vehicle 1: position doubted: jump taken off" in shown
    assert "leader: vehicle 1" not in shown.split("jump taken off")[1]  # it has given up the lead
    assert outcome.succeeded, shown


def test_one_whose_position_freezes_rests_and_lands(tmp_path: Path) -> None:
    outcome, shown = flown(with_fault("position-freeze", 2), tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert "vehicle 2: hold: position frozen" in shown
    assert "vehicle 2: land: position doubted for 15 s" in shown


@pytest.mark.parametrize(("height_m", "range_finder"), [(10.0, True), (-10.0, True), (10.0, False)])
def test_a_height_that_is_wrong_at_once_brings_nobody_down_or_up(
    height_m: float, range_finder: bool, tmp_path: Path
) -> None:
    outcome, shown = flown(with_fault("height-error", 2, height_m=height_m, range_finder=range_finder), tmp_path)
    assert outcome.summary["grade"] == Grade.ARRIVED, shown
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert "vehicle 2: hold: position jumped" in shown


@pytest.mark.parametrize("height_m", [10.0, -10.0])
def test_a_companion_that_starts_anew_under_a_wrong_height_lands_softly(height_m: float, tmp_path: Path) -> None:
    """What it took off its height is forgotten: it would go down by 10 m to be where it is already."""
    tables = with_fault("height-error", 2, height_m=height_m).model_dump(by_alias=True)
    restart = {"kind": "restart", "vehicles": [2], "phase": "transit", "at_s": 10.0, "for_s": 3.0}
    tables["sim"]["faults"] = [*tables["sim"]["faults"], restart]
    outcome, shown = flown(Mission.model_validate(tables), tmp_path)
    assert outcome.metrics.contacts == 0, shown
    assert "vehicle 2: land: height cannot be true" in shown
    assert outcome.summary["grade"] == Grade.DEGRADED, shown


def test_in_the_open_a_leader_whose_position_leaves_its_velocity_goes_by_that_and_lands(tmp_path: Path) -> None:
    outcome, shown = flown(with_fault("position-drift", 1, drift_mps=(0.0, 0.4)), tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert "vehicle 1: position doubted: off its velocity" in shown
    assert "vehicle 1: land: position doubted for 15 s" in shown


@pytest.mark.parametrize(("vehicle", "drift_mps"), [(1, (0.0, 0.5)), (3, (0.3, 0.0))])
def test_in_the_open_range_radios_show_a_fix_that_is_led_astray(
    vehicle: int, drift_mps: tuple[float, float], tmp_path: Path
) -> None:
    """Nothing else does: position and velocity drift together."""
    tables = with_fault("gnss-drift", vehicle, drift_mps=drift_mps, for_s=60.0).model_dump(by_alias=True)
    tables["swarm"]["size"] = 6
    tables["ranging"] = {"reach_m": 40.0}
    outcome, shown = flown(Mission.model_validate(tables), tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert (outcome.metrics.min_separation_m or 0.0) >= 4.5
    said = [line for line in shown.splitlines() if "position doubted: GNSS led astray" in line]
    assert [f"vehicle {vehicle}:" in line for line in said] == [True], shown
    began = next(line for line in shown.splitlines() if "fault: GNSS" in line)
    assert sum(drift_mps) * (float(said[0].split()[0]) - float(began.split()[0])) < 5.0
    assert outcome.summary["grade"] == Grade.DEGRADED, shown


def test_ranges_that_trunks_make_too_long_lead_nobody_astray(tmp_path: Path) -> None:
    """400 trees/ha, some ranges too long by a metre for as long as a trunk stands between: no alarm, all arrive."""
    tables = tomllib.loads((EXAMPLES / "natural_stand.toml").read_text())
    tables["swarm"]["size"] = 5
    tables["ranging"] = {"reach_m": 30.0}
    tables["sim"] |= {"seed": 12, "estimates": "recorded", "time_limit_s": 250.0}
    outcome, shown = flown(Mission.model_validate(tables).with_origin(DEFAULT_ORIGIN), tmp_path)
    assert "doubted" not in shown
    assert outcome.summary["grade"] == Grade.ARRIVED, shown


def test_beside_a_block_of_walls_a_true_fix_is_believed(tmp_path: Path) -> None:
    """Ten along a block of 37.5 m: one took pieces of it for trunks, dropped a true fix for it, and met another."""
    tables = swarmfuzz.mission_of(Case(swarmfuzz.UNATTACKED, 10, 1, swarmfuzz.ESTIMATES)).model_dump(by_alias=True)
    tables["sim"]["time_limit_s"] = 92.0
    outcome, shown = flown(Mission.model_validate(tables), tmp_path)
    assert "doubted" not in shown
    assert (outcome.metrics.min_separation_m or 0.0) >= 4.9


def test_among_trees_a_leader_that_is_led_astray_drops_its_fix_before_15_m(tmp_path: Path) -> None:
    fault = {"kind": "gnss-drift", "vehicles": [1], "drift_mps": [0.0, 0.3]}
    drawn = of_example(
        "natural_stand.toml",
        fault,
        120.0,  # it lands later, and meanwhile drifts as its fix does: not looked at here
        swarm={"size": 4},
        sensing={"sensor": "scan-1deg", "range_m": 12.0},
        sim={"estimates": "recorded"},
    )
    outcome, shown = flown(drawn, tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    said = [line for line in shown.splitlines() if "position doubted: GNSS led astray" in line]
    assert len(said) == 1, shown
    assert "vehicle 1" in said[0]
    began = next(line for line in shown.splitlines() if "fault: GNSS" in line)
    assert 0.3 * (float(said[0].split()[0]) - float(began.split()[0])) < 15.0  # sooner, frames that turn alarm too


def test_where_the_leader_alone_has_gnss_a_drift_drags_nobody_out_of_the_fence(tmp_path: Path) -> None:
    fault = {"kind": "gnss-drift", "vehicles": [1], "drift_mps": [0.0, 0.3]}
    outcome, shown = flown(of_example("only_the_leader.toml", fault, swarm={"size": 6}), tmp_path)
    assert outcome.metrics.contacts == 0
    assert outcome.metrics.fence_exceeded_m <= FENCE_M
    assert "vehicle 1: position doubted: GNSS led astray" in shown
    assert outcome.succeeded, shown
