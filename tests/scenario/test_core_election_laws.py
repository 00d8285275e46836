"""Who leads, in whole networks: whatever the links, the losses and the order of things."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest
from core_election_net import (
    Edge,
    Net,
    Story,
    acting_within,
    failover_within,
    overlap_within,
    recovery_within,
    story,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.election import (
    ACT_PERIODS,
    HANDOVER_PERIODS,
    HEIR_STAYS_PERIODS,
    HELD_PERIODS,
    HOP_LIMIT,
    HYSTERESIS,
    LEASE_PERIODS,
    RESIGN_PERIODS,
    SCORE_LIMIT,
    SEQ_JUMP,
    SEQ_LIMIT,
    Election,
)
from companion.core.types import Lease

# A claim is acted upon after the way to all and back: deeper networks take longer than these tests wait.
MAX_DIAMETER = ACT_PERIODS


def random_links(ids: list[int], rng: random.Random, *, density: float, reach: int) -> set[Edge]:
    """A random tree, in which a vehicle hangs on one of the `reach` before it (1: a chain), and more links."""
    edges = {(ids[k], ids[rng.randrange(max(0, k - reach), k)]) for k in range(1, len(ids))}
    edges |= {(a, b) for a in ids for b in ids if a < b and rng.random() < density}
    return edges


@st.composite
def swarms(draw: st.DrawFn, *, connected: bool = True, priorities: bool = True, near: bool = False) -> dict[str, Any]:
    """Arguments of a Net: up to 12 vehicles, one component or several; `near`: most a few hops from one another."""
    ids = draw(st.lists(st.integers(1, 250), min_size=1, max_size=12, unique=True))
    rng = random.Random(draw(st.integers(0, 2**32)))
    cut = len(ids) if connected else draw(st.integers(0, len(ids)))
    density, reach = draw(
        st.sampled_from([(0.3, 12), (0.6, 12)] if near else [(0.0, 1), (0.0, 3), (0.1, 12), (0.4, 12)])
    )
    edges = random_links(ids[:cut], rng, density=density, reach=reach)
    edges |= random_links(ids[cut:], rng, density=density, reach=reach)
    some = st.sampled_from([0, 0, 0, 1, 2]) if priorities else st.just(0)
    return {
        "ids": ids,
        "edges": edges,
        "priority": {i: draw(some) for i in ids},
        "score": {i: draw(st.integers(0, 10)) for i in ids},
        "seed": draw(st.integers(0, 2**32)),
    }


def lossy(draw_loss: float, most: float) -> dict[str, float]:
    return {"loss": draw_loss * most, "late": 0.1, "skip": 0.01}


@given(swarms(connected=False))
@settings(max_examples=20)
def test_highest_rank_of_each_component_leads_within_its_diameter_and_stays(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    if net.diameter() > MAX_DIAMETER:
        return
    net.run(max(1, net.diameter()))
    for _ in range(30):
        net.step()
        for component in net.components():
            assert net.views(component) == {net.best(component)}
    assert net.acting() == sorted(net.best(component) for component in net.components())


@pytest.mark.parametrize("n", range(2, 30))
def test_news_of_a_leader_goes_two_hops_a_period(n: int) -> None:
    net = Net(range(1, n + 1), [(i, i + 1) for i in range(1, n)])
    while net.views(net.alive) != {1}:
        net.step()
    assert net.period == n // 2


@given(swarms(connected=False))
@settings(max_examples=20)
def test_hops_are_the_distance_to_the_leader_once_settled(swarm: dict[str, Any]) -> None:
    net = Net(**swarm)
    net.run(60)
    for component in net.components():
        (leader,) = net.views(component)
        assert {i: net.nodes[i].hop for i in component} == net.distances(leader)


@given(swarms(connected=False, near=True), st.floats(0.0, 1.0))
@settings(max_examples=20)
def test_one_leader_acts_in_each_component_up_to_half_of_the_beacons_lost(swarm: dict[str, Any], loss: float) -> None:
    net = Net(**swarm, **lossy(loss, 0.5))
    if net.diameter() > 4:
        return
    net.run(60)
    acting = net.acting()
    assert len(acting) == len(net.components())
    for _ in range(30):
        net.step()
        assert net.acting() == acting
    # Followers may lose it for a moment at such losses, and find back to it alone.
    for component in net.components():
        assert net.views(component) - component == set()
        assert sum(net.nodes[i].acts for i in component) == 1


@given(swarms(), st.floats(0.0, 1.0))
@settings(max_examples=40)
def test_never_two_acting_leaders_from_start_to_failover_however_deep(swarm: dict[str, Any], loss: float) -> None:
    net = Net(**swarm, **lossy(loss, 0.1))
    for _ in range(60):
        net.step()
        assert len(net.acting()) <= 1
    (leader,) = net.acting()
    net.alive.discard(leader)
    for _ in range(60):
        net.step()
        for component in net.components():
            assert sum(net.nodes[i].acts for i in component) <= 1


@pytest.mark.parametrize("n", [20, 40])
@pytest.mark.parametrize("seed", range(3))
def test_never_two_acting_leaders_on_a_long_chain(n: int, seed: int) -> None:
    """The worst there is: news takes n periods from end to end, and more at 10 % loss."""
    ids = random.Random(seed).sample(range(1, 251), n)
    net = Net(ids, itertools.pairwise(ids), loss=0.1, seed=seed)
    for _ in range(130):
        net.step()
        assert len(net.acting()) <= 1
    net.alive.discard(net.acting()[0])
    for _ in range(130):
        net.step()
        for component in net.components():
            assert sum(net.nodes[i].acts for i in component) <= 1
    assert len(net.acting()) == len(net.components())


# --- how long, by depth ---


@pytest.mark.parametrize("clock_s", [0.0, 1000.0])
@pytest.mark.parametrize("n", [20, 50, 100])
def test_claim_keeps_its_lease_on_a_long_way_and_acts_when_its_echo_is_back(n: int, clock_s: float) -> None:
    """Two hops a period on the way, one on the way back: without loss that is all."""
    net = Net(range(1, n + 1), itertools.pairwise(range(1, n + 1)))
    net.clock_s = dict.fromkeys(net.nodes, clock_s)
    net.run(n // 2)
    while not net.acting():
        assert net.views(net.alive) == {1}
        net.step()
    assert net.acting() == [1]
    assert net.period <= n // 2 + n


@pytest.mark.parametrize(("n", "seeds"), [(4, 12), (8, 12), (12, 12), (20, 8), (50, 4)])
def test_times_on_a_chain_are_within_their_bounds_by_depth(n: int, seeds: int) -> None:
    for seed in range(seeds):
        rng = random.Random(f"{n} {seed}")
        ids = rng.sample(range(1, n + 1), n)
        score = {i: rng.randint(0, 10) for i in ids}
        net = Net(ids, itertools.pairwise(ids), score=score, loss=0.1, seed=seed)
        net.run(acting_within(n - 1))
        assert len(net.acting()) == 1
        net.alive.discard(net.acting()[0])
        net.run(failover_within(net.diameter()))
        for part in net.components():
            assert sum(net.nodes[i].acts for i in part) == 1


@given(swarms(), st.floats(0.0, 1.0))
@settings(max_examples=30)
def test_start_and_failover_are_within_their_bounds_by_depth(swarm: dict[str, Any], loss: float) -> None:
    net = Net(**swarm, loss=0.1 * loss)
    net.run(acting_within(net.diameter()))
    (leader,) = net.acting()
    net.alive.discard(leader)
    if not net.alive:
        return
    net.run(failover_within(net.diameter()))
    for component in net.components():
        assert sum(net.nodes[i].acts for i in component) == 1


@pytest.mark.parametrize("n", [4, 12, 50])
@pytest.mark.parametrize("seed", range(3))
def test_two_leaders_in_a_merge_of_chains_are_within_their_bound_by_depth(n: int, seed: int) -> None:
    """The leaders are at the far ends of two chains that join."""
    ids = list(range(1, n // 2 + 1)) + list(range(n, n // 2, -1))
    middle = (ids[n // 2 - 1], ids[n // 2])
    net = Net(ids, itertools.pairwise(ids), score={n // 2 + 1: 5}, loss=0.1, seed=seed)
    net.unlink(*middle)
    net.run(acting_within(n))
    assert net.acting() == [1, n // 2 + 1]
    net.link(*middle)
    net.run(overlap_within(n - 1))
    assert net.acting() == [n // 2 + 1]


# --- lies of one member ---


@given(swarms(), st.integers(0, 2**32), st.sampled_from([0, 15, 60]), st.booleans(), st.booleans())
@settings(max_examples=60)
def test_when_a_liar_stops_or_falls_one_leader_acts_within_the_bound(
    swarm: dict[str, Any], lot: int, settled: int, falls: bool, lossy: bool
) -> None:
    """Whatever it told whom, of whom, for up to 80 periods, from start or later."""
    net = Net(**swarm, loss=0.1 * lossy)
    rng = random.Random(lot)
    net.run(settled)
    liar = rng.choice(swarm["ids"])
    for _ in range(rng.randint(1, 4)):
        net.stories[liar] = [story(swarm["ids"], net.priority, rng) for _ in range(rng.choice([1, 1, 3]))]
        net.run(rng.randint(1, 20))
    net.stories.clear()
    if falls:
        net.alive.discard(liar)
        if not net.alive:
            return
    net.run(recovery_within(len(net.alive), net.diameter()))
    for _ in range(40):  # a hand-over to one that precedes may be due: without gap or overlap
        net.step()
        for component in net.components():
            assert sum(net.nodes[i].acts for i in component) == 1


def ring_with_a_liar(seed: int) -> tuple[Net, int, int]:
    """Settled, with its leader and a liar that nobody needs to hear the leader: the ring is whole without it."""
    rng = random.Random(seed)
    ids = rng.sample(range(1, 251), 9)
    ring, liar = ids[:8], ids[8]
    edges = [*itertools.pairwise([*ring, ring[0]]), (liar, ring[0]), (liar, ring[3])]
    net = Net(ids, edges, score={i: 5 for i in ring}, loss=0.1, seed=seed)
    net.run(60)
    (leader,) = net.acting()
    assert leader != liar
    return net, leader, liar


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "false",
    [
        {"seq": SEQ_JUMP + 100},
        {"seq": SEQ_LIMIT, "ahead": False},
        {"seq": 2**32 - 1, "ahead": False},
        {"score": 255},
        {"ends": 2**31},
        {"hop": 10},
    ],
    ids=lambda false: " ".join(f"{name} {value}" for name, value in false.items()),
)
def test_what_cannot_be_true_of_the_leader_changes_nothing(false: dict[str, Any], seed: int) -> None:
    net, leader, liar = ring_with_a_liar(seed)
    true = Story(leader, 1, True, 5, True, 0, 0, 0, True, None)
    net.stories[liar] = [true._replace(**false)]
    for _ in range(100):
        net.step()
        assert net.acting() == [leader]
        for i in net.alive - {liar}:
            lease = net.nodes[i].lease
            assert lease is not None
            assert (lease.leader, lease.score, lease.ends) == (leader, 5, 0)
            assert lease.seq <= HOP_LIMIT + net.period + 1


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ahead", [1, 15, SEQ_JUMP // 10, SEQ_JUMP // 2, SEQ_JUMP])
def test_leader_keeps_the_lead_while_somebody_runs_ahead_of_its_count(ahead: int, seed: int) -> None:
    """Far ahead, each period anew: who is some hops off cannot believe it, and loses its lease again and again."""
    net, leader, liar = ring_with_a_liar(seed)
    net.stories[liar] = [Story(leader, ahead, True, 5, True, 0, 0, 0, True, None)]
    for _ in range(200):
        net.step()
        assert net.acting() == [leader]
        if ahead <= SEQ_JUMP // 10:
            assert net.views(net.alive - {liar}) == {leader}
    net.stories.clear()
    for _ in range(100):
        net.step()
        assert net.acting() == [leader]
    assert net.views(net.alive) == {leader}


@pytest.mark.parametrize("score", [SCORE_LIMIT + 1, 255])
def test_score_beyond_all_does_not_win_the_lead(score: int) -> None:
    ids = [3, 4, 5, 6]
    net = Net(ids, itertools.pairwise(ids), score={3: 9})
    net.stories[6] = [Story(6, 500, True, score, True, 6, 0, 0, True, None)]
    net.run(60)
    assert net.acting() == [3]


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
    net.nodes[min(net.alive)].hear(Lease(leader, seq, priority, 255, established=True), 0)
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
            election.hear(*event)
        else:
            eligible, score = event
            now_s += 0.1
            election.step(now_s, period_s=0.1, eligible=eligible, score=score)
            assert election.leads <= eligible
        assert 0 <= election.hop <= HOP_LIMIT
        assert 0 <= election.age < LEASE_PERIODS
        assert not election.acts or election.leads
        assert len(election._tombs) <= 6
        if election.lease is not None:
            assert 0 <= election.lease.seq <= SEQ_LIMIT
        if election.leads:
            assert election.lease is not None
            assert election.lease.priority == 1
