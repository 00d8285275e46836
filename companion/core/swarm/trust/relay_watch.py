"""Neighbours that hand something else down than the leader does, or hold the whole swarm back for ever.

What is handed down (the reference velocity, the vector to d2) each vehicle means over those nearer to the leader, so a
false one is half of it at worst, and the one that is farthest off is the false one. It is judged by the leader's own
word where that is heard, else by the median of three or more.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.guidance.formation import GOVERNOR_FULL, Route
from companion.core.model.beacon import Beacon
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import norm, sub
from mission.common.frames import Vec3

REF_OFF_MPS: Final = 1.0  # a change of the leader's speed is handed down within a period or two
DEST_OFF_M: Final = 8.0  # estimates of a GNSS-denied swarm differ by less
LEAST_COST: Final = 1.0  # of a route that has a hop
STANDS: Final = 0.05  # of the speed: who allows no more holds all
PATIENCE_S: Final = 30.0  # with one that holds all: less than a leader takes to land a swarm that gets nowhere
AGAIN_S: Final = 60.0  # then the swarm goes on without it for so long


def breaks_route(beacon: Beacon) -> bool:
    """It says that it is on its leader's place, and is not its leader."""
    lease = beacon.lease
    return beacon.route_cost < LEAST_COST and (lease is None or lease.leader != beacon.sender)


def find_contradicting(route: Route, neighbours: Sequence[Neighbour], leader: int) -> int:
    """Of those that `route` goes by, the one that is farthest from what the leader hands down; 0: none."""
    its = next((n for n in neighbours if n.id == leader), None)
    others = [n for n in route.up if n.id != leader]
    if not others or (its is None and len(others) < 3):
        return 0
    ref = its.beacon.ref_ned_mps if its is not None else _median([n.beacon.ref_ned_mps for n in others])
    off = {n.id: norm(sub(n.beacon.ref_ned_mps, ref)) / REF_OFF_MPS for n in others}
    dests = [(n.id, n.dest_ned_m) for n in others if n.dest_ned_m is not None]
    dest = None if its is None else its.dest_ned_m
    if dest is None and len(dests) >= 3:
        dest = _median([vector for _, vector in dests])
    if dest is not None:
        for vehicle, vector in dests:
            off[vehicle] = max(off[vehicle], norm(sub(vector, dest)) / DEST_OFF_M)
    farthest = max(off, key=lambda vehicle: off[vehicle])
    return farthest if off[farthest] > 1.0 else 0


def _median(vectors: Sequence[Vec3]) -> Vec3:
    """Component by component: the lower one of two in the middle."""
    middle = (len(vectors) - 1) // 2
    x, y, z = (sorted([v[k] for v in vectors])[middle] for k in range(3))
    return (x, y, z)


@final
class Patience:
    """With followers that allow no speed though their link is short: for PATIENCE_S, then the swarm goes on."""

    __slots__ = ("_over_s", "_since_s")

    def __init__(self) -> None:
        self._since_s: dict[int, float] = {}
        self._over_s: dict[int, float] = {}

    def filter_followers(self, followers: list[Neighbour], now_s: float, *, range_m: float) -> list[Neighbour]:
        """Each period: the followers whose governor counts."""
        holding = {n.id for n in followers if n.beacon.governor < STANDS and n.distance_m <= GOVERNOR_FULL * range_m}
        if not holding and not self._over_s:
            self._since_s.clear()
            return followers
        self._since_s = {k: self._since_s.get(k, now_s) for k in sorted(holding)}
        for vehicle, since_s in self._since_s.items():
            if now_s - since_s > PATIENCE_S:
                self._over_s[vehicle] = now_s
        self._over_s = {k: at_s for k, at_s in self._over_s.items() if now_s - at_s <= AGAIN_S}
        return [n for n in followers if n.id not in self._over_s]
