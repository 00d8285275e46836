"""Laws that pass trees in place of ours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from sim_bridge.lab.laws import heading_scan, potential_field
from sim_bridge.lab.study.law import law_module
from tests.unit.core.core_kit import mission, neighbour

HERE = Position((0.0, 0.0, -4.0), ZERO)
NORTH = (3.0, 0.0, 0.0)
NOTHING = np.zeros((0, 2))
SEEING = mission(sensing={}, route={"d1_enu_m": (0, 0, 4), "d2_enu_m": (60, 0, 4)})


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
