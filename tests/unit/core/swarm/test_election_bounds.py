"""Bounds of the election and of the majority that the other tests do not come close to."""

from __future__ import annotations

import pytest

from companion.core.model.beacon import Candidate
from companion.core.model.states import Reception, Role
from companion.core.swarm.election import HEIR_STAYS_PERIODS, HOP_LIMIT, LEASE_PERIODS, SEQ_JUMP, Election
from companion.core.swarm.priorities import score_of
from companion.core.swarm.roster import Roster, ids, list_vehicles
from tests.unit.core.core_election_kit import follower_of, leader_of_long_standing, said, step
from tests.unit.core.core_kit import beacon, lease

pytestmark = pytest.mark.sources


def test_who_follows_nobody_has_agreed_on_nobody_and_proposes_none() -> None:
    election = Election(9, 0)
    step(election, eligible=False, heard=said(lease(7, 5)))
    assert (election.lease, election.agreed, election.candidate) == (None, False, None)


def test_an_heir_that_a_mere_claimant_names_is_expected_by_nobody() -> None:
    """Of claims after a loss the heir's comes first: only where its leader led."""
    for established, leader in ((True, 5), (False, 4)):
        election = follower_of(lease(1, 500, established=established, heir=5))
        step(election, LEASE_PERIODS, eligible=False)
        assert election.lease is None
        assert election.receive_lease(lease(5, 700, score=1), 0)
        election.receive_lease(lease(4, 700, score=9), 0)
        assert election.lease is not None
        assert election.lease.leader == leader


def test_an_heir_succeeds_only_once_its_leader_has_announced_when() -> None:
    for ends, goes_over in ((0, False), (510, True)):
        election = follower_of(lease(1, 500, priority=2, established=True, heir=3, ends=ends))
        assert election.receive_lease(lease(3, 600, established=True), 0) is goes_over


def test_a_leaders_score_is_told_anew_at_each_reelection() -> None:
    for every in (1, 5):
        election = Election(9, 0, reelection_periods=every)
        step(election, 30, score=8)
        assert election.acts
        step(election, 5, score=3)
        assert election.lease is not None
        assert election.lease.score == 3
    never = leader_of_long_standing(score=8)
    step(never, 20, score=3)
    assert never.lease is not None
    assert never.lease.score == 8


def test_of_equal_candidates_behind_the_lower_id_goes_up() -> None:
    for order in ((5, 6), (6, 5)):
        election = follower_of(lease(1, 500, established=True))
        heard = [view for k in order for view in said(lease(1, 500, established=True), 3, candidate=Candidate(k, 0, 5))]
        step(election, eligible=False, heard=heard)
        assert election.candidate == Candidate(5, 0, 5)


def test_time_of_a_hand_over_does_not_wait_for_a_way_that_gets_shorter() -> None:
    """Ten hops off it has reckoned ahead by ten; news of the same count over one hop takes none of that back."""
    election = Election(9, 0)
    assert election.receive_lease(lease(1, 500, established=True, heir=9, ends=520), 10)
    step(election, 2)
    election.receive_lease(lease(1, 500, established=True, heir=9, ends=520), 0)
    step(election, 7)
    assert not election.leads
    step(election, 1)
    assert election.acts


def test_a_hand_over_is_the_heirs_alone() -> None:
    for heir, takes_over in ((9, True), (8, False)):
        election = follower_of(lease(1, 0, established=True, heir=heir, ends=1))
        step(election, 2)
        assert election.acts is takes_over


def test_an_heir_that_has_taken_over_hears_no_echo_of_the_one_before() -> None:
    election = follower_of(lease(1, 500, priority=2, established=True, heir=9, ends=502))
    step(election, 3)
    assert election.acts
    assert not election.receive_lease(lease(1, 501, priority=2, established=True), 0)
    assert election.acts
    assert election.receive_lease(lease(1, 503, priority=2, established=True), 0)  # it leads again


def test_a_leader_that_has_handed_over_is_a_hop_behind_its_heir() -> None:
    election = leader_of_long_standing(score=3)
    heir = said(election.lease, candidate=Candidate(7, 1, 9))
    for _ in range(60):
        if not election.leads:
            break
        step(election, score=3, heard=said(election.lease, candidate=Candidate(7, 1, 9)))
    assert heir
    assert (election.role, election.hop) == (Role.FOLLOWER, 1)
    assert election.lease is not None
    assert (election.lease.leader, election.lease.seq) == (7, 0)
    # whatever the heir's count is, it is news
    assert election.receive_lease(lease(7, SEQ_JUMP + 9, established=True), 0)
    assert not election.receive_lease(lease(7, 2 * SEQ_JUMP + 20, established=True), 0)


def test_nobody_deposes_the_own_lead() -> None:
    election = leader_of_long_standing()
    election.depose()
    assert election.acts
    unled = Election(9, 0)
    unled.depose()
    assert unled.role is Role.UNLED
    follower = follower_of(lease(1, 500, established=True))
    follower.depose()
    assert (follower.role, follower.lease) == (Role.UNLED, None)


@pytest.mark.parametrize(("hop", "counts"), [(3, True), (4, False)])
def test_own_count_comes_back_over_no_more_hops_than_the_swarm_has(hop: int, *, counts: bool) -> None:
    election = Election(9, 0, size=3)
    step(election, 20)
    before = election.lease
    assert before is not None
    election.receive_lease(lease(9, before.seq + 100, established=True), hop)
    step(election)
    assert election.lease is not None
    assert (election.lease.seq > before.seq + 100) is counts


def test_quorum_is_told_with_the_own_lease_alone() -> None:
    election = leader_of_long_standing()
    for quorum in (False, True):
        election.set_quorum(quorum)
        assert election.lease is not None
        assert election.lease.quorum is quorum
    follower = follower_of(lease(1, 500, established=True))
    follower.set_quorum(False)
    assert follower.lease is not None
    assert follower.lease.quorum
    nobody = Election(9, 0)
    nobody.set_quorum(False)
    assert nobody.lease is None
    assert HOP_LIMIT == 250


def test_after_a_leader_is_lost_another_is_followed_and_handed_over_by_as_at_first() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS, eligible=False)
    assert election.receive_lease(lease(2, 300, established=True, heir=9, ends=302), 0)
    step(election)
    assert not election.acts
    step(election)
    assert election.acts


def test_an_heir_that_is_gone_is_named_no_more() -> None:
    election = leader_of_long_standing(score=9)
    for _ in range(30):
        step(election, score=9, heard=said(election.lease, candidate=Candidate(7, 0, 5)))
    assert election.lease is not None
    assert election.lease.heir == 7
    step(election, HEIR_STAYS_PERIODS - 1, score=9)
    assert election.lease.heir == 7
    step(election, 2, score=9)
    assert election.lease.heir == 0


def test_a_score_is_a_whole_number_on_the_wire() -> None:
    for percent, score in ((95, 9), (100, 10), (5, 0)):
        found = score_of(percent, Reception.GOOD)
        assert (found, type(found)) == (score, int)


# --- the majority ---


def test_branches_are_there_with_their_senders_and_the_first_vehicle_too() -> None:
    roster = Roster(3, 6)
    roster.collect_branches([beacon(1, present=0b010000, phase=2, done=0b000001)], done=False, phase=2)
    assert (roster.present, roster.done) == (0b010101, 0b000001)
    assert ids(0b010101) == [1, 3, 5]
    assert ids(0) == []


def test_a_roster_begins_with_its_own_vehicle_and_nothing_done() -> None:
    roster = Roster(3, 4)
    assert (roster.present, roster.done, roster.flown) == (0b100, 0, 0)
    roster.mark_airborne(takes_off=True)
    assert roster.flown == 0b100


def test_by_default_nobody_is_known_to_be_on_the_ground_and_a_new_leader_has_no_majority() -> None:
    roster = Roster(2, 4)
    roster.mark_launched(0b0111)
    assert roster.missing_peers() == 0b0101
    assert roster.missing_peers(grounded=0b0001) == 0b0100
    assert not roster.has_quorum(1.0)
    roster.note_following(1.0, majority=False)  # handed over with
    assert roster.has_quorum(1.0)
    assert not roster.has_quorum(9.0)


@pytest.mark.parametrize(
    ("done", "excluded", "left"), [(0b0011, 0b1100, 0b1111), (0b0011, 0b0100, 0b0011), (0b1111, 0, 0b1111), (0, 0, 0)]
)
def test_nobody_waits_for_those_that_are_excluded(done: int, excluded: int, left: int) -> None:
    roster = Roster(1, 4)
    roster.exclude(excluded)
    assert roster.with_excluded(done) == left


@pytest.mark.parametrize(
    ("vehicles", "words"),
    [
        ([], ""),
        ([2], "2"),
        ([1, 2, 3, 4], "1, 2, 3, 4"),
        ([1, 2, 3, 4, 5], "1, 2, 3, 2 more"),
        ([*range(1, 9)], "1, 2, 3, 5 more"),
    ],
)
def test_many_vehicles_are_named_by_the_first_three_and_a_count(vehicles: list[int], words: str) -> None:
    assert list_vehicles(vehicles) == words


def test_one_branch_that_has_not_agreed_is_enough_to_wait_for() -> None:
    own = lease(1, 500, established=True)
    for agreed in ((False, True), (True, False), (True, True)):
        election = follower_of(own)
        heard = [view for one in agreed for view in said(own, 3, agreed=one)]
        step(election, eligible=False, heard=heard)
        assert election.agreed is all(agreed)


def test_those_that_were_launched_come_to_those_that_flew_before() -> None:
    roster = Roster(3, 4)
    roster.mark_airborne(takes_off=True)
    roster.mark_launched(0b0001)
    roster.mark_launched(0b11110010)
    assert roster.flown == 0b0111
    assert Election(9, 0).hop == 0


@pytest.mark.parametrize(
    ("heir", "ends", "age", "inherits"),
    [(9, 1, 0, True), (9, 1, 2, True), (9, 1, 3, False), (9, 0, 0, False), (8, 1, 0, False)],
)
def test_an_heir_has_the_majority_from_the_leader_that_hands_over_to_it(
    heir: int, ends: int, age: int, *, inherits: bool
) -> None:
    election = follower_of(lease(1, 0, established=True, heir=heir, ends=ends))
    step(election, age, eligible=False)
    assert election.inherits_quorum(2) is inherits
    assert not leader_of_long_standing().inherits_quorum(99)
    assert not Election(9, 0).inherits_quorum(99)


def test_a_leader_that_may_not_lead_gives_up_when_its_heir_is_gone_before_its_time() -> None:
    election = leader_of_long_standing(score=9)
    for _ in range(30):
        step(election, score=9, heard=said(election.lease, candidate=Candidate(7, 0, 5)))
    step(election, 2, eligible=False, heard=said(election.lease, candidate=Candidate(7, 0, 5)))
    assert election.acts
    assert election.lease is not None
    assert election.lease.ends > 0
    step(election, eligible=False)
    assert (election.role, election.lease) == (Role.UNLED, None)
