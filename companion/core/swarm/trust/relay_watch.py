"""Neighbours that hand something else down than the leader does, or hold the whole swarm back for ever.

What is handed down (the reference velocity, the vector to d2) each vehicle means over those nearer to the leader, so a
false one is half of it at worst, and the one that is farthest off is the false one. It is judged by the leader's own
word where that is heard, else by the median of three or more. Who holds, or hears little of the leader, hands down
less: a part of the leader's course, or none, only slows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.guidance.formation import GOVERNOR_FULL, Route
from companion.core.localisation.destination import honest_gap_m
from companion.core.model.beacon import Beacon
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import dot, median, norm, scale, sub
from mission.common.frames import Vec3

REF_OFF_MPS: Final = 1.0  # a change of the leader's speed is handed down within a period or two
LEAST_COST: Final = 1.0  # of a route that has a hop
STANDS: Final = 0.05  # of the speed: who allows no more holds all
PATIENCE_S: Final = 30.0  # with one that holds all on a link that is short: its word is all there is for it
# On one that is stretched it is far behind, as it says; less than a leader takes to land a swarm that gets nowhere
STRETCHED_S: Final = 90.0
AGAIN_S: Final = 60.0  # then the swarm goes on without it for so long


def breaks_route(beacon: Beacon) -> bool:
    """It says that it is on its leader's place, and is not its leader.

    One of whose words nothing counts yet, by its signature, names no leader here, and may be it.
    """
    lease = beacon.lease
    return beacon.route_cost < LEAST_COST and lease is not None and lease.leader != beacon.sender


def find_contradicting(route: Route, neighbours: Sequence[Neighbour], leader: int) -> int:
    """Of those that `route` goes by, the one that is farthest from what the leader hands down; 0: none."""
    its = next((n for n in neighbours if n.id == leader), None)
    others = [n for n in route.up if n.id != leader and _follows(n, leader)]
    if not others or (its is None and len(others) < 3):
        return 0
    ref = its.beacon.ref_ned_mps if its is not None else median([n.beacon.ref_ned_mps for n in others])
    off = {n.id: _off_course_mps(n.beacon.ref_ned_mps, ref) / REF_OFF_MPS for n in others}
    dests = [(n, n.dest_ned_m) for n in others if n.dest_ned_m is not None]
    dest = None if its is None else its.dest_ned_m
    its_error_m = 0.0 if its is None else its.beacon.position_error_m
    if dest is None and len(dests) >= 3:
        dest = median([vector for _, vector in dests])
    if dest is not None:
        for told, vector in dests:
            gap_m = honest_gap_m(its_error_m, told.beacon.position_error_m)
            off[told.id] = max(off[told.id], norm(sub(vector, dest)) / gap_m)
    farthest = max(off, key=lambda vehicle: off[vehicle])
    return farthest if off[farthest] > 1.0 else 0


def _follows(neighbour: Neighbour, leader: int) -> bool:
    """It hands down this leader's course. Who has just lost it, or goes over to another, contradicts nobody."""
    lease = neighbour.beacon.lease
    return lease is not None and lease.leader == leader


def _off_course_mps(ref_ned_mps: Vec3, course_ned_mps: Vec3) -> float:
    """Distance from the nearest part of the course, all and none of it included, m/s."""
    length2 = dot(course_ned_mps, course_ned_mps)
    share = max(0.0, min(1.0, dot(ref_ned_mps, course_ned_mps) / length2)) if length2 > 0.0 else 0.0
    return norm(sub(ref_ned_mps, scale(course_ned_mps, share)))


@final
class Patience:
    """With followers that allow no speed: for PATIENCE_S, STRETCHED_S on a stretched link, then the swarm goes on."""

    __slots__ = ("_over_s", "_since_s")

    def __init__(self) -> None:
        self._since_s: dict[int, float] = {}
        self._over_s: dict[int, float] = {}

    def filter_followers(self, followers: list[Neighbour], now_s: float, *, range_m: float) -> list[Neighbour]:
        """Each period: the followers whose governor counts. `range_m`: that the formation keeps."""
        holding = {n.id: n.distance_m <= GOVERNOR_FULL * range_m for n in followers if n.beacon.governor < STANDS}
        if not holding and not self._over_s:
            self._since_s.clear()
            return followers
        self._since_s = {k: self._since_s.get(k, now_s) for k in sorted(holding)}
        for vehicle, since_s in self._since_s.items():
            if now_s - since_s > (PATIENCE_S if holding[vehicle] else STRETCHED_S):
                self._over_s[vehicle] = now_s
        self._over_s = {k: at_s for k, at_s in self._over_s.items() if now_s - at_s <= AGAIN_S}
        return [n for n in followers if n.id not in self._over_s]
