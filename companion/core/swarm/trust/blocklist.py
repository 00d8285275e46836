"""Members whose words count for separation alone: they lead nobody, no route goes over them, and no phase.

A list of its own has those whose course alone is not gone by: who is wrong about that may lead, or two that
judge differently would follow two leaders.

One is blocked for good when it is proven to have lied (`block`), or for a while when what it says contradicts what this
vehicle observes itself, again and again (`note_doubt`). What others say of a member never blocks it: so none can have
another one shut out. A vehicle that contradicts many is more likely wrong itself, so it doubts a third of the swarm at
most (F of 3 F + 1).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, final

from companion.core.model.beacon import NO_ROUTE, Beacon
from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import ZERO

DOUBT_LIMIT: Final = 10.0  # periods of contradiction: a second, which no lost or late beacon makes
FADES: Final = 0.1  # of a doubt each period: a lie told in every tenth beacon is let go
BLOCKED_S: Final = 60.0  # since it contradicted last: then it may have been restarted, or mended


@final
class Blocklist:
    """One vehicle's; bounded by the swarm's size. `fade` each beacon period."""

    __slots__ = ("_doubted", "_doubts", "_most", "_news", "_proven")

    def __init__(self, size: int) -> None:
        """`size`: of the swarm. Where there are two, each has nobody else to go by."""
        self._most = max(1, (size - 1) // 3) if size > 2 else 0
        self._proven: set[int] = set()
        self._doubts: dict[int, float] = {}
        self._doubted: dict[int, float] = {}  # blocked for a while: by vehicle, when it contradicted last
        self._news: list[tuple[int, str]] = []

    @property
    def is_empty(self) -> bool:
        """Nobody is blocked."""
        return not self._proven and not self._doubted

    def block(self, vehicle: int, why: str) -> None:
        """It is proven to have lied; `why`: in words."""
        if vehicle not in self._proven:
            self._proven.add(vehicle)
            self._news.append((vehicle, why))

    def note_doubt(self, vehicle: int, why: str, weight: float, now_s: float) -> None:
        """Its word contradicts what is observed here. `weight`: 1 for one that a lost beacon could explain."""
        if vehicle in self._doubted:
            self._doubted[vehicle] = now_s
            return
        self._doubts[vehicle] = min(DOUBT_LIMIT, self._doubts.get(vehicle, 0.0) + weight)
        if self._doubts[vehicle] >= DOUBT_LIMIT and len(self._doubted) < self._most:
            self._doubted[vehicle] = now_s
            self._news.append((vehicle, why))

    def fade(self, now_s: float) -> None:
        """A beacon period has passed."""
        if self._doubts:
            self._doubts = {k: doubt - FADES for k, doubt in self._doubts.items() if doubt > FADES}
        if self._doubted:
            self._doubted = {k: at_s for k, at_s in self._doubted.items() if now_s - at_s <= BLOCKED_S}

    def has(self, vehicle: int) -> bool:
        """True: it is blocked."""
        return vehicle in self._doubted or vehicle in self._proven

    def bits(self) -> int:
        """The blocked members; bit k-1 for vehicle k."""
        bits = 0
        for vehicle in (*self._proven, *self._doubted):
            bits |= 1 << (vehicle - 1)
        return bits

    def take_news(self) -> list[tuple[int, str]]:
        """The members blocked since this was asked last, and why."""
        news, self._news = self._news, []
        return news


def strip_course(beacon: Beacon) -> Beacon:
    """The beacon of one whose course is not gone by: no route goes over it."""
    return replace(beacon, ref_ned_mps=ZERO, dest_ned_m=None, route_cost=NO_ROUTE)


def strip_beacon(beacon: Beacon) -> Beacon:
    """A blocked member's beacon: where it is, how fast, and what its flight does; nothing that it says of others."""
    return replace(
        beacon,
        ref_ned_mps=ZERO,
        dest_ned_m=None,
        route_cost=NO_ROUTE,
        governor=1.0,
        lease=None,
        hop=0,
        candidate=None,
        parent=0,
        phase=SwarmPhase.ASSEMBLE,
        start=False,
        abort=False,
        agreed=False,
        done=0,
        sighting=None,
        stop=0,
        present=0,
        flown=0,
        accused=0,
    )
