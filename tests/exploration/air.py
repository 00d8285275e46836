"""A swarm and the air between its vehicles, one beacon period at a time; and what an adversary can do to it.

In a period all step, then all beacons that are sent arrive, then those of vehicles that follow another leader since: as
`Agent` does at two ticks a period. Nothing is drawn: what gets lost is the adversary's choice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

from companion.core.model.states import SwarmPhase
from companion.core.swarm.election import HOP_LIMIT, SCORE_LIMIT
from tests.exploration.kept import BOOTED
from tests.exploration.vehicle import Fleet, Said

GONE = -1  # the number of a vehicle whose companion is not there
Edge = tuple[int, int]


class Act(Enum):
    """The adversary's acts, and the operator's; the value says each in words."""

    CUT = "the vehicles of a set do not hear the others, nor those them"
    DEAF = "one vehicle does not hear another"
    CRASH = "a companion ends"
    WEAK = "a vehicle must not lead any more"
    LIE = "a member lies"
    LAND = "the operator orders all to land, at one vehicle"
    END = "that is over: they hear again, the companion starts again, the liar tells the truth"
    REBOOT = "that is over: the board starts again, with its clock at zero"


class Lie(Enum):
    """Lies of an insider about the election, the phase and the roster; each in all of its beacons."""

    LEADS = "it leads, and has for long"
    KEEPS = "the leader's count is far ahead"
    DEPOSES = "the leader hands over to the liar, now"
    PHASE = "the mission is over, by the leader's newest count"
    ROSTER = "all have taken off, all are here, all have done what the phase asks"
    DENIES = "it follows nobody"


class Trouble(NamedTuple):
    """One of the acts that last: which, on whom, and which lie."""

    act: Act
    who: int  # a vehicle; of CUT: the set, bit k-1 for vehicle k
    other: int = 0  # DEAF: the one that it does not hear; CRASH: 1 in the air
    lie: Lie | None = None

    def __str__(self) -> str:
        other = self.lie.name if self.lie is not None else self.other or ""
        return f"{self.act.name}({f'{self.who:b}' if self.act is Act.CUT else self.who}{other and f' {other}'})"


class World(NamedTuple):
    """The state of a swarm."""

    members: tuple[int, ...]  # numbers of `Fleet`
    troubles: tuple[Trouble, ...]


class Links(NamedTuple):
    """Who hears whom."""

    edges: list[Edge]  # sender, receiver
    parts: list[frozenset[int]]  # that are linked both ways
    loose_parts: list[frozenset[int]]  # ... at least one way


class Air:
    """Steps of a world. `chain`: each vehicle hears only those next to it, in the order of ids; else all hear all."""

    def __init__(self, fleet: Fleet, *, chain: bool = False) -> None:
        self.fleet, self.size = fleet, fleet.size
        ids = range(1, self.size + 1)
        self.edges = [(a, b) for a in ids for b in ids if a != b and (not chain or abs(a - b) == 1)]
        self._links: dict[tuple[tuple[Trouble, ...], tuple[bool, ...]], Links] = {}
        self._steps: dict[World, World] = {}
        self._lies: dict[tuple[int, Trouble], int] = {}

    def begin(self, *, started_at: int = 1) -> World:
        """All on the ground, ready; an operator has allowed the flight at one vehicle."""
        members = [self.fleet.begin(k) for k in range(1, self.size + 1)]
        members[started_at - 1] = self.fleet.order(members[started_at - 1], start=True)
        return World(tuple(members), ())

    def step(self, world: World) -> World:
        """One period."""
        found = self._steps.get(world)
        if found is None:
            found = self._steps[world] = self._step(world)
        return found

    def _step(self, world: World) -> World:
        fleet, members = self.fleet, list(world.members)
        edges = self.links(world).edges
        liars = {trouble.who: trouble for trouble in world.troubles if trouble.act is Act.LIE}
        sent: dict[int, int] = {}
        for index, member in enumerate(members):
            if member != GONE:
                members[index], sent[index + 1] = fleet.run(member)
        self._carry(members, sent, edges, liars)
        news: dict[int, int] = {}
        for index, member in enumerate(members):
            told = None if member == GONE else fleet.spread_news(member)
            if told is not None:
                members[index], news[index + 1] = told
        self._carry(members, news, edges, liars)
        return World(tuple(members), world.troubles)

    def _carry(self, members: list[int], sent: dict[int, int], edges: list[Edge], liars: dict[int, Trouble]) -> None:
        if not sent:
            return
        sent = {k: self._falsify(said, liars[k]) if k in liars else said for k, said in sent.items()}
        for sender, receiver in edges:
            if sender in sent and members[receiver - 1] != GONE:
                members[receiver - 1] = self.fleet.hear(members[receiver - 1], sent[sender])

    def links(self, world: World) -> Links:
        """As the air is now."""
        key = (world.troubles, tuple(member != GONE for member in world.members))
        found = self._links.get(key)
        if found is None:
            there = {k for k in range(1, self.size + 1) if world.members[k - 1] != GONE}
            edges = [
                (a, b)
                for a, b in self.edges
                if a in there and b in there and not any(_bars(trouble, a, b) for trouble in world.troubles)
            ]
            back = [(b, a) for a, b in edges]
            both = [edge for edge in edges if edge in back]
            found = self._links[key] = Links(edges, find_parts(there, both), find_parts(there, edges + back))
        return found

    # --- the adversary ---

    def begin_trouble(self, world: World, trouble: Trouble) -> World:
        """The world in which that has begun, before its next period."""
        members = list(world.members)
        at = trouble.who - 1
        match trouble.act:
            case Act.CRASH:
                members[at] = GONE
            case Act.WEAK:
                members[at] = self.fleet.weaken(members[at])
            case Act.LAND:
                members[at] = self.fleet.order(members[at], land=True)
        lasts = trouble.act in (Act.CUT, Act.DEAF, Act.LIE, Act.CRASH)
        troubles = tuple(sorted((*world.troubles, trouble), key=str)) if lasts else world.troubles
        return World(tuple(members), troubles)

    def end_trouble(self, world: World, trouble: Trouble, *, reboot: bool = False) -> World:
        """The world in which that is over. `reboot`: a crashed companion starts again with its clock at zero."""
        members = list(world.members)
        if trouble.act is Act.CRASH:
            airborne, clock = bool(trouble.other), BOOTED if reboot else 0
            members[trouble.who - 1] = self.fleet.begin(trouble.who, airborne=airborne, clock=clock)
        return World(tuple(members), tuple(one for one in world.troubles if one != trouble))

    def troubles(self, world: World, acts: frozenset[Act], lies: tuple[Lie, ...]) -> Iterator[Trouble]:
        """What the adversary can begin now: nobody is struck twice, and one lies at most."""
        lasting = {one.act for one in world.troubles}
        gone = {one.who for one in world.troubles if one.act is Act.CRASH}
        if Act.CUT in acts - lasting:
            for side in range(1, 1 << (self.size - 1)):  # vehicle `size` is always on the other side
                yield Trouble(Act.CUT, side)
        if Act.DEAF in acts:
            for sender, receiver in self.edges:
                trouble = Trouble(Act.DEAF, receiver, sender)
                if trouble not in world.troubles:
                    yield trouble
        for who in [k for k in range(1, self.size + 1) if k not in gone]:
            for act in (Act.CRASH, Act.WEAK, Act.LAND):
                if act in acts and self._changes(act, world.members[who - 1]):
                    yield Trouble(act, who, int(act is Act.CRASH and self.fleet.seen(world.members[who - 1]).airborne))
            if Act.LIE in acts - lasting:
                for lie in lies:
                    yield Trouble(Act.LIE, who, 0, lie)

    def _changes(self, act: Act, number: int) -> bool:
        _, member = self.fleet.member(number)
        if act is Act.LAND:
            return not self.fleet.seen(number).abort
        return act is Act.CRASH or not member.weak

    # --- lies ---

    def _falsify(self, said: int, trouble: Trouble) -> int:
        key = (said, trouble)
        found = self._lies.get(key)
        if found is None:
            assert trouble.lie is not None
            found = self._lies[key] = self.fleet.said_number(self._lie(self.fleet.said[said], trouble.who, trouble.lie))
        return found

    def _lie(self, said: Said, liar: int, lie: Lie) -> Said:
        beacon, lease = said
        everybody = (1 << self.size) - 1
        leader = liar % self.size + 1 if lease is None or lease[0] == liar else lease[0]
        seq = HOP_LIMIT if lease is None or lease[1] is None else lease[1]
        # leader, seq, ends, priority, score, established, heir, quorum
        match lie:
            case Lie.LEADS:
                own = replace(beacon, hop=0, agreed=True, route_cost=0.0, parent=0)
                return Said(own, (liar, HOP_LIMIT + 40, None, 0, SCORE_LIMIT, True, 0, True))
            case Lie.KEEPS:
                return Said(replace(beacon, hop=1), (leader, seq + 400, None, 0, SCORE_LIMIT, True, 0, True))
            case Lie.DEPOSES:
                return Said(replace(beacon, hop=1), (leader, seq + 1, seq + 2, 0, 0, True, liar, True))
            case Lie.PHASE:
                false = replace(beacon, hop=1, phase=SwarmPhase.LAND)
                return Said(false, (leader, seq + 2, None, 0, 0, True, 0, True))
            case Lie.ROSTER:
                return Said(replace(beacon, present=everybody, flown=everybody, done=everybody), lease)
            case Lie.DENIES:
                return Said(replace(beacon, agreed=False), None)


def _bars(trouble: Trouble, sender: int, receiver: int) -> bool:
    """That keeps a beacon from arriving."""
    if trouble.act is Act.CUT:
        return (trouble.who >> (sender - 1) & 1) != (trouble.who >> (receiver - 1) & 1)
    return trouble.act is Act.DEAF and (receiver, sender) == (trouble.who, trouble.other)


def find_parts(there: set[int], edges: list[Edge]) -> list[frozenset[int]]:
    """Those that are linked, over others or not."""
    left, found = set(there), []
    while left:
        part, news = set[int](), {min(left)}
        while news:
            part |= news
            news = {b for a, b in edges if a in news} - part
        left -= part
        found.append(frozenset(part))
    return found
