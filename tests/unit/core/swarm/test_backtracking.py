"""The way back of a leader that does not know where it is: its own, without loops, to where it began."""

from __future__ import annotations

import math

import pytest

from companion.core.model.vectors import add, norm, scale, sub
from companion.core.swarm.backtracking import AHEAD_M, KEPT, STEP_M, Backtracking
from mission.common.frames import Vec3

UP = -8.0


def flown(*corners: tuple[float, float]) -> Backtracking:
    """A vehicle that has gone from corner to corner, in steps of 0.2 m."""
    way = Backtracking()
    here = (*corners[0], UP)
    way.record_position(here)
    for corner in corners[1:]:
        leg = sub((*corner, UP), here)
        for k in range(1, math.ceil(norm(leg) / 0.2) + 1):
            way.record_position(add(here, scale(leg, min(1.0, 0.2 * k / norm(leg)))))
        here = (*corner, UP)
    return way


def fly_back(way: Backtracking, start: tuple[float, float], limit_m: float, step_m: float = 0.3) -> list[Vec3]:
    """The places that a vehicle comes by that flies straight to what it is told."""
    here = (*start, UP)
    way.turn_back(here)
    been = [here]
    while way.left_m(here) > 0.5 and step_m * len(been) < limit_m:
        goal = way.next_waypoint(here)
        assert goal is not None
        to_goal = sub(goal, here)
        here = add(here, scale(to_goal, min(step_m, norm(to_goal)) / max(norm(to_goal), 1e-9)))
        been.append(here)
    return been


def test_it_comes_back_by_its_own_way_to_where_it_began() -> None:
    been = fly_back(flown((0, 0), (40, 0), (40, 40)), (40, 40), 200.0)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0
    assert 0.3 * len(been) < 81.0
    # Beside the two legs by no more than what cutting the corner takes.
    assert max(min(abs(e), abs(n - 40.0)) for n, e, _ in been) < AHEAD_M / 2.0


def test_loops_are_left_out() -> None:
    way = flown((0, 0), (60, 0), (60, 20), (40, 20), (40, 0), (42, -1))
    here = (42.0, -1.0, UP)
    way.turn_back(here)
    assert way.left_m(here) < 46.0


def test_a_vehicle_beside_its_way_goes_back_from_where_that_came_nearest() -> None:
    way = flown((0, 0), (100, 0))
    here = (30.0, 15.0, UP)
    way.turn_back(here)
    assert way.left_m(here) < 50.0
    goal = way.next_waypoint(here)
    assert goal is not None
    assert goal[0] <= 32.0


def test_one_that_overshoots_or_cuts_a_corner_does_not_stay_there() -> None:
    """Its next place but some is where it is."""
    way = flown((0, 0), (20, 0), (20, 6), (14, 6))
    been = fly_back(way, (14.0, 6.0), 120.0)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0


def test_a_long_way_is_kept_in_longer_steps() -> None:
    north_m = 1.5 * STEP_M * KEPT
    way = flown((0, 0), (north_m, 0))
    way.turn_back((north_m, 0.0, UP))
    assert way.left_m((north_m, 0.0, UP)) == pytest.approx(north_m, rel=0.02)
    been = fly_back(way, (north_m, 0.0), 2.0 * STEP_M * KEPT, 3.0)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0


def test_one_that_has_kept_no_way_has_none_back() -> None:
    way = Backtracking()
    way.turn_back((1.0, 2.0, UP))
    assert way.next_waypoint((1.0, 2.0, UP)) is None
    assert way.left_m((1.0, 2.0, UP)) == 0.0
