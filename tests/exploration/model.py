"""Small model of leases, majority and exclusive acts, explored with any beacon of any period lost.

What `companion/core/swarm` does, without all else: a lease that nobody renews runs out, then one claims, and leads a
moment later; a leader counts those that it heard follow it not long ago, the majority counts for a moment longer, and
the leader decides when it has had that for so long (`wait`). All hear all that is not lost; periods are half seconds.

`promise` is what the programs have not: the vote of one that goes over stays the last leader's for so long.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

LEASE, HELD, LINGERS = 2, 1, 2  # of the programs: 1 s, 0.5 s and 1 s
STALE = (1, 3)  # by a good radio, and by the worst
NEVER = 99


class Vehicle(NamedTuple):
    """State of one."""

    leader: int  # whom it follows, itself too; 0: nobody
    age: int  # since news of that one; of its own claim: since it made it, HELD at most
    leads: bool
    heard: tuple[int, ...]  # of each: since it was heard to follow this one
    without: int  # since it counted the majority; NEVER
    has_had: int  # since when it has it, at most the wait; -1: it has not
    bound: int  # for so long its vote is still another's


class Model:
    """Of `size` vehicles."""

    def __init__(self, size: int, *, stale: int, wait: int, promise: int = 0) -> None:
        """`stale`: for so long one counts that is not heard."""
        self.size, self.stale, self.wait, self.promise = size, stale, wait, promise
        ids = range(1, size + 1)
        self.edges = [(a, b) for a in ids for b in ids if a != b]

    def begin(self) -> tuple[Vehicle, ...]:
        """Vehicle 1 has led all for long."""
        leader = Vehicle(1, HELD, True, (0,) * self.size, 0, self.wait, 0)
        other = Vehicle(1, 0, False, (NEVER,) * self.size, NEVER, -1, 0)
        return (leader, *[other] * (self.size - 1))

    def decides(self, one: Vehicle) -> bool:
        """It acts exclusively."""
        return one.leads and one.has_had >= self.wait

    def following(self, swarm: tuple[Vehicle, ...]) -> Iterator[tuple[Vehicle, ...]]:
        """States a period later, whichever beacons are lost."""
        ran = [self._run(k, one) for k, one in enumerate(swarm, start=1)]
        for arrives in itertools.product((False, True), repeat=len(self.edges)):
            heard = list(ran)
            for (sender, receiver), came in zip(self.edges, arrives, strict=True):
                if came:
                    heard[receiver - 1] = self._hear(receiver, heard[receiver - 1], sender, ran[sender - 1])
            yield tuple(heard)

    def _run(self, me: int, one: Vehicle) -> Vehicle:
        one = one._replace(bound=max(0, one.bound - 1))
        heard = tuple(age + 1 if age < self.stale else NEVER for age in one.heard)
        if one.leader != me:
            if one.age + 1 < LEASE:
                return one._replace(age=one.age + 1)
            return Vehicle(me, 0, False, (NEVER,) * self.size, NEVER, -1, self.promise)  # a claim
        if not one.leads:
            return one._replace(age=min(HELD, one.age + 1), leads=one.age + 1 >= HELD, heard=heard)
        here = (one.bound == 0) + sum(age <= self.stale for k, age in enumerate(heard, start=1) if k != me)
        counts = 2 * here > self.size
        without = 0 if counts else one.without + 1 if one.without < LINGERS else NEVER
        had = one.has_had if without <= LINGERS else -1
        had = min(self.wait, had + 1) if had >= 0 or (counts and without <= LINGERS) else -1
        return one._replace(heard=heard, without=without, has_had=had)

    def _hear(self, me: int, one: Vehicle, sender: int, said: Vehicle) -> Vehicle:
        if said.leader == me and one.leader == me:
            if said.bound:
                return one
            return one._replace(heard=(*one.heard[: sender - 1], 0, *one.heard[sender:]))
        if one.leader == me:  # it may yield: to one that has the majority, and to the lower of equals
            one = one._replace(heard=(*one.heard[: sender - 1], NEVER, *one.heard[sender:]))
        if said.leader == sender and self._precedes(said, sender, one, me):
            bound = self.promise if one.leader != sender else one.bound
            return Vehicle(sender, 0, False, (NEVER,) * self.size, NEVER, -1, bound)
        return one

    @staticmethod
    def _precedes(said: Vehicle, sender: int, one: Vehicle, me: int) -> bool:
        if one.leader == sender:
            return True
        mine = (one.leads, one.without <= LINGERS) if one.leader == me else (True, True)
        return (said.leads, said.without <= LINGERS, -sender) > (*mine, -one.leader)


def find_overlap(model: Model) -> tuple[bool, int]:
    """Two can decide at once; and how many states it took to know."""
    seen, news = {model.begin()}, [model.begin()]
    while news:
        for after in set(model.following(news.pop())):
            if after in seen:
                continue
            if sum(map(model.decides, after)) > 1:
                return True, len(seen)
            seen.add(after)
            news.append(after)
    return False, len(seen)


def table() -> Iterator[str]:
    """Rows: silence that counts, wait, promise; whether two decide at once, states."""
    yield "| counts unheard for, s | waits, s | promise, s | two decide at once | states |"
    yield "|---|---|---|---|---|"
    for stale in STALE:
        promised = stale + LINGERS
        for wait, promise in ((0, 0), (10, 0), (20, 0), (0, promised - 1), (0, promised)):
            found, states = find_overlap(Model(3, stale=stale, wait=wait, promise=promise))
            yield f"| {stale / 2} | {wait / 2} | {promise / 2} | {'yes' if found else 'never'} | {states:,} |"
