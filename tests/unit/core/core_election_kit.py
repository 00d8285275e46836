"""One election, stepped by hand."""

from __future__ import annotations

from collections.abc import Sequence

from companion.core.model.beacon import Beacon, Candidate, Lease
from companion.core.swarm.election import ACT_PERIODS, Election, View
from tests.unit.core.core_kit import beacon

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
        election.run_period(now_s, period_s=PERIOD_S, eligible=eligible, score=score, heard=heard)


def follower_of(leader: Lease, me: int = 9, *, priority: int = 0) -> Election:
    """A vehicle that has just heard this leader itself."""
    election = Election(me, priority)
    assert election.receive_lease(leader, 0)
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
