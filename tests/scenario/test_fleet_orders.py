"""Agents in small fleets: what the pilot and the operator want."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.agent import TICK_S, Agent
from companion.core.model.events import OperatorOrder
from companion.core.model.states import FlightMode, FlightState, Order, Request, SwarmPhase
from companion.core.model.vectors import add
from companion.core.vehicle.operator_orders import OperatorOrders
from tests.unit.core.core_fleet import Fleet, asked, fleet, setpoints

pytestmark = pytest.mark.sources

PERIOD_S = 0.1


# --- the pilot ---


@pytest.mark.parametrize("state", ["GATHERING", "COVERAGE"])
@pytest.mark.parametrize("who", [1, 2])
def test_pilot_takes_over_and_the_companion_is_silent_until_start(state: str, who: int) -> None:
    swarm = fleet(3, state)
    flown = swarm.aircraft[who]
    flown.mode = FlightMode.OTHER
    flown.asked.clear()
    for _ in range(60):
        swarm.tick()
        assert setpoints(flown) == []
        assert asked(flown) == []
    assert flown.state is FlightState.RELEASED
    assert swarm.acting() == [2 if who == 1 else 1]
    flown.mode = FlightMode.HOLD
    swarm.run(2.0)
    assert flown.asked == []
    swarm.order(who, Order.START)
    swarm.run(2.0)
    assert flown.asked == [Request.OFFBOARD]
    assert flown.mode is FlightMode.OFFBOARD


def test_pilot_is_above_an_order_to_land_all() -> None:
    swarm = fleet()
    swarm.aircraft[2].mode = FlightMode.OTHER
    swarm.run(0.2)
    swarm.order(1, Order.ABORT)
    swarm.run(20.0)
    assert swarm.aircraft[2].mode is FlightMode.OTHER
    assert [swarm.aircraft[k].state.name for k in (1, 3)] == ["LANDED", "LANDED"]


# --- orders ---


def chain(swarm: Fleet) -> Fleet:
    """1 and 3 hear 2, and not each other."""
    for k, one in swarm.aircraft.items():
        one.pos_ned_m = (20.0 * k, 0.0, one.pos_ned_m[2])
    swarm.range_m = 25.0
    return swarm


def test_start_reaches_those_that_the_ground_does_not() -> None:
    swarm = chain(fleet(3, "READY"))
    swarm.order(3, Order.START)
    swarm.run(2 * 2 * PERIOD_S + 2 * TICK_S)
    swarm.until("TAKING_OFF", limit_s=5.0)


@pytest.mark.parametrize("state", ["TRANSIT", "COVERAGE"])
def test_land_all_reaches_everyone_two_periods_a_hop_and_everyone_lands(state: str) -> None:
    swarm = chain(fleet(3, state))
    swarm.run(0.5)
    swarm.order(3, Order.ABORT)
    swarm.run(2 * 2 * PERIOD_S)
    assert {one.state for one in swarm.aircraft.values()} == {FlightState.LANDING}
    assert sum("land all: ordered by the operator" in one.said for one in swarm.aircraft.values()) == 1
    swarm.until("LANDED", limit_s=20.0)


def test_land_all_cannot_be_taken_back() -> None:
    swarm = fleet(3, "READY")
    swarm.order(2, Order.ABORT)
    swarm.run(1.0)
    swarm.order(2, Order.START)
    swarm.run(10.0)
    for one in swarm.aircraft.values():
        assert one.altitude_m == 0.0
        assert not one.armed


def test_land_all_beats_the_takeoff() -> None:
    swarm = fleet(3, "READY")
    swarm.order(1, Order.START)
    swarm.until("TAKING_OFF", limit_s=5.0)
    swarm.run(3.0)
    assert swarm.aircraft[2].altitude_m > 1.0
    swarm.order(3, Order.ABORT)
    swarm.until("LANDED", limit_s=15.0)


def test_land_all_said_once_even_when_ordered_again() -> None:
    swarm = fleet()
    for _ in range(3):
        swarm.order(1, Order.ABORT)
    swarm.run(0.5)
    assert swarm.aircraft[1].said.count("land all: ordered by the operator") == 1


# --- hold, land, and whose word counts ---


def test_hold_stops_phase_and_its_timers_and_start_goes_on() -> None:
    swarm = fleet(3, "COVERAGE")  # for 20 s
    for k in swarm.aircraft:
        swarm.order(k, Order.HOLD)
    swarm.run(2.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.run(200.0)
    assert {one.state for one in swarm.aircraft.values()} == {FlightState.HOLD}
    assert max(math.dist(before[k], one.pos_ned_m) for k, one in swarm.aircraft.items()) < 0.5
    for k in swarm.aircraft:
        swarm.order(k, Order.START)
    swarm.run(5.0)
    assert {one.state for one in swarm.aircraft.values()} == {FlightState.COVERAGE}
    swarm.until("LANDED", limit_s=60.0)  # as the mission ends


def test_held_leader_takes_the_swarm_no_further() -> None:
    """Though it comes to rest where its phase would end."""
    swarm = fleet(3)
    for k in swarm.aircraft:
        swarm.order(k, Order.HOLD)
    swarm.run(3.0)
    dest = swarm.aircraft[1].agent.localiser.destination.ned_m
    assert dest is not None
    swarm.aircraft[1].put(add(swarm.aircraft[1].pos_ned_m, dest))
    swarm.run(5.0)
    assert swarm.acting() == [1]
    assert {one.agent.swarm.phases.phase for one in swarm.aircraft.values()} == {SwarmPhase.TRANSIT}


def test_one_that_is_held_stays_though_its_swarm_lands() -> None:
    swarm = fleet(3)
    swarm.order(3, Order.HOLD)
    for k in (1, 2):
        swarm.order(k, Order.LAND)
    swarm.until("LANDED", limit_s=30.0, among=(1, 2))
    assert swarm.aircraft[3].state is FlightState.HOLD
    swarm.order(3, Order.START)
    swarm.until("LANDED", limit_s=30.0)


def test_leader_lost_while_held_is_replaced() -> None:
    swarm = fleet(3)
    for k in swarm.aircraft:
        swarm.order(k, Order.HOLD)
    swarm.run(1.0)
    swarm.mute.add(1)
    swarm.run(5.0)
    assert 2 in swarm.acting()
    assert swarm.aircraft[2].state is FlightState.HOLD


def test_held_swarm_keeps_its_distance() -> None:
    swarm = fleet(3)
    for k in swarm.aircraft:
        swarm.order(k, Order.HOLD)
    swarm.run(3.0)
    held, other = swarm.aircraft[2], swarm.aircraft[3]
    north, east, down = held.pos_ned_m
    other.pos_ned_m, other.vel_ned_mps = (north + 3.0, east, down), (0.0, 0.0, 0.0)
    swarm.run(5.0)
    assert math.dist(held.pos_ned_m, other.pos_ned_m) > 4.0


def test_hold_on_the_ground_keeps_it_there_until_start() -> None:
    swarm = fleet(3, "READY")
    swarm.order(3, Order.HOLD)
    swarm.order(1, Order.START)
    swarm.run(8.0)
    assert swarm.aircraft[3].state is FlightState.READY
    assert swarm.aircraft[1].altitude_m > 1.0
    swarm.order(3, Order.START)
    swarm.run(3.0)
    assert swarm.aircraft[3].state is FlightState.TAKING_OFF


def test_land_is_the_missions_orderly_end_and_no_start_takes_it_back() -> None:
    swarm = fleet(3)
    for k in swarm.aircraft:
        swarm.order(k, Order.LAND)
        swarm.order(k, Order.HOLD)
        swarm.order(k, Order.START)
    swarm.until("LANDED", limit_s=40.0)


def test_abort_is_above_hold_and_land() -> None:
    swarm = fleet(3)
    for order in (Order.ABORT, Order.HOLD, Order.LAND, Order.START):
        for k in swarm.aircraft:
            swarm.order(k, order)
    swarm.run(0.2)
    assert {one.state for one in swarm.aircraft.values()} == {FlightState.LANDING}


def signed(size: int = 3) -> Fleet:
    """A signed swarm on the ground: each vehicle goes by its own copies of orders."""
    swarm = Fleet(fleet(size, "READY").mission)
    for k, one in swarm.aircraft.items():
        one.agent = Agent(swarm.mission, k, operator=OperatorOrders())
    swarm.run(2.0)
    return swarm


def test_in_a_signed_swarm_flags_of_others_count_for_nothing() -> None:
    swarm = signed()
    swarm.lies[3] = lambda beacon: replace(beacon, start=True, abort=True)
    swarm.run(3.0)
    assert [swarm.aircraft[k].agent.swarm.operator.started for k in (1, 2)] == [False, False]
    for k in swarm.aircraft:
        swarm.order(k, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.run(5.0)
    assert {swarm.aircraft[k].state for k in (1, 2)} == {FlightState.TRANSIT}


def test_in_a_signed_swarm_nobody_takes_off_without_a_start_of_its_own() -> None:
    """Whatever phase a leader, true or false, announces."""
    swarm = signed()
    for k in (1, 2):
        swarm.order(k, Order.START)
    for k in (1, 2):
        swarm.lies[k] = lambda beacon: replace(beacon, phase=SwarmPhase.GATHER)
    swarm.run(20.0)
    assert swarm.aircraft[3].state is FlightState.READY
    assert Request.ARM not in swarm.aircraft[3].asked


def test_start_hands_back_to_its_companion_only_the_vehicle_that_it_names() -> None:
    swarm = fleet(3)
    swarm.aircraft[2].mode = FlightMode.OTHER
    swarm.run(0.5)
    swarm.aircraft[2].agent.receive(OperatorOrder(Order.START, hands_back=False), swarm.now_s)
    swarm.run(1.0)
    assert swarm.aircraft[2].state is FlightState.RELEASED
    swarm.aircraft[2].mode = FlightMode.HOLD
    assert not any("handed back" in text for text in swarm.aircraft[2].said)
    swarm.order(2, Order.START)
    swarm.run(2.0)
    assert swarm.aircraft[2].mode is FlightMode.OFFBOARD
    assert [text for text in swarm.aircraft[2].said if "handed back" in text] == ["handed back: companion steers again"]


def test_a_start_to_a_vehicle_that_has_landed_is_refused_in_words() -> None:
    swarm = fleet(2)
    swarm.order(1, Order.ABORT)
    swarm.until("LANDED", limit_s=40.0)
    swarm.order(2, Order.START)
    swarm.run(0.5)
    assert swarm.aircraft[2].said[-1] == "not handed back: landed, restart companion"


def test_one_whose_link_fails_while_the_swarm_lands_makes_room_and_lands() -> None:
    swarm = fleet(3, "GATHERING")
    taken, cut = swarm.aircraft[1], swarm.aircraft[2]
    taken.mode, taken.vel_ned_mps = FlightMode.OTHER, (0.0, 0.0, 0.0)  # its pilot hovers, near that one
    swarm.run(0.2)
    north, east, down = taken.pos_ned_m
    cut.put((north + 6.5, east, down))
    for vehicle in swarm.aircraft:
        swarm.order(vehicle, Order.LAND)
    swarm.run(0.1)
    cut.is_linked, cut.vel_ned_mps = False, (0.0, 0.0, 0.0)
    swarm.run(1.5)
    cut.is_linked = True
    assert math.dist(taken.pos_ned_m[:2], cut.pos_ned_m[:2]) < 7.5
    swarm.until("LANDED", limit_s=60.0, among=[2, 3])
    assert math.dist(taken.pos_ned_m[:2], cut.pos_ned_m[:2]) > 7.5
    assert taken.state is FlightState.RELEASED
