"""Nodes that are heard, by their version vectors, and what of the node's own records they lack."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from companion.records.frames import HOPS_UNKNOWN
from companion.records.holdings import AHEAD_MAX, Holding
from companion.records.record import BITMAP, Entry, LogKey, Vector

HEARD_S: Final = 5.0  # five vectors: a node that was not heard for so long is out of range
TOLD_S: Final = 1.5  # a vector of the last second, or so
HOPS_MAX: Final = 16  # farther off, a base station that has gone would be passed on in a circle
LAG_S: Final = 0.7  # a vector that comes so soon after a record was on the air knows not of it: radio, then the disk
WAIT_S: Final = 0.3  # before a record of another's is passed on: its writer may be in range, too
AIRED_MAX: Final = 4096  # records that were on the air lately; of the oldest it is forgotten
PLAN_MAX: Final = 64  # records, of which the next are sent; made anew before they are at an end
PAIRS_MAX: Final = (
    256  # of a node and a log, that one plan looks at: a member that lies may tell of 512 logs in each name
)
SLOTS_MAX: Final = 16
ROUNDING: Final = 1e-6  # of a slot: a tick at its very beginning is in it
SLOT_S: Final = 0.1  # two ticks, one without a beacon: of those that could pass on the same record, one sends it then

Numbered = tuple[LogKey, int]


class Candidate(NamedTuple):
    """A record that somebody lacks, in the order in which they are sent."""

    reach: int  # 0: the base station lacks it, 1: a node that is nearer to it than this one, 2: another
    of_others: bool
    number: int
    key: LogKey
    due_s: float  # not before: its writer may send it first


@dataclass(slots=True)
class _Peer:
    heard_s: float
    hops: int = HOPS_UNKNOWN
    is_full: bool = False
    entries: dict[LogKey, tuple[Entry, float]] = field(default_factory=dict)  # and when that was told


class Peers:
    """Bounded by the number of vehicles: callers let in only those that the mission has, and the base station."""

    def __init__(self, me: int, members: int, *, introduces: bool = False) -> None:
        """`members`: number of vehicles of the swarm.

        `introduces`: others believe in a record that they have, and in no word of one: they are sent the last of each
        log that they know less of.
        """
        self._me = me
        self._introduces = introduces
        self._slots = min(SLOTS_MAX, max(2, members))
        self._peers: dict[int, _Peer] = {}
        self._aired_s: dict[Numbered, float] = {}
        self._turn = 0  # of the pairs that a plan looks at, where there are more than it can

    def note_vector(self, sender: int, vector: Vector, now_s: float, known: Callable[[LogKey], bool]) -> None:
        """A part of a node's vector has come; of logs that are not `known` nothing is kept."""
        peer = self._peers.setdefault(sender, _Peer(now_s))
        peer.heard_s, peer.is_full = now_s, vector.is_full
        peer.hops = 0 if vector.is_base else max(1, vector.hops)
        for entry in vector.entries:
            if known(entry.key):
                peer.entries[entry.key] = (entry, now_s)

    def note_aired(self, key: LogKey, number: int, now_s: float) -> None:
        """A record was on the air, from this node or another: all that are in range may have it."""
        self._aired_s.pop((key, number), None)
        self._aired_s[key, number] = now_s
        if len(self._aired_s) > AIRED_MAX:
            del self._aired_s[next(iter(self._aired_s))]

    def is_aired_since(self, key: LogKey, number: int, since_s: float) -> bool:
        """This record was on the air after `since_s`."""
        at_s = self._aired_s.get((key, number))
        return at_s is not None and at_s >= since_s

    def heard(self, now_s: float) -> int:
        """Number of nodes in range."""
        return sum(now_s - peer.heard_s <= HEARD_S for peer in self._peers.values())

    def hears(self, node: int, now_s: float) -> bool:
        """This node is in range."""
        return node in self._peers and now_s - self._peers[node].heard_s <= HEARD_S

    def hops(self, now_s: float) -> int:
        """From this node to the base station, over those that are heard; HOPS_UNKNOWN: none of them knows."""
        nearest = min((peer.hops for peer in self._in_range(now_s)), default=HOPS_UNKNOWN)
        return nearest + 1 if nearest < HOPS_MAX else HOPS_UNKNOWN

    def plan(self, holdings: Mapping[LogKey, Holding], own: LogKey, now_s: float) -> list[Candidate]:
        """The records to send next: what the base station lacks first, own ones before others', none twice.

        No node asks. A record goes out again only for a node whose vector, told after that, still lacks it. Of others'
        records those who have them send in turn, and who hears one is silent about it: no two send the same.
        (Slotting and damping, as in Floyd et al., "A reliable multicast framework", SIGCOMM 1995.)
        """
        self._forget(now_s)
        found: dict[Numbered, Candidate] = {}
        hops = self.hops(now_s)
        for peer, key in self._pairs(now_s):
            entry, told_s = peer.entries[key]
            holding = holdings.get(key)
            if holding is None or now_s - told_s > HEARD_S:
                continue
            reach = 0 if peer.hops == 0 else 1 if peer.hops < hops else 2
            for number in self._lacking(holding, entry, told_s):
                due_s = told_s if key == own else told_s + WAIT_S
                _put(found, Candidate(reach, key != own, number, key, due_s))
        if self._introduces:
            for candidate in self._introductions(holdings, own, now_s):
                _put(found, candidate)
        return sorted(found.values())[:PLAN_MAX]

    def _introductions(self, holdings: Mapping[LogKey, Holding], own: LogKey, now_s: float) -> Iterator[Candidate]:
        """The last record of each log, for those that tell of no log of that name, or of an end long before."""
        hops = self.hops(now_s)
        for peer in self._in_range(now_s):
            if peer.is_full:
                continue
            reach = 0 if peer.hops == 0 else 1 if peer.hops < hops else 2
            for key, holding in holdings.items():
                entry, told_s = peer.entries.get(key, (None, 0.0))
                if entry is None or now_s - told_s > HEARD_S:
                    told_s, known, most = peer.heard_s, 0, AHEAD_MAX
                else:
                    known, most = max(entry.last, entry.window + BITMAP), entry.upto + AHEAD_MAX
                number = holding.last_upto(most)
                if number > known and not self.is_aired_since(key, number, told_s - LAG_S):
                    yield Candidate(reach, key != own, number, key, told_s if key == own else told_s + WAIT_S)

    def lacks_acknowledgement(self, key: LogKey, acked: int, now_s: float) -> bool:
        """A node in range has just told that it knows less of this log to be at the base station."""
        return any(
            key in peer.entries and now_s - peer.entries[key][1] <= TOLD_S and peer.entries[key][0].acked < acked
            for peer in self._in_range(now_s)
        )

    def _pairs(self, now_s: float) -> list[tuple[_Peer, LogKey]]:
        """Nodes and logs that the next plan looks at: PAIRS_MAX at most, by turns, the base station's among them."""
        found = [(peer, key) for peer in self._in_range(now_s) if not peer.is_full for key in peer.entries]
        if len(found) <= PAIRS_MAX:
            return found
        of_base = [pair for pair in found if pair[0].hops == 0]
        others = [pair for pair in found if pair[0].hops != 0]
        taken: list[tuple[_Peer, LogKey]] = []
        for some in (of_base, others):
            room = min(len(some), PAIRS_MAX // 2 if some is of_base else PAIRS_MAX - len(taken))
            taken += [some[(self._turn + k) % len(some)] for k in range(room)]
        self._turn += PAIRS_MAX // 2
        return taken

    def is_turn(self, candidate: Candidate, now_s: float) -> bool:
        """True if a planned record may go out in this tick. Of others' records each holder has a time of its own."""
        if now_s < candidate.due_s:
            return False
        turn = (int(now_s / SLOT_S + ROUNDING) - candidate.number) % self._slots
        return not candidate.of_others or turn == self._me % self._slots

    def _lacking(self, holding: Holding, entry: Entry, told_s: float) -> Iterator[int]:
        for number in holding.held(entry.window + 1, BITMAP):
            is_there = entry.bits >> (number - entry.window - 1) & 1
            if not is_there and not self.is_aired_since(entry.key, number, told_s - LAG_S):
                yield number

    def _in_range(self, now_s: float) -> Iterator[_Peer]:
        for peer in self._peers.values():
            if now_s - peer.heard_s <= HEARD_S:
                yield peer

    def _forget(self, now_s: float) -> None:
        """Drops what was on the air before any vector that still counts, and nodes that are out of range."""
        self._peers = {k: peer for k, peer in self._peers.items() if now_s - peer.heard_s <= HEARD_S}
        while self._aired_s:
            oldest = next(iter(self._aired_s))
            if now_s - self._aired_s[oldest] <= HEARD_S + LAG_S:
                return
            del self._aired_s[oldest]


def _put(found: dict[Numbered, Candidate], candidate: Candidate) -> None:
    before = found.get((candidate.key, candidate.number))
    if before is None or candidate < before:
        found[candidate.key, candidate.number] = candidate
