"""A leader that trees held up: how much faster it flies, and for how long."""

from __future__ import annotations

import pytest
from core_kit import mission

from companion.core import formation
from companion.core.movement import Movement, Situation
from companion.core.pace import JUMP_M, LATE_MAX_M, MOST, PAUSE_S, Pace
from companion.core.scan_map import ObstacleMap
from companion.core.types import ZERO, FlightState, Position, SwarmPhase

TICK_S = 0.05


def fly(pace: Pace, left_m: float, flown_mps: float, for_s: float, *, from_s: float = 0.0) -> tuple[float, float]:
    """At 3 m/s of cruise: what is left to the goal then, and the last share."""
    share = 1.0
    for k in range(round(for_s / TICK_S) + 1):
        share = pace.follow(left_m, 3.0, from_s + k * TICK_S)
        left_m -= flown_mps * TICK_S
    return left_m + flown_mps * TICK_S, share


def test_leader_that_keeps_its_cruise_speed_flies_no_faster() -> None:
    assert fly(Pace(), 100.0, 3.0, 20.0)[1] == pytest.approx(1.0)
    assert fly(Pace(), 100.0, 3.3, 20.0)[1] == 1.0


def test_late_leader_flies_faster_until_it_has_made_that_up() -> None:
    pace = Pace()
    left_m, share = fly(pace, 100.0, 2.0, 1.0)
    assert share == pytest.approx(1.1)  # a metre late
    left_m, share = fly(pace, left_m, 2.0, 10.0, from_s=1.0)
    assert share == MOST
    left_m, share = fly(pace, left_m, 3.3, 30.0, from_s=11.0)
    assert share == MOST  # 11 m late, of which 9 are made up
    assert fly(pace, left_m, 3.3, 10.0, from_s=41.0)[1] == pytest.approx(1.0)


def test_no_more_is_made_up_than_so_much() -> None:
    pace = Pace()
    left_m, share = fly(pace, 100.0, 0.0, 60.0)
    assert share == MOST
    assert fly(pace, left_m, 4.0, LATE_MAX_M, from_s=60.0)[1] == pytest.approx(1.0)


def test_another_goal_or_a_pause_is_another_way() -> None:
    for left_m, now_s in ((100.0, 10.0 + PAUSE_S + TICK_S), (100.0 + JUMP_M + 0.1, 10.0), (50.0, 10.0), (100.0, 9.0)):
        pace = Pace()
        assert fly(pace, 100.0, 0.0, 10.0)[1] == MOST
        assert pace.follow(left_m, 3.0, now_s) == 1.0


def test_leader_among_trees_makes_up_what_trees_took_and_not_what_its_swarm_asks_of_it() -> None:
    cases = ((True, 1.0, 3.0 * MOST), (True, 0.5, 1.5 * MOST), (True, 0.0, 0.0), (False, 1.0, 3.0))
    for senses, governor, speed_mps in cases:
        movement = Movement(mission(sensing={}) if senses else mission(), 1)
        for k in range(round(4.0 / TICK_S)):  # held in one place
            movement.wish(
                Situation(
                    own=Position((0.0, 50.0, -8.0), ZERO),
                    neighbours=[],
                    standing={},
                    state=FlightState.TRANSIT,
                    phase=SwarmPhase.TRANSIT,
                    route=formation.LEADER_ROUTE,
                    range_m=30.0,
                    leads=True,
                    governor=governor,
                    faith=1.0,
                    goal=((0.0, 130.0, -8.0), 4.0),
                    size=1,
                    obstacles=ObstacleMap() if senses else None,
                    now_s=k * TICK_S,
                )
            )
        assert movement.ref_ned_mps == pytest.approx((0.0, speed_mps, 0.0))
