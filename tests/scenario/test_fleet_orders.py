"""Agents in small fleets: what the pilot and the operator want."""

from __future__ import annotations

import pytest

from companion.core.agent import TICK_S
from companion.core.model.states import FlightMode, FlightState, Order, Request
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
    swarm.order(1, Order.LAND_ALL)
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
    swarm.order(3, Order.LAND_ALL)
    swarm.run(2 * 2 * PERIOD_S)
    assert {one.state for one in swarm.aircraft.values()} == {FlightState.LANDING}
    assert sum("land all: ordered by the operator" in one.said for one in swarm.aircraft.values()) == 1
    swarm.until("LANDED", limit_s=20.0)


def test_land_all_cannot_be_taken_back() -> None:
    swarm = fleet(3, "READY")
    swarm.order(2, Order.LAND_ALL)
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
    swarm.order(3, Order.LAND_ALL)
    swarm.until("LANDED", limit_s=15.0)


def test_land_all_said_once_even_when_ordered_again() -> None:
    swarm = fleet()
    for _ in range(3):
        swarm.order(1, Order.LAND_ALL)
    swarm.run(0.5)
    assert swarm.aircraft[1].said.count("land all: ordered by the operator") == 1
