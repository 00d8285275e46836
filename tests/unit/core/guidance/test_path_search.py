"""A way out, searched over all that was seen: round what bars the straight one, and none where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import pytest

from companion.core.guidance.dead_end_recovery import PATIENCE_S, SEARCH_MAX_S, WAY_MPS, DeadEndRecovery
from companion.core.guidance.search import path_search
from companion.core.guidance.search.known_places import KnownPlaces
from companion.core.perception.obstacle_memory import SeenBefore

CLEAR_M = 0.65
NORTH = (3.0, 0.0)
Points = list[tuple[float, float]]


def find_way(
    points: SeenBefore,
    target: tuple[float, float],
    known: Sequence[tuple[float, float, float]] = (),
    fence: Sequence[tuple[float, float]] = (),
) -> tuple[float, float] | None:
    """The direction in which it begins."""
    way = path_search.find_way(points, target, KnownPlaces(known, fence))
    if way is None:
        return None
    away_m = math.hypot(*way.aim)
    return way.aim[0] / away_m, way.aim[1] / away_m


def seen(points: Points, here: tuple[float, float] = (0.0, 0.0)) -> SeenBefore:
    return SeenBefore([n for n, _ in points], [e for _, e in points], here, CLEAR_M)


def pocket(depth_m: float = 6.0, half_m: float = 3.0) -> Points:
    """A U of trunks, open to the south, whose end is 4 m north."""
    across = [(4.0, 0.5 * k) for k in range(round(-half_m / 0.5), round(half_m / 0.5) + 1)]
    along = [(4.0 - 0.5 * k, side) for k in range(round(depth_m / 0.5)) for side in (-half_m, half_m)]
    return across + along


def follow(points: Points, start: tuple[float, float], target: tuple[float, float], step_m: float = 0.3) -> Points:
    """The way that a point flies which searches anew at each step, and sees all from the start."""
    way, at = [start], start
    for _ in range(400):
        to = (target[0] - at[0], target[1] - at[1])
        if math.hypot(*to) < 3.0:
            return way
        along = find_way(seen(points, at), to)
        assert along is not None
        at = (at[0] + step_m * along[0], at[1] + step_m * along[1])
        way.append(at)
    raise AssertionError("it never came")


def test_straight_on_where_nothing_stands() -> None:
    along = find_way(seen([]), (20.0, 0.0))
    assert along == pytest.approx((1.0, 0.0))


def test_out_of_a_pocket_backwards_and_round_it() -> None:
    way = follow(pocket(), (0.0, 0.0), (15.0, 0.0))
    assert min(n for n, _ in way) < -2.0  # first back, out of it
    nearest_m = min(math.dist(at, trunk) for at in way for trunk in pocket())
    assert nearest_m > CLEAR_M - 0.3  # a cell's rounding: each setpoint is verified besides
    flown_m = sum(math.dist(a, b) for a, b in pairwise(way))
    assert flown_m < 1.3 * 29.0


def test_no_way_out_of_a_closed_ring() -> None:
    ring = [(2.0 * math.cos(k * math.tau / 40), 2.0 * math.sin(k * math.tau / 40)) for k in range(40)]
    assert find_way(seen(ring), (20.0, 0.0)) is None


def test_a_gap_that_is_too_narrow_is_no_way() -> None:
    wall = [(4.0, 0.3 * k) for k in range(-60, 61) if abs(0.3 * k) > 0.5]
    along = find_way(seen(wall), (20.0, 0.0))
    assert along is None or abs(along[1]) > 0.5  # along the wall, and not through it
    wide = [(4.0, 0.3 * k) for k in range(-60, 61) if abs(0.3 * k) > 1.2]
    through = find_way(seen(wide), (20.0, 0.0))
    assert through is not None
    assert through[0] > 0.9


@pytest.mark.parametrize("width_m", [1.5, 1.7, 1.9])
def test_gap_is_a_way_or_none_from_wherever_the_vehicle_is(width_m: float) -> None:
    """Cells that moved along with it made a gap a way, and none half a second later."""
    wall = [(4.0, side * (width_m / 2.0 + 0.2 * k)) for k in range(80) for side in (-1.0, 1.0)]
    through = set()
    for k in range(25):
        here = (0.1 * (k // 5), 0.1 * (k % 5))
        along = find_way(seen(wall, here), (20.0 - here[0], -here[1]))
        through.add(along is not None and along[0] > 0.9)
    assert len(through) == 1


def test_one_that_stands_within_what_should_be_kept_finds_out() -> None:
    along = find_way(seen([(0.3, 0.0)]), (-10.0, 0.0))
    assert along is not None
    assert along[0] < -0.5


def test_a_way_leads_round_vehicles_that_hover_unseen() -> None:
    """Two that were killed at their take-off, 9.5 m apart, bar the straight way between them."""
    known = [(6.0, -4.7, 6.2), (6.0, 4.8, 6.2)]
    straight = find_way(seen([]), (20.0, 0.0))
    along = find_way(seen([]), (20.0, 0.0), known)
    assert straight is not None
    assert along is not None
    assert straight[0] > 0.9
    assert abs(along[1]) > 0.5


def test_one_that_is_too_near_to_a_vehicle_that_hovers_comes_no_nearer() -> None:
    along = find_way(seen([]), (-20.0, 0.0), [(4.0, 0.0, 6.2)])
    assert along == pytest.approx((-1.0, 0.0))
    past = find_way(seen([]), (20.0, 0.0), [(4.0, 0.0, 6.2)])
    assert past is not None
    assert abs(past[1]) > 0.7


def stuck(points: Points | None) -> tuple[DeadEndRecovery, tuple[float, float]]:
    recovery, said = DeadEndRecovery(), NORTH
    for _ in range(round((PATIENCE_S + 0.5) / 0.1)):
        said = recovery.redirect(NORTH, (0.0, 0.0), 1, 1.0, 0.1, None if points is None else seen(points))
    return recovery, said


def test_a_vehicle_that_is_stuck_flies_the_way_that_was_found() -> None:
    _, said = stuck(pocket())
    assert said[0] < -1.0
    assert math.hypot(*said) == pytest.approx(WAY_MPS)


def test_without_a_way_it_goes_to_its_side_as_ever() -> None:
    ring = [(2.0 * math.cos(k * math.tau / 40), 2.0 * math.sin(k * math.tau / 40)) for k in range(40)]
    for points in (ring, None):
        _, said = stuck(points)
        assert said[1] > 2.0


def test_it_flies_as_desired_again_when_it_has_got_past() -> None:
    recovery, said = stuck(pocket())
    for k in range(80):
        said = recovery.redirect(NORTH, (0.1 * k, 0.0), 1, 8.0, 0.1, seen([], (0.1 * k, 0.0)))
    assert said == NORTH


def test_a_way_is_not_flown_for_ever() -> None:
    recovery, said = stuck(pocket())
    for _ in range(round(SEARCH_MAX_S / 0.1) + 2):
        said = recovery.redirect(NORTH, (0.0, 0.0), 1, 1.0, 0.1, seen(pocket()))
    assert said[1] > 2.0  # to its side: what bars it is not among what was seen


def box(south: float, west: float, north: float, east: float, turned_rad: float = 0.0) -> Points:
    """A fence, turned about the vehicle."""
    cos, sin = math.cos(turned_rad), math.sin(turned_rad)
    corners = [(south, west), (south, east), (north, east), (north, west)]
    return [(cos * n - sin * e, sin * n + cos * e) for n, e in corners]


@pytest.mark.parametrize("turned_deg", [0.0, 10.0, 45.0])
def test_no_way_leads_over_the_fence(turned_deg: float) -> None:
    """A wall from the fence in the west to 9 m east: round its western end there is nothing but the fence."""
    turned_rad = math.radians(turned_deg)
    cos, sin = math.cos(turned_rad), math.sin(turned_rad)
    wall = [(cos * 4.0 - sin * e, sin * 4.0 + cos * e) for e in (0.4 * k - 2.2 for k in range(29))]
    target = (20.0 * cos, 20.0 * sin)
    west = find_way(seen(wall), target)
    east = find_way(seen(wall), target, fence=box(-20.0, -2.4, 30.0, 22.0, turned_rad))
    assert west is not None
    assert east is not None
    assert cos * west[1] - sin * west[0] < -0.3
    assert cos * east[1] - sin * east[0] > 0.3


def test_a_target_beyond_the_fence_is_before_it() -> None:
    fence = box(-20.0, -20.0, 8.0, 20.0)
    assert KnownPlaces((), fence).end_before((20.0, 0.0)) == pytest.approx((6.5, 0.0))
    assert KnownPlaces((), fence).end_before((4.0, 3.0)) == (4.0, 3.0)
    assert find_way(seen([]), (20.0, 0.0), fence=fence) == pytest.approx((1.0, 0.0))


def test_one_that_is_outside_of_the_fence_may_come_back() -> None:
    fence = box(1.0, -10.0, 25.0, 10.0)  # before it there would be no way
    assert KnownPlaces((), fence).end_before((15.0, 0.0)) == (15.0, 0.0)
    assert find_way(seen([]), (15.0, 0.0), fence=fence) == pytest.approx((1.0, 0.0))
