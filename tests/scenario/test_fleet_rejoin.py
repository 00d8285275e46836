"""Agents in small fleets that see obstacles: parts that lose one another find one another again, and stay safe.

Between parts that do not hear one another only what they see, and where they were heard last, keeps them apart: the
separation is less than the mission's then, and never a contact.
"""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import FlightState, Order
from companion.core.swarm.partition_recovery import LOST_S, stay_outside_m
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

WAIT_S = failsafe_engine.row(Cause.OTHERS_LOST).limit_s
NO_QUORUM_LAND_S = failsafe_engine.row(Cause.NO_MAJORITY_LONG).delay_s

D2_EAST_M = 130.0
RANGE_M = 55.0
UNHEARD_LEAST_M = 3.0  # between vehicles that do not hear each other
REAR = {2, 3}  # of five in two rows, when 4 leads


def on_the_way(
    size: int = 5, *, sees: bool = True, seconds: float = 4.0, at_end: str = "land", priority: tuple[int, ...] = (4,)
) -> Fleet:
    tables = {
        "route": {"d2_enu_m": (D2_EAST_M, 0.0, 8.0), "at_end": at_end},
        "swarm": {"size": size, "leader_priority": [k for k in priority if k <= size]},
        "coverage": {"duration_s": 20.0},
    }
    swarm = Fleet(mission(**tables, **({"sensing": {}} if sees else {})), range_m=RANGE_M)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.run(seconds)
    return swarm


def lane(swarm: Fleet, *, length_m: float = 25.0) -> None:
    """The leader's way goes on between two closed thickets: no radio goes through them."""
    north_m, east_m, _ = swarm.aircraft[leader(swarm)].pos_ned_m
    for k in range(round(length_m / 0.5)):
        swarm.trunks += [(north_m + side_m, east_m + 2.0 + 0.5 * k, 0.3) for side_m in (-2.5, 2.5)]


def leader(swarm: Fleet) -> int:
    (acting,) = swarm.acting()
    return acting


def until_apart(swarm: Fleet, *, limit_s: float = 20.0) -> None:
    end_s = swarm.now_s + limit_s
    while len(swarm.parts()) == 1:
        assert swarm.now_s < end_s
        swarm.tick()


def until_one(swarm: Fleet, *, limit_s: float) -> float:
    """How long it takes until all hear one another again, over others or not, and follow one leader."""
    start_s = swarm.now_s
    while len(swarm.parts()) > 1 or len({one.agent.swarm.election.lease.leader for one in alive(swarm)}) > 1:  # type: ignore[union-attr]
        assert swarm.now_s - start_s < limit_s, [one.state.name for one in alive(swarm)]
        swarm.tick()
    return swarm.now_s - start_s


def alive(swarm: Fleet) -> list:  # type: ignore[type-arg]
    return [one for one in swarm.aircraft.values() if one.id not in swarm.hung and one.agent.swarm.election.lease]


def tree_m(swarm: Fleet, vehicle: int) -> float:
    north_m, east_m, _ = swarm.aircraft[vehicle].pos_ned_m
    return math.hypot(north_m, east_m - D2_EAST_M)


@pytest.mark.parametrize("size", [2, 3, 5, 8])
def test_leader_cut_off_by_thickets_comes_back_its_own_way_and_is_heard_within_ten_seconds(size: int) -> None:
    swarm = on_the_way(size)
    lane(swarm)
    until_apart(swarm)
    assert until_one(swarm, limit_s=10.0) > 0.0
    assert swarm.least_m >= 5.0


def test_without_a_sensor_nobody_looks_for_others() -> None:
    swarm = on_the_way(sees=False)
    lane(swarm)
    until_apart(swarm)
    swarm.run(3.0)
    lost = swarm.parts()[-1]
    before = {k: swarm.aircraft[k].pos_ned_m for k in lost}
    swarm.run(7.0)
    for k in lost:
        assert swarm.aircraft[k].state is FlightState.HOLD
        assert math.dist(before[k], swarm.aircraft[k].pos_ned_m) <= 1.0


def test_part_that_is_left_behind_comes_after_the_others_and_covers_with_them() -> None:
    """Its radio is back only when the others have gone on: it does not find them where they were."""
    swarm = on_the_way()
    swarm.apart |= REAR
    swarm.run(40.0)
    assert all(tree_m(swarm, k) > tree_m(swarm, 4) + 10.0 for k in REAR)
    swarm.apart.clear()
    swarm.until("COVERAGE", limit_s=60.0)
    assert swarm.least_m >= UNHEARD_LEAST_M


def test_halves_of_which_none_has_the_majority_find_each_other_and_go_on() -> None:
    swarm = on_the_way(4)
    swarm.apart |= {1, 2}
    swarm.run(8.0)
    states = {one.state for one in swarm.aircraft.values()}
    assert states == {FlightState.SEEKING}
    swarm.apart.clear()
    until_one(swarm, limit_s=10.0)
    swarm.until("COVERAGE", limit_s=90.0)
    assert swarm.least_m >= 5.0


def test_part_without_the_majority_stays_outside_the_tree_and_lands_there_at_last() -> None:
    swarm = on_the_way(at_end="hold")
    swarm.apart |= REAR
    nearest_m, farthest_m = math.inf, stay_outside_m(15.0, 10.0) + 15.0
    for _ in range(round(NO_QUORUM_LAND_S)):
        swarm.run(1.0)
        nearest_m = min(nearest_m, *(tree_m(swarm, k) for k in REAR))
    swarm.until("LANDED", limit_s=40.0, among=REAR)
    assert 15.0 + 5.0 <= nearest_m <= farthest_m
    assert swarm.aircraft[1].state is FlightState.COVERAGE
    assert swarm.least_m >= UNHEARD_LEAST_M


def test_part_with_the_majority_waits_for_those_that_are_lost_and_then_goes_on() -> None:
    swarm = on_the_way()
    swarm.apart |= REAR
    swarm.run(LOST_S + 2.0)  # until it has come to rest
    here_m = swarm.aircraft[4].pos_ned_m[1]
    swarm.run(WAIT_S - 3.0)
    assert here_m - 15.0 <= swarm.aircraft[4].pos_ned_m[1] <= here_m + 1.0
    swarm.run(10.0)
    assert swarm.aircraft[4].pos_ned_m[1] >= here_m + 4.0
    assert any("no link to 2, 3: waiting" in text for text in swarm.aircraft[4].said)


def test_part_cut_off_around_the_tree_stays_and_the_majority_closes_up_around_it() -> None:
    """Who is silent keeps no rank on the ring, and the majority takes it to hover: that is so, whoever is cut off."""
    swarm = on_the_way(at_end="hold")
    swarm.until("COVERAGE", limit_s=90.0)
    swarm.run(20.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.apart |= REAR
    swarm.run(60.0)
    for k in REAR:
        assert math.dist(swarm.aircraft[k].pos_ned_m[:2], before[k][:2]) <= 4.0
    assert all(swarm.aircraft[k].state is FlightState.COVERAGE for k in swarm.aircraft.keys() - REAR)
    swarm.apart.clear()
    swarm.run(30.0)
    for k, one in swarm.aircraft.items():
        assert math.dist(one.pos_ned_m[:2], before[k][:2]) <= 4.0
    assert swarm.least_m >= 5.0


def test_leader_that_dies_costs_the_others_no_more_than_the_wait() -> None:
    swarm = on_the_way()
    swarm.hung.add(4)
    swarm.until("COVERAGE", limit_s=80.0, among=[1, 2, 3, 5])
    assert swarm.least_m >= 5.0
