"""The way back of a leader that does not know where it is: its own, without loops, to where it began."""

from __future__ import annotations

import math

import pytest

from companion.core.model.vectors import add, norm, scale, sub
from companion.core.swarm import backtracking
from companion.core.swarm.backtracking import AHEAD_M, KEPT, STEP_M, Track
from mission.common.frames import Vec3

UP = -8.0


def flown(*corners: tuple[float, float]) -> Track:
    """A vehicle that has gone from corner to corner, in steps of 0.2 m."""
    track = Track()
    here = (*corners[0], UP)
    track.note(here)
    for corner in corners[1:]:
        way = sub((*corner, UP), here)
        for k in range(1, math.ceil(norm(way) / 0.2) + 1):
            track.note(add(here, scale(way, min(1.0, 0.2 * k / norm(way)))))
        here = (*corner, UP)
    return track


def fly_back(track: Track, start: tuple[float, float], limit_m: float) -> list[Vec3]:
    """Where a vehicle comes by that flies straight to what it is told."""
    here = (*start, UP)
    track.turn(here)
    been = [here]
    while track.left_m(here) > 0.5 and 0.3 * len(been) < limit_m:
        goal = track.back(here)
        assert goal is not None
        to_goal = sub(goal, here)
        here = add(here, scale(to_goal, min(0.3, norm(to_goal)) / max(norm(to_goal), 1e-9)))
        been.append(here)
    return been


def test_it_comes_back_by_its_own_way_to_where_it_began() -> None:
    been = fly_back(flown((0, 0), (40, 0), (40, 40)), (40, 40), 200.0)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0
    assert 0.3 * len(been) < 81.0
    # Beside the two legs by no more than what cutting the corner takes.
    assert max(min(abs(e), abs(n - 40.0)) for n, e, _ in been) < AHEAD_M / 2.0


def test_loops_are_left_out() -> None:
    track = flown((0, 0), (60, 0), (60, 20), (40, 20), (40, 0), (42, -1))
    here = (42.0, -1.0, UP)
    track.turn(here)
    assert track.left_m(here) < 46.0


def test_a_vehicle_beside_its_way_goes_back_from_where_that_came_nearest() -> None:
    track = flown((0, 0), (100, 0))
    here = (30.0, 15.0, UP)
    track.turn(here)
    assert track.left_m(here) < 50.0
    goal = track.back(here)
    assert goal is not None
    assert goal[0] <= 32.0


def test_one_that_overshoots_or_cuts_a_corner_does_not_stay_there() -> None:
    """Its next place but some is where it is."""
    track = flown((0, 0), (20, 0), (20, 6), (14, 6))
    been = fly_back(track, (14.0, 6.0), 120.0)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0


def test_a_long_way_is_kept_in_longer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = KEPT // 4
    monkeypatch.setattr(backtracking, "KEPT", kept)
    track = flown((0, 0), (3.0 * STEP_M * kept, 0))
    assert len(track._places) <= kept
    here = (3.0 * STEP_M * kept, 0.0, UP)
    track.turn(here)
    assert track.left_m(here) == pytest.approx(3.0 * STEP_M * kept, rel=0.02)
    been = fly_back(track, (here[0], 0.0), 4.0 * STEP_M * kept)
    assert norm(sub(been[-1], (0.0, 0.0, UP))) < 1.0


def test_one_that_has_kept_no_way_has_none_back() -> None:
    track = Track()
    track.turn((1.0, 2.0, UP))
    assert track.back((1.0, 2.0, UP)) is None
    assert track.left_m((1.0, 2.0, UP)) == 0.0
