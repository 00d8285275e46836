"""The safety filter among trunks, case by case. Over all inputs: tests/property/test_core_trees.py."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.response_model import DEAD_S, SPEED_MARGIN_S
from companion.core.safety.safety_filter import AGAINST, SafetyFilter
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import applied

OPEN = SafetyFilter.of(mission())
# north of the vehicle its edge, as near as the safety filter allows
FENCED = replace(OPEN, polygon_m=((0.3, -30.0), (0.3, 30.0), (-30.0, 30.0), (-30.0, -30.0)))
CLEAR_M, DT_S = 0.65, 0.05
KEPT_M = CLEAR_M + SPEED_MARGIN_S * 2.0  # at 2 m/s


def apply(
    wanted_mps: float, trunk_m: float, *, vel_mps: float, drift_mps: float = 0.0, safety_filter: SafetyFilter = OPEN
) -> Vec3:
    """North and south alone: so much is flown and has been told, and a trunk stands so far off."""
    points = LocalObstacleCloud(7.35, [False] * 72)
    points.add_points([trunk_m], [0.0], CLEAR_M)
    own = Position((0.0, 0.0, -8.0), (vel_mps, 0.0, 0.0))
    return applied(
        safety_filter,
        (wanted_mps, 0.0, 0.0),
        (vel_mps - drift_mps, 0.0, 0.0),
        own,
        [],
        [],
        dt_s=DT_S,
        drift=(drift_mps, 0.0, 0.0),
        points=points,
    )


def way_m(told_mps: float, vel_mps: float = 2.0) -> float:
    """At most: through the dead time and the tick, then to a stop."""
    change = (vel_mps - told_mps) * -math.expm1(-DT_S / 0.3)
    return vel_mps * (DEAD_S + DT_S) + OPEN.response.way_m(vel_mps - min(change, 3.0 * DT_S))


def test_where_the_whole_of_a_setpoint_leads_too_near_half_of_it_is_told() -> None:
    assert apply(2.0, KEPT_M + way_m(2.0) + 0.01, vel_mps=2.0) == pytest.approx((2.0, 0.0, 0.0))
    assert apply(2.0, KEPT_M + way_m(1.0) + 0.01, vel_mps=2.0) == pytest.approx((1.0, 0.0, 0.0))
    assert apply(2.0, KEPT_M + way_m(1.0) - 0.15, vel_mps=2.0)[0] <= 0.0


@pytest.mark.parametrize(("aside_m", "passes"), [(CLEAR_M + 0.10, False), (CLEAR_M + 0.16, True)])
def test_a_trunk_is_passed_the_wider_the_faster(aside_m: float, passes: bool) -> None:
    """At 3 m/s by 0.15 m more: a velocity that is known wrong, or a turn that is late, leads so far aside."""
    for mps, clear in ((3.0, passes), (1.0, True)):
        points, own = LocalObstacleCloud(7.35, [False] * 72), Position((0.0, 0.0, -8.0), (mps, 0.0, 0.0))
        points.add_points([2.0], [aside_m], CLEAR_M)
        flown = applied(OPEN, (mps, 0.0, 0.0), (mps, 0.0, 0.0), own, [], [], dt_s=DT_S, points=points)
        assert (flown == pytest.approx((mps, 0.0, 0.0))) is clear


def test_what_the_wind_adds_counts_in_what_a_setpoint_leads_to() -> None:
    """Told 1 m/s it flies 2, told 0.5 it flies 1.5."""
    assert apply(2.0, KEPT_M + way_m(2.0) + 0.01, vel_mps=2.0, drift_mps=1.0) == pytest.approx((1.0, 0.0, 0.0))
    assert apply(2.0, KEPT_M + way_m(1.5) + 0.01, vel_mps=2.0, drift_mps=1.0) == pytest.approx((0.5, 0.0, 0.0))


def test_vehicle_that_comes_too_near_brakes_harder_than_rest_but_not_out_of_the_fence() -> None:
    assert apply(0.0, -0.8, vel_mps=-1.0) == pytest.approx((AGAINST * 1.0, 0.0, 0.0))
    assert apply(0.0, -0.8, vel_mps=-1.0, safety_filter=FENCED) == ZERO


def test_vehicle_at_the_ceiling_gets_away_from_a_trunk_though_what_it_is_told_of_its_climb_is_off_by_millimetres() -> (
    None
):
    points = LocalObstacleCloud(7.35, [False] * 72)
    points.add_points([0.5], [0.0], CLEAR_M)
    own = Position((0.0, 0.0, -OPEN.altitude_max_m), (0.6, 0.0, 0.0))
    drift = (0.0, 0.0, 0.003)  # so rest, as it is told, climbs by as much
    told = applied(OPEN, ZERO, ZERO, own, [], [], dt_s=DT_S, drift=drift, points=points)
    assert told[0] < -0.1  # against what it flies


def test_vehicle_that_finds_no_way_on_keeps_its_height() -> None:
    """As in a stem map: one rose for 7 s by what its velocity was wrong, and touched a crown 0.2 m above its height."""
    points = LocalObstacleCloud(7.35, [False] * 72)
    points.add_points([0.5, 0.0, -0.5], [0.2, 0.5, 0.2], CLEAR_M)
    own = Position((0.0, 0.0, -8.0), (0.6, 0.3, 0.0))
    drift = (0.0, 0.0, -0.03)  # it rises by so much where it is told rest
    told = ZERO
    for _ in range(20):
        told = applied(OPEN, (0.0, 0.0, 0.1), told, own, [], [], dt_s=DT_S, drift=drift, points=points)
    assert told[2] == pytest.approx(0.1 + 0.03, abs=0.01)
