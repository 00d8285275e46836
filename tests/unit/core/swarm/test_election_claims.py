"""What cannot be true of a leader is refused; when a claim may be acted upon; which succeeds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import Beacon, Candidate
from companion.core.swarm.election import (
    ACT_PERIODS,
    EARLIER_SEQ_LIMIT,
    HANDOVER_PERIODS,
    HEIR_KNOWN_PERIODS,
    HEIR_STAYS_PERIODS,
    HELD_PERIODS,
    HOP_LIMIT,
    HYSTERESIS,
    LEASE_PERIODS,
    RESIGN_PERIODS,
    SCORE_LIMIT,
    SEQ_JUMP,
    SEQ_LIMIT,
    TOMBS,
    Election,
)
from tests.unit.core.core_election_kit import follower_of, leader_of_long_standing, said, step
from tests.unit.core.core_kit import lease

# --- what cannot be true ---


@pytest.mark.parametrize("seq", [SEQ_LIMIT + 1, 2**32 - 1])
def test_count_beyond_all_clocks_is_refused(seq: int) -> None:
    election = Election(9, 0)
    assert not election.receive_lease(lease(1, seq, priority=9, established=True), 0)
    assert election.lease is None


@pytest.mark.parametrize(("ahead", "believed"), [(SEQ_JUMP, True), (SEQ_JUMP + 1, False), (2**31, False)])
def test_count_far_ahead_of_what_the_leader_can_have_counted_is_refused(ahead: int, believed: bool) -> None:
    election = follower_of(lease(1, 500, established=True))
    assert election.receive_lease(lease(1, 500 + ahead, established=True), 0) == believed
    step(election)
    assert election.receive_lease(lease(1, 501, established=True), 0) != believed


def test_leader_outcounts_what_others_say_of_it() -> None:
    """A false count is believed: the leader's next is above it, so the lease is the leader's again."""
    election = leader_of_long_standing(1)
    assert election.lease is not None
    false = election.lease.seq + SEQ_JUMP
    election.receive_lease(replace(election.lease, seq=false), 3)
    step(election)
    assert election.lease.seq == false + 1
    assert election.acts


def test_leader_does_not_outcount_what_its_followers_refuse() -> None:
    election = leader_of_long_standing(1)
    assert election.lease is not None
    true = election.lease.seq
    election.receive_lease(replace(election.lease, seq=true + SEQ_JUMP + 1), 3)
    election.receive_lease(replace(election.lease, seq=2**32 - 1), 3)
    step(election)
    assert election.lease.seq == true + 1


def test_claimant_that_hears_of_an_earlier_life_counts_on_from_there() -> None:
    reborn, follower = Election(1, 0), follower_of(lease(1, 90_000, established=True))
    step(reborn)
    reborn.receive_lease(lease(1, 90_000, established=True), 1)
    step(reborn)
    assert reborn.lease is not None
    assert follower.receive_lease(reborn.lease, 0)


@pytest.mark.parametrize("seq", [EARLIER_SEQ_LIMIT + 1, SEQ_LIMIT])
def test_earlier_life_that_leaves_no_room_to_count_on_is_not_believed(seq: int) -> None:
    election = Election(1, 0)
    election.receive_lease(lease(1, seq, established=True), 1)
    step(election, ACT_PERIODS)
    assert election.acts
    assert election.lease is not None
    assert election.lease.seq < 2 * HOP_LIMIT


@pytest.mark.parametrize("jump_s", [-1e6, -50.0, 50.0, 1e9])
def test_leader_whose_clock_jumps_counts_on(jump_s: float) -> None:
    election = Election(1, 0)
    step(election, ACT_PERIODS, now_s=2e6)
    assert election.lease is not None
    last = election.lease.seq
    for k in range(1, 20):
        step(election, now_s=2e6 + jump_s)
        assert election.lease.seq == last + k
    assert election.acts


def test_claim_is_above_all_counts_of_this_life_though_the_clock_jumps_back() -> None:
    election = Election(5, 0)
    step(election, ACT_PERIODS, now_s=2e6)
    assert election.lease is not None
    last = election.lease.seq
    election.receive_lease(lease(1, 7, established=True), 0)
    step(election, LEASE_PERIODS, now_s=10.0)
    assert election.leads
    assert election.lease.seq > last


def test_leader_whose_count_has_run_out_gives_up_and_claims_again_from_its_clock() -> None:
    """It would be refused: so it is replaced as if lost, and never leads on beside the next."""
    election = leader_of_long_standing(1)
    election.lease = lease(1, SEQ_LIMIT - 1, established=True, heir=4)
    step(election)
    assert election.lease == lease(1, SEQ_LIMIT, established=True, heir=election.lease.heir)
    step(election)
    assert election.lease is None
    assert not election.acts
    step(election)
    assert election.lease is not None
    assert election.lease.seq < 2 * HOP_LIMIT
    assert not election.acts


def test_score_that_no_battery_has_is_refused() -> None:
    election = Election(1, 0)
    assert not election.receive_lease(lease(9, score=SCORE_LIMIT + 1), 0)
    assert election.receive_lease(lease(9, score=SCORE_LIMIT), 0)


def test_own_score_is_one_that_others_believe() -> None:
    election = Election(1, 0)
    step(election, score=12)
    assert election.lease is not None
    assert election.lease.score == SCORE_LIMIT


def test_candidate_whose_score_no_battery_has_is_passed_over() -> None:
    election = follower_of(lease(1, 500, established=True), me=4)
    step(election, score=2, heard=said(lease(1), 2, candidate=Candidate(6, 0, 255)))
    assert election.candidate == Candidate(4, 0, 2)


@pytest.mark.parametrize(
    ("ends", "hop", "believed"),
    [
        (0, 0, True),
        (500, 0, False),
        (501, 0, True),
        (500 + HANDOVER_PERIODS + 1, 0, True),
        (500 + HANDOVER_PERIODS + 2, 0, False),
        (500 + HANDOVER_PERIODS + 5, 4, True),  # told early four times, a count back each
        (2**32 - 1, 0, False),
    ],
)
def test_hand_over_at_a_count_that_no_leader_announces_is_refused(ends: int, hop: int, believed: bool) -> None:
    election = Election(9, 0)
    assert election.receive_lease(lease(1, 500, established=True, heir=4, ends=ends), hop) == believed


def test_way_longer_than_the_swarm_is_refused() -> None:
    election = Election(9, 0, size=4)
    assert not election.receive_lease(lease(1), 4)
    assert election.receive_lease(lease(1), 3)


def test_heir_that_is_expected_in_vain_is_expected_no_more() -> None:
    """Vehicles that were told of different heirs would give way to different claims for ever."""
    election = follower_of(lease(1, 500, established=True, heir=4), me=3)
    step(election, LEASE_PERIODS)
    assert election.receive_lease(lease(4, 7), 0)
    step(election, LEASE_PERIODS)
    assert election.leads
    assert not election.receive_lease(lease(4, 8), 0)


def test_lost_leaders_kept_in_mind_are_bounded() -> None:
    election = Election(9, 0)
    for k in range(3 * TOMBS):
        election.receive_lease(lease(10 + k, 500, established=True, heir=11 + k, ends=510, score=5), 0)
    assert len(election._tombs) == TOMBS


# --- the echo ---


@pytest.mark.parametrize("other", [said(None), said(lease(9)), said(lease(5), agreed=False)])
def test_claim_is_not_acted_upon_while_a_neighbour_or_one_behind_it_does_not_follow(other: tuple[Beacon, ...]) -> None:
    election = Election(5, 0, size=4)
    step(election, ACT_PERIODS + 5, heard=other)
    assert election.leads
    assert not election.acts
    step(election, heard=said(lease(5)))
    assert election.acts


def test_hops_of_a_claim_only_fall_so_that_nobody_slips_out_of_its_echo() -> None:
    election = follower_of(lease(1, 500))  # at one hop
    election.receive_lease(lease(1, 501), 4)  # the direct word was lost
    assert election.hop == 1
    step(election, heard=said(lease(1, 501), 2, agreed=False))
    assert not election.agreed
    election.receive_lease(lease(1, 502, established=True), 4)
    assert election.hop == 5


def test_neighbour_that_never_follows_delays_a_leader_and_does_not_prevent_it() -> None:
    election = Election(5, 0, size=4)
    step(election, ACT_PERIODS + 2 * 4 - 1, heard=said(None))
    assert not election.acts
    step(election, heard=said(None))
    assert election.acts


def test_leader_that_acts_needs_no_further_agreement() -> None:
    election = leader_of_long_standing(5)
    step(election, 30, heard=said(None))
    assert election.acts


def test_follower_agrees_when_all_it_hears_follow_and_all_behind_it_agree() -> None:
    election = follower_of(lease(1, 500, established=True))  # at one hop
    step(election, heard=[*said(lease(1, 499), 0, agreed=False), *said(lease(1, 499), 1, agreed=False)])
    assert election.agreed
    step(election, heard=said(lease(1, 499), 2, agreed=False))
    assert not election.agreed
    step(election, heard=said(lease(2, 499), 1))
    assert not election.agreed


def test_best_candidate_behind_goes_up_and_those_ahead_do_not_count() -> None:
    election = follower_of(lease(1, 500, established=True), me=4)
    ahead, behind = Candidate(2, 9, 9), Candidate(6, 0, 5)
    views = [*said(lease(1), 1, candidate=ahead), *said(lease(1), 2, candidate=behind)]
    step(election, score=4, heard=views)
    assert election.candidate == behind
    step(election, score=5, heard=views)
    assert election.candidate == Candidate(4, 0, 5)  # the lower id
    step(election, eligible=False, heard=views)
    assert election.candidate == behind


# --- succession ---


def led_with_heir(candidate: Candidate, *, reelection_periods: int = 0) -> Election:
    election = Election(9, 0, reelection_periods=reelection_periods)
    step(election, ACT_PERIODS, score=5, heard=said(lease(9), candidate=candidate))
    assert election.lease is not None
    assert election.lease.heir == candidate.vehicle
    return election


def test_leader_names_the_best_candidate_as_its_heir_and_keeps_it_while_reports_flicker() -> None:
    election = led_with_heir(Candidate(3, 0, 5))
    step(election, HEIR_STAYS_PERIODS - 1, heard=said(lease(9), candidate=Candidate(4, 0, 5)))
    assert election.lease is not None
    assert election.lease.heir == 3
    step(election, heard=said(lease(9), candidate=Candidate(4, 0, 5)))
    assert election.lease.heir == 4


@pytest.mark.parametrize(("score", "hands_over"), [(5 + HYSTERESIS, True), (4 + HYSTERESIS, False), (5, False)])
def test_clearly_better_candidate_takes_over_at_the_period_and_others_never(score: int, hands_over: bool) -> None:
    better = said(lease(9), candidate=Candidate(3, 0, score))
    election = led_with_heir(Candidate(3, 0, score), reelection_periods=50)
    step(election, 49 - ACT_PERIODS, score=5, heard=better)
    assert election.lease is not None
    assert election.lease.ends == 0
    step(election, score=5, heard=better)
    assert (election.lease.ends > 0) == hands_over
    acted = election.acts
    step(election, HANDOVER_PERIODS, score=5, heard=better)
    assert acted
    assert election.acts != hands_over


def test_without_a_period_the_score_changes_nothing() -> None:
    election = led_with_heir(Candidate(3, 0, 10))
    step(election, 2000, score=1, heard=said(lease(9), candidate=Candidate(3, 0, 10)))
    assert election.acts


def test_predetermined_candidate_takes_over_at_once() -> None:
    election = led_with_heir(Candidate(3, 1, 0))
    step(election, HANDOVER_PERIODS, score=10, heard=said(lease(9), candidate=Candidate(3, 1, 0)))
    assert not election.leads


def test_leader_that_may_not_lead_any_more_leads_on_until_its_heir_takes_over() -> None:
    election = led_with_heir(Candidate(3, 0, 0))
    heard = said(lease(9), candidate=Candidate(3, 0, 0))
    for _ in range(RESIGN_PERIODS):
        step(election, eligible=False, heard=heard)
        assert election.acts
    step(election, eligible=False, heard=heard)
    assert not election.acts
    assert election.lease == lease(3, 0, established=True)


def test_leader_and_heir_change_places_in_the_same_period() -> None:
    leader, heir = led_with_heir(Candidate(3, 1, 0)), Election(3, 1)
    changed = []
    for k in range(2 * HANDOVER_PERIODS):
        assert leader.lease is not None
        if leader.leads and k % 3:  # a third of the news is lost
            heir.receive_lease(leader.lease, leader.hop)
        step(leader, score=10, heard=said(lease(9), candidate=Candidate(3, 1, 0)))
        step(heir, heard=said(lease(9), 0))
        assert leader.acts != heir.acts
        changed.append(heir.acts)
        if heir.lease is not None and heir.leads:
            leader.receive_lease(heir.lease, 0)
    assert changed == sorted(changed)
    assert changed[-1]
    assert leader.lease is not None
    assert leader.lease.leader == 3


def test_followers_go_over_to_the_heir_whatever_its_rank_and_not_back() -> None:
    election = follower_of(lease(1, 500, priority=3, established=True, heir=4, ends=510))
    assert election.receive_lease(lease(4, 77, established=True), 0)
    assert not election.receive_lease(lease(1, 509, priority=3, established=True, heir=4, ends=510), 0)


def heir_of_the_lost(known: int) -> Election:
    """Has followed 1 for so many periods as its heir; 1 has just been given up."""
    election = follower_of(lease(1, 500, established=True, heir=9))
    for k in range(known):
        election.receive_lease(lease(1, 501 + k, established=True, heir=9), 0)
        step(election)
    step(election, LEASE_PERIODS - 1, heard=said(None))
    assert election.leads
    return election


def test_heir_of_a_lost_leader_acts_soon_and_without_agreement() -> None:
    election = heir_of_the_lost(HEIR_KNOWN_PERIODS)
    step(election, HELD_PERIODS - 2, heard=said(None))
    assert not election.acts
    step(election, heard=said(None))
    assert election.acts


def test_heir_that_not_all_may_know_of_waits_for_agreement() -> None:
    election = heir_of_the_lost(HEIR_KNOWN_PERIODS - LEASE_PERIODS - 1)
    step(election, ACT_PERIODS, heard=said(None))
    assert election.leads
    assert not election.acts


def test_among_claims_that_of_the_lost_leaders_heir_comes_first() -> None:
    election = follower_of(lease(1, 500, established=True, heir=4))
    step(election, LEASE_PERIODS, score=10)
    assert election.leads
    assert election.receive_lease(lease(4, 7), 0)
    assert not election.receive_lease(lease(2, 7, priority=5, score=10), 0)
    assert election.receive_lease(lease(3, 7, established=True), 0)  # but an established one before it
