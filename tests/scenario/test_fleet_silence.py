"""Agents in small fleets: some fall silent, parts do not hear one another, members lie."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import FlightMode, FlightState, Order, SwarmPhase
from companion.core.swarm.partition import WAIT_OPEN_S
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_fleet import Fleet, fleet
from tests.unit.core.core_kit import heard_beacon, mission

pytestmark = pytest.mark.sources

NO_QUORUM_LAND_S = failsafe_engine.row(Cause.NO_MAJORITY_LONG).delay_s

# --- those that fall silent in the air ---


def test_swarm_flies_round_the_leader_that_fell_silent_at_departure_and_lands_beside_it() -> None:
    """Its autopilot holds at d1, where the swarm comes back to."""
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (40.0, 0.0, 8.0), "at_end": "return"}, swarm={"size": 4}, coverage={"duration_s": 1.0}
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("GATHERING", limit_s=60.0)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.hung.add(1)
    swarm.until("LANDED", limit_s=200.0, among=[2, 3, 4])
    dead = swarm.aircraft[1]
    assert dead.mode is FlightMode.HOLD
    assert swarm.least_m >= 5.0
    assert "vehicle 1 link lost in the air: keeping clear" in swarm.aircraft[2].said


def test_one_that_never_heard_a_silent_vehicle_keeps_clear_of_it_by_what_others_tell() -> None:
    swarm = fleet(3)
    swarm.hung.add(1)
    swarm.aircraft[3].forget(1)
    swarm.run(4.0)
    assert list(swarm.aircraft[3].agent.localiser.silent) == [1]
    rel = swarm.aircraft[3].agent.localiser.silent[1].rel_ned_m
    there = tuple(a - b for a, b in zip(swarm.aircraft[1].pos_ned_m, swarm.aircraft[3].pos_ned_m, strict=True))
    assert rel == pytest.approx(there, abs=1.5)


def test_burst_of_losses_is_no_news_and_a_lasting_silence_is_told_once() -> None:
    swarm = fleet(3)
    text = "vehicle 3 link lost in the air: keeping clear"
    for _ in range(3):
        swarm.mute.add(3)
        swarm.run(0.8)
        swarm.mute.clear()
        swarm.run(0.5)
    assert text not in swarm.aircraft[1].said
    swarm.mute.add(3)
    swarm.run(5.0)
    assert swarm.aircraft[1].said.count(text) == 1


# --- parts that do not hear one another ---


def test_only_the_part_with_the_majority_goes_on_and_the_other_holds_and_says_so() -> None:
    swarm = fleet(5)
    swarm.apart |= {4, 5}
    swarm.run(3.0)
    at_m = swarm.aircraft[4].pos_ned_m[1]
    swarm.until("COVERAGE", limit_s=60.0, among=[1, 2, 3])
    assert swarm.aircraft[4].state is swarm.aircraft[5].state is FlightState.HOLD
    assert swarm.aircraft[4].pos_ned_m[1] == pytest.approx(at_m, abs=2.0)
    assert "hold: no quorum, without 1, 2, 3" in swarm.aircraft[4].said
    assert swarm.least_m >= 5.0


def test_part_that_holds_its_leader_but_not_the_majority_holds_too() -> None:
    swarm = fleet(5)
    swarm.apart |= {1, 2}
    swarm.until("COVERAGE", limit_s=60.0 + WAIT_OPEN_S, among=[3, 4, 5])
    assert swarm.aircraft[1].state is swarm.aircraft[2].state is FlightState.HOLD
    assert "hold: no quorum, without 3, 4, 5" in swarm.aircraft[1].said


def test_part_that_held_joins_when_it_hears_the_others_and_the_majoritys_leader_leads() -> None:
    swarm = fleet(5)
    swarm.apart |= {1, 2}
    swarm.run(5.0)
    leader = next(k for k in (3, 4, 5) if swarm.aircraft[k].agent.swarm.election.acts)
    swarm.apart.clear()
    swarm.run(3.0)
    assert swarm.acting() == [leader]
    assert all(one.agent.swarm.election.lease.quorum for one in swarm.aircraft.values())  # type: ignore[union-attr]
    swarm.until("COVERAGE", limit_s=60.0)
    assert swarm.least_m >= 5.0


@pytest.mark.parametrize(("size", "dead"), [(4, {1, 2}), (5, {1, 2, 3})])
def test_part_without_the_majority_lands_after_a_stated_time(size: int, dead: set[int]) -> None:
    swarm = fleet(size)
    swarm.hung |= dead
    left = [k for k in swarm.aircraft if k not in dead]
    swarm.run(NO_QUORUM_LAND_S - 5.0)
    assert {swarm.aircraft[k].state for k in left} == {FlightState.HOLD}
    swarm.until("LANDED", limit_s=40.0, among=left)
    assert swarm.least_m >= 5.0


def test_part_without_the_majority_stays_in_coverage_where_it_is_and_nobody_comes_near() -> None:
    """The majority closes up around it: it takes those that are silent to hover."""
    swarm = fleet(5)
    swarm.until("COVERAGE", limit_s=60.0)
    swarm.run(15.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.apart |= {1, 2}
    swarm.run(30.0)
    for k in swarm.apart:
        assert math.dist(swarm.aircraft[k].pos_ned_m[:2], before[k][:2]) <= 1.5
    assert swarm.least_m >= 5.0


# --- lies ---


def ghost(swarm: Fleet, me: int, rel: tuple[float, float, float], **says: object) -> None:
    """A false member 3, heard by `me` with every tick."""
    agent = swarm.aircraft[me].agent
    said = heard_beacon(3, time_ms=int(swarm.now_s * 1e3), rel_ned_m=rel, airborne=True, **says)  # type: ignore[arg-type]
    agent.receive(said, swarm.now_s)


def test_ghost_a_kilometre_off_has_no_part_in_movement() -> None:
    swarm, haunted = fleet(3), fleet(3)
    swarm.mute.add(3)
    haunted.mute.add(3)
    for _ in range(60):
        ghost(haunted, 2, (0.0, 1000.0, 0.0), lease=None, state=FlightState.TRANSIT)
        swarm.tick()
        haunted.tick()
    apart_m = math.dist(swarm.aircraft[2].pos_ned_m, haunted.aircraft[2].pos_ned_m)
    assert apart_m <= 1.0


def test_false_tree_lets_nobody_nearer_to_the_true_one() -> None:
    """One that is led straight at d2, and told that the tree stands far beyond: the mission's own trunk holds."""
    swarm = fleet(2, "TRANSIT")
    one = swarm.aircraft[2]
    one.put((0.3, 45.0, -8.0))
    swarm.aircraft[1].put((25.0, 60.0, -8.0))
    one.agent.movement.find_desired = lambda _: (0.0, 3.0, 0.0)  # type: ignore[attr-defined]
    one.agent.localiser.update_destination = lambda *_, **__: None  # type: ignore[method-assign]
    one.agent.localiser.destination.ned_m = (0.0, 300.0, 0.0)
    nearest_m = math.inf
    for _ in range(400):
        swarm.tick()
        nearest_m = min(nearest_m, math.hypot(one.pos_ned_m[0], one.pos_ned_m[1] - 60.0))
    assert 2.0 <= nearest_m < 4.0


def test_beacons_once_a_second_fly_the_mission_too() -> None:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (60.0, 0.0, 8.0)},
            swarm={"size": 3},
            radio={"beacon_rate_hz": 1.0},
            coverage={"duration_s": 5.0},
        )
    )
    swarm.run(15.0)
    swarm.order(1, Order.START)
    swarm.until("COVERAGE", limit_s=150.0)
    assert swarm.least_m >= 5.0


# --- what happens as the swarm takes off ---


@pytest.mark.parametrize("after_s", [0.1, 1.0, 3.0])
def test_parts_that_are_cut_off_as_the_swarm_takes_off_do_not_come_to_the_same_place(after_s: float) -> None:
    swarm = fleet(5, "READY")
    swarm.order(1, Order.START)
    swarm.until("TAKING_OFF", limit_s=5.0)
    swarm.run(after_s)
    swarm.apart |= {1, 2}
    swarm.until("TRANSIT", limit_s=150.0, among=[3, 4, 5])
    assert swarm.aircraft[1].state is swarm.aircraft[2].state is FlightState.HOLD
    assert any("hold: no quorum, without 3, 4, 5" in text for text in swarm.aircraft[1].said)
    assert swarm.least_m >= 5.0


def test_leader_that_is_cut_off_as_it_launches_the_swarm_misses_those_that_were_ready() -> None:
    """They have not said yet that they take off."""
    swarm = fleet(5, "READY")
    swarm.order(1, Order.START)
    while swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.ASSEMBLE:
        swarm.tick()
    swarm.apart |= {1, 2}
    swarm.tick()
    assert swarm.aircraft[1].agent.swarm.roster.flown == 0b11111


@pytest.mark.parametrize("after_s", [2.0, 3.0])
def test_leader_that_dies_in_the_climb_is_kept_clear_of_at_every_height(after_s: float) -> None:
    """It starts below d1, its autopilot climbs on, and the next leader is to gather at d1."""
    swarm = fleet(4, "READY")
    swarm.order(1, Order.START)
    swarm.until("TAKING_OFF", limit_s=5.0)
    swarm.run(after_s)
    swarm.hung.add(1)
    swarm.until("TRANSIT", limit_s=150.0, among=[2, 3, 4])
    assert swarm.aircraft[1].altitude_m > 7.0
    assert swarm.least_m >= 5.0
