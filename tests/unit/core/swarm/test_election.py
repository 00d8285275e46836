"""One vehicle's view of which leads, period by period. Whole networks: tests/scenario/test_core_election_laws.py."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import Candidate, Lease
from companion.core.swarm.election import (
    ACT_PERIODS,
    ECHO_SEQS,
    FIRST_SEQ_LIMIT,
    HELD_PERIODS,
    HOP_LIMIT,
    LEASE_PERIODS,
    SEQ_LIMIT,
    TOMB_PERIODS,
    Election,
    priority_of,
    rank,
)
from tests.unit.core.core_election_kit import PERIOD_S, follower_of, leader_of_long_standing, said, step
from tests.unit.core.core_kit import lease


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (lease(9, established=True), lease(1, priority=1, score=10)),
        (lease(9, priority=1), lease(1, score=10)),
        (lease(9, score=1), lease(1)),
        (lease(1), lease(2)),
    ],
    ids=["established before all else", "priority before score", "score before id", "low id at last"],
)
def test_rank_compares_in_order(better: Lease, worse: Lease) -> None:
    assert rank(better) > rank(worse)


def test_rank_ignores_the_count_so_an_old_leader_does_not_win_by_age() -> None:
    assert rank(lease(3, seq=1)) == rank(lease(3, seq=SEQ_LIMIT))


def test_priority_falls_along_the_missions_list_and_is_zero_off_it() -> None:
    assert [priority_of(i, (7, 3, 5)) for i in (7, 3, 5, 1)] == [3, 2, 1, 0]


def test_vehicle_that_hears_nobody_claims_at_once_and_acts_after_ten_periods() -> None:
    election = Election(5, 0)
    acts = []
    for _ in range(ACT_PERIODS + 1):
        step(election)
        assert election.leads
        assert election.hop == 0
        acts.append(election.acts)
    assert acts == [False] * (ACT_PERIODS - 1) + [True, True]


def test_claim_is_established_on_the_wire_from_the_period_in_which_it_acts() -> None:
    election = Election(5, 0)
    for _ in range(2 * ACT_PERIODS):
        step(election)
        assert election.lease is not None
        assert election.lease.established == election.acts


def test_leaders_count_advances_each_period() -> None:
    election = Election(5, 0)
    counts = []
    for _ in range(5):
        step(election, now_s=1000.0)
        assert election.lease is not None
        counts.append(election.lease.seq)
    assert counts == list(range(counts[0], counts[0] + 5))


def test_ineligible_vehicle_never_claims() -> None:
    election = Election(1, 5)
    step(election, 3 * LEASE_PERIODS, eligible=False)
    assert election.lease is None


def test_claimant_gives_way_to_a_higher_rank_and_stops_acting() -> None:
    election = leader_of_long_standing(5)
    assert election.receive_lease(lease(4, established=True), 0)
    assert not election.leads
    assert not election.acts
    assert election.hop == 1


def test_follower_keeps_its_leader_against_an_equal_or_lower_rank() -> None:
    election = follower_of(lease(3, score=5))
    assert not election.receive_lease(lease(4, score=5), 0)
    assert not election.receive_lease(lease(2, score=4), 0)
    assert election.lease == lease(3, score=5)


@pytest.mark.parametrize("newcomer", [lease(1, score=0), lease(1, score=10)], ids=["equal", "better score"])
def test_incumbent_is_not_displaced_by_a_newcomer_of_its_priority(newcomer: Lease) -> None:
    election = leader_of_long_standing(9)
    assert not election.receive_lease(newcomer, 0)
    assert election.acts


def test_predetermined_vehicle_waits_for_an_established_leader_to_hand_over() -> None:
    election = follower_of(lease(1, 500, score=10, established=True), priority=1)
    step(election)
    assert not election.leads
    assert election.candidate == Candidate(9, 1, 0)


def test_follower_with_the_better_score_lets_an_established_leader_be() -> None:
    election = follower_of(lease(20, 500, established=True), me=1)
    step(election, score=10)
    assert election.lease == lease(20, 500, established=True)


def test_leader_that_falls_silent_is_replaced_after_ten_periods() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS - 1)
    assert not election.leads
    step(election)
    assert election.leads


def test_only_an_advancing_count_renews_the_lease() -> None:
    renewed, echoed = follower_of(lease(1, 500)), follower_of(lease(1, 500))
    for k in range(1, 2 * LEASE_PERIODS):
        step(renewed)
        step(echoed)
        assert renewed.receive_lease(lease(1, 500 + k), 3)
        echoed.receive_lease(lease(1, 500), 3)
    assert not renewed.leads
    assert echoed.leads


def test_older_count_of_the_same_leader_is_no_news() -> None:
    election = follower_of(lease(1, 500))
    assert not election.receive_lease(lease(1, 499), 0)
    assert election.lease == lease(1, 500)


def test_shorter_way_to_the_same_count_shortens_the_hops_without_renewing() -> None:
    election = Election(9, 0)
    election.receive_lease(lease(1, 500), 6)
    step(election, 3)
    assert not election.receive_lease(lease(1, 500), 2)
    assert election.hop == 3
    assert election.age == 3
    election.receive_lease(lease(1, 500), 8)
    assert election.hop == 3


def test_echoes_of_a_lost_leader_are_refused_and_its_newer_counts_are_not() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS)
    assert not election.receive_lease(lease(1, 500, established=True), 0)
    assert not election.receive_lease(lease(1, 12, established=True), 0)
    assert election.leads
    assert election.receive_lease(lease(1, 501, established=True), 0)
    assert not election.leads


def test_tomb_of_a_lost_leader_is_cleared_once_its_echoes_are_gone() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS)
    step(election, TOMB_PERIODS - 1)
    assert not election.receive_lease(lease(1, 3, established=True), 0)
    step(election)
    assert election.receive_lease(lease(1, 3, established=True), 0)


def test_leader_restarted_with_a_clock_that_went_on_is_followed_again_at_once() -> None:
    first_life = Election(1, 1)
    step(first_life, 30, now_s=100.0)
    assert first_life.lease is not None
    follower = follower_of(first_life.lease, priority=0)
    step(follower, LEASE_PERIODS)
    second_life = Election(1, 1)
    step(second_life, now_s=104.0)  # 30 periods lived, ten more gone
    assert second_life.lease is not None
    assert follower.receive_lease(second_life.lease, 0)
    assert follower.lease == second_life.lease


@pytest.mark.parametrize(
    ("counted", "followed_after"),
    [(ECHO_SEQS + 300, LEASE_PERIODS), (ECHO_SEQS, LEASE_PERIODS + TOMB_PERIODS)],
    ids=["far below its last count: at once", "among its echoes: when they are gone"],
)
def test_leader_restarted_with_its_clock_at_zero_is_followed_when_its_lease_has_run_out(
    counted: int, followed_after: int
) -> None:
    follower = follower_of(lease(1, counted, priority=1, established=True))
    reborn = lease(1, 251, priority=1)
    step(follower, followed_after - 1, eligible=False)
    assert not follower.receive_lease(reborn, 0)
    step(follower, eligible=False)
    assert follower.receive_lease(reborn, 0)


def test_follower_that_takes_the_lead_is_no_hops_from_the_leader() -> None:
    election = Election(9, 0)
    election.receive_lease(lease(1, 500), 6)
    step(election, LEASE_PERIODS)
    assert election.leads
    assert election.hop == 0


def test_another_leader_is_news_until_the_next_step_and_a_newer_count_is_not() -> None:
    election = Election(9, 0)
    step(election)
    assert not election.changed
    election.receive_lease(lease(1, 500), 0)
    assert election.changed
    step(election)
    election.receive_lease(lease(1, 501), 0)
    assert not election.changed


def test_nobody_has_agreed_yet_on_a_leader_just_heard_of() -> None:
    election = Election(9, 0)
    step(election, heard=said(lease(9), candidate=Candidate(12, 0, 3)))
    assert election.agreed
    election.receive_lease(lease(1, 500), 0)
    assert not election.agreed
    assert election.candidate is None


def test_early_beacon_is_a_count_back_so_that_an_heir_does_not_reckon_ahead() -> None:
    election = Election(9, 0)
    assert election.early is None
    election.receive_lease(lease(1, 500, heir=4), 2)
    assert election.early == lease(1, 499, heir=4)
    election.receive_lease(lease(2, 0, established=True), 0)  # an heir's first, as its forerunner says it
    assert election.early == lease(2, 0, established=True)


def test_of_equal_candidates_the_one_nearer_to_the_leader_goes_up() -> None:
    election = follower_of(lease(1, 500, established=True), me=7)
    step(election, score=5, heard=said(lease(1), 2, candidate=Candidate(6, 0, 5)))
    assert election.candidate == Candidate(7, 0, 5)


def test_own_claim_coming_back_is_no_news() -> None:
    election = leader_of_long_standing(9)
    before = election.lease
    assert not election.receive_lease(lease(9, 3, priority=9, score=7), 4)
    assert election.lease == before
    assert election.hop == 0
    restarted = Election(9, 0)
    assert not restarted.receive_lease(lease(9, 77, established=True), 2)
    assert restarted.lease is None


def test_news_from_beyond_the_hop_limit_is_ignored() -> None:
    election = Election(9, 0)
    assert not election.receive_lease(lease(1, 5), HOP_LIMIT)
    assert not election.receive_lease(lease(1, 5), 255)
    assert election.receive_lease(lease(1, 5), HOP_LIMIT - 1)
    assert election.hop == HOP_LIMIT


@pytest.mark.parametrize("leads_before", [1, ACT_PERIODS])
def test_leader_that_may_not_lead_any_more_resigns_at_once(leads_before: int) -> None:
    election = Election(1, 0)
    step(election, leads_before)
    step(election, eligible=False)
    assert election.lease is None
    assert not election.leads
    assert not election.acts


def test_leader_that_resigned_must_hold_its_claim_again() -> None:
    election = leader_of_long_standing(1)
    step(election, eligible=False)
    step(election, HELD_PERIODS - 1)
    assert election.leads
    assert not election.acts


def test_ineligible_follower_keeps_following() -> None:
    election = follower_of(lease(1, 5))
    step(election, eligible=False)
    assert election.lease == lease(1, 5)


def test_highest_possible_count_cannot_freeze_the_lead() -> None:
    """A count that does not advance any more runs out like that of a silent leader."""
    election = follower_of(lease(1, SEQ_LIMIT, priority=255, established=True))
    for _ in range(LEASE_PERIODS):
        step(election)
        election.receive_lease(lease(1, SEQ_LIMIT, priority=255, established=True), 0)
    assert election.leads


@pytest.mark.parametrize("now_s", [1.7e9, 2.0**31 * PERIOD_S, SEQ_LIMIT * PERIOD_S * 4])
def test_clock_that_counts_from_1970_leaves_room_to_count_on(now_s: float) -> None:
    election = Election(1, 0)
    counts = set()
    for _ in range(100):
        step(election, now_s=now_s)
        assert election.lease is not None
        counts.add(election.lease.seq)
    assert len(counts) == 100
    assert max(counts) <= FIRST_SEQ_LIMIT + HOP_LIMIT + 100
    assert election.acts


def test_score_is_that_of_the_claim_not_of_the_moment() -> None:
    """A battery that empties does not hand the lead to and fro."""
    election = Election(1, 0)
    step(election, score=9)
    step(election, score=3)
    assert election.lease is not None
    assert election.lease.score == 9


def test_claims_after_a_loss_are_below_the_established() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS)
    assert election.lease is not None
    assert not election.lease.established
    assert election.receive_lease(replace(lease(200, 3), established=True), 0)
