"""Agents in small fleets: alone, hung, restarted, or in a state that must end."""

from __future__ import annotations

import pytest

from companion.core.agent import TICK_S, Agent
from companion.core.localisation.peer_table import STALE_S
from companion.core.localisation.silence_reports import REGAINED_S
from companion.core.model.beacon import PeerReport
from companion.core.model.states import FlightMode, FlightState, Order, Request
from companion.core.model.vectors import norm
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_fleet import Fleet, asked, fleet, setpoints
from tests.unit.core.core_kit import heard_beacon

pytestmark = pytest.mark.sources

ALONE_HOLD_S = failsafe_engine.row(Cause.NO_NEIGHBOUR).delay_s
ALONE_LAND_S = failsafe_engine.row(Cause.ALONE_LONG).delay_s


def ghost(swarm: Fleet, me: int, rel: tuple[float, float, float], **says: object) -> None:
    """A false member 3, heard by `me` with every tick."""
    agent = swarm.aircraft[me].agent
    said = heard_beacon(3, time_ms=int(swarm.now_s * 1e3), rel_ned_m=rel, airborne=True, **says)  # type: ignore[arg-type]
    agent.receive(said, swarm.now_s)


# --- alone, or without a leader ---


def test_vehicle_that_hears_nobody_holds_and_at_last_lands_and_never_climbs() -> None:
    swarm = fleet()
    alone = swarm.aircraft[2]
    swarm.mute.add(2)
    swarm.hung |= {1, 3}
    swarm.run(STALE_S + ALONE_HOLD_S + 0.3)
    assert alone.state is FlightState.HOLD
    assert "hold: no link to any peer" in alone.said
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
    assert swarm.aircraft[2].said.count("hold: no link to any peer") == 2  # said each time, once


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
        assert one.said[-1] == "hold: no leader"


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
    assert "companion stalled: resynchronising" in hung.said
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
        assert "companion stalled: resynchronising" in one.said
        assert one.asked.count(Request.TAKEOFF) == 1


def test_companion_that_stood_still_in_the_climb_lands_when_ordered_to() -> None:
    swarm = fleet(3, "READY")
    swarm.order(1, Order.START)
    swarm.until("TAKING_OFF", limit_s=5.0)
    swarm.run(3.0)
    swarm.hung.add(2)
    swarm.run(1.0)
    swarm.hung.clear()
    swarm.order(3, Order.ABORT)
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


def test_companions_started_again_where_they_are_cut_off_decide_nothing_beside_the_others() -> None:
    """They know of nobody else that took off, and were a majority of themselves (search, seed 12043)."""
    swarm = fleet(5)
    swarm.apart |= {4, 5}
    for k in (4, 5):
        restarted = swarm.aircraft[k]
        restarted.agent = Agent(swarm.mission, k)
        restarted.mode, restarted.failsafe = FlightMode.HOLD, True
    both_s = led_s = 0.0
    for _ in range(round(30.0 / TICK_S)):
        swarm.tick()
        deciding = [k for k in swarm.acting() if swarm.aircraft[k].agent.swarm.roster.may_decide(swarm.now_s)]
        both_s += TICK_S if len(deciding) > 1 else 0.0
        led_s += TICK_S if {4, 5} & set(swarm.acting()) else 0.0
    assert led_s > 10.0  # one of them leads the other, and both hold
    assert both_s == 0.0


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
    pilots.put((0.2, swarm.aircraft[1].pos_ned_m[1] + 20.0, -8.0))
    pilots.vel_ned_mps = (0.0, 0.0, 0.0)
    swarm.until("COVERAGE", limit_s=60.0, among=[1, 2])
    assert swarm.least_m >= 5.0


def test_word_of_one_beyond_reach_that_fell_silent_is_not_taken() -> None:
    swarm = fleet(3)
    agent = swarm.aircraft[1].agent
    swarm.aircraft[1].forget(2)
    for north_m, known in ((200.0, False), (30.0, True)):
        seen = PeerReport(2, (north_m, 0.0, 0.0), 5.0, silent=True)
        ghost(swarm, 1, (5.0, -12.0, 0.0), lease=None, state=FlightState.TRANSIT, sighting=seen)
        assert (2 in agent.localiser.peers._reports.vehicles()) is known
        swarm.now_s += 0.2


def test_silence_and_its_end_are_told() -> None:
    swarm = fleet(3)
    swarm.mute.add(3)
    swarm.run(3.0)
    swarm.mute.clear()
    swarm.run(REGAINED_S + 1.0)
    said = [text for text in swarm.aircraft[1].said if text.startswith("vehicle 3")]
    assert said == ["vehicle 3 link lost in the air: keeping clear", "vehicle 3 link regained"]
