"""Agents in small fleets: whole flights, and what happens when the leader is lost or some cannot go on."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from companion.core.agent import TICK_S
from companion.core.guidance.movement import GATHER_MPS
from companion.core.model.actions import SendBeacon
from companion.core.model.states import FlightMode, FlightState, Order, Request, SwarmPhase
from companion.core.model.vectors import ZERO, norm
from companion.core.swarm.partition import WAIT_OPEN_S
from tests.unit.core.core_fleet import Fleet, fleet, setpoints
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

PERIOD_S = 0.1


# --- whole flights ---


@pytest.mark.parametrize("size", [1, 3])
def test_swarm_flies_its_mission_and_lands_apart(size: int) -> None:
    swarm = fleet(size, "READY")
    swarm.order(size, Order.START)
    for state in ("GATHERING", "TRANSIT", "COVERAGE", "LANDED"):
        swarm.until(state, limit_s=60.0)
        assert swarm.acting() == ([1] if state != "LANDED" else [])
    assert size == 1 or swarm.least_m >= 5.0
    for one in swarm.aircraft.values():
        assert math.hypot(one.pos_ned_m[0], one.pos_ned_m[1] - 60.0) == pytest.approx(15.0, abs=6.0)
        assert set(one.asked) == {Request.ARM, Request.TAKEOFF, Request.OFFBOARD, Request.LAND}


def test_swarm_that_is_to_return_lands_at_its_deployment() -> None:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (30.0, 0.0, 8.0), "at_end": "return"}, swarm={"size": 2}, coverage={"duration_s": 0.0}
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("LANDED", limit_s=150.0)
    assert all(math.hypot(*one.pos_ned_m) < 20.0 for one in swarm.aircraft.values())


def test_swarm_in_open_sky_spreads_over_a_sphere() -> None:
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (40.0, 0.0, 25.0), "d1_enu_m": (0.0, 0.0, 20.0)},
            swarm={"size": 4},
            coverage={"shape": "sphere", "radius_m": 15.0, "duration_s": 600.0},
            fence={"altitude_max_m": 60.0},
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("COVERAGE", limit_s=90.0)
    swarm.run(40.0)
    places = [one.pos_ned_m for one in swarm.aircraft.values()]
    assert [math.dist(p, (0.0, 40.0, -25.0)) for p in places] == pytest.approx([15.0] * 4, abs=0.5)
    assert min(math.dist(a, b) for a, b in itertools.combinations(places, 2)) > 20.0
    assert max(p[2] for p in places) - min(p[2] for p in places) > 8.0


def test_leader_says_whom_it_departs_without() -> None:
    swarm = Fleet(mission(swarm={"size": 5, "start_timeout_s": 3.0}))
    swarm.hung.add(4)
    swarm.mute.add(4)
    swarm.run(3.0)
    swarm.order(1, Order.START)
    swarm.run(5.0)
    assert any(text == "swarm goes on without 4" for text in swarm.aircraft[1].said)


def test_leader_that_holds_does_not_take_the_swarm_on() -> None:
    """Alone at d2 with no one to hear it, it waits for the others."""
    swarm = fleet(3)
    swarm.mute |= {2, 3}
    swarm.run(2.0)
    swarm.aircraft[1].put((0.0, 60.0, -8.0))
    swarm.run(3.0)
    assert swarm.aircraft[1].agent.swarm.election.acts
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.TRANSIT


def test_same_events_give_the_same_actions() -> None:
    flights = []
    for _ in range(2):
        swarm = Fleet(mission(route={"d2_enu_m": (30.0, 0.0, 8.0)}, swarm={"size": 3}))
        swarm.run(2.0)
        swarm.order(1, Order.START)
        actions: list[Any] = []
        for _ in range(250):
            swarm.tick()
            actions += [one.actions for one in swarm.aircraft.values()]
        flights.append(actions)
    assert flights[0] == flights[1]


# --- the leader is lost ---


def test_follower_leads_after_leader_falls_silent() -> None:
    swarm = fleet()
    swarm.mute.add(1)
    swarm.run(25 * PERIOD_S)
    assert swarm.acting() == [1, 2]  # 1 does not know, and holds for want of neighbours
    assert swarm.aircraft[1].state is FlightState.HOLD
    assert "leader: vehicle 2 (this one)" in swarm.aircraft[2].said
    assert "leader: vehicle 2" in swarm.aircraft[3].said
    swarm.until("COVERAGE", limit_s=60.0, among=[2, 3])


def test_swarm_without_a_leader_slows_down_until_one_acts() -> None:
    swarm = fleet()
    follower = swarm.aircraft[3]
    assert norm(follower.vel_ned_mps) > 2.0
    swarm.mute.add(1)
    while 2 not in swarm.acting():
        swarm.tick()
    swarm.run(PERIOD_S)
    assert norm(follower.vel_ned_mps) < 1.2
    swarm.run(WAIT_OPEN_S + 5.0)  # it waits for the one that is lost
    assert norm(follower.vel_ned_mps) > 1.5


def test_returned_leader_follows_the_new_one() -> None:
    """Both are established, and 1 has the lower id: the swarm goes back to it, with one leader all told."""
    swarm = fleet()
    swarm.mute.add(1)
    swarm.run(4.0)
    swarm.mute.clear()
    swarm.run(1.0)
    assert len(swarm.acting()) == 1
    swarm.until("COVERAGE", limit_s=60.0)


@pytest.mark.parametrize(("percent", "hands_over"), [(49, True), (70, False), (90, False)])
def test_reelection_in_flight_changes_the_leader_without_gap_or_overlap(percent: int, hands_over: bool) -> None:
    swarm = Fleet(mission(swarm={"size": 3, "reelection_period_s": 5.0}))
    swarm.run(3.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    swarm.run(2.0)
    for one in swarm.aircraft.values():
        one.battery_percent = 78
    swarm.aircraft[1].battery_percent = percent
    for _ in range(round(12.0 / TICK_S)):
        swarm.tick()
        assert len(swarm.acting()) == 1
    assert swarm.acting() == [2 if hands_over else 1]
    assert norm(swarm.aircraft[3].vel_ned_mps) > 2.5  # nobody has slowed down for it


@pytest.mark.parametrize("percent", [19, 11])
def test_leader_with_low_battery_resigns(percent: int) -> None:
    swarm = fleet()
    swarm.aircraft[1].battery_percent = percent
    swarm.run(25 * PERIOD_S)
    assert swarm.acting() == [2]
    assert swarm.aircraft[1].state is FlightState.TRANSIT  # it follows


@pytest.mark.parametrize("percent", [10, 3, 0])
def test_vehicle_with_a_nearly_empty_battery_lands_where_it_is(percent: int) -> None:
    swarm = fleet()
    spent = swarm.aircraft[1]
    spent.battery_percent = percent
    swarm.tick()
    assert spent.state is FlightState.LANDING
    swarm.until("LANDED", limit_s=10.0, among=[1])
    swarm.until("COVERAGE", limit_s=60.0, among=[2, 3])


@pytest.mark.parametrize("percent", [20, 100, None])
def test_leader_with_enough_or_unknown_battery_stays(percent: int | None) -> None:
    swarm = fleet()
    swarm.aircraft[1].battery_percent = percent
    swarm.run(25 * PERIOD_S)
    assert swarm.acting() == [1]


def test_leader_that_loses_its_position_resigns_and_holds() -> None:
    swarm = fleet()
    leader = swarm.aircraft[1]
    leader.estimates_position = False
    swarm.run(1.0)
    assert leader.state is FlightState.HOLD
    swarm.run(1.0)
    assert not leader.agent.swarm.election.leads
    assert "hold: position lost" in leader.said
    swarm.run(2.0)
    assert norm(leader.vel_ned_mps) < 0.2
    assert swarm.acting() == [2]


def test_predetermined_leader_leads_from_the_start() -> None:
    swarm = fleet(3, "READY", priority=(3, 2))
    assert swarm.acting() == [3]
    swarm.hung.add(3)
    swarm.run(25 * PERIOD_S)
    assert swarm.acting() == [2]


def test_leader_goes_slowly_through_those_that_have_just_taken_off() -> None:
    swarm = fleet(1, "READY")
    leader = swarm.aircraft[1]
    leader.pos_ned_m = (20.0, 0.0, 0.0)
    swarm.order(1, Order.START)
    swarm.until("GATHERING", limit_s=30.0)
    fastest_mps = 0.0
    while leader.state is FlightState.GATHERING:
        swarm.tick()
        fastest_mps = max(fastest_mps, math.hypot(*leader.vel_ned_mps))
    assert fastest_mps == pytest.approx(GATHER_MPS, abs=0.05)
    swarm.run(5.0)
    assert math.hypot(*leader.vel_ned_mps) > 2.0


# --- some cannot go on ---


def test_vehicle_that_cannot_arm_does_not_hold_up_the_majority() -> None:
    swarm = Fleet(mission(route={"d2_enu_m": (40.0, 0.0, 8.0)}, swarm={"size": 3}))
    swarm.aircraft[3].can_arm = False
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("COVERAGE", limit_s=150.0, among=[1, 2])
    assert swarm.aircraft[3].altitude_m == 0.0


def test_vehicle_left_hovering_by_its_pilot_does_not_hold_up_the_others() -> None:
    swarm = fleet()
    swarm.aircraft[2].mode = FlightMode.OTHER
    swarm.until("COVERAGE", limit_s=100.0, among=[1, 3])


def test_vehicle_on_the_ground_does_not_take_the_lead_of_a_swarm_in_the_air() -> None:
    """Though the mission has it lead first."""
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (100.0, 0.0, 8.0)}, swarm={"size": 3, "leader_priority": (3,), "start_timeout_s": 5.0}
        )
    )
    swarm.aircraft[3].can_arm = False
    swarm.hung.add(3)
    swarm.mute.add(3)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=100.0, among=[1, 2])
    swarm.run(3.0)
    swarm.hung.clear()
    swarm.mute.clear()
    swarm.run(5.0)
    assert swarm.acting() == [1]


def test_vehicle_that_is_not_steered_hands_down_no_reference() -> None:
    swarm = fleet()
    swarm.aircraft[1].mode = FlightMode.OTHER
    swarm.run(5.0)
    sent = []
    for _ in range(2):
        swarm.tick()
        sent += [a.beacon.ref_ned_mps for a in swarm.aircraft[1].actions if isinstance(a, SendBeacon)]
    assert sent == [ZERO]


def test_missing_have_their_time_though_the_start_is_ordered_at_once() -> None:
    swarm = Fleet(mission(swarm={"size": 3, "start_timeout_s": 10.0}))
    swarm.hung.add(3)
    swarm.mute.add(3)
    swarm.order(1, Order.START)
    swarm.run(10.0)
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.ASSEMBLE
    swarm.until("TAKING_OFF", limit_s=5.0, among=[1, 2])


# --- what each knows ---


def test_vehicles_face_the_way_in_transit_and_the_tree_in_coverage() -> None:
    swarm = fleet()
    assert [setpoints(one)[0].yaw_rad for one in swarm.aircraft.values()] == pytest.approx([math.pi / 2] * 3, abs=0.1)
    swarm = fleet(3, "COVERAGE")
    for one in swarm.aircraft.values():
        to_tree = math.atan2(60.0 - one.pos_ned_m[1], -one.pos_ned_m[0])
        assert math.cos(setpoints(one)[0].yaw_rad - to_tree) == pytest.approx(1.0, abs=0.01)


def test_everyone_knows_where_the_tree_is_by_word_of_the_leader() -> None:
    swarm = fleet()
    swarm.run(1.0)
    for one in swarm.aircraft.values():
        told = one.agent.localiser.destination.ned_m
        assert told is not None
        north, east, _ = told
        assert (north + one.pos_ned_m[0], east + one.pos_ned_m[1]) == pytest.approx((0.0, 60.0), abs=0.5)


def test_where_the_tree_is_stays_known_by_odometry_when_the_leader_is_lost() -> None:
    swarm = fleet(2)
    swarm.mute.add(1)
    left = swarm.aircraft[2]
    at_m = left.pos_ned_m[1]
    swarm.run(1.3)
    assert not left.agent.swarm.election.acts
    assert left.pos_ned_m[1] - at_m > 1.0
    told = left.agent.localiser.destination.ned_m
    assert told is not None
    assert told[1] + left.pos_ned_m[1] == pytest.approx(60.0, abs=0.5)


def test_vehicle_handed_back_by_its_pilot_starts_from_rest() -> None:
    swarm = fleet(2, "TRANSIT")
    swarm.run(3.0)
    agent = swarm.aircraft[1].agent
    assert norm(agent.setpoint.vel_ned_mps) > 1.0
    agent.flight.state = FlightState.RELEASED
    agent.flight._listen()
    agent.tick(swarm.now_s + 0.05)
    assert agent.setpoint.vel_ned_mps == ZERO
