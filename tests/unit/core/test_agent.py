"""One agent by itself."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import pytest

from companion.core.agent import TICK_S, Agent
from companion.core.guidance.open_sky_planner import has_just_fallen_silent
from companion.core.localisation.dead_reckoning import SILENT_S
from companion.core.model.actions import Say, SendBeacon
from companion.core.model.beacon import Lease, PeerReport
from companion.core.model.events import AutopilotHealth, AutopilotMode, Landed, OperatorOrder, Position, Satellites
from companion.core.model.neighbour import find_hover_places
from companion.core.model.states import FlightMode, FlightState, LandedState, Order, SwarmPhase
from companion.core.model.vectors import ZERO, norm
from companion.core.safety.descent import is_clear_below
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.accepted import UNSIGNED, Accepted
from companion.core.vehicle.failsafe import Cause, Finding
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3
from tests.unit.core.core_kit import heard_beacon, lease, mission, neighbour, picture

STALLED_S = failsafe_engine.row(Cause.COMPANION_STALLED).delay_s


def said(agent: Agent, now_s: float) -> list[str]:
    return [action.text for action in agent.tick(now_s) if isinstance(action, Say)]


def fed(agent: Agent, now_s: float, *, pos: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Agent:
    """An agent whose autopilot is there and ready, on the ground."""
    agent.receive(AutopilotMode(FlightMode.HOLD, False, "AUTO.HOLD", traits=PX4.traits), now_s)
    agent.receive(AutopilotHealth(True, 90), now_s)
    agent.receive(Landed(LandedState.ON_GROUND), now_s)
    agent.receive(Position(pos, ZERO), now_s)
    return agent


CRAZY: list[Callable[[Agent, float], None]] = [
    lambda agent, now_s: agent.receive(OperatorOrder(Order.START), now_s),
    lambda agent, now_s: agent.receive(OperatorOrder(Order.ABORT), now_s),
    lambda agent, now_s: agent.receive(AutopilotMode(FlightMode.OTHER, True, "POSCTL", traits=PX4.traits), now_s),
    lambda agent, now_s: agent.receive(Landed(LandedState.IN_AIR), now_s),
    lambda agent, now_s: agent.receive(heard_beacon(5, airborne=True, lease=lease(5, 99, established=True)), now_s),
]


@pytest.mark.parametrize(("level_m", "lands"), [(7.0, False), (8.5, True)])
def test_vehicle_lands_when_no_one_is_above_or_below(level_m: float, lands: bool) -> None:
    agent = Agent(mission(), 1)
    apart = agent.mission.separation

    def lands_near(rel_ned_m: Vec3) -> bool:
        clear = is_clear_below([neighbour(2, rel_ned_m)], [], soft_m=apart.soft_m, hard_m=apart.hard_m)
        return Finding(Cause.SWARM_LANDS) in agent.swarm.findings(picture(), clear_below=clear)

    assert not lands_near((100.0, 0.0, -6.0))
    agent.swarm.phases.adopt_phase(SwarmPhase.LAND, 0.0)
    assert lands_near((level_m, 0.0, -6.0)) is lands
    assert lands_near((100.0, 0.0, -6.0))


@pytest.mark.parametrize(("level_m", "lands"), [(4.5, False), (5.5, True)])
def test_vehicle_lands_where_a_silent_one_hovers_by_nobodys_word(level_m: float, lands: bool) -> None:
    silent = PeerReport(2, (100.0, 0.0, -6.0), 20.0, silent=True, elsewhere=((0.0, level_m, -6.0),))
    apart = mission().separation
    assert is_clear_below([], find_hover_places([silent]), soft_m=apart.soft_m, hard_m=apart.hard_m) is lands


@pytest.mark.parametrize(("gap_s", "wakes"), [(STALLED_S - 0.01, False), (STALLED_S + 0.01, True)])
def test_late_tick_is_no_interruption_but_one_that_the_autopilot_may_act_upon_is(gap_s: float, wakes: bool) -> None:
    agent = Agent(mission(), 1)
    agent.tick(100.0)
    assert ("companion stalled: resynchronising" in said(agent, 100.0 + gap_s)) is wakes


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


def test_range_is_short_on_the_way_and_full_about_a_tree() -> None:
    ranges = {}
    for phase in SwarmPhase:
        agent = Agent(mission(), 1)
        agent.swarm.phases.adopt_phase(phase, 0.0)
        ranges[phase.name] = agent.swarm.range_m
    assert ranges == {
        "ASSEMBLE": 30.0,
        "GATHER": 30.0,
        "TRANSIT": 30.0,
        "COVERAGE": 55.0,
        "RETURN": 30.0,
        "LAND": 55.0,
    }


@pytest.mark.parametrize("first", range(len(CRAZY)))
def test_events_in_any_order_before_the_autopilot_is_known_ask_for_nothing(first: int) -> None:
    for then in range(len(CRAZY)):
        agent = Agent(mission(), 1)
        for k in range(40):
            CRAZY[first if k % 2 else then](agent, 10.0 + k * TICK_S)
            assert all(isinstance(action, Say | SendBeacon) for action in agent.tick(10.0 + k * TICK_S))


def test_positions_that_come_in_bursts_are_no_velocity() -> None:
    agent = Agent(mission(), 1)
    for k in range(200):
        measured_s = 10.0 + 0.05 * k
        comes_s = 10.0 + 0.2 * (k // 4 + 1)  # four at a time
        agent.receive(Position((3.0 * measured_s, 0.0, -8.0), (3.0, 0.0, 0.0), measured_s), comes_s)
    assert norm(agent.localiser.velocity_bias_ned_mps) < 0.01


@pytest.mark.parametrize(("told", "holds"), [(True, False), (False, True)])
def test_only_a_silence_that_was_heard_here_makes_the_swarm_pause(told: bool, holds: bool) -> None:
    """A false word, said again and again, would hold it for ever."""
    assert has_just_fallen_silent({2: PeerReport(2, (30.0, 0.0, 0.0), 0.6, silent=True, received=told)}) is holds


def test_operator_hears_at_each_start_why_a_vehicle_is_grounded_and_once_what_was_waived() -> None:
    agent = Agent(mission(), 1)
    agent.ground("no preflight")
    agent.waive("home,battery", "waive: no check named 'bogus'")
    assert said(agent, 100.0) == ["waive: no check named 'bogus'"]
    agent.receive(OperatorOrder(Order.START), 100.05)
    assert {"grounded, no preflight", "preflight waived: home,battery"} <= set(said(agent, 100.05))
    agent.receive(OperatorOrder(Order.START), 100.10)
    assert said(agent, 100.10) == ["grounded, no preflight"]


def test_ground_is_told_each_time_a_vehicle_with_an_unsigned_radio_gets_ready() -> None:
    accepted = Accepted()
    states = [FlightState.WAITING, FlightState.READY, FlightState.READY, FlightState.WAITING, FlightState.READY]
    assert not any(accepted.texts(state, started=False) for state in states)
    accepted.accept("", unsigned=True)
    accepted.texts(FlightState.WAITING, started=False)
    told = [[say.text for say in accepted.texts(state, started=False)] for state in states]
    assert told == [[], [UNSIGNED], [], [], [UNSIGNED]]


def test_the_filter_is_told_how_far_the_own_position_may_be_off() -> None:
    agent = fed(Agent(mission(), 1), 10.0)
    assert agent._observe_surroundings(agent.observe(10.0)).error_m == 0.0
    agent.own_position._gate.off_ned_m = (0.0, 6.0, 0.0)
    assert agent._observe_surroundings(agent.observe(10.0)).error_m == pytest.approx(6.0)


def test_a_receiver_that_falls_silent_has_no_fix_but_none_is_silent_by_a_stall_of_the_companion() -> None:
    silent, stalled = Agent(mission(), 1), Agent(mission(), 1)
    until_s = 10.0 + SILENT_S + 0.5
    for agent in (silent, stalled):
        fed(agent, 10.0).receive(Satellites(used=True, sd_m=0.9), 10.0)
        agent.tick(10.0)
    for k in range(round((until_s - 10.0) / TICK_S)):
        now_s = 10.0 + TICK_S * (k + 1)
        fed(silent, now_s).tick(now_s)
    fed(stalled, until_s).tick(until_s)
    assert silent.localiser.is_fix_lost
    assert not stalled.localiser.is_fix_lost
