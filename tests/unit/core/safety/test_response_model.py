"""Where a velocity leads until the vehicle is at rest: every part of the way counts, and what gusts add to it."""

from __future__ import annotations

import math

import pytest

from companion.core.perception.obstacle_cloud import PUSH_PER_S, LocalObstacleCloud
from companion.core.safety.response_model import CREEP_MPS, DEAD_S, GUST_SHARE, LAG_S, Disturbance, ResponseModel

STOPPING = ResponseModel(3.0, 1.8)
GUSTS = Disturbance(change_mps=0.5 / GUST_SHARE)
SEEN = [False] * 72
FINE_S = 0.001
Level = tuple[float, float]


def points_at(*found: Level, clear_m: float = 0.2) -> LocalObstacleCloud:
    points = LocalObstacleCloud(20.0, SEEN)
    points.add_points([n for n, _ in found], [e for _, e in found], clear_m)
    return points


def flown(vel: Level, told: Level, hold_s: float) -> list[Level]:
    """The model of the module's text in fine steps: a place for each, the way to a stop not among them."""
    (u_n, u_e), places, n, e = vel, [], 0.0, 0.0
    for k in range(round((DEAD_S + hold_s) / FINE_S)):
        s_n, s_e = vel if k * FINE_S < DEAD_S else told
        a_n, a_e = (s_n - u_n) / LAG_S, (s_e - u_e) / LAG_S
        cut = min(1.0, STOPPING.acceleration_mps2 / max(math.hypot(a_n, a_e), 1e-9))
        u_n, u_e = u_n + cut * a_n * FINE_S, u_e + cut * a_e * FINE_S
        n, e = n + u_n * FINE_S, e + u_e * FINE_S
        places.append((n, e))
    return [*places, (n + 0.5 * u_n, e + 0.5 * u_e)]  # and one well within the way to a stop


@pytest.mark.parametrize("told", [(3.0, 0.0), (2.0, 2.0), (0.0, -3.0)])
@pytest.mark.parametrize("at_s", [0.1, 0.3, 9.9])
def test_no_part_of_the_way_may_lead_too_near_to_a_point(told: Level, at_s: float) -> None:
    way = flown((3.0, 0.0), told, 0.3)
    on_it = way[min(round(at_s / FINE_S), len(way) - 1)]
    assert not STOPPING.is_clear(points_at(on_it), (3.0, 0.0), (3.0, 0.0), told, 0.3, slews=False)
    assert STOPPING.is_clear(points_at((on_it[0], 4.0)), (3.0, 0.0), (3.0, 0.0), told, 0.3, slews=False)


def test_vehicle_goes_on_as_it_was_told_for_the_dead_time() -> None:
    """Told to rest at 3 m/s, it comes as far as in the dead time and from 2.85 m/s, a tick later, on."""
    least_m = 3.0 * DEAD_S + STOPPING.way_m(2.85)
    way = (3.0, 0.0), (3.0, 0.0), (0.0, 0.0), 0.05
    assert not STOPPING.is_clear(points_at((least_m + 0.2, 0.0)), *way, slews=False)
    assert STOPPING.is_clear(points_at((least_m + 0.4, 0.0)), *way, slews=False)


def test_gust_makes_the_way_to_a_stop_longer_but_not_that_of_a_vehicle_that_creeps() -> None:
    far_m = 3.0 * DEAD_S + 3.0 * 0.05 + STOPPING.way_m(3.0) + 0.25
    way = (3.0, 0.0), (3.0, 0.0), (3.0, 0.0), 0.05
    assert STOPPING.is_clear(points_at((far_m, 0.0)), *way, slews=False)
    assert not STOPPING.is_clear(points_at((far_m, 0.0)), *way, slews=False, disturbance=GUSTS)
    creep = (CREEP_MPS, 0.0), (CREEP_MPS, 0.0), (CREEP_MPS, 0.0), 0.05
    assert STOPPING.is_clear(points_at((0.5, 0.0)), *creep, slews=False, disturbance=GUSTS)


def test_vehicle_is_pushed_away_from_what_is_too_near_and_no_faster_than_allowed() -> None:
    assert points_at((1.0, 0.0), clear_m=0.8).push_away(0.0, 1.0) == (0.0, 0.0)
    assert points_at((1.0, 0.0), clear_m=0.8).push_away(0.4, 1.0) == pytest.approx((-0.2 * PUSH_PER_S, 0.0))
    assert points_at((0.0, -1.0), clear_m=1.3).push_away(0.0, 1.0) == pytest.approx((0.0, 0.3 * PUSH_PER_S))
    assert math.hypot(*points_at((0.3, 0.4), clear_m=5.0).push_away(0.0, 0.8)) == pytest.approx(0.8)
