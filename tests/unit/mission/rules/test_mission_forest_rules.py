"""Forests and sensors that cannot go with the rest of a mission are refused: each law on both sides of its bound."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from companion.core.perception import obstacle_map
from companion.core.safety import clearance
from mission.document.model import Mission, RadioTrunks
from mission.rules import flight_rules

Tables = dict[str, Any]


def tables(**changes: Tables) -> Tables:
    route = {"d1_enu_m": [0, 0, 4], "d2_enu_m": [130, 0, 4], "vel_leader_mps": 3, **changes.pop("route", {})}
    forest = {"stand": {"density_per_ha": 400, **changes.pop("stand", {})}, **changes.pop("forest", {})}
    return {"schema": 1, "route": route, "sensing": {}, "forest": forest, **changes}


def refusal(**changes: Tables) -> str:
    """The conflict; empty if there is none."""
    try:
        Mission.model_validate(tables(**changes))
    except ValidationError as error:
        return str(error)
    return ""


def trees_at(east_m: float) -> Tables:
    return {"stand": None, "trees": [{"base_enu_m": [east_m, 0], "trunk_radius_m": 0.2, "height_m": 20}]}


def test_the_defaults_go_together() -> None:
    mission = Mission.model_validate(tables())

    assert mission.sensing is not None
    assert (mission.sensing.range_m, mission.sensing.rate_hz, mission.sensing.stale_s) == (8.0, 10.0, 0.3)
    assert (mission.sim.lidar.noise_m, mission.sim.lidar.dropout) == (None, 0.02)
    assert mission.sim.radio_trunks is RadioTrunks.DISC


def test_a_mission_has_neither_sensors_nor_a_stand_unless_it_says_so() -> None:
    least = Mission.model_validate({"schema": 1, "route": tables()["route"]})

    assert least.sensing is None
    assert least.forest.stand is None


@pytest.mark.parametrize(
    ("good", "bad", "says"),
    [
        # the way of one scan 0.3 m, braking 1.5 m, vehicle and margin 0.65 m
        (
            {"sensing": {"range_m": 2.45}},
            {"sensing": {"range_m": 2.44}},
            "sensing.range_m = 2.44: must be at least 2.45 m: the way of one scan, that of braking",
        ),
        (
            {"route": {"vel_leader_mps": 6}, "limits": {"speed_max_mps": 6}},
            {"route": {"vel_leader_mps": 7}, "limits": {"speed_max_mps": 7}},
            "sensing.range_m = 8.0: must be at least 9.52 m",
        ),
        (
            {"sensing": {"rate_hz": 5, "stale_s": 0.4}},
            {"sensing": {"rate_hz": 5}},
            "sensing.stale_s = 0.3: must be at least 0.4 s, two scans",
        ),
        (
            {"sensing": {"stale_s": obstacle_map.MEMORY_S}},  # beyond, what is forgotten would count as free
            {"sensing": {"stale_s": 4.01}},
            "sensing.stale_s\n  Input should be less than or equal to 4",
        ),
        (
            {"sim": {"lidar": {"delay_s": 0.29}}},
            {"sim": {"lidar": {"delay_s": 0.3}}},
            "sim.lidar.delay_s = 0.3: must be less than 0.3 s: vehicles do not notice a constant delay",
        ),
        (
            {"sensing": {"sensor": "scan-1deg", "range_m": 12}},
            {"sensing": {"sensor": "scan-1deg", "range_m": 12.1}},
            "sensing.range_m = 12.1: must be at most 12 m",
        ),
        (
            {"sensing": {"sensor": "multi-layer", "upside_down": True}},
            {"sensing": {"sensor": "scan-0.5deg", "upside_down": True}},
            "sensing.upside_down = true: must be false but with multi-layer",
        ),
        (
            {"sensing": {}, "sim": {"lidar": {"via": "autopilot"}}},
            {"sensing": {"sensor": "scan-0.5deg"}, "sim": {"lidar": {"via": "autopilot"}}},
            'must be "link": no autopilot forwards SWARM_LIDAR_SCAN',
        ),
        (
            {"sensing": None, "sim": {"lidar": {"delay_s": 0.0, "dropout": 0.02}}},
            {"sensing": None, "sim": {"lidar": {"dropout": 0.03}}},
            "sim.lidar.dropout = 0.03: needs [sensing]: without it no vehicle has an obstacle sensor",
        ),
        (
            {"sensing": {"vehicle_radius_m": 1, "margin_m": 1}, "separation": {"hard_m": 4}, "forest": {"stand": None}},
            {"sensing": {"vehicle_radius_m": 1, "margin_m": 1}, "separation": {"hard_m": 3.9}},
            "separation.hard_m = 3.9: must be at least 4 m: both vehicles' vehicle_radius_m and margin_m",
        ),
        (
            {"coverage": {"keep_out_m": 0.95}},
            {"coverage": {"keep_out_m": 0.94}},
            "coverage.keep_out_m = 0.94: must be at least 0.95 m: half of dbh_max_m, and 0.65 m for a vehicle",
        ),
        (
            {"forest": {"stand": None}, "coverage": {"keep_out_m": 0.65}},
            {"forest": {"stand": None}, "coverage": {"keep_out_m": 0.64}},
            "coverage.keep_out_m = 0.64: must be at least 0.65 m: vehicle_radius_m and margin_m",
        ),
        (
            {"sensing": {"margin_m": 1.2}, "stand": {"clearing_m": 1.55}},
            {"sensing": {"margin_m": 1.2}, "stand": {"clearing_m": 1.5}},
            "forest.stand.clearing_m = 1.5: must be at least 1.55 m: vehicle_radius_m and margin_m",
        ),
        (
            {"sensing": {"margin_m": 1.2}, "forest": trees_at(15.6)},
            {"sensing": {"margin_m": 1.2}, "forest": trees_at(15.3)},
            "forest.trees[0].base_enu_m = [15.3, 0.0]: stands 15.1 m from d1: must be at least 15.1 m",
        ),
        (
            {"stand": {"dbh_min_m": 0.2499}},
            {"stand": {"dbh_min_m": 0.25}},
            "forest.stand.dbh_min_m = 0.25: must be less than dbh_mean_m (forest.stand.dbh_mean_m = 0.25)",
        ),
        (
            {"stand": {"dbh_mean_m": 0.59}},
            {"stand": {"dbh_mean_m": 0.6}},
            "forest.stand.dbh_mean_m = 0.6: must be less than dbh_max_m",
        ),
        (
            {"stand": {"dbh_max_m": 1.4}},
            {"stand": {"dbh_max_m": 1.5}},
            "forest.stand.dbh_max_m = 1.5: must be less than spacing_min_m",
        ),
        (
            {"stand": {"spacing_min_m": 3.33}},
            {"stand": {"spacing_min_m": 3.34}},
            "forest.stand.spacing_min_m = 3.34: must be at most 3.33 m, or so many trees find no place",
        ),
        # 130 + 2 x 319 by 2 x 319 m are 49.0 ha
        (
            {"stand": {"margin_m": 319}},
            {"stand": {"margin_m": 330}},
            "forest.stand.density_per_ha = 400.0: makes 20856 on 52.1 ha: must be at most 20000",
        ),
        (
            {"stand": {"undergrowth_per_ha": 4000, "margin_m": 80}},
            {"stand": {"undergrowth_per_ha": 5000, "margin_m": 85}},
            "forest.stand.undergrowth_per_ha = 5000.0: makes 25500 on 5.1 ha: must be at most 20000",
        ),
        (
            {"stand": {"area_enu_m": [[0, 0], [100, 100], [100, 89.9]]}},
            {"stand": {"area_enu_m": [[0, 0], [100, 100], [95, 85.5]]}},
            "forest.stand.area_enu_m = [[0.0, 0.0], [100.0, 100.0], [95.0, 85.5]]: takes 475 m2: must be at least 5%",
        ),
        # the thinnest spruce is 8.7 m tall, its crown begins at 5.2 m; the thickest is 28 m tall
        (
            {"route": {"d2_enu_m": [130, 0, 4.8]}},
            {"route": {"d2_enu_m": [130, 0, 4.9]}},
            "route.d2_enu_m = [130.0, 0.0, 4.9]: is 4.9 m above the ground, among crowns: must be at most 4.85 m",
        ),
        (
            {"route": {"d2_enu_m": [130, 0, 9]}, "stand": {"height_mean_m": 34}},
            {"route": {"d2_enu_m": [130, 0, 11]}, "stand": {"height_mean_m": 34}},
            'forest.stand.species = ["spruce"], forest.stand.height_mean_m = 34.0)',
        ),
        (
            {"route": {"d1_enu_m": [0, 0, 29], "d2_enu_m": [130, 0, 29]}},
            {"route": {"d1_enu_m": [0, 0, 28], "d2_enu_m": [130, 0, 29]}},
            "route.d1_enu_m = [0.0, 0.0, 28.0]: is 28.0 m above the ground, among crowns",
        ),
        (
            {"forest": {"grade": [0.02, 0.0]}},
            {"forest": {"grade": [0.03, 0.0]}},
            "route.d2_enu_m = [130.0, 0.0, 4.0]: is 0.1 m above the ground there: must be more than 1 m",
        ),
        (
            {"forest": {"grade": [-0.006, 0.0]}},
            {"forest": {"grade": [-0.01, 0.0]}},
            "route.d2_enu_m = [130.0, 0.0, 4.0]: is 5.3 m above the ground, among crowns",
        ),
    ],
)
def test_a_law_holds_up_to_its_bound(good: Tables, bad: Tables, says: str) -> None:
    assert refusal(**good) == ""
    assert says in refusal(**bad)


def test_a_ring_without_sensors_keeps_the_safety_filters_margin_from_the_trunk() -> None:
    assert refusal(sensing=None, coverage={"keep_out_m": 0.6}) == ""
    assert "0.3 m for a vehicle" in refusal(sensing=None, coverage={"keep_out_m": 0.59})
    assert flight_rules.MARGIN_M == clearance.MARGIN_M
