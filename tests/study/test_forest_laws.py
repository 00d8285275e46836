"""Laws that pass trees in place of ours, and what they are tuned for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from core_kit import mission, neighbour

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from sim_bridge.lab.laws import heading_scan, potential_field, tune_forest
from sim_bridge.lab.study.forest.figures import Figures
from sim_bridge.lab.study.law import law_module

HERE = Position((0.0, 0.0, -4.0), ZERO)
NORTH = (3.0, 0.0, 0.0)
NOTHING = np.zeros((0, 2))
SEEING = mission(sensing={}, route={"d1_enu_m": (0, 0, 4), "d2_enu_m": (60, 0, 4)})
FIGURES = Figures(
    arrived=True,
    alone_s=20.0,
    straight_time_s=19.0,
    arrival_leader_s=21.0,
    arrival_last_s=22.0,
    overhead_leader=0.1,
    overhead_last=0.15,
    over_alone_leader=0.05,
    over_alone_last=0.1,
    contacts=0,
    contacts_trunks=0,
    contacts_vehicles=0,
    contacts_crowns=0,
    contacts_ground=0,
    lost=0,
    min_separation_m=6.0,
    trunk_clearance_min_m=0.7,
    connected_fraction_transit=1.0,
    connected_disc=1.0,
    connected_attenuated=1.0,
    connected_cut=1.0,
    longest_gap_s=0.0,
    speed_mean_transit_mps=2.9,
    speed_max_mps=3.3,
    acceleration_mean_mps2=0.5,
    acting_leaders_max=1,
    leader_changes=0,
    coverage_gap_deg=None,
    coverage_gap_ideal_deg=None,
    sim_time_s=40.0,
    vehicle_s=160.0,
)


@pytest.mark.parametrize("name", ["heading-scan", "potential-field"])
def test_in_the_open_what_is_wanted_is_flown(name: str) -> None:
    module = law_module(name)
    law = module.stage(SEEING, module.Params())
    assert law.velocity(NORTH, HERE, [], NOTHING, 0.0) == pytest.approx(NORTH)


def test_a_heading_goes_as_far_as_the_first_point_lets_it() -> None:
    points = np.array([[5.0, 0.5], [7.0, 0.0], [3.0, 4.0]])
    free_m = heading_scan.free_along(points, np.array([0.0, math.pi]), 0.85, 10.0)
    assert free_m == pytest.approx([5.0 - math.sqrt(0.85**2 - 0.5**2), 10.0])


def test_heading_scan_turns_away_from_a_trunk_ahead_and_stays_on_that_side() -> None:
    law = heading_scan.stage(SEEING, heading_scan.Params())
    right_of_it = law.velocity(NORTH, HERE, [], np.array([[4.0, -0.3]]), 0.0)
    assert right_of_it[1] > 0.3
    assert law.velocity(NORTH, HERE, [], np.array([[4.0, 0.02]]), 0.1)[1] > 0.0


def test_heading_scan_never_closes_on_bark_faster_than_it_can_stop() -> None:
    law = heading_scan.stage(SEEING, heading_scan.Params())
    wall = np.array([[1.5, 0.1 * k] for k in range(-60, 61)])
    assert law.velocity(NORTH, HERE, [], wall, 0.0)[0] <= heading_scan.braking_mps(1.5 - 0.85) + 0.01


def test_heading_scan_keeps_its_distance_from_neighbours() -> None:
    law = heading_scan.stage(SEEING, heading_scan.Params())
    v = law.velocity(NORTH, HERE, [neighbour(2, (4.0, 0.0, 0.0))], NOTHING, 0.0)
    assert v[0] < 0.0


def test_potential_field_pushes_from_the_nearest_point_of_each_obstacle_alone() -> None:
    law = potential_field.stage(SEEING, potential_field.Params(eta=1.0, rho0_m=3.0))
    rho_m = 2.0 - 0.35
    push = (1.0 / rho_m - 1.0 / 3.0) / rho_m**2
    trunk = np.array([[0.0, 2.0], [0.1, 2.2], [-0.1, 2.2]])
    assert law.velocity(NORTH, HERE, [], trunk, 0.0) == pytest.approx((3.0, -push, 0.0))
    assert law.velocity(NORTH, HERE, [], np.array([[0.0, 3.4]]), 0.0) == NORTH


def test_two_obstacles_have_two_nearest_points() -> None:
    points = np.array([[5.0, 0.0], [5.5, 0.1], [0.0, -3.0], [0.1, -3.2]])
    assert sorted(potential_field.nearest_points(points).tolist()) == [[0.0, -3.0], [5.0, 0.0]]


@pytest.mark.parametrize(
    ("changes", "cost"),
    [
        ({}, 0.15),
        ({"arrived": False}, 1.05),
        ({"acceleration_mean_mps2": 2.5}, 0.35),
        ({"min_separation_m": 5.0}, 0.25),
        ({"connected_fraction_transit": 0.99}, 0.25),
        ({"contacts": 2}, 2.15),
    ],
)
def test_the_objective_weighs_time_effort_separation_links_and_contacts(changes: dict[str, float], cost: float) -> None:
    assert tune_forest.objective(replace(FIGURES, **changes)) == pytest.approx(cost)  # type: ignore[arg-type]


def test_laws_are_tuned_on_other_seeds_than_they_are_judged_on() -> None:
    assert max(tune_forest.TRAINING) <= 199
    assert min(tune_forest.HELD_OUT) >= 1000


def test_tuning_finds_the_least_of_a_simple_cost() -> None:
    best = tune_forest.search({"a": 1.0, "b": 1.0}, lambda v: (v["a"] - 2.0) ** 2 + (v["b"] - 0.5) ** 2, 120, 6)
    assert best["a"] == pytest.approx(2.0, rel=0.1)
    assert best["b"] == pytest.approx(0.5, rel=0.2)
