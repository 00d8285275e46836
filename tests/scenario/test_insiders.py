"""One member with all its own keys lies: agents in small fleets, a lie each. Nobody lands, turns back or follows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from companion.core.model.beacon import Beacon, Candidate, Lease
from companion.core.model.states import FlightState, Order, SwarmPhase
from companion.core.model.vectors import sub
from companion.core.swarm.roster import DECIDES_AFTER_S
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.core_fleet import Fleet, fleet
from tests.unit.core.core_kit import mission

pytestmark = pytest.mark.sources

FLEET = 5


def others(swarm: Fleet, liar: int) -> list[int]:
    return [k for k in swarm.aircraft if k != liar]


def phases(swarm: Fleet, among: list[int]) -> set[str]:
    return {swarm.aircraft[k].agent.swarm.phases.phase.name for k in among}


def leaders(swarm: Fleet, among: list[int]) -> set[int]:
    leases = [swarm.aircraft[k].agent.swarm.election.lease for k in among]
    return {0 if lease is None else lease.leader for lease in leases}


def announces(phase: SwarmPhase, stop: int = 0) -> Callable[[Beacon], Beacon]:
    """As news of the leader, of the next count."""

    def lie(sent: Beacon) -> Beacon:
        assert sent.lease is not None
        return replace(sent, phase=phase, stop=stop, lease=replace(sent.lease, seq=sent.lease.seq + 2))

    return lie


@pytest.mark.parametrize("phase", [SwarmPhase.LAND, SwarmPhase.RETURN, SwarmPhase.COVERAGE])
def test_a_phase_that_one_member_tells_moves_nobody(phase: SwarmPhase) -> None:
    swarm = fleet(FLEET)
    swarm.lies[3] = announces(phase)
    swarm.run(3.0)
    assert phases(swarm, others(swarm, 3)) == {"TRANSIT"}
    assert leaders(swarm, others(swarm, 3)) == {1}


def test_followers_of_a_leader_do_not_land_it_by_the_word_of_one_of_them() -> None:
    """It has joined a part that is further on when two say so."""
    swarm = fleet(FLEET)
    swarm.lies[3] = announces(SwarmPhase.LAND)
    swarm.run(1.0)
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.TRANSIT
    swarm.lies[4] = swarm.lies[3]
    swarm.run(1.0)
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.TRANSIT  # the mission has no landing so soon


@pytest.mark.parametrize("phase", [SwarmPhase.LAND, SwarmPhase.RETURN])
def test_a_leader_that_lands_the_swarm_on_its_way_is_not_followed_and_another_leads(phase: SwarmPhase) -> None:
    swarm = fleet(FLEET)
    swarm.lies[1] = lambda sent: replace(sent, phase=phase)
    swarm.run(4.0)
    among = others(swarm, 1)
    assert not phases(swarm, among) & {"LAND", "RETURN"}
    swarm.run(4.0)
    assert len(leaders(swarm, among)) == 1
    assert not leaders(swarm, among) & {0, 1}
    assert any("vehicle 1 blocked: phase is false" in text for k in among for text in swarm.aircraft[k].said)


def usurps(me: int, ref_ned_mps: Vec3) -> Callable[[Beacon], Beacon]:
    count = 100_000

    def lie(sent: Beacon) -> Beacon:
        nonlocal count
        count += 1
        lease = Lease(me, count, 0, 10, established=True)
        return replace(sent, lease=lease, hop=0, route_cost=0.0, parent=0, ref_ned_mps=ref_ned_mps, candidate=None)

    return lie


def test_one_that_says_that_it_leads_while_the_leader_is_heard_is_not_followed() -> None:
    swarm = fleet(FLEET)
    swarm.lies[3] = usurps(3, (0.0, -5.0, 0.0))
    for _ in range(60):
        swarm.tick()
        assert leaders(swarm, others(swarm, 3)) == {1}
    assert any("vehicle 3 blocked: leads unasked" in text for k in others(swarm, 3) for text in swarm.aircraft[k].said)


def test_one_that_stands_for_the_leaders_place_is_no_way_to_it() -> None:
    swarm = fleet(FLEET)
    swarm.lies[3] = lambda sent: replace(sent, route_cost=0.0, parent=0, ref_ned_mps=(0.0, -5.0, 0.0))
    swarm.run(3.0)
    for k in others(swarm, 3):
        if k != 1:
            route = swarm.aircraft[k].agent.swarm.route
            assert route.parent == 1
            assert 3 not in [n.id for n in route.up]


def test_a_course_unlike_the_leaders_is_handed_down_for_a_second_at_most() -> None:
    swarm = fleet(FLEET)
    swarm.lies[3] = lambda sent: replace(sent, route_cost=1.0, ref_ned_mps=(0.0, -5.0, 0.0))
    swarm.links = {frozenset((a, b)) for a in range(1, 6) for b in range(a) if b}
    far = swarm.aircraft[5]
    swarm.run(3.0)
    assert 3 not in [n.id for n in far.agent.swarm.route.up]


def test_a_leader_that_leads_away_from_the_mission_is_given_up() -> None:
    """By how far the followers have come themselves."""
    swarm = fleet(FLEET)
    leader = swarm.aircraft[1]
    leader.tells_mode = True
    swarm.lies[1] = lambda sent: replace(sent, ref_ned_mps=(-3.0, 0.0, 0.0))
    movement = leader.agent.movement
    guide = movement.guide

    def away(now: object, *, dt_s: float) -> object:
        return replace(guide(now, dt_s=dt_s), vel_ned_mps=(-3.0, 0.0, 0.0))  # type: ignore[arg-type]

    movement.guide = away  # type: ignore[method-assign, assignment]
    swarm.run(30.0)
    among = others(swarm, 1)
    assert 1 not in leaders(swarm, among)
    assert any("vehicle 1 blocked: leaves the way" in text for k in among for text in swarm.aircraft[k].said)


def test_a_false_way_to_the_next_tree_told_for_a_second_costs_no_leader_its_lead() -> None:
    """By it the way would lead back, and the leader would be given up for the way of the mission."""
    swarm = Fleet(
        mission(
            route={"stops": [{"pos_enu_m": (40.0, 0.0, 8.0), "duration_s": 2.0}], "d2_enu_m": (40.0, 130.0, 8.0)},
            swarm={"size": 3},
        )
    )
    began_s: list[float] = []

    def lie(sent: Beacon) -> Beacon:
        if sent.phase is not SwarmPhase.TRANSIT or sent.stop == 0 or sent.dest_ned_m is None:
            return sent
        began_s.append(swarm.now_s)
        dest = sub(sent.dest_ned_m, (400.0, 0.0, 0.0)) if swarm.now_s - began_s[0] <= 1.1 else sent.dest_ned_m
        return replace(sent, dest_ned_m=dest, route_cost=1.0)

    swarm.lies[2] = lie
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=90.0)
    swarm.until("COVERAGE", limit_s=90.0)
    swarm.until("TRANSIT", limit_s=60.0)
    told = swarm.aircraft[3].agent.localiser.destination
    for _ in range(40):
        swarm.tick()
        assert told.ned_m is not None
        true = sub(enu_to_ned((40.0, 130.0, 8.0)), swarm.aircraft[3].pos_ned_m)
        assert math.dist(told.ned_m, true) <= 5.0
    swarm.until("COVERAGE", limit_s=120.0)
    assert leaders(swarm, [1, 3]) == {1}
    assert not any("leaves the way" in text for k in swarm.aircraft for text in swarm.aircraft[k].said)


def test_one_that_allows_no_speed_holds_the_swarm_for_half_a_minute() -> None:
    swarm = fleet(FLEET)
    swarm.lies[3] = lambda sent: replace(sent, governor=0.0, parent=1, route_cost=50.0)
    swarm.run(10.0)
    assert swarm.aircraft[1].agent.swarm.governor == 0.0
    swarm.run(25.0)
    assert swarm.aircraft[1].agent.swarm.governor > 0.0


def test_one_that_is_proven_to_lie_counts_for_separation_alone() -> None:
    swarm = fleet(FLEET)
    for k in others(swarm, 1):
        swarm.aircraft[k].agent.swarm.block(1, "equivocates")
    swarm.run(6.0)
    among = others(swarm, 1)
    assert not leaders(swarm, among) & {0, 1}
    for k in among:
        one = swarm.aircraft[k].agent
        assert 1 in [n.id for n in one.localiser.neighbours]
        assert 1 not in [n.id for n in one.swarm.route.up]
    swarm.run(70.0)  # for good
    assert 1 not in leaders(swarm, among)


def test_a_blocked_leader_is_given_up_at_once_and_not_taken_from_those_that_follow_it() -> None:
    swarm = fleet(FLEET)
    one = swarm.aircraft[2].agent.swarm
    one.block(1, "equivocates")
    for _ in range(60):
        swarm.run(0.1)
        assert one.election.lease is None or one.election.lease.leader != 1
    assert leaders(swarm, [3, 4, 5]) == {1}


def test_a_relay_tells_no_count_that_the_leader_cannot_have_come_to() -> None:
    swarm = fleet(FLEET)

    def lie(sent: Beacon) -> Beacon:
        assert sent.lease is not None
        return replace(sent, lease=replace(sent.lease, seq=sent.lease.seq + 500, heir=3, ends=sent.lease.seq + 505))

    swarm.lies[3] = lie
    leader, one = (swarm.aircraft[k].agent.swarm.election for k in (1, 5))
    for _ in range(20):
        swarm.tick()
        assert leader.lease is not None
        assert one.lease is not None
        assert one.lease.seq <= leader.lease.seq  # which outcounts what it hears itself
        assert one.lease.ends == 0


@pytest.mark.parametrize("near_m", [0.5, 2.0, 4.0])
def test_one_that_claims_to_fly_at_others_brings_none_together(near_m: float) -> None:
    """It stands where it leads one to its nearest other."""
    swarm = Fleet(
        mission(
            route={"d2_enu_m": (40.0, 0.0, 8.0), "at_end": "return"},
            swarm={"size": 4},
            coverage={"duration_s": 10.0},
        )
    )
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=60.0)
    true_tick, least_m = swarm.tick, math.inf

    def lie(sent: Beacon) -> Beacon:
        return replace(sent, vel_ned_mps=(0.0, 5.0, 0.0))

    swarm.lies[4] = lie
    for _ in range(20 * 20):
        places = {k: one.pos_ned_m for k, one in swarm.aircraft.items() if k != 4}
        aim = min(places, key=lambda k: places[k][1])
        there = places[aim]
        swarm._under_way = [
            ((there[0], there[1] - near_m, there[2]) if beacon.sender == 4 else place, beacon)
            for place, beacon in swarm._under_way
        ]
        true_tick()
        least_m = min([least_m, *[math.dist(places[a], places[b]) for a in places for b in places if a < b]])
    assert least_m > 4.0


def longest_lead_s(swarm: Fleet, among: list[int], seconds: float) -> float:
    """Of one of them without a break."""
    longest, since, before = 0, 0, None
    for _ in range(round(20 * seconds)):
        swarm.tick()
        acting = [k for k in swarm.acting() if k in among]
        since = since + 1 if acting and acting == before else 0
        before = acting
        longest = max(longest, since)
    return longest / 20.0


def test_an_heir_that_is_not_there_takes_the_lead_once_and_the_mission_goes_on() -> None:
    swarm = fleet(FLEET, priority=(1,))
    swarm.hung.add(1)
    swarm.lies[3] = lambda sent: replace(sent, candidate=Candidate(1, 1, 10))
    among = [2, 4, 5]
    assert longest_lead_s(swarm, among, 60.0) > 30.0
    swarm.until("LANDED", limit_s=300.0, among=among)


def test_a_lead_is_handed_over_to_one_that_is_there_whatever_became_of_others() -> None:
    """Another, which was gone, was named in vain before."""
    swarm = fleet(FLEET, priority=(2, 1))
    swarm.hung |= {1, 2}
    swarm.lies[3] = lambda sent: replace(sent, candidate=Candidate(2, 2, 10))
    swarm.run(20.0)
    del swarm.lies[3]
    assert not leaders(swarm, [4, 5]) & {0, 1, 2}
    swarm.hung.discard(1)
    swarm.run(10.0)
    assert leaders(swarm, [3, 4, 5]) == {1}


# --- which are here, and which have done what the phase asks ---


def everyone(size: int, *fields: str) -> Callable[[Beacon], Beacon]:
    """It says of all that they are here, or have done what the phase asks."""
    return lambda sent: replace(sent, **dict.fromkeys(fields, (1 << size) - 1))


def test_one_member_makes_no_majority_of_a_part_without_it() -> None:
    swarm = fleet(8)
    swarm.lies[2] = everyone(8, "present", "done")
    swarm.apart |= {1, 2, 3}
    swarm.run(1.4 + DECIDES_AFTER_S)  # sooner no other one decides
    for _ in range(400):
        swarm.tick()
        for k in (1, 3):
            one = swarm.aircraft[k]
            lease = one.agent.swarm.election.lease
            assert lease is None or not lease.quorum
            assert one.state is FlightState.HOLD


def test_a_chain_goes_on_by_the_word_of_the_one_neighbour_that_its_leader_hears() -> None:
    swarm = fleet(FLEET)
    swarm.links = {frozenset((k, k + 1)) for k in range(1, FLEET)}
    for one in swarm.aircraft.values():  # they have never heard the others
        for k in swarm.aircraft:
            if abs(k - one.id) > 1:
                one.forget(k)
    swarm.run(10.0)
    assert leaders(swarm, [*swarm.aircraft]) == {1}
    leader = swarm.aircraft[1].agent
    assert leader.swarm.election.lease is not None
    assert leader.swarm.election.lease.quorum
    assert [n.id for n in leader.localiser.neighbours] == [2]
    assert leader.swarm.roster.present == 0b11111


def test_one_member_does_not_have_a_straggler_done_that_the_others_hear() -> None:
    swarm = fleet(FLEET, "READY")
    swarm.aircraft[5].can_arm = False
    swarm.lies[3] = everyone(FLEET, "done")
    swarm.order(1, Order.START)
    swarm.run(30.0)
    assert phases(swarm, [1]) == {"GATHER"}


def test_a_chain_that_is_cut_has_one_majority_by_what_each_hears_over_one_neighbour() -> None:
    """Why one member's word is enough that a vehicle has taken off: nobody else tells of those behind it."""
    swarm = Fleet(mission(route={"d2_enu_m": (200.0, 0.0, 8.0), "at_end": "land"}, swarm={"size": 8}))
    swarm.links = {frozenset((k, k + 1)) for k in range(1, 8)}
    swarm.run(4.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=90.0)
    swarm.links.discard(frozenset((5, 6)))
    swarm.run(8.0)
    for _ in range(100):
        swarm.tick()
        quorums = [lease.quorum for k in (1, 6) if (lease := swarm.aircraft[k].agent.swarm.election.lease)]
        assert quorums == [True, False]
