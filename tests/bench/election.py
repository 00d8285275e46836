"""Who leads, over many random graphs: agreement, failover, merge, and how often two act at once.

News goes a hop at a time, so each time has a part that is the graph's: its *way*, in hops. What is left is the law's.

Four families of connected graphs:

- geometric: n points, even in a cube of 200 m (the paper's volume), linked within 55 m (its r). So few seldom connect:
  the cube shrinks by 3 % and is drawn anew until they do, so the graphs are just connected.
- grown: each next point is an even draw from the balls of 55 m round those there are, one ball by lot: sparser.
- tree: a random labelled tree; every link is a bridge, every way the only one.
- chain: the deepest; each inner vehicle lost divides it.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from tests.unit.core.core_election_net import Edge, Net, recovery_within, story

VOLUME_M, RANGE_M = 200.0, 55.0  # the paper's l and r
LOSS = 0.1
AT_MOST = 200  # periods until all is settled
QUIET = 20  # periods without a change: settled
KNOWN = 40  # periods more until the leader is lost: its heir is known by then
Point = tuple[float, float, float]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Course:
    """One graph's figures, in beacon periods."""

    diameter: int
    extra: float  # beacons a vehicle that were not due, from start until one acts
    agreement: int  # from start until all know the same leader
    agreement_way: int  # hops from that leader to the farthest
    acting: int  # from start until one acts
    start_overlap: int  # periods with two acting, from start
    failover: int  # from the loss of the leader until one acts, in each part that is left
    failover_way: int  # hops from the lost leader to the one that acts next; the farthest of several
    left_diameter: int  # of the deepest part that is left
    split: bool  # that loss leaves two parts or more; one without the heir waits for its echo
    failover_overlap: int
    merge_overlap: int  # two settled halves meet
    merge_way: int  # hops from a leader that gives way to where a better one is followed; the longest of several
    settled: bool  # one acting leader, in each part, at the end of each of the three


def linked(points: Sequence[Point]) -> set[Edge]:
    """Links between points within range; vehicles are 1..n."""
    pairs = itertools.combinations(range(len(points)), 2)
    return {(a + 1, b + 1) for a, b in pairs if math.dist(points[a], points[b]) <= RANGE_M}


def is_connected(n: int, edges: set[Edge]) -> bool:
    """One component."""
    net = Net(range(1, n + 1), edges)
    return len(net.distances(1)) == n


def geometric(n: int, rng: random.Random) -> set[Edge]:
    """Just connected in the paper's volume, shrunk as far as it takes."""
    side_m = VOLUME_M
    while True:
        edges = linked([(rng.random() * side_m, rng.random() * side_m, rng.random() * side_m) for _ in range(n)])
        if is_connected(n, edges):
            return edges
        side_m *= 0.97


def grown(n: int, rng: random.Random) -> set[Edge]:
    """Each within range of one before it, chosen by lot."""
    points: list[Point] = [(0.0, 0.0, 0.0)]
    while len(points) < n:
        at = rng.choice(points)
        step = tuple(rng.uniform(-RANGE_M, RANGE_M) for _ in range(3))
        if math.hypot(*step) <= RANGE_M:
            points.append((at[0] + step[0], at[1] + step[1], at[2] + step[2]))
    return linked(points)


def tree(n: int, rng: random.Random) -> set[Edge]:
    """All labelled trees are equally likely: a random walk's first visits (Aldous, Broder)."""
    edges, at, seen = set(), 1, {1}
    while len(seen) < n:
        to = rng.randint(1, n)
        if to not in seen:
            seen.add(to)
            edges.add((at, to))
        at = to
    return edges


def chain(n: int, _rng: random.Random) -> set[Edge]:
    """One after the other: the deepest there is. Who stands where is shuffled, as for all."""
    return set(itertools.pairwise(range(1, n + 1)))


FAMILIES: dict[str, Callable[[int, random.Random], set[Edge]]] = {
    "geometric": geometric,
    "grown": grown,
    "tree": tree,
    "chain": chain,
}


def course(family: str, n: int, seed: int) -> Course:
    """Start, lose the leader, and, apart from that, let two halves meet."""
    rng = random.Random(f"{family} {n} {seed}")
    edges = shuffled(FAMILIES[family](n, rng), n, rng)
    score = {i: rng.randint(0, 10) for i in range(1, n + 1)}
    net = Net(range(1, n + 1), edges, score=score, loss=LOSS, seed=rng.getrandbits(32))
    diameter = net.diameter()
    agreement = acting = extra = 0

    def look() -> None:
        nonlocal agreement, acting, extra
        views = net.views(net.alive)
        agreement = agreement or (net.period if len(views) == 1 and 0 not in views else 0)
        acting = acting or (net.period if net.acting() else 0)
        extra = extra if acting else net.extra

    _, start_overlap = settle(net, look)
    settled = one_each(net)
    net.run(KNOWN)
    lost = net.acting()[0]
    away = net.distances(lost)
    net.alive.discard(lost)
    split, left_diameter = len(net.components()) > 1, net.diameter()
    failover, failover_overlap = settle(net)
    settled &= one_each(net)
    merge_overlap, merge_way, one = merge(n, edges, score, rng)
    return Course(
        diameter=diameter,
        extra=extra / n,
        agreement=agreement,
        agreement_way=max(away.values()),
        acting=acting,
        start_overlap=start_overlap,
        failover=failover,
        failover_way=max(away[successor] for successor in net.acting()),
        left_diameter=left_diameter,
        split=split,
        failover_overlap=failover_overlap,
        merge_overlap=merge_overlap,
        merge_way=merge_way,
        settled=settled and one,
    )


def settle(net: Net, look: Callable[[], None] = lambda: None) -> tuple[int, int]:
    """Periods until one acts in each part, for good; periods with two acting in one part."""
    began, since, overlap = net.period, net.period, 0
    while net.period - since < QUIET and net.period - began < AT_MOST:
        net.step()
        look()
        acting = [sum(net.nodes[i].acts for i in part) for part in net.components()]
        if any(count != 1 for count in acting):
            since = net.period
        overlap += max(acting) > 1
    return since + 1 - began, overlap


@dataclass(frozen=True, slots=True)
class Lied:
    """One member of a settled swarm lies for 2 to 8 s, and stops."""

    acting: int  # periods from its last lie until one acts in each part, for good
    overlap: int  # of them: with two acting in one part
    most: int  # the bound


def lied(n: int, seed: int) -> Lied:
    """On a grown graph, at 10 % loss. Another lie every two seconds, or three that it tells by turns."""
    rng = random.Random(f"lied {n} {seed}")
    edges = shuffled(grown(n, rng), n, rng)
    ids = range(1, n + 1)
    net = Net(ids, edges, score={i: rng.randint(0, 10) for i in ids}, loss=LOSS, seed=rng.getrandbits(32))
    net.run(KNOWN)
    liar = rng.randint(1, n)
    for _ in range(rng.randint(1, 4)):
        net.stories[liar] = [story(ids, net.priority, rng) for _ in range(rng.choice((1, 3)))]
        net.run(20)
    net.stories.clear()
    acting, overlap = settle(net)
    return Lied(acting, overlap, recovery_within(n, net.diameter()))


def one_each(net: Net) -> bool:
    """One acting leader in each part."""
    return all(sum(net.nodes[i].acts for i in part) == 1 for part in net.components())


def merge(n: int, edges: set[Edge], score: dict[int, int], rng: random.Random) -> tuple[int, int, bool]:
    """The graph without the links between one connected part and the others; then with them."""
    net = Net(range(1, n + 1), edges, score=score, loss=LOSS, seed=rng.getrandbits(32))
    near = net.distances(rng.randint(1, n))
    part = set(sorted(near, key=lambda i: (near[i], i))[: n // 2])
    across = [(a, b) for a, b in edges if (a in part) != (b in part)]
    for a, b in across:
        net.unlink(a, b)
    settle(net)
    leader_of = {i: leader for parts in net.components() for leader in set(net.acting()) & parts for i in parts}
    for a, b in across:
        net.link(a, b)
    way = 0
    for lower in set(leader_of.values()) - {net.best(leader_of.values())}:
        better = [i for i, leader in leader_of.items() if net.best((leader, lower)) != lower]
        way = max(way, min(net.distances(lower)[i] for i in better))
    _, overlap = settle(net)
    return overlap, way, one_each(net)


def shuffled(edges: set[Edge], n: int, rng: random.Random) -> set[Edge]:
    """The same graph under other names: the lowest id must not sit in a certain place."""
    name = dict(zip(range(1, n + 1), rng.sample(range(1, n + 1), n), strict=True))
    return {(name[a], name[b]) for a, b in edges}


def courses(family: str, n: int, graphs: int) -> list[Course]:
    """Of seeds 1, 2, ...; on all processors."""
    return on_all_processors(partial(course, family, n), graphs)


def all_lied(n: int, graphs: int) -> list[Lied]:
    """Of seeds 1, 2, ...; on all processors."""
    return on_all_processors(partial(lied, n), graphs)


def on_all_processors(one: Callable[[int], T], graphs: int) -> list[T]:
    """Of seeds 1, 2, ..."""
    with ProcessPoolExecutor() as pool:
        return list(pool.map(one, range(1, graphs + 1), chunksize=10))
