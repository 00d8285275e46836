"""How far a member's word goes: blocklist, phase gate, claims to lead, and what is handed down."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.model.beacon import NO_ROUTE, Lease
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import SwarmPhase
from companion.core.swarm.election import Election
from companion.core.swarm.phases import Phases
from companion.core.swarm.priorities import Priorities
from companion.core.swarm.trust.blocklist import BLOCKED_S, DOUBT_LIMIT, Blocklist, strip_beacon
from companion.core.swarm.trust.lead_watch import LeadWatch
from companion.core.swarm.trust.phase_gate import PhaseGate
from companion.core.swarm.trust.relay_watch import LEAST_COST, breaks_route, find_contradicting
from companion.core.swarm.trust.trust import Trust
from mission.document.model import Mission
from tests.unit.core.core_election_kit import follower_of
from tests.unit.core.core_kit import beacon, lease, mission, neighbour

pytestmark = pytest.mark.sources

MISSION = mission(swarm={"size": 6}, route={"at_end": "land"}, coverage={"duration_s": 20.0})


def test_doubts_block_for_a_while_and_fade() -> None:
    blocked = Blocklist(6)
    for _ in range(int(DOUBT_LIMIT) - 1):
        blocked.note_doubt(3, "lies", 1.0, 10.0)
    assert not blocked.has(3)
    blocked.note_doubt(3, "lies", 1.0, 10.0)
    assert blocked.has(3)
    assert blocked.take_news() == [(3, "lies")]
    assert blocked.bits() == 0b100
    blocked.fade(10.0 + BLOCKED_S)
    assert blocked.has(3)
    blocked.fade(10.1 + BLOCKED_S)
    assert not blocked.has(3)


def test_what_contradicts_now_and_then_is_let_go() -> None:
    blocked = Blocklist(6)
    for k in range(1000):
        if k % 20 == 0:
            blocked.note_doubt(3, "lies", 1.0, 0.1 * k)
        blocked.fade(0.1 * k)
    assert not blocked.has(3)


def test_one_that_contradicts_many_doubts_a_third_of_the_swarm_at_most() -> None:
    blocked = Blocklist(7)
    for vehicle in range(2, 8):
        blocked.note_doubt(vehicle, "lies", DOUBT_LIMIT, 1.0)
    assert sum(blocked.has(vehicle) for vehicle in range(1, 8)) == 2
    blocked.block(7, "equivocates")  # a proof is one, whatever else is doubted
    assert blocked.has(7)


def test_a_blocked_members_beacon_tells_where_it_is_and_no_more() -> None:
    said = beacon(
        3, lease=lease(3), route_cost=0.0, abort=True, start=True, phase=SwarmPhase.LAND, flown=7, governor=0.0
    )
    left = strip_beacon(said)
    assert (left.sender, left.time_ms, left.vel_ned_mps, left.state) == (3, said.time_ms, said.vel_ned_mps, said.state)
    assert (left.lease, left.route_cost, left.abort, left.start, left.flown) == (None, NO_ROUTE, False, False, 0)
    assert (left.phase, left.governor) == (SwarmPhase.ASSEMBLE, 1.0)


# --- phases ---


def on_the_way(flies: Mission = MISSION, phase: SwarmPhase = SwarmPhase.TRANSIT) -> tuple[PhaseGate, Phases]:
    """A follower that has seen each phase begin, the last at 0 s."""
    phases = Phases(flies)
    for one in range(SwarmPhase.GATHER, phase + 1):
        phases.adopt_phase(SwarmPhase(one), 0.0)
    return PhaseGate(flies, 5), phases


@pytest.mark.parametrize(
    ("told", "believed"),
    [
        ([(1, 0)], True),  # its leader's own
        ([(2, 1)], True),  # the one way to it
        ([(1, None), (2, 1)], False),  # the leader is heard, and says nothing of it
        ([(2, 1), (3, None)], False),  # two ways, and one says so
        ([(2, 1), (3, 1)], True),
        ([(1, None), (2, 1), (3, 1)], True),
    ],
)
def test_a_phase_is_its_leaders_to_announce(told: list[tuple[int, int | None]], believed: bool) -> None:
    gate, phases = on_the_way()
    for sender, hop in told:
        phase = SwarmPhase.TRANSIT if hop is None else SwarmPhase.COVERAGE
        said = beacon(
            sender, phase=phase, lease=lease(1, 7, established=True), hop=hop or 0 if sender == 1 else 1, route_cost=1.0
        )
        gate.store(said, 1.0)
    said = beacon(told[-1][0], phase=SwarmPhase.COVERAGE, lease=lease(1, 7, established=True), hop=1, route_cost=1.0)
    if told[-1][1] is None:
        said = beacon(told[0][0], phase=SwarmPhase.COVERAGE, lease=lease(1, 7, established=True), hop=1)
    found = gate.is_believed(said, phases, 2, 1.0, is_news=True)
    assert found is believed


@pytest.mark.parametrize(
    ("phase", "following", "after_s", "believed"),
    [
        (SwarmPhase.TRANSIT, SwarmPhase.RETURN, 1e3, False),  # all have satellites: none turns back
        (SwarmPhase.TRANSIT, SwarmPhase.LAND, 90.0, False),
        (SwarmPhase.TRANSIT, SwarmPhase.LAND, 100.0, True),  # a leader is stuck by then
        (SwarmPhase.COVERAGE, SwarmPhase.LAND, 14.0, False),
        (SwarmPhase.COVERAGE, SwarmPhase.LAND, 20.0, True),
        (SwarmPhase.COVERAGE, SwarmPhase.RETURN, 20.0, False),  # it ends there
        (SwarmPhase.GATHER, SwarmPhase.LAND, 30.0, False),
    ],
)
def test_even_a_leader_takes_no_step_that_the_mission_does_not_have(
    phase: SwarmPhase, following: SwarmPhase, after_s: float, believed: bool
) -> None:
    gate, phases = on_the_way(phase=phase)
    said = beacon(1, phase=following, lease=lease(1, 7, established=True), hop=0)
    gate.store(said, after_s)
    assert gate.is_believed(said, phases, 1, after_s, is_news=True) is believed


@pytest.mark.parametrize(("after_s", "believed"), [(5.0, False), (6.9, False), (7.1, True), (14.0, True)])
def test_a_leader_may_leave_a_tree_early_where_the_mission_has_until_and_not_before_its_least_time(
    after_s: float, believed: bool
) -> None:
    flies = mission(
        swarm={"size": 6},
        route={"at_end": "land"},
        coverage={"duration_s": 60.0},
        sensing={"sensor": "scan-1deg"},
        survey={"until": {"basal_area_pct": 10.0, "after_s": 10.0}},
    )
    gate, phases = on_the_way(flies, SwarmPhase.COVERAGE)
    said = beacon(1, phase=SwarmPhase.LAND, lease=lease(1, 7, established=True), hop=0)
    gate.store(said, after_s)
    assert gate.is_believed(said, phases, 1, after_s, is_news=True) is believed
    assert gate.is_foul(said, phases, after_s) is not believed


def test_while_an_operator_holds_it_no_leader_is_late_and_none_too_soon() -> None:
    """It may be the only one that is held: a leader that was not has counted that time, too."""
    gate, phases = on_the_way(phase=SwarmPhase.COVERAGE)
    watch, here = LeadWatch(MISSION), (0.0, 0.0, 0.0)
    phases.obey(1.0, holds=False, lands=False)
    phases.obey(501.0, holds=True, lands=False)
    assert watch.find_fault(here, None, phases, 501.0, leader=0) == ""
    assert watch.find_fault(here, None, phases, 502.0, leader=1) == ""
    assert gate.is_possible(SwarmPhase.LAND, 0, phases, 502.0)
    phases.adopt_phase(SwarmPhase.LAND, 502.0)
    assert (phases.elapsed_s(503.0), phases.most_elapsed_s(503.0)) == (1.0, 1.0)  # a hold before counts for nothing
    _, phases = on_the_way(phase=SwarmPhase.COVERAGE)
    assert watch.find_fault(here, None, phases, 501.0, leader=1) == "covers too long"


def test_a_leader_and_another_that_land_at_once_may_have_been_ordered_to() -> None:
    gate, phases = on_the_way()
    for sender, believed in ((2, False), (3, False), (1, True)):
        said = beacon(sender, phase=SwarmPhase.LAND, lease=lease(1, 7, established=True), hop=0 if sender == 1 else 1)
        gate.store(said, 1.0)
        assert gate.is_believed(said, phases, 2, 1.0, is_news=True) is believed


def test_who_has_joined_late_knows_no_times() -> None:
    phases = Phases(MISSION)
    phases.adopt_phase(SwarmPhase.COVERAGE, 0.0)
    gate = PhaseGate(MISSION, 5)
    said = beacon(1, phase=SwarmPhase.LAND, lease=lease(1, 7, established=True), hop=0)
    gate.store(said, 1.0)
    assert gate.is_believed(said, phases, 1, 1.0, is_news=True)


def test_a_swarm_that_returns_lands_where_it_set_out() -> None:
    """By the own odometry."""
    flies = mission(swarm={"size": 6}, route={"at_end": "return"}, coverage={"duration_s": 20.0})
    gate, phases = on_the_way(flies, SwarmPhase.RETURN)
    gate.note_position((5.0, 0.0, -8.0), SwarmPhase.GATHER)
    gate.note_position((125.0, 0.0, -8.0), SwarmPhase.COVERAGE)
    said = beacon(1, phase=SwarmPhase.LAND, lease=lease(1, 7, established=True), hop=0)
    gate.store(said, 9.0)
    assert not gate.is_believed(said, phases, 1, 9.0, is_news=True)
    gate.note_position((20.0, 0.0, -8.0), SwarmPhase.RETURN)
    assert gate.is_believed(said, phases, 1, 9.0, is_news=True)


# --- who leads, and what is handed down ---


def test_one_that_is_heard_to_follow_does_not_come_to_lead_but_by_hand_over() -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    claim = beacon(3, lease=Lease(3, 900, 0, 10, established=True))
    watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert not watch.note_claim(claim, election, 1.1)
    assert not watch.may_lead(3)
    assert watch.note_claim(beacon(3, lease=lease(1, 502, established=True)), election, 1.2)
    assert watch.may_lead(3)


def test_one_that_was_not_heard_meanwhile_may_come_from_another_part() -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert watch.note_claim(beacon(3, lease=Lease(3, 900, 0, 10, established=True)), election, 3.0)


def test_of_a_part_without_the_majority_another_may_come_to_lead() -> None:
    """Found by exploration: a leader that was cut off with nobody comes back when the others have just elected."""
    alone = Lease(1, 500, 0, 0, True, quorum=False)
    watch, election = LeadWatch(MISSION), follower_of(alone)
    watch.note_claim(beacon(3, lease=lease(3, 900)), election, 1.0)
    assert watch.note_claim(beacon(3, lease=Lease(3, 901, 0, 10, established=True)), election, 1.1)
    assert watch.may_lead(3)


def test_where_none_led_a_moment_ago_two_may_have_come_to_lead_at_once() -> None:
    """Found by exploration: one started again claims, and so does the heir that the others know; both have patience."""
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500))
    watch.note_claim(beacon(3, lease=lease(3, 900)), election, 1.0)
    assert election.receive_lease(lease(1, 501, established=True), 0)
    second = beacon(3, lease=Lease(3, 901, 0, 10, established=True))
    assert watch.note_claim(second, election, 1.1)
    watch.note_claim(beacon(4, lease=lease(1, 530, established=True)), election, 3.9)
    assert not watch.note_claim(beacon(4, lease=Lease(4, 950, 0, 10, established=True)), election, 4.0)


def test_a_relay_cannot_say_that_a_leader_that_is_heard_has_lost_the_majority() -> None:
    trust, election = Trust(MISSION, 5, Priorities(MISSION)), follower_of(lease(1, 500, established=True))
    trust.receive_lease(beacon(1, lease=lease(1, 501, established=True)), election, 1.0)
    trust.receive_lease(beacon(3, lease=Lease(1, 502, 0, 0, True, quorum=False), hop=1), election, 1.1)
    assert election.lease == lease(1, 502, established=True)


def test_the_heir_that_the_leader_itself_names_may_come_to_lead() -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    watch.note_claim(beacon(1, lease=lease(1, 500, established=True, heir=3, ends=510)), election, 1.0)
    watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert watch.note_claim(beacon(3, lease=Lease(3, 900, 0, 10, established=True)), election, 1.1)


@pytest.mark.parametrize(
    ("sender", "cost", "breaks"), [(1, 0.0, False), (2, 0.0, True), (2, 0.9, True), (2, 1.0, False)]
)
def test_only_a_leader_is_at_its_own_place(sender: int, cost: float, breaks: bool) -> None:
    assert breaks_route(beacon(sender, lease=lease(1, established=True), route_cost=cost)) is breaks


def test_a_leader_whose_word_is_not_proven_yet_does_not_lie_about_its_place() -> None:
    """Its lease does not count, its course does: 46 were blocked for it in 17 drawn flights, most of them honest."""
    trust = Trust(MISSION, 5, Priorities(MISSION))
    for k in range(30):
        said = trust.sanitise_beacon(beacon(1, lease=None, route_cost=0.0, ref_ned_mps=(3.0, 0.0, 0.0)), 0.1 * k)
    assert (said.route_cost, said.ref_ned_mps) == (LEAST_COST, (3.0, 0.0, 0.0))


def relay(sender: int, **said: Any) -> Neighbour:
    """A follower of vehicle 1, nearer to it than the one that judges."""
    return neighbour(sender, (9.0, -5.0, 0.0), **{"lease": lease(1, established=True), "route_cost": 1.0, **said})


def test_of_those_that_hand_down_another_course_the_farthest_off_is_doubted() -> None:
    """The others mean over it, and are half off."""
    leader = neighbour(1, (9.0, 0.0, 0.0), route_cost=0.0, ref_ned_mps=(3.0, 0.0, 0.0))
    honest = relay(2, ref_ned_mps=(3.0, 2.0, 0.0))
    liar = relay(3, ref_ned_mps=(3.0, 4.0, 0.0))
    route = formation.Route(2.0, 1, 9.0, (leader, honest, liar))
    assert find_contradicting(route, [leader, honest, liar], 1) == 3
    assert find_contradicting(formation.Route(2.0, 1, 9.0, (leader,)), [leader], 1) == 0
    # Without the leader nobody can tell of two which is wrong.
    assert find_contradicting(formation.Route(2.0, 2, 9.0, (honest, liar)), [honest, liar], 1) == 0


def test_a_false_way_to_d2_is_doubted_too() -> None:
    leader = neighbour(1, (9.0, 0.0, 0.0), route_cost=0.0, dest_ned_m=(50.0, 0.0, 0.0))
    liar = relay(3, dest_ned_m=(50.0, 30.0, 0.0))
    assert find_contradicting(formation.Route(2.0, 1, 9.0, (leader, liar)), [leader, liar], 1) == 3


@pytest.mark.parametrize(
    ("said", "doubted"),
    [
        ({"ref_ned_mps": (0.0, 0.0, 0.0)}, False),  # it holds
        ({"ref_ned_mps": (1.2, 0.0, 0.0)}, False),  # it has heard little of the leader
        ({"ref_ned_mps": (-1.2, 0.0, 0.0)}, True),
        ({"ref_ned_mps": (4.2, 0.0, 0.0)}, True),
        ({"ref_ned_mps": (-3.0, 0.0, 0.0), "lease": None}, False),  # it has just lost the leader
        ({"ref_ned_mps": (-3.0, 0.0, 0.0), "lease": lease(4, established=True)}, False),
        ({"dest_ned_m": (50.0, 10.0, 0.0)}, True),
        ({"dest_ned_m": (50.0, 10.0, 0.0), "position_error_m": 3.0}, False),
        ({"dest_ned_m": (50.0, 30.0, 0.0), "position_error_m": 60.0}, True),
    ],
)
def test_less_of_the_course_is_no_contradiction(said: dict[str, Any], doubted: bool) -> None:
    leader = neighbour(1, (9.0, 0.0, 0.0), route_cost=0.0, ref_ned_mps=(3.0, 0.0, 0.0), dest_ned_m=(50.0, 0.0, 0.0))
    other = relay(3, **{"ref_ned_mps": (3.0, 0.0, 0.0), **said})
    assert find_contradicting(formation.Route(2.0, 1, 9.0, (leader, other)), [leader, other], 1) == (
        3 if doubted else 0
    )


def test_who_hands_down_a_false_course_may_lead_all_the_same() -> None:
    """Else two that judge differently follow two leaders: tests/testdata/found/stalled_companion.toml."""
    trust, election = Trust(MISSION, 5, Priorities(MISSION)), Election(5, 0, size=6)
    false = beacon(3, lease=lease(1, 500, established=True), route_cost=0.0, ref_ned_mps=(0.0, 3.0, 0.0))
    for k in range(5):
        said = trust.sanitise_beacon(false, 0.1 * k)
    assert (said.route_cost, said.ref_ned_mps, said.lease) == (NO_ROUTE, (0.0, 0.0, 0.0), false.lease)
    assert trust.blocklist.is_empty
    said = beacon(3, lease=Lease(3, 900, 0, 10, established=True), route_cost=0.0)
    assert trust.sanitise_beacon(said, 3.0).route_cost == 0.0
    assert trust.receive_lease(said, election, 3.0)


def test_no_route_goes_over_one_that_leads_unasked() -> None:
    """Or those behind it are lost to the leader's count, which then lacks the majority, and gives way."""
    trust, election = Trust(MISSION, 5, Priorities(MISSION)), follower_of(lease(1, 500, established=True))
    usurps = beacon(3, lease=Lease(3, 900, 0, 10, established=True), route_cost=0.0, ref_ned_mps=(0.0, 3.0, 0.0))
    trust.receive_lease(beacon(3, lease=lease(1, 500, established=True)), election, 1.0)
    assert trust.sanitise_beacon(usurps, 1.1) == usurps
    assert not trust.receive_lease(usurps, election, 1.1)
    said = trust.sanitise_beacon(usurps, 1.2)
    assert (said.route_cost, said.ref_ned_mps) == (NO_ROUTE, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("leads", [False, True])
def test_whose_part_lacks_the_majority_judges_no_leader(leads: bool) -> None:
    """The other may have it; a leader that judged it led its part on until it landed."""
    lacks = Lease(5 if leads else 1, 500, 0, 10, established=True, quorum=False)
    watch, election = LeadWatch(MISSION), follower_of(lacks)
    claim = beacon(3, lease=Lease(3, 900, 0, 10, established=True))
    watch.note_claim(beacon(3, lease=lease(lacks.leader, 500, established=True)), election, 1.0)
    assert watch.note_claim(claim, election, 1.1)
    assert watch.may_lead(3)


def test_one_that_leads_unasked_is_named_once() -> None:
    watch, election = LeadWatch(MISSION), follower_of(lease(1, 500, established=True))
    for at_s in (1.0, 2.0, 3.0):
        watch.note_claim(beacon(3, lease=lease(1, 500, established=True)), election, at_s)
        assert not watch.note_claim(beacon(3, lease=Lease(3, 900, 0, 10, established=True)), election, at_s + 0.1)
        assert watch.take_news() == ([(3, "leads unasked")] if at_s == 1.0 else [])
