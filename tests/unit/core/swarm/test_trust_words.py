"""What is made of a member's words before anything goes by them: `Trust`, and a blocked member's beacon."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.guidance.formation import Route
from companion.core.model.beacon import NO_ROUTE, Candidate, PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.swarm.election import Election
from companion.core.swarm.phases import Phases
from companion.core.swarm.picture import Picture
from companion.core.swarm.priorities import Priorities
from companion.core.swarm.trust.blocklist import BLOCKED_S, DOUBT_LIMIT, Blocklist, strip_beacon
from companion.core.swarm.trust.relay_watch import AGAIN_S, PATIENCE_S, STRETCHED_S, Patience, find_contradicting
from companion.core.swarm.trust.trust import PERIODS_BESIDE, PHASE_LIE, PLAIN_LIE, RANGE_STEP_M, Trust
from tests.unit.core.core_election_kit import follower_of, leader_of_long_standing
from tests.unit.core.core_kit import BEACON, beacon, lease, mission, neighbour, picture

pytestmark = pytest.mark.sources

MISSION = mission(
    swarm={"size": 9, "leader_priority": [1, 4]},
    coverage={"radius_m": 25.0, "duration_s": 60.0},
    route={"at_end": "land"},
)
ME, LEADER = 9, 1
OWN = lease(LEADER, 500, priority=2, established=True)


def trust() -> Trust:
    return Trust(MISSION, ME, Priorities(MISSION))


def test_nothing_of_a_blocked_member_counts_but_where_it_is_and_what_its_flight_does() -> None:
    said = replace(
        BEACON,
        sender=3,
        vel_ned_mps=(1.0, 2.0, 3.0),
        ref_ned_mps=(3.0, 0.0, 0.0),
        dest_ned_m=(9.0, 9.0, 0.0),
        route_cost=2.0,
        governor=0.0,
        lease=OWN,
        hop=3,
        agreed=True,
        candidate=Candidate(3, 0, 9),
        parent=2,
        phase=SwarmPhase.LAND,
        state=FlightState.TRANSIT,
        airborne=True,
        start=True,
        abort=True,
        done=7,
        sighting=PeerReport(2, (1.0, 0.0, 0.0), 0.1, silent=True),
        stop=1,
        present=7,
        flown=7,
        position_error_m=2.0,
    )
    left = strip_beacon(said)
    kept = replace(
        BEACON, sender=3, vel_ned_mps=said.vel_ned_mps, state=said.state, airborne=True, position_error_m=2.0
    )
    assert left == replace(kept, route_cost=left.route_cost, governor=1.0)
    assert left.route_cost > 1e3
    judge = trust()
    judge.blocklist.block(3, "lies")
    assert judge.sanitise_beacon(said, 1.0) == left
    assert judge.sanitise_beacon(replace(said, sender=4), 1.0) != left


def test_a_reference_faster_than_the_mission_is_cut_and_a_lesser_range_than_any_is_not_believed() -> None:
    judge, fastest_mps = trust(), MISSION.limits.speed_max_mps
    least_m = min(MISSION.radio.transit_range_m, MISSION.radio.full_range_m)
    as_told = beacon(2, ref_ned_mps=(0.0, fastest_mps, 0.0), range_m=least_m - RANGE_STEP_M, route_cost=1.0)
    assert judge.sanitise_beacon(as_told, 1.0) is as_told
    cut = judge.sanitise_beacon(replace(as_told, ref_ned_mps=(0.0, 2.0 * fastest_mps, 0.0)), 1.0)
    assert cut == as_told
    assert judge.sanitise_beacon(replace(as_told, range_m=least_m - RANGE_STEP_M - 0.01), 1.0).range_m == least_m


@pytest.mark.parametrize(("priority", "stays"), [(1, True), (2, False), (0, False)])
def test_a_candidates_priority_is_the_missions(priority: int, *, stays: bool) -> None:
    said = beacon(2, candidate=Candidate(4, priority, 9))
    assert (trust().sanitise_beacon(said, 1.0).candidate is not None) is stays


def test_a_false_route_cost_weighs_three_lost_beacons_and_costs_the_course_alone() -> None:
    judge, told = trust(), beacon(3, lease=OWN, route_cost=0.5, ref_ned_mps=(1.0, 0.0, 0.0), dest_ned_m=(9.0, 0.0, 0.0))
    found = [judge.sanitise_beacon(told, 1.0) for _ in range(5)]
    assert PLAIN_LIE == 3.0
    assert [said.route_cost for said in found] == [1.0, 1.0, 1.0, NO_ROUTE, NO_ROUTE]
    assert (found[2].ref_ned_mps, found[2].dest_ned_m) == (told.ref_ned_mps, told.dest_ned_m)
    assert (found[3].ref_ned_mps, found[3].dest_ned_m, found[3].lease) == (ZERO, None, OWN)
    assert judge.run_period(own_picture(1.0), Election(ME, 0), Phases(MISSION), is_held=False) == [
        (3, "route cost is false")
    ]
    leads = beacon(3, lease=lease(3, 9), route_cost=0.0)  # as a leader it has its say again
    assert judge.sanitise_beacon(leads, 1.0) is leads
    judge.run_period(own_picture(1.0 + BLOCKED_S + 0.1), Election(ME, 0), Phases(MISSION), is_held=False)
    again = replace(told, route_cost=1.0)
    assert judge.sanitise_beacon(again, 9.0) is again


# --- leases ---


def test_a_lease_is_news_unless_its_leader_is_blocked_or_its_priority_false() -> None:
    for blocked, priority, is_news in ((0, 2, True), (LEADER, 2, False), (3, 2, True), (0, 1, False)):
        judge, election = trust(), Election(ME, 0)
        judge.blocklist.block(blocked, "lies")
        told = beacon(3, lease=replace(OWN, priority=priority), hop=1)
        assert judge.receive_lease(told, election, 1.0) is is_news
        assert (election.lease is not None) is is_news
    assert not trust().receive_lease(beacon(3, lease=None), Election(ME, 0), 1.0)


def test_one_that_leads_unasked_is_not_followed_whoever_passes_it_on_and_named_once() -> None:
    judge, election, phases = trust(), follower_of(OWN), Phases(MISSION)
    judge.receive_lease(beacon(4, lease=OWN, hop=1), election, 1.0)
    claim = beacon(4, lease=lease(4, 900, priority=1, established=True))
    for count in range(1, 9):
        assert not judge.receive_lease(claim, election, 1.0 + 0.1 * count)
    assert not judge.receive_lease(beacon(5, lease=claim.lease, hop=2), election, 2.0)
    assert judge.run_period(own_picture(2.0), election, phases, is_held=False) == [(4, "leads unasked")]
    assert judge.run_period(own_picture(2.1), election, phases, is_held=False) == []
    assert not judge.blocklist.has(4)
    assert election.lease is not None
    assert election.lease.leader == LEADER


@pytest.mark.parametrize(
    ("ahead", "after_s", "believed"),
    [
        (PERIODS_BESIDE, 0.0, True),
        (PERIODS_BESIDE + 1, 0.0, False),
        (PERIODS_BESIDE + 10, 1.05, True),
        (PERIODS_BESIDE + 11, 1.05, False),
    ],
)
def test_a_relay_tells_a_leaders_count_as_far_as_time_has_passed(ahead: int, after_s: float, *, believed: bool) -> None:
    judge, election = trust(), Election(ME, 0)
    assert judge.receive_lease(beacon(LEADER, lease=OWN), election, 5.0)
    told = replace(OWN, seq=OWN.seq + ahead)
    assert judge.receive_lease(beacon(3, lease=told, hop=1), election, 5.0 + after_s) is believed


def test_of_a_leader_that_is_heard_the_rest_of_a_relays_word_is_its_own() -> None:
    judge, election = trust(), Election(ME, 0)
    own = replace(OWN, heir=4, ends=510)
    judge.receive_lease(beacon(LEADER, lease=own), election, 5.0)
    false = replace(OWN, seq=501, heir=3, ends=505)
    assert judge.receive_lease(beacon(3, lease=false, hop=1), election, 5.0)
    assert election.lease == replace(own, seq=501)
    assert judge.receive_lease(beacon(3, lease=replace(own, seq=502, established=False), hop=1), election, 5.0)
    assert election.lease == replace(own, seq=502)
    # of one that is not heard any more a relay's word is all there is
    assert judge.receive_lease(beacon(3, lease=replace(false, seq=530, ends=540), hop=1), election, 9.0)
    assert election.lease == replace(false, seq=530, ends=540)


# --- phases ---


def test_of_another_leader_or_as_claimant_no_phase_is_gone_over_to() -> None:
    phases = Phases(MISSION)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    told = beacon(LEADER, phase=SwarmPhase.TRANSIT, lease=OWN)
    assert trust().believes_phase(told, follower_of(OWN), phases, 1.0, is_news=True)
    assert not trust().believes_phase(told, Election(ME, 0), phases, 1.0, is_news=True)
    assert not trust().believes_phase(replace(told, lease=None), follower_of(OWN), phases, 1.0, is_news=True)
    assert not trust().believes_phase(told, follower_of(lease(4, 5, priority=1)), phases, 1.0, is_news=True)
    claimant = Election(ME, 0)
    claimant.run_period(0.0, period_s=0.1, eligible=True, score=0)
    assert claimant.role is Role.CLAIMANT
    own = lease(ME, 5)
    assert not trust().believes_phase(replace(told, lease=own), claimant, phases, 1.0, is_news=True)


def test_a_leaders_foul_weighs_half_of_a_lost_beacon_and_a_relays_nothing() -> None:
    phases = Phases(MISSION)
    for phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT):
        phases.adopt_phase(phase, 0.0)
    judge, election = trust(), follower_of(OWN)
    for k in range(20):
        assert not judge.blocklist.has(LEADER)
        judge.believes_phase(beacon(3, phase=SwarmPhase.LAND, lease=OWN, hop=1), election, phases, 1.0, is_news=False)
        judge.believes_phase(beacon(LEADER, phase=SwarmPhase.RETURN, lease=OWN), election, phases, 1.0, is_news=True)
        assert k < DOUBT_LIMIT / PHASE_LIE
    assert judge.blocklist.take_news() == [(LEADER, "phase is false")]
    assert not judge.blocklist.has(3)


# --- each period ---


def own_picture(now_s: float, pos_ned_m: tuple[float, float, float] = ZERO) -> Picture:
    return picture(now_s=now_s, own=Position(pos_ned_m, ZERO, None), state=FlightState.TRANSIT, airborne=True)


def test_a_leader_that_covers_too_long_is_given_up_by_who_follows_it() -> None:
    def news(*, is_held: bool = False, follows: bool = True) -> tuple[list[tuple[int, str]], Election]:
        phases = Phases(MISSION)
        for phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            phases.adopt_phase(phase, 0.0)
        judge, election = trust(), follower_of(OWN) if follows else Election(ME, 0)
        found = []
        for now_s in (1.0, 300.0):
            found += judge.run_period(own_picture(now_s), election, phases, is_held=is_held)
        return found, election

    found, election = news()
    assert found == [(LEADER, "covers too long")]
    assert election.lease is None
    assert news(is_held=True)[0] == []
    assert news(follows=False)[0] == []


def test_a_leader_that_leads_away_is_given_up_by_the_own_odometry() -> None:
    phases, judge, election = Phases(MISSION), trust(), follower_of(OWN)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    judge.run_period(own_picture(0.0), election, phases, is_held=False)
    phases.adopt_phase(SwarmPhase.TRANSIT, 1.0)
    sets_out = picture(
        now_s=1.0, own=Position(ZERO, ZERO, None), state=FlightState.TRANSIT, airborne=True, dest_ned_m=(80.0, 0.0, 0.0)
    )
    for _ in range(2):
        assert judge.run_period(sets_out, election, phases, is_held=False) == []
    on_the_way = [
        judge.run_period(own_picture(2.0, (40.0, 5.0, 0.0)), election, phases, is_held=False) for _ in range(30)
    ]
    assert on_the_way == [[]] * 30
    found = [judge.run_period(own_picture(3.0, (40.0, 90.0, 0.0)), election, phases, is_held=False) for _ in range(21)]
    assert found == [*[[]] * 20, [(LEADER, "leaves the way")]]
    assert election.lease is None


def test_a_leader_goes_by_two_of_its_followers() -> None:
    phases = Phases(MISSION)
    for phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT):
        phases.adopt_phase(phase, 0.0)
    own = lease(ME, 5, established=True)
    leader = leader_of_long_standing(ME)
    for others, believed in ((1, False), (2, True)):
        judge = trust()
        judge.gate.store(beacon(7, phase=SwarmPhase.TRANSIT, lease=own, hop=1), 1.0)
        for k in range(others):
            told = beacon(2 + k, phase=SwarmPhase.COVERAGE, lease=own, hop=1)
            found = judge.believes_phase(told, leader, phases, 1.0, is_news=True)
        assert found is believed


def test_of_two_vehicles_none_doubts_the_other() -> None:
    for size, has in ((2, False), (3, True)):
        blocked = Blocklist(size)
        blocked.note_doubt(2, "lies", DOUBT_LIMIT, 1.0)
        assert blocked.has(2) is has


def test_views_of_blocked_members_do_not_count() -> None:
    judge = trust()
    judge.blocklist.block(3, "lies")
    heard = [beacon(2), beacon(3), beacon(4)]
    assert judge.find_views(heard) == [heard[0], heard[2]]


def test_who_hands_down_a_false_course_is_doubted_by_a_lost_beacon_each_period() -> None:
    judge = trust()
    leader = neighbour(LEADER, (9.0, 0.0, 0.0), route_cost=0.0, ref_ned_mps=(3.0, 0.0, 0.0), lease=OWN)
    liar = neighbour(3, (9.0, -5.0, 0.0), route_cost=1.0, ref_ned_mps=(3.0, 4.0, 0.0), lease=OWN)
    honest = neighbour(2, (9.0, 5.0, 0.0), route_cost=1.0, ref_ned_mps=(3.0, 1.0, 0.0), lease=OWN)  # just in bounds
    route = Route(2.0, 1, 9.0, (leader, honest, liar))

    def news(now_s: float) -> list[tuple[int, str]]:
        return judge.run_period(own_picture(now_s), Election(ME, 0), Phases(MISSION), is_held=False)

    for _ in range(int(DOUBT_LIMIT) + 2):
        judge.check_route(Route(2.0, 1, 9.0, (leader, honest)), [leader, honest], OWN, 1.0)
        judge.check_route(route, [leader, honest, liar], None, 1.0)
    for _ in range(int(DOUBT_LIMIT) - 1):
        judge.check_route(route, [leader, honest, liar], OWN, 1.0)
    told = beacon(3, lease=OWN, route_cost=1.0)
    assert judge.sanitise_beacon(told, 1.0) is told
    judge.check_route(route, [leader, honest, liar], OWN, 5.0)
    assert judge.sanitise_beacon(told, 5.0).route_cost == NO_ROUTE
    assert news(5.0 + BLOCKED_S) == [(3, "hands down a false course")]
    assert judge.sanitise_beacon(told, 5.0 + BLOCKED_S).route_cost == NO_ROUTE
    assert news(5.1 + BLOCKED_S) == []
    assert judge.sanitise_beacon(told, 5.1 + BLOCKED_S) is told


def test_patience_with_one_that_holds_all_lasts_half_a_minute_and_the_swarm_goes_on_for_a_whole() -> None:
    patience, range_m = Patience(), 40.0
    holds = neighbour(3, (9.0, 0.0, 0.0), governor=0.0)
    others = [neighbour(2, (9.0, 5.0, 0.0), governor=0.3), neighbour(4, (39.0, 0.0, 0.0), governor=0.1)]
    everyone, since_s = [*others, holds], 500.0
    assert patience.filter_followers(everyone, since_s, range_m=range_m) == everyone
    assert patience.filter_followers(everyone, since_s + PATIENCE_S, range_m=range_m) == everyone
    for at_s in (since_s + PATIENCE_S + 0.1, since_s + 2.0 * PATIENCE_S):
        assert patience.filter_followers(everyone, at_s, range_m=range_m) == others
    # it lets go: for a minute from then on it does not count, whatever it says
    free = [*others, neighbour(3, (9.0, 0.0, 0.0), governor=1.0)]
    last_s = since_s + 2.0 * PATIENCE_S
    assert patience.filter_followers(free, last_s + AGAIN_S, range_m=range_m) == others
    assert patience.filter_followers(free, last_s + AGAIN_S + 0.1, range_m=range_m) == free


@pytest.mark.parametrize(("away_m", "lasts_s"), [(20.0, PATIENCE_S), (27.0, STRETCHED_S)])
def test_with_one_far_behind_patience_lasts_longer_by_the_range_that_the_formation_keeps(
    away_m: float, lasts_s: float
) -> None:
    """By the full range each link on the way was short: after half a minute the leader broke a stretched one."""
    judge, holds = trust(), [neighbour(3, (away_m, 0.0, 0.0), governor=0.0)]
    judge.filter_followers(holds, 0.0, range_m=30.0)
    assert judge.filter_followers(holds, lasts_s, range_m=30.0) == holds
    assert judge.filter_followers(holds, lasts_s + 0.1, range_m=30.0) == []


def test_whether_it_is_back_the_gate_judges_by_the_own_odometry() -> None:
    phases, judge, election = Phases(MISSION), trust(), follower_of(OWN)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    judge.run_period(own_picture(0.0), election, phases, is_held=False)
    for phase in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE, SwarmPhase.RETURN):
        phases.adopt_phase(phase, 1.0)
    judge.run_period(own_picture(1.0, (120.0, 0.0, 0.0)), election, phases, is_held=False)
    assert not judge.gate.is_possible(SwarmPhase.LAND, 0, phases, 2.0)
    judge.run_period(own_picture(2.0, (5.0, 0.0, 0.0)), election, phases, is_held=False)
    assert judge.gate.is_possible(SwarmPhase.LAND, 0, phases, 2.0)


def test_of_three_vehicles_one_is_doubted_at_most() -> None:
    blocked = Blocklist(3)
    for vehicle in (2, 3):
        blocked.note_doubt(vehicle, "lies", DOUBT_LIMIT, 1.0)
    assert (blocked.has(2), blocked.has(3)) == (True, False)


def test_all_that_are_blocked_are_told_as_bits() -> None:
    blocked = Blocklist(7)
    blocked.block(2, "lies")
    blocked.block(7, "lies")
    blocked.note_doubt(5, "lies", DOUBT_LIMIT, 1.0)
    assert blocked.bits() == 0b1010010


def test_of_three_without_the_leader_the_one_that_is_off_their_middle_is_doubted() -> None:
    def at(vehicle: int, ref_mps: float, dest_m: float) -> Neighbour:
        return neighbour(
            vehicle,
            (9.0, float(vehicle), 0.0),
            route_cost=1.0,
            ref_ned_mps=(ref_mps, 0.0, 0.0),
            dest_ned_m=(dest_m, 0.0, 0.0),
            lease=OWN,
        )

    for refs, dests, false in (((3.0, 3.0, 9.0), (50.0, 50.0, 50.0), 4), ((3.0, 3.0, 3.0), (50.0, 90.0, 50.0), 3)):
        others = tuple(at(2 + k, refs[k], dests[k]) for k in range(3))
        assert find_contradicting(Route(2.0, 2, 9.0, others), others, LEADER) == false


def test_a_leader_whose_phase_was_foul_is_believed_again_a_minute_after() -> None:
    phases = Phases(MISSION)
    for phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT):
        phases.adopt_phase(phase, 0.0)
    judge, election = trust(), follower_of(OWN)
    for _ in range(20):
        told = beacon(LEADER, phase=SwarmPhase.RETURN, lease=OWN)
        judge.believes_phase(told, election, phases, 5.0, is_news=True)
    assert judge.blocklist.has(LEADER)
    judge.blocklist.fade(5.0 + BLOCKED_S)
    assert judge.blocklist.has(LEADER)
    judge.blocklist.fade(5.1 + BLOCKED_S)
    assert not judge.blocklist.has(LEADER)


@pytest.mark.parametrize("vehicle", [0, 10, 77])
def test_a_candidate_that_is_no_member_is_none(vehicle: int) -> None:
    assert trust().sanitise_beacon(beacon(3, candidate=Candidate(vehicle, 0, 9)), 1.0).candidate is None


def test_a_blocked_member_is_no_candidate_whoever_names_it() -> None:
    one = trust()
    said = beacon(3, candidate=Candidate(4, 1, 9))
    assert one.sanitise_beacon(said, 1.0).candidate == Candidate(4, 1, 9)
    one.blocklist.block(4, "equivocates")
    assert one.sanitise_beacon(said, 1.0).candidate is None
