"""What must hold in every step of a swarm, whatever the adversary does; and, when it rests, after so many periods."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from companion.core.swarm.phases import TRANSITIONS
from companion.core.swarm.roster import NO_MAJORITY
from tests.exploration.air import GONE, Act, Air, World, find_parts
from tests.exploration.kept import PERIOD_S
from tests.exploration.vehicle import STALE_PERIODS, Seen
from tests.unit.core.core_election_net import acting_within, failover_within, overlap_within, recovery_within

# One-way links, lies: what they break is settled when they are over
UNSETTLED = frozenset({Act.DEAF, Act.LIE})
QUORUM_PERIODS = round(NO_MAJORITY.delay_s / PERIOD_S)


class Monitor(NamedTuple):
    """What is counted along the way."""

    together: int = 0  # periods, without a break, with two acting leaders in one part
    exclusive: int = 0  # the same with two that decide for the swarm, wherever they are
    met: tuple[tuple[int, ...], ...] = ()  # of each vehicle: since each other was in its part
    apart: tuple[int, ...] = ()  # of each vehicle: since those that it may count were the majority of those in the air
    lied: bool = False  # a member has lied


class Bounds(NamedTuple):
    """Of a swarm, in beacon periods."""

    together: int
    exclusive: int
    met: int  # so long a vehicle that is not there any more may be counted
    apart: int
    settled: int
    settled_after_lies: int

    @classmethod
    def of(cls, size: int, depth: int) -> Bounds:
        """By the bounds of the election's laws, for a graph of that depth."""
        # What a leader hears of a branch is old when a link on its way is cut, at each hop; then it still counts.
        met, apart = STALE_PERIODS * depth, QUORUM_PERIODS + 2
        settled = max(acting_within(depth), failover_within(depth)) + overlap_within(depth)
        return cls(overlap_within(depth), 0, met, apart, settled, recovery_within(size, depth))


class Rules:
    """Judges steps."""

    def __init__(self, air: Air, bounds: Bounds) -> None:
        self.air, self.bounds = air, bounds

    def begin(self, world: World) -> Monitor:
        """Of the first state."""
        size = len(world.members)
        return Monitor(met=((0,) * size,) * size, apart=(0,) * size)

    def count(self, world: World, monitor: Monitor) -> Monitor:
        """One period later."""
        seen, links = self._seen(world), self.air.links(world)
        # What drifted apart by one-way links is none of the merge's: it counts from when they hear each other again.
        settles = not any(trouble.act in UNSETTLED for trouble in world.troubles)
        acting = max((sum(one.acts for k, one in seen.items() if k in part) for part in links.parts), default=0)
        deciding = sum(one.decides for one in seen.values())
        flying = {k for k, one in seen.items() if one.airborne}
        flying |= {trouble.who for trouble in world.troubles if trouble.act is Act.CRASH and trouble.other}
        apart, met = list(monitor.apart), list(monitor.met)
        for part in links.loose_parts:
            for k in part:
                aged = enumerate(met[k - 1], start=1)
                met[k - 1] = tuple(0 if j in part else min(self.bounds.met + 1, periods + 1) for j, periods in aged)
                here = {j for j in flying if met[k - 1][j - 1] <= self.bounds.met}
                whole = len(here) > len(flying - here)
                apart[k - 1] = 0 if whole else min(self.bounds.apart + 1, apart[k - 1] + 1)
        return Monitor(
            together=min(self.bounds.together + 1, monitor.together + 1) if acting > 1 and settles else 0,
            exclusive=monitor.exclusive + 1 if deciding > 1 else 0,
            met=tuple(met),
            apart=tuple(apart),
            lied=monitor.lied or any(trouble.act is Act.LIE for trouble in world.troubles),
        )

    def find_violations(self, before: World, after: World, monitor: Monitor, rested: int) -> Iterator[str]:
        """Of one step. `rested`: periods since the adversary's last act."""
        old, new = self._seen(before), self._seen(after)
        liars = {trouble.who for trouble in after.troubles if trouble.act is Act.LIE}
        honest = {k: one for k, one in new.items() if k not in liars}
        for k, one in honest.items():
            if k in old:
                others = [seen[other] for seen in (old, new) for other in seen if other != k]
                yield from self._find_regressions(k, old[k], one, others, lied=monitor.lied)
            if one.decides and not one.counted:
                yield f"exclusive: vehicle {k} decides for the swarm without quorum"
            if one.decides and monitor.apart[k - 1] > self.bounds.apart and not monitor.lied:
                yield f"majority: vehicle {k} decides {monitor.apart[k - 1]} periods after its part lost the majority"
        if monitor.exclusive > self.bounds.exclusive and not monitor.lied:
            who = [k for k, one in new.items() if one.decides]
            yield f"two exclusive leaders: {who}"
        if monitor.together > self.bounds.together and not monitor.lied:
            yield f"two leaders: in one part for more than {self.bounds.together} periods"
        if rested >= self.limit(monitor) and not self.is_settled(after, monitor):
            leaders = {k: one.leader for k, one in new.items()}
            yield f"liveness: no agreement {rested} periods after the adversary's last act: {leaders}"
        yield from self._find_unheard_orders(after, monitor, rested)

    def limit(self, monitor: Monitor) -> int:
        """After so many periods of rest a swarm has settled."""
        return self.bounds.settled_after_lies if monitor.lied else self.bounds.settled

    def is_settled(self, world: World, monitor: Monitor) -> bool:
        """One acts in each part in which any is able to, and all there follow it; who is not believed follows, too."""
        if any(trouble.act in UNSETTLED for trouble in world.troubles):
            return True
        seen = self._seen(world)
        for part in self._find_parts(world, monitor):
            here = [seen[k] for k in part]
            if not any(one.able for one in here):
                continue
            leaders = {one.leader for one in here}
            acting = [k for k in part if seen[k].acts]
            is_led = acting or (monitor.lied and any(k in seen and seen[k].acts for k in leaders))
            if len(leaders) != 1 or len(acting) > 1 or not is_led:
                return False
        return True

    def _find_regressions(self, k: int, old: Seen, new: Seen, others: list[Seen], *, lied: bool) -> Iterator[str]:
        if new.progress < old.progress:
            yield f"phase: vehicle {k} went back from {old.phase.name} to {new.phase.name}"
        if (old.abort and not new.abort) or (old.started and not new.started):
            yield f"latch: vehicle {k} has forgotten an order"
        if new.progress != old.progress and not lied:
            heard = any(one.progress == new.progress for one in others)
            by_table = new.phase in [phase for _, phase in TRANSITIONS[old.phase]]
            if not heard and not (by_table and new.acts and new.quorum):
                yield f"phase: vehicle {k} enters {new.phase.name} after {old.phase.name} by nobody's word"

    def _find_unheard_orders(self, world: World, monitor: Monitor, rested: int) -> Iterator[str]:
        """An order to land is known to all that are linked to one that knows it, a hop a period."""
        seen = self._seen(world)
        for part in self._find_parts(world, monitor):
            if rested >= len(part) and len({seen[k].abort for k in part}) > 1:
                yield f"abort: not known to all of {sorted(part)} after {rested} periods"

    def _find_parts(self, world: World, monitor: Monitor) -> list[frozenset[int]]:
        """Those that are linked both ways; and once a member has lied, believe each other."""
        links = self.air.links(world)
        if not monitor.lied:
            return links.parts
        seen = self._seen(world)
        believed = {(a, b) for a, b in links.edges if not seen[b].blocks >> (a - 1) & 1}
        return find_parts(set(seen), [(a, b) for a, b in believed if (b, a) in believed])

    def _seen(self, world: World) -> dict[int, Seen]:
        return {k: self.air.fleet.seen(m) for k, m in enumerate(world.members, start=1) if m != GONE}
