"""Agents in small fleets: one that is ready late takes off where others hover already, and one lands among others."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import STEERED, FlightState, Order, Request
from companion.core.swarm.phases import GATHER_LIMIT_S
from tests.unit.core.core_fleet import Fleet, fleet
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources


def gathered(size: int, late_ned_m: tuple[float, float, float], *, up_m: float = 8.0) -> Fleet:
    """All but vehicle 3 have gathered, the leader over d1; that one stands there, and is not ready yet."""
    swarm = Fleet(
        mission(
            route={"d1_enu_m": (0.0, 0.0, up_m), "d2_enu_m": (60.0, 0.0, up_m), "at_end": "land"},
            swarm={"size": size, "leader_priority": (1,), "start_timeout_s": 3.0},
            coverage={"duration_s": 20.0},
        ),
        spacing_m=9.0,
    )
    leader, late = swarm.aircraft[1], swarm.aircraft[3]
    swarm.run(0.1)
    leader.pos_ned_m, late.pos_ned_m, late.estimates_position = (9.0, 9.0, 0.0), late_ned_m, False
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("GATHERING", limit_s=60.0, among=set(swarm.aircraft) - {3})
    while math.dist(leader.pos_ned_m, (0.0, 0.0, -up_m)) > 0.5:
        swarm.tick()
    return swarm


def least_m(swarm: Fleet, one: int, other: int, seconds: float) -> float:
    """Least distance of two within that time."""
    least = math.inf
    for _ in range(round(seconds / 0.05)):
        swarm.tick()
        least = min(least, math.dist(swarm.aircraft[one].pos_ned_m, swarm.aircraft[other].pos_ned_m))
    return least


def test_no_vehicle_takes_off_under_one_that_hovers_silent() -> None:
    swarm = gathered(4, (0.0, 0.0, 0.0))
    late = swarm.aircraft[3]
    swarm.hung.add(1)
    swarm.run(5.0)
    late.estimates_position = True
    swarm.run(10.0)
    assert Request.ARM not in late.asked
    assert late.agent.flight.waits_for == "a vehicle above"
    assert "waiting: a vehicle above" in late.said


def test_vehicle_right_under_the_leader_takes_off_when_that_one_has_left() -> None:
    swarm = gathered(3, (0.0, 0.0, 0.0))
    late = swarm.aircraft[3]
    late.estimates_position = True
    swarm.run(5.0)
    assert late.agent.flight.waits_for == "a vehicle above"
    assert least_m(swarm, 1, 3, GATHER_LIMIT_S + 20.0) >= 5.0
    assert late.state in STEERED
    assert late.altitude_m > 7.0


@pytest.mark.parametrize("off_m", [3.0, 4.2])
def test_those_that_hover_make_way_for_one_that_climbs_beside_them(off_m: float) -> None:
    swarm = gathered(3, (off_m, 0.0, 0.0))
    swarm.aircraft[3].estimates_position = True
    assert least_m(swarm, 1, 3, 12.0) >= 5.0
    assert swarm.aircraft[3].altitude_m > 7.0


@pytest.mark.parametrize("off_m", [0.1, 1.0])
def test_vehicle_that_holds_makes_way_for_one_that_lands_from_above_it(off_m: float) -> None:
    swarm = fleet()
    for vehicle in swarm.aircraft:
        swarm.order(vehicle, Order.HOLD)
    swarm.run(5.0)
    north, east, down = swarm.aircraft[1].pos_ned_m
    swarm.aircraft[2].put((north + off_m, east, down - 6.0))
    swarm.run(1.0)
    swarm.aircraft[2].battery_percent = 10
    assert least_m(swarm, 1, 2, 20.0) >= 5.0
    assert swarm.aircraft[2].state is FlightState.LANDED
