"""A network of `Election` objects, one beacon period at a time; loss, delay, order and missed steps by seed."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from companion.core.model.beacon import Candidate, Lease
from companion.core.swarm.election import (
    ACT_PERIODS,
    ECHO_PERIODS,
    FIRST_SEQ_LIMIT,
    HANDOVER_PERIODS,
    HELD_PERIODS,
    HOP_LIMIT,
    LEASE_PERIODS,
    SCORE_LIMIT,
    SEQ_JUMP,
    SEQ_LIMIT,
    TOMB_PERIODS,
    Election,
)

PERIOD_S = 0.1

Edge = tuple[int, int]


# Bounds in beacon periods by depth, the diameter in hops, at 10 % loss at most. News of a new leader goes two hops a
# period, all other news and the echo go one; what the loss takes is in the factors.


def acting_within(depth: int) -> int:
    """From start until one acts: the claim goes to all, and its echo comes back."""
    return ACT_PERIODS + 2 * depth


def failover_within(depth: int) -> int:
    """From the loss of the leader until one acts in each part, of this depth at most.

    Worst without the heir: leases run out from the lost leader outwards, as its last count did; then a claim from the
    far end, and its echo.
    """
    return LEASE_PERIODS + 2 * HELD_PERIODS + 3 * depth


def overlap_within(depth: int) -> int:
    """Two acting when swarms meet: until the worse has heard of the better."""
    return 5 + 3 * depth // 4


def recovery_within(size: int, depth: int) -> int:
    """From the last lie of one member until one acts in each part.

    A false lease runs out and is refused for a while, or those that expect different heirs wait in vain for agreement;
    then as after the loss of a leader.
    """
    return (
        LEASE_PERIODS + max(TOMB_PERIODS, ACT_PERIODS + 2 * size) + overlap_within(depth) + failover_within(depth) - 1
    )


class Said(NamedTuple):
    """The election's part of a beacon."""

    lease: Lease | None
    hop: int
    agreed: bool
    candidate: Candidate | None


def _said(node: Election, lease: Lease | None) -> Said:
    return Said(lease, node.hop, node.agreed, node.candidate)


class Story(NamedTuple):
    """What a liar says of one member of the mission, at its true priority: all else is refused unheard."""

    leader: int
    seq: int  # above the highest count of that leader's that anybody has heard, or absolute
    ahead: bool
    score: int
    established: bool
    heir: int
    ends: int  # above the count; 0: not announced
    hop: int
    agreed: bool
    candidate: Candidate | None

    def told(self, net: Net) -> Said:
        """The beacon's part."""
        known = (net.nodes[i].lease for i in net.alive)
        true_seq = max((lease.seq for lease in known if lease is not None and lease.leader == self.leader), default=0)
        seq = max(0, true_seq * self.ahead + self.seq)
        ends = self.ends and seq + self.ends
        priority = net.priority.get(self.leader, 0)
        lease = Lease(self.leader, seq, priority, self.score, self.established, self.heir, ends)
        return Said(lease, self.hop, self.agreed, self.candidate)


def story(ids: Sequence[int], priority: Mapping[int, int], rng: random.Random) -> Story:
    """Drawn by lot, mostly at the edges of what is believed."""
    ahead = rng.random() < 0.7
    near = (-5, 0, 1, 2, 9, 100, SEQ_JUMP - 1, SEQ_JUMP, SEQ_JUMP + 1, SEQ_JUMP + 9, 2 * SEQ_JUMP)
    far = (0, 1, FIRST_SEQ_LIMIT, SEQ_LIMIT - 9, SEQ_LIMIT, SEQ_LIMIT + 1, 2**32 - 1)
    some = rng.choice(ids)
    return Story(
        leader=rng.choice(ids),
        seq=rng.choice(near if ahead else far),
        ahead=ahead,
        score=rng.choice((0, SCORE_LIMIT, SCORE_LIMIT, SCORE_LIMIT + 1, 255)),
        established=rng.random() < 0.8,
        heir=rng.choice([0, *ids]),
        ends=rng.choice((0, 0, 1, HANDOVER_PERIODS, HANDOVER_PERIODS + 1, 10 * HANDOVER_PERIODS)),
        hop=rng.choice((0, 0, 1, len(ids) - 1, len(ids), HOP_LIMIT, 255)),
        agreed=rng.random() < 0.7,
        candidate=Candidate(some, priority.get(some, 0), rng.choice((0, SCORE_LIMIT, 255))),
    )


class Net:
    """Vehicles `ids` with links `edges`. Beacons are heard a period later at most, unless `late` says otherwise."""

    def __init__(
        self,
        ids: Iterable[int],
        edges: Iterable[Edge],
        *,
        priority: Mapping[int, int] | None = None,
        score: Mapping[int, int] | None = None,
        loss: float = 0.0,
        late: float = 0.0,
        skip: float = 0.0,
        reelection: int = 0,
        seed: int = 0,
    ) -> None:
        """`loss` of a beacon at each receiver; `late`: it comes 1 to 3 periods later; `skip`: a step is missed."""
        self.priority, self.score = dict(priority or {}), dict(score or {})
        ids = list(ids)
        self.nodes = {
            i: Election(i, self.priority.get(i, 0), size=len(ids), reelection_periods=reelection) for i in ids
        }
        self.alive = set(self.nodes)
        self.eligible = set(self.nodes)
        self._links: dict[int, set[int]] = {i: set() for i in self.nodes}
        for a, b in edges:
            self.link(a, b)
        self.loss, self.late, self.skip = loss, late, skip
        self.period = 0
        self.extra = 0  # beacons that were not due
        self.clock_s = dict.fromkeys(self.nodes, 0.0)  # no two clocks agree, if a test says so
        self.stories: dict[int, list[Story]] = {}  # of liars: each receiver hears one of these instead of the truth
        self._rng = random.Random(seed)
        self._under_way: list[tuple[int, int, int, Said]] = []  # due, receiver, sender
        self._heard: dict[int, dict[int, tuple[int, Said]]] = {i: {} for i in self.nodes}  # receiver, sender -> period

    def step(self) -> None:
        """One period of everyone: step and beacon, in any order; then everyone hears, in any order; then the news."""
        self.period += 1
        beacons: list[tuple[int, Said]] = []
        for i in self._rng.sample(sorted(self.alive), len(self.alive)):
            self.clock_s[i] += PERIOD_S
            if self._rng.random() < self.skip:
                continue
            node = self.nodes[i]
            heard = [said for period, said in self._heard[i].values() if period >= self.period - ECHO_PERIODS]
            eligible, score = i in self.eligible, self.score.get(i, 0)
            node.run_period(self.clock_s[i], period_s=PERIOD_S, eligible=eligible, score=score, heard=heard)
            beacons.append((i, _said(node, node.lease)))
        self._spread(beacons)
        # Half a period later: once more from those whose leader has changed. As the agent, at 10 Hz.
        changed = [(i, self.nodes[i]) for i in sorted(self.alive) if self.nodes[i].changed]
        self.extra += len(changed)
        self._spread([(i, _said(node, node.early)) for i, node in changed])

    def _spread(self, beacons: list[tuple[int, Said]]) -> None:
        """Everyone hears, in any order."""
        for i, said in beacons:
            for j in sorted(self.neighbours(i)):
                if i in self.stories:
                    said = self._rng.choice(self.stories[i]).told(self)
                if self.loss == 0.0 or self._rng.random() >= self.loss:
                    later = self._rng.randint(1, 3) if self.late > 0.0 and self._rng.random() < self.late else 0
                    self._under_way.append((self.period + later, j, i, said))
        due = [item for item in self._under_way if item[0] <= self.period]
        self._under_way = [item for item in self._under_way if item[0] > self.period]
        self._rng.shuffle(due)
        for _, j, i, said in due:
            if j in self.alive:
                self._heard[j][i] = (self.period, said)
                if said.lease is not None:
                    self.nodes[j].receive_lease(said.lease, said.hop)

    def run(self, periods: int) -> None:
        for _ in range(periods):
            self.step()

    def link(self, a: int, b: int) -> None:
        if a != b:
            self._links[a].add(b)
            self._links[b].add(a)

    def unlink(self, a: int, b: int) -> None:
        self._links[a].discard(b)
        self._links[b].discard(a)

    def neighbours(self, i: int) -> set[int]:
        return self._links[i] & self.alive

    def components(self) -> list[set[int]]:
        """Of those alive."""
        left, found = set(self.alive), []
        while left:
            reached = set(self.distances(min(left)))
            found.append(reached)
            left -= reached
        return found

    def distances(self, start: int) -> dict[int, int]:
        """Hops from `start`, breadth first."""
        hops, queue = {start: 0}, deque([start])
        while queue:
            i = queue.popleft()
            for j in self.neighbours(i):
                if j not in hops:
                    hops[j] = hops[i] + 1
                    queue.append(j)
        return hops

    def diameter(self) -> int:
        return max(max(self.distances(i).values()) for i in self.alive)

    def acting(self) -> list[int]:
        return sorted(i for i in self.alive if self.nodes[i].acts)

    def views(self, among: Iterable[int]) -> set[int]:
        """The leaders that these vehicles know of; 0: none."""
        leases = (self.nodes[i].lease for i in among)
        return {lease.leader if lease is not None else 0 for lease in leases}

    def best(self, among: Iterable[int]) -> int:
        """Who ranks highest while none is established."""
        able = [i for i in among if i in self.eligible]
        return max(able, key=lambda i: (self.priority.get(i, 0), self.score.get(i, 0), -i))
