"""Orders of the operator's key in whole flights: by them alone a swarm starts, holds, goes on, lands and aborts."""

from __future__ import annotations

import math

import pytest

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.orders.order import OrderKind
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.autopilot import Link
from tests.scenario.signed_swarm import READY_S, SignedSwarm

pytestmark = pytest.mark.sources

START, HOLD, LAND, ABORT = OrderKind
IN_PHASE = ["TAKING_OFF", "GATHERING", "TRANSIT", "COVERAGE"]


def test_by_the_key_alone_a_swarm_starts_holds_goes_on_and_lands() -> None:
    swarm = SignedSwarm(4)
    swarm.until("READY", READY_S)
    for vehicle in swarm.lockstep.world.vehicles.values():  # a ground station without the key
        vehicle.autopilot.receive(Link.GROUND, operator_order(vehicle.id, dialect.MAV_CMD_MISSION_START), swarm.now_s)
    swarm.run(5.0)
    assert set(swarm.states()) == {FlightState.READY}
    swarm.order(START)
    swarm.until("TRANSIT", 60.0)
    swarm.run(3.0)
    swarm.order(HOLD)
    swarm.run(4.0)
    assert set(swarm.states()) == {FlightState.HOLD}
    assert swarm.operator.station.waits_for(swarm.now_s) == []
    places = swarm.places()
    swarm.run(140.0)  # longer than a leader may be stuck
    assert max(map(math.dist, places, swarm.places())) < 1.0
    swarm.order(START)
    swarm.run(1.0)
    assert set(swarm.states()) == {FlightState.TRANSIT}
    swarm.order(LAND)
    swarm.until("LANDED", 60.0)
    assert swarm.operator.station.waits_for(swarm.now_s) == []


@pytest.mark.parametrize("state", IN_PHASE)
def test_abort_lands_all_in_each_phase_and_no_start_takes_it_back(state: str) -> None:
    swarm = SignedSwarm(4)
    swarm.start()
    swarm.until(state, 90.0)
    swarm.run(1.0)
    swarm.order(ABORT)
    swarm.run(0.5)
    assert set(swarm.states()) <= {FlightState.LANDING, FlightState.LANDED}
    swarm.order(START)
    swarm.until("LANDED", 30.0)


def test_abort_on_the_ground_keeps_all_there() -> None:
    swarm = SignedSwarm(4)
    swarm.until("READY", READY_S)
    swarm.order(ABORT)
    swarm.run(1.0)
    swarm.order(START)
    swarm.run(10.0)
    assert set(swarm.states()) == {FlightState.READY}
    assert all(swarm.lockstep.last.on_ground)


def test_part_that_was_cut_off_gets_the_order_when_it_is_heard_again() -> None:
    swarm = SignedSwarm(5)
    swarm.start()
    swarm.until("TRANSIT", 60.0)
    radio, one = swarm.lockstep.world.radio, frozenset({4, 5})
    radio.cut_off = (one, frozenset({1, 2, 3, swarm.operator.id}))
    swarm.run(2.0)
    swarm.order(HOLD)
    swarm.run(3.0)
    held = [swarm.agent(k).swarm.operator.holds for k in range(1, 6)]
    assert held == [True, True, True, False, False]
    radio.cut_off = ()
    swarm.run(1.2)
    assert all(swarm.agent(k).swarm.operator.holds for k in range(1, 6))


def test_those_that_do_not_hear_the_operator_get_it_over_the_others() -> None:
    swarm = SignedSwarm(4)
    swarm.start()
    swarm.until("TRANSIT", 60.0)
    swarm.run(1.0)
    swarm.lockstep.world.radio.set_range(swarm.operator.id, 0.0)
    swarm.order(ABORT)
    swarm.run(1.0)
    assert FlightState.LANDING not in swarm.states()
    distances = sorted(math.dist(swarm.operator.pos_ned_m, place) for place in swarm.places())
    swarm.lockstep.world.radio.set_range(swarm.operator.id, distances[0] + 0.5)
    swarm.run(1.0)
    assert distances[1] > distances[0] + 1.0  # the others did not hear it
    assert set(swarm.states()) <= {FlightState.LANDING, FlightState.LANDED}


@pytest.mark.parametrize("forgets", [False, True])
def test_companion_started_again_in_the_air_holds_with_the_others(forgets: bool) -> None:
    swarm = SignedSwarm(4)
    swarm.start()
    swarm.until("TRANSIT", 60.0)
    swarm.order(HOLD)
    swarm.run(2.0)
    swarm.lockstep.kill(3)
    swarm.run(1.0)
    if forgets:
        swarm.keys.disks[3].kept = b""
    swarm.lockstep.join(swarm.open_companion(3))
    swarm.run(8.0)
    assert swarm.agent(3).swarm.operator.holds
    assert set(swarm.states()) == {FlightState.HOLD}


def test_vehicle_rebooted_on_the_ground_stays_there_until_a_start_names_its_new_boot() -> None:
    swarm = SignedSwarm(4, swarm={"size": 4, "start_timeout_s": 5.0})
    swarm.until("READY", READY_S)
    swarm.order(START)
    swarm.run(0.3)
    swarm.lockstep.kill(4)
    swarm.lockstep.join(swarm.open_companion(4))
    swarm.run(20.0)
    assert swarm.agent(4).flight.state is FlightState.READY
    assert swarm.agent(1).flight.state is not FlightState.READY
    swarm.order(START)
    swarm.run(3.0)
    assert swarm.agent(4).flight.state is FlightState.TAKING_OFF
