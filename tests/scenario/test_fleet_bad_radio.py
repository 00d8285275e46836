"""Agents in small fleets with a bad radio: it slows the swarm and closes it up, and parts none of it."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.localisation.link_share import SILENCE_MAX_S
from companion.core.model.states import FlightState, Order
from companion.core.model.vectors import sub
from companion.core.swarm.partition import WAIT_OPEN_S
from companion.core.swarm.partition_recovery import LOST_S
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

CUT_S = 28.0
HARD_M = 5.0
RANGE_M = 55.0


def under_way(size: int, *, d2_east_m: float = 130.0, seconds: float = 6.0, loss: float = 0.0) -> Fleet:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (d2_east_m, 0.0, 8.0), "at_end": "hold"},
            swarm={"size": size},
            coverage={"duration_s": 20.0},
        ),
        range_m=RANGE_M,
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.loss = loss
    swarm.run(seconds)
    return swarm


def flown(swarm: Fleet, seconds: float) -> tuple[float, float]:
    """The leader's mean speed, and how far from it the others are at last."""
    (leader,) = swarm.acting()
    began_m = swarm.aircraft[leader].pos_ned_m[1]
    swarm.run(seconds)
    here = swarm.aircraft[leader].pos_ned_m
    return (here[1] - began_m) / seconds, max(math.dist(here, one.pos_ned_m) for one in swarm.aircraft.values())


def silences(swarm: Fleet, seconds: float) -> int:
    """How often a vehicle took another for silent."""
    count, before = 0, {k: set[int]() for k in swarm.aircraft}
    for _ in range(round(seconds / 0.05)):
        swarm.tick()
        for k, one in swarm.aircraft.items():
            now = set(one.agent.localiser.silent)
            count, before[k] = count + len(now - before[k]), now
    return count


def test_at_40_percent_loss_nobody_is_taken_for_silent_and_the_swarm_flies_as_fast() -> None:
    swarm = under_way(8, d2_east_m=330.0, loss=0.4, seconds=12.0)
    said = {k: set(one.said) for k, one in swarm.aircraft.items()}
    assert silences(swarm, 30.0) <= 1
    assert flown(swarm, 10.0)[0] >= 2.8
    for k, one in swarm.aircraft.items():
        assert set(one.said) - said[k] <= {"radio poor: over a third of beacons lost"}
    assert swarm.least_m >= HARD_M


def test_worse_radio_slows_the_swarm_and_closes_it_up() -> None:
    good_mps, good_m = flown(under_way(5, d2_east_m=330.0, seconds=18.0), 20.0)
    swarm = under_way(5, d2_east_m=330.0, loss=0.7, seconds=18.0)
    bad_mps, bad_m = flown(swarm, 20.0)
    assert good_mps >= 2.8
    assert 1.0 <= bad_mps <= 2.0
    assert bad_m <= good_m - 2.0
    assert len(swarm.acting()) == 1
    assert swarm.least_m >= HARD_M


def test_dead_companion_behind_a_bad_radio_is_an_obstacle_within_the_bound() -> None:
    swarm = under_way(5, loss=0.5, seconds=12.0)
    swarm.hung.add(5)
    swarm.run(SILENCE_MAX_S + 0.2)
    for k in (1, 2, 3, 4):
        assert 5 in swarm.aircraft[k].agent.localiser.silent
    swarm.run(20.0)
    assert swarm.least_m >= HARD_M


@pytest.mark.parametrize("seed", range(8))
def test_under_the_open_sky_those_cut_off_for_half_a_minute_are_waited_for_and_all_arrive(seed: int) -> None:
    drawn = random.Random(seed)
    swarm = under_way(8, seconds=drawn.uniform(3.0, 35.0))
    swarm.apart |= set(drawn.sample(range(1, 9), drawn.randint(1, 3)))
    swarm.run(CUT_S)
    swarm.apart.clear()
    swarm.until("COVERAGE", limit_s=90.0)
    assert swarm.least_m >= HARD_M - 0.5


def test_under_the_open_sky_both_parts_stand_until_they_hear_each_other_and_nobody_comes_to_look() -> None:
    swarm = under_way(8)
    swarm.apart |= {2, 5}
    swarm.run(5.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.run(20.0)
    for k, one in swarm.aircraft.items():
        assert math.dist(before[k], one.pos_ned_m) <= 3.0
        assert one.state is (FlightState.HOLD if k in swarm.apart else FlightState.TRANSIT)


def test_under_the_open_sky_one_that_is_lost_for_good_is_waited_for_once() -> None:
    swarm = under_way(8)
    swarm.hung.add(5)
    swarm.run(LOST_S + WAIT_OPEN_S - 2.0)
    here_m = swarm.aircraft[1].pos_ned_m[1]
    assert here_m <= 60.0
    swarm.run(8.0)
    assert swarm.aircraft[1].pos_ned_m[1] >= here_m + 9.0
    swarm.until("COVERAGE", limit_s=60.0, among=swarm.aircraft.keys() - {5})
    (waits,) = [text for text in swarm.aircraft[1].said if "waiting" in text]
    assert waits == "no link to 5: waiting up to 39 s"
    assert swarm.aircraft[1].said.count("swarm goes on without 5") == 1
    assert swarm.least_m >= HARD_M


def test_two_that_do_not_hear_each_other_know_from_the_others_where_they_are() -> None:
    """A majority hears both, so neither counts as silent; each asks on, for as long as it does not hear the other."""
    swarm = under_way(5, d2_east_m=330.0)
    swarm.links = {frozenset((a, b)) for a in range(1, 6) for b in range(1, a)} - {frozenset((2, 3))}
    swarm.run(5.0)
    for _ in range(200):
        swarm.tick()
        for me, other in ((2, 3), (3, 2)):
            localiser = swarm.aircraft[me].agent.localiser
            assert other not in localiser.silent
            there = sub(swarm.aircraft[other].pos_ned_m, swarm.aircraft[me].pos_ned_m)
            (rel, age_s), *_ = localiser.relayed
            assert math.dist(rel, there) <= 0.5 + 3.0 * (age_s + 0.2)
            assert age_s <= 0.5
    swarm.links = None
    swarm.run(1.0)
    assert all(one.agent.localiser.relayed == [] for one in swarm.aircraft.values())
