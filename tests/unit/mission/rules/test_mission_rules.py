"""Missions that cannot fly are refused: the laws between the fields, and what they rest on in the companion."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from companion.core.guidance import coverage, formation
from companion.core.safety import clearance
from companion.core.swarm import phases
from companion.mavlink.makes import MAKES
from mission.common.problems import MissionError
from mission.document.model import Mission
from mission.rules import fence_rules, flight_rules

Tables = dict[str, dict[str, Any]]


def tables(**changes: dict[str, Any]) -> dict[str, Any]:
    route = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3, **changes.pop("route", {})}
    return {"schema": 1, "route": route, **changes}


def refused(**changes: dict[str, Any]) -> str:
    with pytest.raises(ValidationError) as caught:
        Mission.model_validate(tables(**changes))
    return str(caught.value)


def flies(**changes: dict[str, Any]) -> bool:
    return Mission.model_validate(tables(**changes)) is not None


def chord(spacing_m: float, n: int = 8) -> float:
    """The radius of a ring of `n`, `spacing_m` apart."""
    return spacing_m / (2.0 * math.sin(math.pi / n))


# What the laws rest on


def test_the_laws_know_what_the_companion_does() -> None:
    assert flight_rules.FULL_SPEED_SHARE == formation.GOVERNOR_FULL
    assert flight_rules.STOP_SHARE == phases.STOP_SHARE
    assert flight_rules.MARGIN_M == clearance.MARGIN_M
    assert {make.traits.climb_short_m for make in MAKES.values()} == {fence_rules.TAKEOFF_SHORT_M}
    assert flight_rules.SPREAD_MPS == coverage.SPREAD_LIMIT_MPS


def test_a_swarm_that_keeps_soft_apart_does_not_slow_its_leader_down() -> None:
    apart = formation.Route(1.0, 1, flight_rules.FULL_SPEED_SHARE * 30.0, ())

    assert formation.governor(apart, [], range_m=30.0) == pytest.approx(1.0)


# Each law, on both sides of its bound


@pytest.mark.parametrize(
    ("good", "bad", "says"),
    [
        (
            {"separation": {"soft_m": 21.0}},
            {"separation": {"soft_m": 21.1}},
            "separation.soft_m = 21.1: must be at most 21.00 m, 70% of the range",
        ),
        (
            {"coverage": {"keep_out_m": 3.7}},
            {"coverage": {"keep_out_m": 3.71}},
            "coverage.keep_out_m = 3.71: must be at most 3.70 m: the leader comes to rest 0.8 of arrival_distance_m",
        ),
        (
            {"route": {"d2_enu_m": [130, 0, 30]}, "coverage": {"shape": "sphere"}, "fence": {"altitude_max_m": 45.3}},
            {"route": {"d2_enu_m": [130, 0, 30]}, "coverage": {"shape": "sphere"}, "fence": {"altitude_max_m": 45.2}},
            "coverage.radius_m = 15.0: reaches from 15.0 to 45.0 m: must be inside the fence, 0.3 m from each altitude",
        ),
        (
            {"route": {"d1_enu_m": [0, 0, 2.3]}},
            {"route": {"d1_enu_m": [0, 0, 2.2]}},
            "route.d1_enu_m = [0.0, 0.0, 2.2]: must be inside the fence's altitudes, 0.3 m from each",
        ),
        (
            {"route": {"d2_enu_m": [130, 0, 29.7]}},
            {"route": {"d2_enu_m": [130, 0, 29.8]}},
            "route.d2_enu_m = [130.0, 0.0, 29.8]: must be inside the fence's altitudes, 0.3 m from each",
        ),
        (
            {"route": {"d1_enu_m": [0, 0, 1.1]}, "fence": {"altitude_min_m": 0.0}},
            {"route": {"d1_enu_m": [0, 0, 1]}, "fence": {"altitude_min_m": 0.0}},
            "route.d1_enu_m = [0.0, 0.0, 1.0]: must be more than 1 m up: a take-off may end that far below",
        ),
        (
            {"fence": {"altitude_min_m": 7.5, "altitude_max_m": 8.5}},
            {"fence": {"altitude_min_m": 7.8, "altitude_max_m": 8.3}},
            "fence.altitude_min_m = 7.8: must be at least 0.6 m below altitude_max_m",
        ),
        (
            {"coverage": {"radius_m": chord(5.81)}},
            {"coverage": {"radius_m": chord(5.79)}},
            "leaves 5.79 m between neighbours: must leave at least hard_m and 0.8 m",
        ),
        (
            {"coverage": {"radius_m": chord(52.9), "duration_s": 300.0}},
            {"coverage": {"radius_m": chord(53.1), "duration_s": 300.0}},
            "puts neighbours 53.10 m apart: must be at most full_range_m less 2 m",
        ),
        (
            {"swarm": {"size": 12}, "radio": {"full_range_m": 56.0}, "coverage": {"radius_m": 100, "duration_s": 236}},
            {"swarm": {"size": 12}, "radio": {"full_range_m": 56.0}, "coverage": {"radius_m": 100, "duration_s": 235}},
            "coverage.duration_s = 235.0: must be at least 236 s for a ring wider than full_range_m, or 0 for no cover",
        ),
        (
            {"coverage": {"radius_m": 27.5, "duration_s": 1.0}},
            {"coverage": {"radius_m": 27.6, "duration_s": 1.0}},
            "coverage.duration_s = 1.0: must be at least 66 s for a ring wider than full_range_m",
        ),
        (
            {"coverage": {"radius_m": 40.0, "duration_s": 0.0}},
            {"coverage": {"radius_m": 40.0, "duration_s": 0.1}},
            "coverage.duration_s = 0.1: must be at least 95 s for a ring wider than full_range_m",
        ),
        (
            {"separation": {"hard_m": 5.7}},
            {"separation": {"hard_m": 5.71}},
            "separation.hard_m = 5.71: must be at most placement_spacing_m less 0.3 m",
        ),
        (
            {"sim": {"placement_spacing_m": 14.0}},
            {"sim": {"placement_spacing_m": 14.1}},
            "sim.placement_spacing_m = 14.1: must be at most transit_range_m less 2 m, and half of that for random",
        ),
        (
            {"sim": {"placement_spacing_m": 28.0, "placement": "grid"}},
            {"sim": {"placement_spacing_m": 28.1, "placement": "grid"}},
            "sim.placement_spacing_m = 28.1: must be at most transit_range_m less 2 m",
        ),
        (
            {"route": {"d2_enu_m": [16, 0, 8]}},
            {"route": {"d2_enu_m": [15.8, 0, 8]}},
            "is 15.8 m from the trunk at d2: must be at least 15.9 m, for starting points outside keep_out_m",
        ),
        (
            {"sim": {"time_limit_s": 99.0}},
            {"sim": {"time_limit_s": 98.0}},
            "sim.time_limit_s = 98.0: must be above 98.3 s, which the way and the coverage take by themselves",
        ),
        (
            {"sim": {"time_limit_s": 137.0}, "route": {"at_end": "return"}},
            {"sim": {"time_limit_s": 136.0}, "route": {"at_end": "return"}},
            "sim.time_limit_s = 136.0: must be above 136.7 s",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_mission_flies_up_to_the_bound_and_is_refused_beyond(good: Tables, bad: Tables, says: str) -> None:
    assert flies(**good)
    assert says in refused(**bad)


def test_a_sphere_may_hang_above_the_starting_points_but_no_ring_stands_among_them() -> None:
    above = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [0, 0, 60], "vel_leader_mps": 1}
    fence = {"altitude_max_m": 90}

    assert flies(route=above, fence=fence, coverage={"shape": "sphere"})
    assert "is 0.0 m from the trunk at d2" in refused(route=above, fence=fence)


def test_a_fence_must_leave_slack_beside_the_way() -> None:
    """A notch that ends 3 m beside the straight way."""

    def notched(depth_m: float) -> list[list[float]]:
        return [[-40, -50], [65, -50], [65, -depth_m], [70, -depth_m], [70, -50], [170, -50], [170, 50], [-40, 50]]

    assert flies(fence={"polygon_enu_m": notched(5.1)})
    assert "must hold the straight way d1 to d2, with 5 m of slack" in refused(fence={"polygon_enu_m": notched(3.0)})


# Tables by vehicle


@pytest.mark.parametrize("table", ["personalities", "battery_mah"])
def test_a_vehicle_named_twice_is_refused_with_both_keys(table: str) -> None:
    value: dict[str, Any] = {"personalities": "px4", "battery_mah": 1000.0}
    twice = {"3": value[table], "1": value[table], "03": value[table]}

    assert "must name each vehicle once: 3 and 03 are the same" in refused(sim={table: twice})
    assert flies(sim={table: {"03": value[table], "1": value[table]}})


def test_a_copy_keeps_its_tables_by_vehicle() -> None:
    mixed = Mission.model_validate(tables(sim={"personalities": {"03": "ardupilot"}, "battery_mah": {"3": 900.0}}))

    assert mixed.with_seed(2).sim.personalities == {3: "ardupilot"}
    with pytest.raises(MissionError):
        mixed.with_seed(-1)


def test_a_wide_sphere_and_a_vehicle_alone_on_a_wide_ring_need_no_longer_time() -> None:
    wide = {"radius_m": 40.0, "duration_s": 10.0}
    high = {"route": {"d1_enu_m": [0, 0, 60], "d2_enu_m": [130, 0, 60]}, "fence": {"altitude_max_m": 110.0}}
    assert flies(coverage={**wide, "shape": "sphere"}, **high)
    assert flies(coverage=wide, swarm={"size": 1})
