"""The trail of breadcrumbs: what is left on the way out, and found again on the way back."""

from __future__ import annotations

import pytest

from companion.core.model.breadcrumbs import BreadcrumbTrail
from mission.common.frames import Vec3


def at(north_m: float, east_m: float = 0.0) -> Vec3:
    return (north_m, east_m, -8.0)


def trail_to(north_m: int, *, max_count: int = 100, thins: bool = False) -> BreadcrumbTrail:
    """A crumb every metre to the north, from 0."""
    trail = BreadcrumbTrail(1.0, max_count, thins=thins)
    for k in range(north_m + 1):
        trail.append(at(float(k)))
    return trail


def test_a_crumb_is_left_only_far_enough_from_the_newest() -> None:
    trail = BreadcrumbTrail(2.0, 10)
    assert trail.append(at(0.0))
    assert not trail.append(at(1.9))
    assert trail.append(at(2.0))
    assert trail.append(at(0.0))  # the newest alone counts
    assert trail.count == 3


def test_of_too_many_the_oldest_is_forgotten() -> None:
    trail = trail_to(12, max_count=5)
    assert [trail.crumb(k) for k in range(trail.count)] == [at(float(k)) for k in (12, 11, 10, 9, 8)]
    assert trail.spacing_m == 1.0


def test_one_that_thins_keeps_its_beginning_in_longer_steps() -> None:
    trail = trail_to(100, max_count=10, thins=True)
    assert trail.count <= 10
    assert trail.spacing_m == 16.0
    assert trail.crumb(trail.count - 1) == at(0.0)
    assert trail.length_m(at(100.0)) == 100.0


def test_the_newest_are_dropped() -> None:
    trail = trail_to(5)
    trail.drop(0)
    assert trail.count == 6
    trail.drop(2)
    assert trail.crumb(0) == at(3.0)
    trail.drop(4)
    assert trail.count == 0


def test_a_loop_is_dropped_to_where_the_way_first_came_as_near() -> None:
    trail = BreadcrumbTrail(1.0, 100)
    for place in (at(0.0), at(10.0), at(20.0), at(20.0, 10.0), at(10.0, 10.0), at(10.0, 1.0)):
        trail.append(place)
    trail.drop_loops(at(10.0, 1.0), 2.0)
    assert trail.count == 2
    assert trail.crumb(0) == at(10.0)


def test_nearest_of_the_newest() -> None:
    trail = trail_to(9)
    assert trail.nearest(at(7.0, 0.5), 4) == (2, 0.5)
    assert trail.nearest(at(3.0), 4) == (3, 3.0)  # older ones are not looked at


def test_reached_counts_up_to_the_oldest_that_is_near() -> None:
    trail = trail_to(9)
    assert trail.reached(at(7.2), 1.0, 6) == 3  # 9, 8 and 7 are passed; 6 is too far
    assert trail.reached(at(7.2), 1.0, 1) == 0
    assert trail.reached(at(7.0), 0.0, 6) == 3


def test_the_way_back_is_counted_from_here() -> None:
    trail = trail_to(9)
    assert trail.count_within(at(9.0, 0.5), 0.4) == 0
    assert trail.count_within(at(9.0), 3.0) == 4
    assert trail.count_within(at(9.0), 99.0) == 10
    assert trail.length_m(at(9.0, 2.0)) == pytest.approx(11.0)


def test_an_empty_trail_has_nothing() -> None:
    trail = BreadcrumbTrail(1.0, 10)
    trail.drop_loops(at(0.0), 1.0)
    assert trail.nearest(at(0.0), 8) is None
    assert trail.reached(at(0.0), 9.0, 8) == 0
    assert trail.count_within(at(0.0), 9.0) == 0
    assert trail.length_m(at(0.0)) == 0.0
