"""Who succeeds, in whole networks: losses, merges, re-election, restarts."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.model.beacon import Lease
from companion.core.swarm.election import (
    HANDOVER_PERIODS,
    HEIR_STAYS_PERIODS,
    HELD_PERIODS,
    HOP_LIMIT,
    HYSTERESIS,
    LEASE_PERIODS,
    RESIGN_PERIODS,
    SEQ_LIMIT,
    Election,
)
from tests.unit.core.core_election_net import (
    Net,
)
from tests.unit.core.core_election_swarms import MAX_DIAMETER, swarms


@given(swarms(near=True), st.floats(0.0, 1.0))
@settings(max_examples=20)
def test_lost_leader_is_replaced_by_one_acting_leader_within_25_periods(swarm: dict[str, Any], loss: float) -> None:
    net = Net(**swarm, loss=0.1 * loss)
    net.run(40)
    if len(net.alive) < 2:
        return
    (leader,) = net.acting()
    net.alive.discard(leader)
    components = net.components()
    if net.diameter() > 4:  # a part without the heir waits for its echo
        return
    net.run(25)
    for component in components:
        assert sum(net.nodes[i].acts for i in component) == 1


@pytest.mark.parametrize("n", range(3, 12))
def test_heir_takes_over_fourteen_periods_after_the_leaders_last_news(n: int) -> None:
    """The lease and the heir's wait, less the period they share; however far the others are."""
    net = Net(range(1, n + 1), [(i, i + 1) for i in range(1, n)])
    net.run(60)
    assert net.acting() == [1]
    net.alive.discard(1)
    net.run(LEASE_PERIODS + HELD_PERIODS)
    assert net.acting() == [2]
    net.run(n)
    assert net.views(net.alive) == {2}


@given(swarms(), swarms(), st.integers(0, 2**32))
@settings(max_examples=20)
def test_merged_swarms_keep_one_leader_and_the_lower_resigns(
    left: dict[str, Any], right: dict[str, Any], seed: int
) -> None:
    ids = left["ids"] + [i for i in right["ids"] if i not in left["ids"]]
    edges = left["edges"] | {e for e in right["edges"] if not set(e) & set(left["ids"])}
    both = {key: right[key] | left[key] for key in ("priority", "score")}
    net = Net(ids, edges, seed=seed, **both)
    net.run(60)
    leaders = net.acting()
    assert len(leaders) == len(net.components())
    # Any one of either side meets any one of the other.
    meeting = [min(component) for component in net.components()]
    for a, b in itertools.pairwise(meeting):
        net.link(a, b)
    if net.diameter() > MAX_DIAMETER:
        return
    net.run(net.diameter() + 1)
    assert net.acting() == [net.best(leaders)]
    net.run(20)
    assert net.views(net.alive) == {net.best(leaders)}


@given(swarms(priorities=False))
@settings(max_examples=20)
def test_newcomer_never_displaces_the_incumbent_of_its_priority(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    if net.diameter() > MAX_DIAMETER - 1:
        return
    best = net.best(net.alive)
    net.alive.discard(best)
    if not net.alive:
        return
    net.run(40)
    incumbents = net.acting()
    net.alive.add(best)  # the best of all comes late
    for _ in range(60):
        net.step()
        assert set(net.acting()) <= set(incumbents)
    assert len(net.acting()) == 1


@given(swarms(priorities=False))
@settings(max_examples=20)
def test_predetermined_leader_takes_over_even_when_it_comes_late(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    chosen = max(net.nodes)
    net.nodes[chosen] = Election(chosen, 1)
    net.alive.discard(chosen)
    net.run(40)
    net.alive.add(chosen)
    net.run(HEIR_STAYS_PERIODS + HANDOVER_PERIODS + 2 * net.diameter() + 1)  # to be seen, named and told
    assert net.acting() == [chosen]
    assert net.views(net.alive) == {chosen}


@given(swarms())
@settings(max_examples=20)
def test_resigned_leader_is_replaced_and_does_not_lead_while_ineligible(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    if len(net.alive) < 2 or net.diameter() > MAX_DIAMETER:
        return
    net.run(40)
    (leader,) = net.acting()
    net.eligible.discard(leader)
    for _ in range(50):
        net.step()
        assert len(net.acting()) == 1  # without a gap
    (successor,), best = net.acting(), net.best(net.alive)
    assert (net.priority[successor], net.score[successor]) == (net.priority[best], net.score[best])
    assert net.views(net.alive) == {successor}  # it follows, and relays


@given(swarms(priorities=False), st.integers(0, 10))
@settings(max_examples=20)
def test_reelection_goes_to_the_clearly_better_without_gap_or_overlap(swarm: dict[str, Any], fallen: int) -> None:
    net = Net(**swarm, reelection=40)
    if net.diameter() > MAX_DIAMETER:
        return
    net.run(45)
    (leader,) = net.acting()
    net.score[leader] = fallen
    best = max((score for i, score in net.score.items() if i != leader), default=0)
    for _ in range(100):
        net.step()
        assert len(net.acting()) == 1
    if best >= fallen + HYSTERESIS:
        assert net.score[net.acting()[0]] == best
    else:
        assert net.acting() == [leader]
    assert net.views(net.alive) == set(net.acting())


@given(swarms(), st.floats(0.0, 1.0))
@settings(max_examples=20)
def test_restarted_leader_is_accepted_again(swarm: dict[str, Any], downtime: float) -> None:
    net = Net(**swarm)
    net.run(40)
    (leader,) = net.acting()
    net.nodes[leader] = Election(leader, 9)
    net.priority[leader] = 9
    net.alive.discard(leader)
    away = round(downtime * 40)
    net.run(away)
    net.clock_s[leader] += away * 0.1 + 0.2  # the board's clock went on
    net.alive.add(leader)
    net.run(55)
    assert net.views(net.alive) == {leader}
    assert net.acting() == [leader]


@given(swarms())
@settings(max_examples=20)
def test_when_all_that_may_lead_are_gone_no_echo_keeps_them_in_office(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    if net.diameter() > MAX_DIAMETER:
        return
    net.run(40)
    net.eligible.clear()
    net.run(RESIGN_PERIODS + LEASE_PERIODS + len(net.alive) + 1)
    assert all(net.nodes[i].lease is None for i in net.alive)


@given(swarms(), st.integers(0, 2**32 - 1), st.integers(1, 250), st.integers(0, 255))
@settings(max_examples=20)
def test_any_claim_heard_once_expires(swarm: dict[str, Any], seq: int, leader: int, priority: int) -> None:
    """A stale or forged claim of a vehicle that is not there holds the swarm up for a while, at any count."""
    net = Net(**swarm)
    if leader in net.nodes or net.diameter() > 6:
        return
    net.run(30)
    net.nodes[min(net.alive)].receive_lease(Lease(leader, seq, priority, 255, established=True), 0)
    net.run(60)
    assert net.views(net.alive) == set(net.acting())
    assert len(net.acting()) == 1


claims = st.builds(
    Lease,
    leader=st.integers(1, 6),
    seq=st.sampled_from([0, 1, 2, 3, SEQ_LIMIT - 1, SEQ_LIMIT]) | st.integers(0, SEQ_LIMIT),
    priority=st.integers(0, 2),
    score=st.integers(0, 10),
    established=st.booleans(),
)
steps = st.tuples(st.booleans(), st.integers(0, 10))  # eligible, score


@given(st.lists(st.one_of(st.tuples(claims, st.integers(0, 255)), steps), max_size=60))
@settings(max_examples=60)
def test_one_view_stays_consistent_whatever_it_hears(course: list[Any]) -> None:
    election = Election(3, 1)
    now_s, eligible = 0.0, False
    for event in course:
        if isinstance(event[0], Lease):
            election.receive_lease(*event)
        else:
            eligible, score = event
            now_s += 0.1
            election.run_period(now_s, period_s=0.1, eligible=eligible, score=score)
            assert election.leads <= eligible
        assert 0 <= election.hop <= HOP_LIMIT
        assert election.lease is None or 0 <= election.age < LEASE_PERIODS
        assert not election.acts or election.leads
        assert len(election._tombs) <= 6
        if election.lease is not None:
            assert 0 <= election.lease.seq <= SEQ_LIMIT
        if election.leads:
            assert election.lease is not None
            assert election.lease.priority == 1
