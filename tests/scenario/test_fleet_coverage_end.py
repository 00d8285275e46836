"""Agents in small fleets at the end of coverage: it goes on while the ring has a gap that is being closed."""

from __future__ import annotations

import functools
import math
from copy import deepcopy
from itertools import pairwise

import pytest

from companion.core.model.states import Order
from mission.common.forming import FORMED_RATIO, FORMING_LIMIT_S
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources  # fleets are copied

DURATION_S = 25.0
D2_NED_M = (0.0, 60.0)


@functools.cache
def _covering() -> Fleet:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (60.0, 0.0, 8.0), "at_end": "land"},
            swarm={"size": 5},
            coverage={"duration_s": DURATION_S},
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("COVERAGE", limit_s=120.0)
    return swarm


def covering() -> Fleet:
    """Its coverage has just begun. Flown there once for all tests."""
    return deepcopy(_covering())


def gap_ratio(swarm: Fleet) -> float:
    """The largest gap of those alive, to that of an even ring."""
    alive = [one for one in swarm.aircraft.values() if one.id not in swarm.hung]
    bearings = sorted(math.atan2(a.pos_ned_m[1] - D2_NED_M[1], a.pos_ned_m[0] - D2_NED_M[0]) for a in alive)
    gaps = [after - before for before, after in pairwise([*bearings, bearings[0] + math.tau])]
    return max(gaps) * len(alive) / math.tau


def cover_to_the_end(swarm: Fleet) -> float:
    """How long it took from now, until it lands."""
    alive = set(swarm.aircraft) - swarm.hung
    return swarm.until("LANDING", limit_s=DURATION_S + FORMING_LIMIT_S + 5.0, among=alive)


def test_formed_ring_is_left_when_its_time_is_up() -> None:
    assert cover_to_the_end(covering()) == pytest.approx(DURATION_S, abs=1.0)


def test_ring_torn_in_the_last_seconds_closes_up_before_the_swarm_leaves() -> None:
    swarm = covering()
    swarm.run(DURATION_S - 4.0)
    swarm.hung.add(next(k for k in swarm.aircraft if k not in swarm.acting()))
    swarm.run(1.0)
    assert gap_ratio(swarm) > FORMED_RATIO
    took_s = cover_to_the_end(swarm)
    assert gap_ratio(swarm) <= FORMED_RATIO
    assert took_s < FORMING_LIMIT_S
    assert swarm.least_m >= 5.0


def test_ring_whose_leader_falls_silent_at_the_end_closes_up_too() -> None:
    swarm = covering()
    swarm.run(DURATION_S - 4.0)
    swarm.hung.update(swarm.acting())
    cover_to_the_end(swarm)
    assert gap_ratio(swarm) <= FORMED_RATIO


def test_one_that_comes_late_is_waited_for() -> None:
    """Its autopilot did not obey for a while: it holds on the way, and comes when it is steered again."""
    swarm = covering()
    late = swarm.aircraft[5]
    late.put((late.pos_ned_m[0], late.pos_ned_m[1] - 10.0, late.pos_ned_m[2]))
    late.is_linked = False
    swarm.run(DURATION_S - 2.0)
    late.is_linked = True
    cover_to_the_end(swarm)
    assert abs(math.hypot(late.pos_ned_m[0] - D2_NED_M[0], late.pos_ned_m[1] - D2_NED_M[1]) - 15.0) <= 2.0
    assert gap_ratio(swarm) <= FORMED_RATIO
