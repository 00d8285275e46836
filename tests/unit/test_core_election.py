"""One vehicle's view of who leads, period by period. Whole networks: tests/scenario/test_core_election_laws.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from core_kit import beacon, lease

from companion.core.election import (
    ACT_PERIODS,
    EARLIER_SEQ_LIMIT,
    ECHO_SEQS,
    FIRST_SEQ_LIMIT,
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
    TOMB_PERIODS,
    TOMBS,
    Election,
    View,
    priority_of,
    rank,
)
from companion.core.types import Beacon, Candidate, Lease

PERIOD_S = 0.1


def step(
    election: Election,
    periods: int = 1,
    *,
    now_s: float = 0.0,
    eligible: bool = True,
    score: int = 0,
    heard: Sequence[View] = (),
) -> None:
    for _ in range(periods):
        election.step(now_s, period_s=PERIOD_S, eligible=eligible, score=score, heard=heard)


def follower_of(leader: Lease, me: int = 9, *, priority: int = 0) -> Election:
    """A vehicle that has just heard this leader itself."""
    election = Election(me, priority)
    assert election.hear(leader, 0)
    return election


def said(
    who: Lease | None, hop: int = 1, *, agreed: bool = True, candidate: Candidate | None = None
) -> tuple[Beacon, ...]:
    """A neighbour's view."""
    return (beacon(7, lease=who, hop=hop, agreed=agreed, candidate=candidate),)


def leader_of_long_standing(me: int = 9, *, priority: int = 0, score: int = 0) -> Election:
    election = Election(me, priority)
    step(election, ACT_PERIODS, score=score)
    assert election.acts
    return election


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
    assert election.hear(lease(4, established=True), 0)
    assert not election.leads
    assert not election.acts
    assert election.hop == 1


def test_follower_keeps_its_leader_against_an_equal_or_lower_rank() -> None:
    election = follower_of(lease(3, score=5))
    assert not election.hear(lease(4, score=5), 0)
    assert not election.hear(lease(2, score=4), 0)
    assert election.lease == lease(3, score=5)


@pytest.mark.parametrize("newcomer", [lease(1, score=0), lease(1, score=10)], ids=["equal", "better score"])
def test_incumbent_is_not_displaced_by_a_newcomer_of_its_priority(newcomer: Lease) -> None:
    election = leader_of_long_standing(9)
    assert not election.hear(newcomer, 0)
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
        assert renewed.hear(lease(1, 500 + k), 3)
        echoed.hear(lease(1, 500), 3)
    assert not renewed.leads
    assert echoed.leads


def test_older_count_of_the_same_leader_is_no_news() -> None:
    election = follower_of(lease(1, 500))
    assert not election.hear(lease(1, 499), 0)
    assert election.lease == lease(1, 500)


def test_shorter_way_to_the_same_count_shortens_the_hops_without_renewing() -> None:
    election = Election(9, 0)
    election.hear(lease(1, 500), 6)
    step(election, 3)
    assert not election.hear(lease(1, 500), 2)
    assert election.hop == 3
    assert election.age == 3
    election.hear(lease(1, 500), 8)
    assert election.hop == 3


def test_echoes_of_a_lost_leader_are_refused_and_its_newer_counts_are_not() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS)
    assert not election.hear(lease(1, 500, established=True), 0)
    assert not election.hear(lease(1, 12, established=True), 0)
    assert election.leads
    assert election.hear(lease(1, 501, established=True), 0)
    assert not election.leads


def test_tomb_of_a_lost_leader_is_cleared_once_its_echoes_are_gone() -> None:
    election = follower_of(lease(1, 500, established=True))
    step(election, LEASE_PERIODS)
    step(election, TOMB_PERIODS - 1)
    assert not election.hear(lease(1, 3, established=True), 0)
    step(election)
    assert election.hear(lease(1, 3, established=True), 0)


def test_leader_restarted_with_a_clock_that_went_on_is_followed_again_at_once() -> None:
    first_life = Election(1, 1)
    step(first_life, 30, now_s=100.0)
    assert first_life.lease is not None
    follower = follower_of(first_life.lease, priority=0)
    step(follower, LEASE_PERIODS)
    second_life = Election(1, 1)
    step(second_life, now_s=104.0)  # 30 periods lived, ten more gone
    assert second_life.lease is not None
    assert follower.hear(second_life.lease, 0)
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
    assert not follower.hear(reborn, 0)
    step(follower, eligible=False)
    assert follower.hear(reborn, 0)


def test_follower_that_takes_the_lead_is_no_hops_from_the_leader() -> None:
    election = Election(9, 0)
    election.hear(lease(1, 500), 6)
    step(election, LEASE_PERIODS)
    assert election.leads
    assert election.hop == 0


def test_another_leader_is_news_until_the_next_step_and_a_newer_count_is_not() -> None:
    election = Election(9, 0)
    step(election)
    assert not election.changed
    election.hear(lease(1, 500), 0)
    assert election.changed
    step(election)
    election.hear(lease(1, 501), 0)
    assert not election.changed


def test_nobody_has_agreed_yet_on_a_leader_just_heard_of() -> None:
    election = Election(9, 0)
    step(election, heard=said(lease(9), candidate=Candidate(12, 0, 3)))
    assert election.agreed
    election.hear(lease(1, 500), 0)
    assert not election.agreed
    assert election.candidate is None


def test_early_beacon_is_a_count_back_so_that_an_heir_does_not_reckon_ahead() -> None:
    election = Election(9, 0)
    assert election.early is None
    election.hear(lease(1, 500, heir=4), 2)
    assert election.early == lease(1, 499, heir=4)
    election.hear(lease(2, 0, established=True), 0)  # an heir's first, as its forerunner says it
    assert election.early == lease(2, 0, established=True)


def test_of_equal_candidates_the_one_nearer_to_the_leader_goes_up() -> None:
    election = follower_of(lease(1, 500, established=True), me=7)
    step(election, score=5, heard=said(lease(1), 2, candidate=Candidate(6, 0, 5)))
    assert election.candidate == Candidate(7, 0, 5)


def test_own_claim_coming_back_is_no_news() -> None:
    election = leader_of_long_standing(9)
    before = election.lease
    assert not election.hear(lease(9, 3, priority=9, score=7), 4)
    assert election.lease == before
    assert election.hop == 0
    restarted = Election(9, 0)
    assert not restarted.hear(lease(9, 77, established=True), 2)
    assert restarted.lease is None


def test_news_from_beyond_the_hop_limit_is_ignored() -> None:
    election = Election(9, 0)
    assert not election.hear(lease(1, 5), HOP_LIMIT)
    assert not election.hear(lease(1, 5), 255)
    assert election.hear(lease(1, 5), HOP_LIMIT - 1)
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
        election.hear(lease(1, SEQ_LIMIT, priority=255, established=True), 0)
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
    assert election.hear(replace(lease(200, 3), established=True), 0)


# --- what cannot be true ---


@pytest.mark.parametrize("seq", [SEQ_LIMIT + 1, 2**32 - 1])
def test_count_beyond_all_clocks_is_refused(seq: int) -> None:
    election = Election(9, 0)
    assert not election.hear(lease(1, seq, priority=9, established=True), 0)
    assert election.lease is None


@pytest.mark.parametrize(("ahead", "believed"), [(SEQ_JUMP, True), (SEQ_JUMP + 1, False), (2**31, False)])
def test_count_far_ahead_of_what_the_leader_can_have_counted_is_refused(ahead: int, believed: bool) -> None:
    election = follower_of(lease(1, 500, established=True))
    assert election.hear(lease(1, 500 + ahead, established=True), 0) == believed
    step(election)
    assert election.hear(lease(1, 501, established=True), 0) != believed


def test_leader_outcounts_what_others_say_of_it() -> None:
    """A false count is believed: the leader's next is above it, so the lease is the leader's again."""
    election = leader_of_long_standing(1)
    assert election.lease is not None
    false = election.lease.seq + SEQ_JUMP
    election.hear(replace(election.lease, seq=false), 3)
    step(election)
    assert election.lease.seq == false + 1
    assert election.acts


def test_leader_does_not_outcount_what_its_followers_refuse() -> None:
    election = leader_of_long_standing(1)
    assert election.lease is not None
    true = election.lease.seq
    election.hear(replace(election.lease, seq=true + SEQ_JUMP + 1), 3)
    election.hear(replace(election.lease, seq=2**32 - 1), 3)
    step(election)
    assert election.lease.seq == true + 1


def test_claimant_that_hears_of_an_earlier_life_counts_on_from_there() -> None:
    reborn, follower = Election(1, 0), follower_of(lease(1, 90_000, established=True))
    step(reborn)
    reborn.hear(lease(1, 90_000, established=True), 1)
    step(reborn)
    assert reborn.lease is not None
    assert follower.hear(reborn.lease, 0)


@pytest.mark.parametrize("seq", [EARLIER_SEQ_LIMIT + 1, SEQ_LIMIT])
def test_earlier_life_that_leaves_no_room_to_count_on_is_not_believed(seq: int) -> None:
    election = Election(1, 0)
    election.hear(lease(1, seq, established=True), 1)
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
    election.hear(lease(1, 7, established=True), 0)
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
    assert not election.hear(lease(9, score=SCORE_LIMIT + 1), 0)
    assert election.hear(lease(9, score=SCORE_LIMIT), 0)


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
    assert election.hear(lease(1, 500, established=True, heir=4, ends=ends), hop) == believed


def test_way_longer_than_the_swarm_is_refused() -> None:
    election = Election(9, 0, size=4)
    assert not election.hear(lease(1), 4)
    assert election.hear(lease(1), 3)


def test_heir_that_is_expected_in_vain_is_expected_no_more() -> None:
    """Vehicles that were told of different heirs would give way to different claims for ever."""
    election = follower_of(lease(1, 500, established=True, heir=4), me=3)
    step(election, LEASE_PERIODS)
    assert election.hear(lease(4, 7), 0)
    step(election, LEASE_PERIODS)
    assert election.leads
    assert not election.hear(lease(4, 8), 0)


def test_lost_leaders_kept_in_mind_are_bounded() -> None:
    election = Election(9, 0)
    for k in range(3 * TOMBS):
        election.hear(lease(10 + k, 500, established=True, heir=11 + k, ends=510, score=5), 0)
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
    election.hear(lease(1, 501), 4)  # the direct word was lost
    assert election.hop == 1
    step(election, heard=said(lease(1, 501), 2, agreed=False))
    assert not election.agreed
    election.hear(lease(1, 502, established=True), 4)
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
            heir.hear(leader.lease, leader.hop)
        step(leader, score=10, heard=said(lease(9), candidate=Candidate(3, 1, 0)))
        step(heir, heard=said(lease(9), 0))
        assert leader.acts != heir.acts
        changed.append(heir.acts)
        if heir.lease is not None and heir.leads:
            leader.hear(heir.lease, 0)
    assert changed == sorted(changed)
    assert changed[-1]
    assert leader.lease is not None
    assert leader.lease.leader == 3


def test_followers_go_over_to_the_heir_whatever_its_rank_and_not_back() -> None:
    election = follower_of(lease(1, 500, priority=3, established=True, heir=4, ends=510))
    assert election.hear(lease(4, 77, established=True), 0)
    assert not election.hear(lease(1, 509, priority=3, established=True, heir=4, ends=510), 0)


def heir_of_the_lost(known: int) -> Election:
    """Has followed 1 for so many periods as its heir; 1 has just been given up."""
    election = follower_of(lease(1, 500, established=True, heir=9))
    for k in range(known):
        election.hear(lease(1, 501 + k, established=True, heir=9), 0)
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
    assert election.hear(lease(4, 7), 0)
    assert not election.hear(lease(2, 7, priority=5, score=10), 0)
    assert election.hear(lease(3, 7, established=True), 0)  # but an established one before it
