"""Agents in small fleets: what each does when something happens to it or to the others."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest
from core_fleet import Aircraft, Fleet
from core_kit import heard_beacon, lease, mission, neighbour

from companion.core.agent import TICK_S, Agent
from companion.core.failsafe import ALONE_HOLD_S, ALONE_LAND_S, NO_QUORUM_LAND_S, STALLED_S, Cause, Finding
from companion.core.movement import GATHER_MPS
from companion.core.obstacles import is_clear_below, pauses
from companion.core.peers import STALE_S
from companion.core.types import (
    ZERO,
    Ask,
    AutopilotHealth,
    AutopilotMode,
    FlightMode,
    FlightState,
    Landed,
    LandedState,
    Lease,
    OperatorOrder,
    Order,
    Position,
    Request,
    Say,
    SendBeacon,
    Sighting,
    SwarmPhase,
    VelocitySetpoint,
)
from companion.core.vec import norm
from mission.frames import Vec3

PERIOD_S = 0.1


@functools.cache
def _fleet(size: int, state: str, priority: tuple[int, ...]) -> Fleet:
    fleet = Fleet(
        mission(
            route={"d2_enu_m": (60.0, 0.0, 8.0), "at_end": "land"},
            swarm={"size": size, "leader_priority": priority},
            coverage={"duration_s": 20.0},
        )
    )
    fleet.run(2.0)
    if state != "READY":
        fleet.order(1, Order.START)
        fleet.until(state, limit_s=60.0)
        fleet.run(2.0)
    return fleet


def fleet(size: int = 3, state: str = "TRANSIT", *, priority: tuple[int, ...] = ()) -> Fleet:
    """On its way, for two seconds, by default: at full speed, vehicle 1 leading. Flown there once for all tests."""
    return deepcopy(_fleet(size, state, priority))


def asked(one: Aircraft) -> list[Request]:
    return [action.request for action in one.actions if isinstance(action, Ask)]


def setpoints(one: Aircraft) -> list[VelocitySetpoint]:
    return [action for action in one.actions if isinstance(action, VelocitySetpoint)]


def said(agent: Agent, now_s: float) -> list[str]:
    return [action.text for action in agent.tick(now_s) if isinstance(action, Say)]


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
            route={"d2_enu_m": (30.0, 0.0, 8.0), "at_end": "return"}, swarm={"size": 2}, coverage={"duration_s": 1.0}
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
    assert any(text.endswith(", without 4") for text in swarm.aircraft[1].said)


def test_leader_that_holds_does_not_take_the_swarm_on() -> None:
    """Alone at d2 with no one to hear it, it waits for the others."""
    swarm = fleet(3)
    swarm.mute |= {2, 3}
    swarm.run(2.0)
    swarm.aircraft[1].pos_ned_m = (0.0, 60.0, -8.0)
    swarm.run(3.0)
    assert swarm.aircraft[1].agent.swarm.election.acts
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.TRANSIT


@pytest.mark.parametrize(("level_m", "lands"), [(7.0, False), (8.5, True)])
def test_vehicle_lands_when_no_one_is_above_or_below(level_m: float, lands: bool) -> None:
    agent = Agent(mission(), 1)
    apart, peers = agent.mission.separation, agent.localiser.peers

    def lands_near(rel_ned_m: Vec3) -> bool:
        clear = is_clear_below([neighbour(2, rel_ned_m)], {}, soft_m=apart.soft_m, hard_m=apart.hard_m)
        return Finding(Cause.SWARM_LANDS) in agent.swarm.findings(peers, 0.0, clear_below=clear)

    assert not lands_near((100.0, 0.0, -6.0))
    agent.swarm.phases.follow(SwarmPhase.LAND, 0.0)
    assert lands_near((level_m, 0.0, -6.0)) is lands
    assert lands_near((100.0, 0.0, -6.0))


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
    swarm.run(5.0)
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
    assert "holding: no position" in leader.said
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
    assert sum("land all: ordered from the ground" in one.said for one in swarm.aircraft.values()) == 1
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
    assert swarm.aircraft[1].said.count("land all: ordered from the ground") == 1


# --- alone, or without a leader ---


def test_vehicle_that_hears_nobody_holds_and_at_last_lands_and_never_climbs() -> None:
    swarm = fleet()
    alone = swarm.aircraft[2]
    swarm.mute.add(2)
    swarm.hung |= {1, 3}
    swarm.run(STALE_S + ALONE_HOLD_S + 0.3)
    assert alone.state is FlightState.HOLD
    assert "holding: no neighbour heard" in alone.said
    height_m = alone.altitude_m
    for _ in range(round((ALONE_LAND_S - ALONE_HOLD_S - 0.5) / TICK_S)):
        swarm.tick()
        assert alone.state is FlightState.HOLD
        assert alone.altitude_m <= height_m + 0.2
    swarm.run(1.0)
    assert alone.state is FlightState.LANDING
    assert Request.LAND in alone.asked


def test_vehicle_that_hears_the_swarm_again_goes_on() -> None:
    swarm = fleet()
    swarm.mute.add(2)
    swarm.run(3.0)
    assert swarm.aircraft[2].state is FlightState.HOLD
    swarm.mute.clear()
    swarm.run(1.0)
    assert swarm.aircraft[2].state is FlightState.TRANSIT
    swarm.mute.add(2)
    swarm.run(3.0)
    assert swarm.aircraft[2].said.count("holding: no neighbour heard") == 2  # said each time, once


def test_swarm_of_one_is_never_alone() -> None:
    swarm = fleet(1)
    swarm.run(5.0)
    assert swarm.aircraft[1].state is FlightState.TRANSIT


def test_swarm_in_which_no_one_may_lead_holds() -> None:
    swarm = fleet()
    for one in swarm.aircraft.values():
        one.battery_percent = 15
    swarm.run(3.0)
    for one in swarm.aircraft.values():
        assert one.state is FlightState.HOLD
        assert norm(one.vel_ned_mps) < 0.2
        assert one.said[-1] == "holding: no leader"


# --- hung, or restarted ---


def test_agent_that_stood_still_listens_first_and_joins_again() -> None:
    swarm = fleet()
    hung = swarm.aircraft[2]
    hung.asked.clear()
    swarm.hung.add(2)
    swarm.run(2.0)
    assert hung.mode is FlightMode.HOLD  # the autopilot's own doing
    swarm.hung.clear()
    swarm.tick()
    assert "companion stalled; resynchronising" in hung.said
    assert hung.state is FlightState.WAITING
    assert setpoints(hung) == []
    assert asked(hung) == []
    swarm.until("TRANSIT", limit_s=3.0, among=[2])
    assert hung.asked == []  # PX4 goes back by itself when setpoints come


@pytest.mark.parametrize("hung", [{1}, {2}, {1, 2, 3}])
@pytest.mark.parametrize(("at_m", "for_s"), [(0.0, 0.5), (2.0, 0.5), (5.0, 8.0), (7.8, 0.5)])
def test_swarm_whose_companions_stood_still_in_the_climb_flies_its_mission(
    hung: set[int], at_m: float, for_s: float
) -> None:
    swarm = fleet(3, "READY")
    swarm.order(1, Order.START)
    climbing = [swarm.aircraft[i] for i in hung]
    while any(Request.TAKEOFF not in one.asked or one.altitude_m < at_m for one in climbing):
        swarm.tick()
    swarm.hung |= hung
    swarm.run(for_s)
    swarm.hung.clear()
    swarm.until("TRANSIT", limit_s=40.0)
    for one in climbing:
        assert "companion stalled; resynchronising" in one.said
        assert one.asked.count(Request.TAKEOFF) == 1


def test_companion_that_stood_still_in_the_climb_lands_when_ordered_to() -> None:
    swarm = fleet(3, "READY")
    swarm.order(1, Order.START)
    swarm.until("TAKING_OFF", limit_s=5.0)
    swarm.run(3.0)
    swarm.hung.add(2)
    swarm.run(1.0)
    swarm.hung.clear()
    swarm.order(3, Order.LAND_ALL)
    swarm.until("LANDED", limit_s=20.0)


def test_leader_that_stood_still_does_not_lead_at_once() -> None:
    swarm = fleet()
    swarm.hung.add(1)
    swarm.run(4.0)
    assert swarm.acting() == [2]
    swarm.hung.clear()
    for _ in range(100):
        swarm.tick()
        assert swarm.acting() == [2]


@pytest.mark.parametrize(("gap_s", "wakes"), [(STALLED_S - 0.01, False), (STALLED_S + 0.01, True)])
def test_late_tick_is_no_interruption_but_one_that_the_autopilot_may_act_upon_is(gap_s: float, wakes: bool) -> None:
    agent = Agent(mission(), 1)
    agent.tick(100.0)
    assert ("companion stalled; resynchronising" in said(agent, 100.0 + gap_s)) is wakes


def test_companion_restarted_in_the_air_joins_the_swarm_that_it_hears() -> None:
    swarm = fleet()
    restarted = swarm.aircraft[3]
    restarted.agent = Agent(swarm.mission, 3)
    restarted.mode, restarted.failsafe = FlightMode.HOLD, True
    restarted.asked.clear()
    swarm.tick()
    assert restarted.state is FlightState.WAITING
    swarm.until("TRANSIT", limit_s=4.0, among=[3])
    assert restarted.asked == []
    swarm.until("COVERAGE", limit_s=60.0)


def test_companion_that_stood_still_while_the_swarm_landed_is_not_left_hovering() -> None:
    swarm = fleet(3, "COVERAGE")
    swarm.hung.add(2)
    swarm.until("LANDED", limit_s=60.0, among=[1, 3])
    swarm.hung.clear()
    swarm.run(ALONE_LAND_S + 15.0)
    assert swarm.aircraft[2].altitude_m == 0.0
    assert Request.LAND in swarm.aircraft[2].asked


def test_companion_restarted_in_the_air_that_hears_nobody_lands_at_last() -> None:
    swarm = fleet()
    restarted = swarm.aircraft[2]
    restarted.agent = Agent(swarm.mission, 2)
    restarted.mode, restarted.failsafe = FlightMode.HOLD, True
    restarted.asked.clear()
    swarm.hung |= {1, 3}
    swarm.mute |= {1, 2, 3}
    swarm.run(ALONE_LAND_S - 1.0)
    assert restarted.asked == []
    swarm.run(15.0)
    assert restarted.altitude_m == 0.0


# --- one agent by itself ---


def fed(agent: Agent, now_s: float, *, pos: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Agent:
    """An agent whose autopilot is there and ready, on the ground."""
    agent.receive(AutopilotMode(FlightMode.HOLD, False, "AUTO.HOLD"), now_s)
    agent.receive(AutopilotHealth(True, 90), now_s)
    agent.receive(Landed(LandedState.ON_GROUND), now_s)
    agent.receive(Position(pos, ZERO), now_s)
    return agent


@pytest.mark.parametrize("vehicle_id", [0, -1, 9, 250])
def test_vehicle_that_the_mission_does_not_know_is_refused(vehicle_id: int) -> None:
    with pytest.raises(ValueError, match=rf"vehicle id {vehicle_id}: the mission has 1\.\.8"):
        Agent(mission(), vehicle_id)


@pytest.mark.parametrize(("rate_hz", "in_a_second"), [(10.0, 10), (20.0, 20), (4.0, 4), (1.0, 1)])
def test_beacons_come_at_the_missions_rate(rate_hz: float, in_a_second: int) -> None:
    agent = Agent(mission(radio={"beacon_rate_hz": rate_hz}), 1)
    beacons = []
    for k in range(40):
        fed(agent, 10.0 + k * TICK_S)
        beacons += [a for a in agent.tick(10.0 + k * TICK_S) if isinstance(a, SendBeacon)]
    assert len(beacons) == 2 * in_a_second
    times_ms = [sent.beacon.time_ms for sent in beacons]
    assert times_ms[-1] - times_ms[0] == pytest.approx((len(beacons) - 1) * 1000 / rate_hz, abs=2)


@pytest.mark.parametrize(("rate_hz", "ticks"), [(10.0, 2), (4.0, 5), (20.0, 1)])
def test_news_of_another_leader_does_not_wait_for_the_period_and_goes_once_in_it(rate_hz: float, ticks: int) -> None:
    agent = Agent(mission(radio={"beacon_rate_hz": rate_hz}, swarm={"leader_priority": (3, 2)}), 1)
    sent = []
    for k in range(2 * ticks):
        fed(agent, 10.0 + k * TICK_S)
        if k == ticks:  # heard before the tick of a period: it says so anyway
            agent.receive(heard_beacon(2, time_ms=1, lease=lease(2, 5, priority=1), route_cost=5.0), 10.0 + k * TICK_S)
        if ticks + 1 <= k:
            news = lease(3, 5 + k, priority=2, established=True)
            agent.receive(heard_beacon(3, time_ms=k, lease=news, route_cost=0.0), 10.0 + k * TICK_S)
        sent.append([a.beacon for a in agent.tick(10.0 + k * TICK_S) if isinstance(a, SendBeacon)])
    early = [1] if ticks > 1 else []
    assert [len(beacons) for beacons in sent] == [1, *[0] * (ticks - 1), 1, *early, *[0] * (ticks - 2)]
    for one in sent[ticks + 1 : ticks + 2]:
        assert one[0].lease == lease(3, 5 + ticks, priority=2, established=True)
        assert (one[0].hop, one[0].parent, one[0].agreed) == (1, 3, False)


def test_no_beacon_before_the_own_position_is_known() -> None:
    agent = Agent(mission(), 1)
    assert not any(isinstance(a, SendBeacon) for k in range(10) for a in agent.tick(10.0 + k * TICK_S))


def test_beacons_are_of_no_use_before_the_own_position_is_known() -> None:
    agent = Agent(mission(), 1)
    agent.receive(heard_beacon(2, lease=lease(2, established=True), abort=True), 10.0)
    assert agent.swarm.election.lease is None


def test_own_beacon_coming_back_is_no_neighbour() -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    agent.receive(heard_beacon(1), 10.0)
    assert agent.localiser.peers.neighbours(ZERO, 10.0) == []


def test_repeated_beacon_is_heard_once() -> None:
    agent = fed(Agent(mission(swarm={"leader_priority": (3, 2)}), 1), 10.0)
    agent.receive(heard_beacon(2, lease=lease(2, 5, priority=1)), 10.0)
    agent.receive(heard_beacon(2, lease=lease(3, 9, priority=2)), 10.1)  # the same time_ms
    assert agent.swarm.election.lease == lease(2, 5, priority=1)


@pytest.mark.parametrize("stranger", [9, 200, 0])
def test_vehicle_that_the_mission_does_not_know_is_not_heard(stranger: int) -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    agent.receive(heard_beacon(stranger, lease=lease(2, 5, established=True), start=True, abort=True), 10.0)
    assert agent.localiser.peers.neighbours(ZERO, 10.0) == []
    assert agent.swarm.election.lease is None
    agent.tick(10.0)
    (sent,) = [a.beacon for k in (1, 2) for a in agent.tick(10.0 + k * TICK_S) if isinstance(a, SendBeacon)]
    assert not sent.start
    assert not sent.abort


@pytest.mark.parametrize("forged", [lease(200, 9, priority=250), lease(9, 9), lease(2, 9, priority=3), lease(0, 9)])
def test_lease_that_is_not_the_missions_is_not_followed(forged: Lease) -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    agent.receive(heard_beacon(3, lease=replace(forged, established=True), phase=SwarmPhase.TRANSIT), 10.0)
    assert agent.swarm.election.lease is None
    assert agent.swarm.phases.phase is SwarmPhase.ASSEMBLE


def test_phase_is_believed_with_news_of_the_leader_only() -> None:
    agent = fed(Agent(mission(swarm={"leader_priority": (1,)}), 3), 10.0)
    agent.receive(heard_beacon(2, time_ms=1, lease=lease(1, 5, priority=1), phase=SwarmPhase.GATHER), 10.0)
    assert agent.swarm.phases.phase is SwarmPhase.GATHER
    agent.receive(heard_beacon(2, time_ms=2, lease=lease(1, 5, priority=1), phase=SwarmPhase.COVERAGE), 10.1)
    agent.receive(heard_beacon(2, time_ms=3, lease=None, phase=SwarmPhase.COVERAGE), 10.2)
    assert agent.swarm.phases.phase is SwarmPhase.GATHER
    agent.receive(heard_beacon(2, time_ms=4, lease=lease(1, 6, priority=1), phase=SwarmPhase.TRANSIT), 10.3)
    assert agent.swarm.phases.phase is SwarmPhase.TRANSIT


def test_done_is_collected_from_the_own_branch_in_the_same_phase() -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    child = functools.partial(heard_beacon, parent=1, route_cost=1.0)
    agent.tick(10.0)
    agent.tick(10.05)
    agent.receive(child(2, done=0b1000010), 10.1)
    agent.receive(child(3, done=0b100, phase=SwarmPhase.GATHER), 10.1)
    agent.receive(heard_beacon(4, done=0b1000, parent=9, route_cost=1.0), 10.1)
    (sent,) = [a.beacon for a in agent.tick(10.1) if isinstance(a, SendBeacon)]
    assert sent.done == 0b1000011


def test_done_of_a_vehicle_that_the_mission_does_not_know_counts_for_nothing() -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    agent.tick(10.0)
    agent.tick(10.05)
    agent.receive(heard_beacon(2, parent=1, route_cost=1.0, done=1 << 199 | 1 << 8 | 0b10), 10.1)
    (sent,) = [a.beacon for a in agent.tick(10.1) if isinstance(a, SendBeacon)]
    assert sent.done == 0b11


def test_range_is_short_on_the_way_and_full_in_coverage() -> None:
    ranges = {}
    for phase in SwarmPhase:
        agent = Agent(mission(), 1)
        agent.swarm.phases.follow(phase, 0.0)
        ranges[phase.name] = agent.swarm.range_m
    assert ranges == {
        "ASSEMBLE": 30.0,
        "GATHER": 30.0,
        "TRANSIT": 30.0,
        "COVERAGE": 55.0,
        "RETURN": 55.0,
        "LAND": 55.0,
    }


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
        told = one.agent.movement.dest_ned_m
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
    told = left.agent.movement.dest_ned_m
    assert told is not None
    assert told[1] + left.pos_ned_m[1] == pytest.approx(60.0, abs=0.5)


CRAZY: list[Callable[[Agent, float], None]] = [
    lambda agent, now_s: agent.receive(OperatorOrder(Order.START), now_s),
    lambda agent, now_s: agent.receive(OperatorOrder(Order.LAND_ALL), now_s),
    lambda agent, now_s: agent.receive(AutopilotMode(FlightMode.OTHER, True, "POSCTL"), now_s),
    lambda agent, now_s: agent.receive(Landed(LandedState.IN_AIR), now_s),
    lambda agent, now_s: agent.receive(heard_beacon(5, airborne=True, lease=lease(5, 99, established=True)), now_s),
]


@pytest.mark.parametrize("first", range(len(CRAZY)))
def test_events_in_any_order_before_the_autopilot_is_known_ask_for_nothing(first: int) -> None:
    for then in range(len(CRAZY)):
        agent = Agent(mission(), 1)
        for k in range(40):
            CRAZY[first if k % 2 else then](agent, 10.0 + k * TICK_S)
            assert all(isinstance(action, Say | SendBeacon) for action in agent.tick(10.0 + k * TICK_S))


def test_vehicle_handed_back_by_its_pilot_starts_from_rest() -> None:
    swarm = fleet(2, "TRANSIT")
    swarm.run(3.0)
    agent = swarm.aircraft[1].agent
    assert norm(agent.movement.setpoint_ned_mps) > 1.0
    agent.flight.state = FlightState.RELEASED
    agent.flight._listen()
    agent.tick(swarm.now_s + 0.05)
    assert agent.movement.setpoint_ned_mps == ZERO


def test_operator_hears_at_each_start_why_a_vehicle_is_grounded_and_once_what_was_waived() -> None:
    agent = Agent(mission(), 1)
    agent.ground("no preflight")
    agent.waive("home,battery", "waive: no check named 'bogus'")
    assert said(agent, 100.0) == ["waive: no check named 'bogus'"]
    agent.receive(OperatorOrder(Order.START), 100.05)
    assert {"grounded, no preflight", "preflight waived: home,battery"} <= set(said(agent, 100.05))
    agent.receive(OperatorOrder(Order.START), 101.05)
    assert said(agent, 101.05) == ["grounded, no preflight"]


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
    assert "vehicle 1 silent in the air: kept clear of" in swarm.aircraft[2].said


def test_one_that_never_heard_a_silent_vehicle_keeps_clear_of_it_by_what_others_tell() -> None:
    swarm = fleet(3)
    unheard = swarm.aircraft[3].agent.localiser.peers
    swarm.hung.add(1)
    unheard._heard.pop(1)
    swarm.run(4.0)
    assert list(swarm.aircraft[3].agent.localiser.silent) == [1]
    rel = swarm.aircraft[3].agent.localiser.silent[1].rel_ned_m
    there = tuple(a - b for a, b in zip(swarm.aircraft[1].pos_ned_m, swarm.aircraft[3].pos_ned_m, strict=True))
    assert rel == pytest.approx(there, abs=1.5)


def test_burst_of_losses_is_no_news_and_a_lasting_silence_is_told_once() -> None:
    swarm = fleet(3)
    text = "vehicle 3 silent in the air: kept clear of"
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
    assert "holding: no majority, without 1, 2, 3" in swarm.aircraft[4].said
    assert swarm.least_m >= 5.0


def test_part_that_holds_its_leader_but_not_the_majority_holds_too() -> None:
    swarm = fleet(5)
    swarm.apart |= {1, 2}
    swarm.until("COVERAGE", limit_s=60.0, among=[3, 4, 5])
    assert swarm.aircraft[1].state is swarm.aircraft[2].state is FlightState.HOLD
    assert "holding: no majority, without 3, 4, 5" in swarm.aircraft[1].said


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


def test_parts_of_a_swarm_in_coverage_stay_where_they_are() -> None:
    """The others' places stay taken: they may still be there."""
    swarm = fleet(5)
    swarm.until("COVERAGE", limit_s=60.0)
    swarm.run(15.0)
    before = {k: one.pos_ned_m for k, one in swarm.aircraft.items()}
    swarm.apart |= {1, 2}
    swarm.run(30.0)
    for k, one in swarm.aircraft.items():
        assert math.dist(one.pos_ned_m[:2], before[k][:2]) <= 1.5
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
    one.pos_ned_m = (0.3, 45.0, -8.0)
    swarm.aircraft[1].pos_ned_m = (25.0, 60.0, -8.0)
    one.agent.movement.wish = lambda _: (0.0, 3.0, 0.0)  # type: ignore[method-assign]
    one.agent.movement.locate = lambda *_, **__: None  # type: ignore[method-assign]
    one.agent.movement.dest_ned_m = (0.0, 300.0, 0.0)
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


def test_positions_that_come_in_bursts_are_no_velocity() -> None:
    agent = Agent(mission(), 1)
    for k in range(200):
        measured_s = 10.0 + 0.05 * k
        comes_s = 10.0 + 0.2 * (k // 4 + 1)  # four at a time
        agent.receive(Position((3.0 * measured_s, 0.0, -8.0), (3.0, 0.0, 0.0), measured_s), comes_s)
    assert norm(agent.localiser._drift.ned_mps) < 0.01


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
    assert any("no majority, without 3, 4, 5" in text for text in swarm.aircraft[1].said)
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


# --- states that must end ---


def test_swarm_of_which_all_stalled_at_once_goes_on() -> None:
    swarm = fleet(3)
    swarm.hung |= {1, 2, 3}
    swarm.run(2.0)
    swarm.hung.clear()
    swarm.until("WAITING", limit_s=2.0)
    swarm.until("TRANSIT", limit_s=20.0)
    assert len(swarm.acting()) == 1


def test_leader_flies_round_one_that_hovers_with_its_pilot_on_the_way() -> None:
    swarm = fleet(3)
    pilots = swarm.aircraft[3]
    pilots.mode = FlightMode.OTHER
    pilots.pos_ned_m = (0.2, swarm.aircraft[1].pos_ned_m[1] + 20.0, -8.0)
    pilots.vel_ned_mps = (0.0, 0.0, 0.0)
    swarm.until("COVERAGE", limit_s=60.0, among=[1, 2])
    assert swarm.least_m >= 5.0


@pytest.mark.parametrize(("told", "holds"), [(True, False), (False, True)])
def test_only_a_silence_that_was_heard_here_makes_the_swarm_pause(told: bool, holds: bool) -> None:
    """A false word, said again and again, would hold it for ever."""
    assert pauses({2: Sighting(2, (30.0, 0.0, 0.0), 0.6, silent=True, told=told)}) is holds


def test_word_of_one_beyond_reach_that_fell_silent_is_not_taken() -> None:
    swarm = fleet(3)
    agent = swarm.aircraft[1].agent
    agent.localiser.peers._heard.pop(2)
    for north_m, known in ((200.0, False), (30.0, True)):
        seen = Sighting(2, (north_m, 0.0, 0.0), 5.0, silent=True)
        ghost(swarm, 1, (5.0, -12.0, 0.0), lease=None, state=FlightState.TRANSIT, sighting=seen)
        assert (2 in agent.localiser.peers._told) is known
        swarm.now_s += 0.2


def test_silence_and_its_end_are_told() -> None:
    swarm = fleet(3)
    swarm.mute.add(3)
    swarm.run(3.0)
    swarm.mute.clear()
    swarm.run(1.0)
    said = [text for text in swarm.aircraft[1].said if text.startswith("vehicle 3")]
    assert said == ["vehicle 3 silent in the air: kept clear of", "vehicle 3 heard again"]
