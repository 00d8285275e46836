"""Which leads, in whole networks: whatever the links, the losses and the order of things."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.swarm.election import HOP_LIMIT, SCORE_LIMIT, SEQ_JUMP, SEQ_LIMIT
from tests.unit.core.core_election_net import (
    Net,
    Story,
    acting_within,
    failover_within,
    overlap_within,
    recovery_within,
    story,
)
from tests.unit.core.core_election_swarms import MAX_DIAMETER, swarms


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
    """Far ahead, each period anew: one that is some hops off cannot believe it, and loses its lease again and again."""
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
