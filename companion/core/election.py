"""Who leads: leased KHOPCA, one leader per connected component.

Algorithm 1 of the paper (lines 5-19) is KHOPCA: weights fall by one a hop from a cluster head. As printed it seldom
ends with one leader and never replaces a lost one, so here the head holds a lease: it counts periods, the count spreads
with the beacons, and only an advancing count renews it; echoes of a dead leader expire. `weight = limit - hop` is the
paper's weight, so the hops are also a gradient that leads to the leader.

| KHOPCA | here |
|---|---|
| rules 1 and 4: the best neighbour's weight minus one; of two heads the better stays | `hear` adopts a higher rank |
| rules 2 and 3: no better neighbour: become the head | `step` claims when no lease is alive |
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.core.types import Lease

LEASE_PERIODS = 10  # without a newer count the leader is lost; 5 loses live ones at 30 % loss
ACT_PERIODS = 10  # a claim older than this has spread and may be acted upon
TOMB_PERIODS = 50  # a lost leader's old counts are refused this long, when all their echoes have expired
HOP_LIMIT = 32
SEQ_LIMIT = 2**32 - 1  # uint32 on the wire
FIRST_SEQ_LIMIT = 2**31  # so that a clock that counts from 1970 leaves room to count on


def rank(lease: Lease) -> tuple[int, bool, int, int]:
    """Higher leads: predetermined priority, then an established leader before a new claim, then score, then low id."""
    return (lease.priority, lease.established, lease.score, -lease.leader)


def priority_of(vehicle_id: int, leader_priority: Sequence[int]) -> int:
    """Of the mission's `leader_priority`, best first: the first has the highest; 0 when not listed."""
    return len(leader_priority) - leader_priority.index(vehicle_id) if vehicle_id in leader_priority else 0


class Election:
    """One vehicle's view of who leads. `step` once per beacon period, `hear` for every beacon."""

    __slots__ = ("_held", "_tombs", "age", "hop", "lease", "me", "priority")

    def __init__(self, me: int, priority: int) -> None:
        self.me = me
        self.priority = priority
        self.lease: Lease | None = None
        self.hop = 0
        self.age = 0  # periods since the lease was renewed
        self._held = 0  # periods in which this vehicle has led without a break
        self._tombs: dict[int, tuple[int, int]] = {}  # lost leader -> (its last count, periods left)

    @property
    def leads(self) -> bool:
        """This vehicle claims the lead."""
        return self.lease is not None and self.lease.leader == self.me

    @property
    def acts(self) -> bool:
        """This vehicle leads, and has for long enough that no one in reach has a better claim."""
        return self.leads and self._held >= ACT_PERIODS

    def hear(self, lease: Lease, hop: int) -> bool:
        """A neighbour's view of the leader, `hop` hops from it; True when it is news of the leader now followed."""
        if lease.leader == self.me or hop + 1 > HOP_LIMIT:
            return False
        tomb = self._tombs.get(lease.leader)
        if tomb is not None and lease.seq <= tomb[0]:
            return False
        mine = self.lease
        if mine is not None and lease.leader == mine.leader:
            if lease.seq < mine.seq:
                return False
            if lease.seq == mine.seq:
                self.hop = min(self.hop, hop + 1)
                return False
        elif mine is not None and rank(lease) <= rank(mine):
            return False
        self.lease, self.hop, self.age = lease, hop + 1, 0
        return True

    def step(self, now_s: float, *, period_s: float, eligible: bool, score: int) -> None:
        """One beacon period has passed. An ineligible vehicle (no position, low battery, pilot) never leads."""
        self._bury()
        if self.leads and not eligible:
            self.lease = None
        if self.lease is not None and self.lease.leader != self.me:
            self.age += 1
            if self.age >= LEASE_PERIODS:
                self._tombs[self.lease.leader] = (self.lease.seq, TOMB_PERIODS)
                self.lease = None
        if eligible and not self.leads:
            # Counting from the clock keeps a restarted leader's counts above those of its earlier life.
            claim = Lease(self.me, int(now_s / period_s) % FIRST_SEQ_LIMIT, self.priority, score, established=False)
            if self.lease is None or rank(claim) > rank(self.lease):
                self.lease = claim
        self._count()

    def _count(self) -> None:
        if not self.leads:
            self._held = 0
            return
        assert self.lease is not None
        self._held += 1
        self.hop = 0
        self.lease = Lease(
            self.me,
            min(self.lease.seq + 1, SEQ_LIMIT),
            self.priority,
            self.lease.score,
            established=self._held >= ACT_PERIODS,
        )

    def _bury(self) -> None:
        self._tombs = {leader: (seq, left - 1) for leader, (seq, left) in self._tombs.items() if left > 1}
