"""The way through trees: which candidate is taken, and when none is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

from companion.core.guidance.course_planner import COURSES, FREE_BEYOND_M, VERIFIED_MAX, CoursePlanner
from companion.core.guidance.search.path_search import WIDER_M
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.bounds import Bound
from companion.core.safety.response_model import CALM, CREEP_MPS, LAG_S, ResponseModel
from companion.core.safety.safety_filter import SafetyFilter
from tests.unit.core.core_kit import mission

STOPPING = SafetyFilter.of(mission()).response
CLEAR_M = 0.65
SEEN = [False] * 72
NORTH = (3.0, 0.0)


def points_at(
    *found: tuple[float, float], blind: list[bool] | None = None, reach_m: float = 7.35
) -> LocalObstacleCloud:
    points = LocalObstacleCloud(reach_m, blind or SEEN)
    points.add_points([n for n, _ in found], [e for _, e in found], CLEAR_M)
    return points


def plan(
    points: LocalObstacleCloud,
    *,
    desired: tuple[float, float] = NORTH,
    vel: tuple[float, float] = NORTH,
    planner: CoursePlanner | None = None,
    bounds: Sequence[Bound] = (),
    reach_m: float = math.inf,
) -> tuple[float, float] | None:
    planner = planner or CoursePlanner(STOPPING)
    return planner.plan(desired, vel, vel, points, bounds, wider_m=0.0, reach_m=reach_m)


def course_of(points: LocalObstacleCloud, **changes: Any) -> tuple[float, float]:
    course = plan(points, **changes)
    assert course is not None
    return course


def wall(north_m: float, east_from_m: float, east_to_m: float) -> list[tuple[float, float]]:
    count = round((east_to_m - east_from_m) / 0.5)
    return [(north_m, east_from_m + 0.5 * k) for k in range(count + 1)]


def test_free_way_is_flown_as_wished() -> None:
    assert plan(points_at()) == pytest.approx(NORTH)
    assert plan(points_at((4.0, 3.0), (-1.0, 0.0))) == pytest.approx(NORTH)


def test_trunk_ahead_is_passed_at_full_speed_on_the_side_with_room() -> None:
    north, east = course_of(points_at((4.0, 0.4)))
    assert east < 0.0
    assert math.hypot(north, east) == pytest.approx(3.0)
    north, east = course_of(points_at((4.0, -0.4)))
    assert east > 0.0


def test_trunk_beyond_the_goal_is_not_in_the_way() -> None:
    assert plan(points_at((7.0, 0.0)), desired=(1.0, 0.0), vel=(1.0, 0.0), reach_m=3.0) == pytest.approx((1.0, 0.0))


def test_wall_ahead_is_not_flown_into() -> None:
    points = points_at(*wall(2.0, -8.0, 8.0))
    course = plan(points, vel=(0.0, 0.0))
    assert course is None or STOPPING.is_clear(points, (0.0, 0.0), (0.0, 0.0), course, 0.3, slews=True)


def test_on_a_way_that_was_found_a_gap_is_free_that_is_as_wide_as_the_search_had_it() -> None:
    """2 x (0.65 + 0.1) m are: by what a free course keeps else it would turn aside before it."""
    gap = points_at(*wall(4.0, -8.0, -0.78), *wall(4.0, 0.78, 8.0))
    planner = CoursePlanner(STOPPING)
    for beyond_m, is_through in ((FREE_BEYOND_M, False), (WIDER_M, True)):
        course = planner.plan((1.5, 0.0), (1.5, 0.0), (1.5, 0.0), gap, (), wider_m=0.0, reach_m=9.0, beyond_m=beyond_m)
        assert course is not None
        assert (abs(course[1]) < 0.2 * course[0]) is is_through
        planner.reset()


def test_boxed_in_vehicle_gets_no_course_and_tries_only_so_many() -> None:
    box = [(1.0 * math.cos(a / 4), 1.0 * math.sin(a / 4)) for a in range(25)]
    planner = CoursePlanner(STOPPING)
    assert plan(points_at(*box), planner=planner) is None
    assert planner.verified == VERIFIED_MAX


def test_side_once_taken_is_kept_before_a_trunk_dead_ahead() -> None:
    for first in (0.3, -0.3):
        planner = CoursePlanner(STOPPING)
        taken = course_of(points_at((5.0, first)), planner=planner)
        again = course_of(points_at((5.0, -first / 6)), planner=planner, vel=taken)
        assert taken[1] * again[1] > 0.0


def test_a_trunk_beside_the_way_is_passed_the_wider_the_faster() -> None:
    """By 0.05 s times the speed beyond its clearance."""
    points = points_at((2.0, CLEAR_M + 0.1))
    for mps in (1.0, 3.0):
        vel = (mps, 0.0)
        course = CoursePlanner(STOPPING).plan(vel, vel, vel, points, (), wider_m=0.0, reach_m=math.inf, beyond_m=0.0)
        assert course is not None
        assert (course == pytest.approx(vel)) is (mps == 1.0)


def test_neighbour_that_would_be_closed_on_costs_a_course() -> None:
    bound = Bound((0.0, 1.0, 0.0), -0.5)  # one to the right, too near already
    assert course_of(points_at((5.5, -0.4)))[1] > 0.0
    assert course_of(points_at((5.5, -0.4)), bounds=[bound])[1] < 0.0


def test_nothing_is_flown_into_faster_than_it_stops_within_what_is_seen() -> None:
    fast = ResponseModel(3.0, 1.8)
    for reach_m in (2.0, 4.0, 7.35):
        course = plan(points_at(reach_m=reach_m), planner=CoursePlanner(fast), vel=(0.0, 0.0), desired=(6.0, 0.0))
        assert course is not None
        assert not fast.is_clear(points_at(reach_m=reach_m), (6.0, 0.0), (6.0, 0.0), (6.0, 0.0), 0.05, slews=False)
    blind = [k > 18 and k < 54 for k in range(72)]  # behind
    course = plan(points_at(blind=blind), desired=(-3.0, 0.0), vel=(0.0, 0.0))
    assert course is None or not (course[0] < -CREEP_MPS and abs(course[1]) < abs(course[0]))


def test_way_to_stop_is_that_of_the_model_and_its_inverse() -> None:
    for speed_mps in (0.0, 0.5, 3.0, 6.0):
        assert STOPPING.speed_mps(STOPPING.way_m(speed_mps)) == pytest.approx(speed_mps)
    assert STOPPING.way_m(3.0) == pytest.approx(LAG_S * 3.0 + 9.0 / 3.6)
    assert STOPPING.speed_mps(-1.0) == 0.0


def test_point_that_is_nearer_than_allowed_may_be_left_but_not_approached() -> None:
    points = points_at((0.5, 0.0))
    rest = (0.0, 0.0)
    assert STOPPING.is_clear(points, rest, rest, (-1.0, 0.0), 0.05, slews=False)
    assert STOPPING.is_clear(points, rest, rest, (0.0, 1.0), 0.05, slews=False)
    assert not STOPPING.is_clear(points, rest, rest, (1.0, 0.0), 0.05, slews=False)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_stands_near_behind_bars_courses_to_both_sides(side: float) -> None:
    """170 degrees to one side, and nearer than it should be: courses back to the other side lead no better."""
    at = math.radians(170.0 * side)
    near = points_at((0.6 * math.cos(at), 0.6 * math.sin(at)))
    free_m = CoursePlanner(STOPPING)._free_ways(near, CALM, (0.0, 0.0), 0.0, 0.25, 8.0)
    barred = [5 * (k - COURSES) for k, room_m in enumerate(free_m) if room_m == 0.0]
    assert {-150 * side, -105 * side, 85 * side, 150 * side} <= set(barred)
    assert not set(barred) & set(range(-75, 76, 5))
