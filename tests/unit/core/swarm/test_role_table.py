"""The table of roles: closed, and at one with the lease that an election holds."""

from __future__ import annotations

import itertools

import pytest

from companion.core.model.states import Role
from companion.core.swarm.election import ACT_PERIODS, LEASE_PERIODS, Election
from companion.core.swarm.role_table import TRANSITIONS, RoleEvent, transition
from tests.unit.core.core_election_kit import step
from tests.unit.core.core_kit import lease


@pytest.mark.parametrize(("role", "event"), list(itertools.product(Role, RoleEvent)))
def test_every_event_in_every_role_has_a_row_or_is_refused(role: Role, event: RoleEvent) -> None:
    following = TRANSITIONS[role].get(event)
    if following is not None:
        assert transition(role, event) is following
        return
    with pytest.raises(ValueError, match=f"{role.name}: {event.name} is refused"):
        transition(role, event)


def test_every_event_changes_some_role_and_every_role_can_be_had_and_lost() -> None:
    assert {event for rows in TRANSITIONS.values() for event in rows} == set(RoleEvent)
    for first in Role:
        reached, new = {first}, {first}
        while new:
            new = {following for role in new for following in TRANSITIONS[role].values()} - reached
            reached |= new
        assert reached == set(Role)


def test_nobody_leads_who_has_not_claimed_it_or_is_heir() -> None:
    assert {event for rows in TRANSITIONS.values() for event, to in rows.items() if to is Role.LEADER} == {
        RoleEvent.AGREE,
        RoleEvent.SUCCEED,
    }
    assert RoleEvent.SUCCEED not in TRANSITIONS[Role.UNLED]


def test_a_vehicle_claims_leads_follows_and_is_left_without_a_leader() -> None:
    election = Election(5, 0)
    assert election.role is Role.UNLED
    step(election)
    assert election.role is Role.CLAIMANT
    step(election, ACT_PERIODS)
    assert election.role is Role.LEADER
    assert election.receive_lease(lease(1, 7, established=True), 0)
    assert election.role is Role.FOLLOWER
    step(election, LEASE_PERIODS, eligible=False)
    assert election.role is Role.UNLED
    assert election.lease is None
