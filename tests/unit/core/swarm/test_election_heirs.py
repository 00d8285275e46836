"""An heir that is not there: the lead is handed over to it once, and not again for a while."""

from __future__ import annotations

import pytest

from companion.core.model.beacon import Beacon, Candidate
from companion.core.swarm.election import HANDOVER_PERIODS, HEIR_ABSENT_S, LEASE_PERIODS, Election
from tests.unit.core.core_election_kit import PERIOD_S, follower_of, leader_of_long_standing, said, step
from tests.unit.core.core_kit import lease

pytestmark = pytest.mark.sources


def names(best: Candidate, election: Election) -> tuple[Beacon, ...]:
    """A follower of that one's, and what it says of who is to succeed."""
    return said(election.lease, candidate=best)


def hands_over_in_vain(heir: int) -> Election:
    election = leader_of_long_standing(score=3)
    for _ in range(2 * HANDOVER_PERIODS + LEASE_PERIODS):
        step(election, score=3, heard=names(Candidate(heir, 1, 9), election))
    assert election.leads
    return election


def test_one_that_was_handed_the_lead_and_did_not_take_it_is_no_heir_for_a_while() -> None:
    election = hands_over_in_vain(7)
    for _ in range(round(0.8 * HEIR_ABSENT_S / PERIOD_S)):
        step(election, score=3, heard=names(Candidate(7, 1, 9), election))
        assert election.leads
        assert election.lease is not None
        assert election.lease.heir == 0
    for _ in range(round(0.3 * HEIR_ABSENT_S / PERIOD_S)):
        step(election, score=3, heard=names(Candidate(7, 1, 9), election))
        if not election.leads:
            break
    assert not election.leads  # by then it may be there


def test_another_heir_takes_the_lead_meanwhile() -> None:
    election = hands_over_in_vain(7)
    for _ in range(60):
        step(election, score=3, heard=[*names(Candidate(7, 1, 9), election), *names(Candidate(8, 1, 5), election)])
        if not election.leads:
            break
    assert election.lease is not None
    assert (election.lease.leader, election.lease.seq) == (8, 0)


@pytest.mark.parametrize(("ahead", "is_absent"), [(1, True), (5, True), (6, False), (20, False)])
def test_followers_take_no_heir_for_absent_that_had_no_time_to_be_heard(ahead: int, *, is_absent: bool) -> None:
    """The leader falls silent `ahead` periods before the hand-over that it has announced; its lease runs out after."""
    election = follower_of(lease(1, 500, priority=2, established=True, heir=7, ends=500 + ahead))
    step(election, LEASE_PERIODS, eligible=False)
    assert election.lease is None
    step(election, 2)
    assert election.lease is not None
    step(election, heard=names(Candidate(7, 1, 9), election))
    assert (election.candidate is None) is is_absent


def test_an_heir_that_takes_over_is_an_heir_again_when_another_leads() -> None:
    election = follower_of(lease(1, 500, priority=2, established=True, heir=7, ends=502))
    step(election, 4, eligible=False)
    assert election.receive_lease(lease(7, 900, established=True), 0)
    step(election, LEASE_PERIODS, eligible=False)  # it is lost later
    step(election, 2)
    step(election, heard=names(Candidate(7, 1, 9), election))
    assert election.candidate == Candidate(7, 1, 9)


def test_as_many_absent_heirs_are_remembered_as_a_swarm_has_members() -> None:
    election = Election(9, 0, size=3)
    for heir in range(100, 120):
        assert election.receive_lease(lease(1, 500 + 10 * heir, established=True, heir=heir, ends=501 + 10 * heir), 0)
        step(election, LEASE_PERIODS, eligible=False)
    assert list(election._absent_s) == [117, 118, 119]
