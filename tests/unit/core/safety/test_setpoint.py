"""What is cut of a desired velocity, and why: every reason, and none where it is flown as desired."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, Trunk
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.setpoint import AT_REST, CutReason
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import surroundings

OPEN = SafetyFilter.of(mission())
HIGH = Position((0.0, 0.0, -10.0), ZERO)
NORTH = (3.0, 0.0, 0.0)
OUTSIDE = replace(OPEN, polygon_m=((20.0, -30.0), (20.0, 30.0), (50.0, 30.0), (50.0, -30.0)))


def reasons(
    desired: Vec3, around: Surroundings, *, safety_filter: SafetyFilter = OPEN, dt_s: float = 9.0
) -> list[CutReason]:
    """In a tick that is long enough for any acceleration, unless given."""
    return [cut.reason for cut in safety_filter.apply(desired, around, dt_s=dt_s).cuts()]


def test_setpoint_that_is_flown_as_desired_has_no_cuts() -> None:
    assert reasons(NORTH, surroundings(HIGH)) == []
    assert AT_REST.cuts() == []


def test_each_limit_that_changes_what_is_desired_is_named() -> None:
    assert reasons((math.nan, 0.0, 0.0), surroundings(HIGH)) == [CutReason.NO_NUMBER]
    assert reasons((30.0, 0.0, 0.0), surroundings(HIGH)) == [CutReason.SPEED]
    trunk = [Trunk((3.0, 0.0, -10.0), 2.0, upright=True)]
    assert reasons(NORTH, surroundings(HIGH, trunks=trunk)) == [CutReason.LIMITS]
    assert reasons(NORTH, surroundings(HIGH, [neighbour(2, (6.0, 0.0, 0.0))])) == [CutReason.SEPARATION]
    assert reasons(NORTH, surroundings(HIGH), dt_s=0.05) == [CutReason.ACCELERATION]


def test_vehicle_outside_the_fence_is_turned_back_by_its_limits() -> None:
    assert reasons((-3.0, 0.0, 0.0), surroundings(HIGH), safety_filter=OUTSIDE)[0] is CutReason.LIMITS


def test_scanned_trunk_cuts_what_all_the_rest_lets_pass() -> None:
    points = LocalObstacleCloud(7.35, [False] * 72)
    points.add_points([1.2], [0.0], 0.65)
    sensing, around = replace(OPEN, senses=True), surroundings(HIGH, points=points)
    setpoint = sensing.apply(NORTH, around, dt_s=9.0)
    (cut,) = setpoint.cuts()
    assert cut.reason is CutReason.OBSTACLES
    assert cut.by_mps == pytest.approx(math.dist(NORTH, setpoint.vel_ned_mps))


def test_what_wind_adds_is_no_cut() -> None:
    assert reasons(NORTH, surroundings(HIGH, drift=(0.5, 0.0, 0.0))) == []
