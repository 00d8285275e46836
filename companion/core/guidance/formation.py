"""The five movement conditions of the paper, as a law that flies. Relative positions only.

Each function is one condition (Section IV.B) or what it needs; Algorithm 1's lines 20-35 are what they replace
(numbered as in docs/paper.md).
Velocities are NED m/s; `n` is the unit vector to a neighbour, `d` its distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import NO_ROUTE
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, add, limit, norm, scale
from mission.common.frames import Vec3
from mission.lanes.spread import LineAbreast

STRETCH: Final = 20.0  # what a link at full range costs more than one at half range
UP_STEP: Final = 0.99  # a neighbour this much nearer to the leader is followed
GOVERNOR_FULL: Final = 0.70  # share of the range: full speed up to there
GOVERNOR_ZERO: Final = 0.92  # standstill from there
# Of the beacons on the link up the route, the share that arrives: bad below the first until it is above the second. At
# 40 % loss it is measured as 0.6, 0.45 after a trunk's shadow of 1.5 s, and varies by 0.06: such a radio slows nobody.
BAD_LINK: Final = 0.3
GOOD_LINK: Final = 0.45
BAD_LINK_RANGE: Final = 0.8  # of the range, that is kept on a bad link: what loses much is soon lost
BAD_LINK_LEAST: Final = 0.5  # of the speed: slower, a swarm would stay where the radio is bad
SEPARATION_GAIN_PER_S: Final = 0.6
SEPARATION_LIMIT_MPS: Final = 3.0
COHESION_GAIN_PER_S: Final = 0.25
COHESION_START: Final = 0.5  # share of the range; nearer to the 10 m of separation, a wide swarm presses on its leader
COHESION_LIMIT_MPS: Final = 1.5
STRAIN_START: Final = 0.8  # share of the range from which a link is pulled together hard
FOLLOWED: Final = 3  # how many of Up pull
ABREAST_GAIN_PER_S: Final = 0.5
ABREAST_LIMIT_MPS: Final = 1.5
LEVEL_GAIN_PER_S: Final = 0.8  # as the leader's back to its line
APPROACH_MPS2: Final = 1.0  # the leader's deceleration towards its goal ...
# ... which at the end would chatter with the autopilot's lag: the last metres are slower
APPROACH_GAIN_PER_S: Final = 0.8


@dataclass(slots=True, init=False, unsafe_hash=True)
class Route:
    """The way to the leader: its cost, the neighbour to go through (0: none), and all that are nearer to it."""

    cost: Final[float]
    parent: Final[int]
    parent_distance_m: Final[float]
    up: Final[tuple[Neighbour, ...]]
    parent_share: Final[float]  # of the parent's beacons that arrives, 0..1

    def __init__(
        self,
        cost: float,
        parent: int,
        parent_distance_m: float,
        up: tuple[Neighbour, ...],
        parent_share: float = 1.0,
    ) -> None:
        self.cost = cost
        self.parent = parent
        self.parent_distance_m = parent_distance_m
        self.up = up
        self.parent_share = parent_share


LEADER_ROUTE = Route(0.0, 0, 0.0, ())
NOWHERE = Route(NO_ROUTE, 0, 0.0, ())


def link_cost(distance_m: float, range_m: float) -> float:
    """One, and more for a link beyond half of the range."""
    stretch = max(0.0, (distance_m / range_m - 0.5) / 0.5)
    return 1.0 + STRETCH * stretch * stretch


def route(neighbours: Sequence[Neighbour], *, range_m: float) -> Route:
    """A follower's route: the cheapest neighbour's cost and that of the link to it."""
    least = NO_ROUTE
    parent: Neighbour | None = None
    for neighbour in neighbours:
        its_cost = neighbour.beacon.route_cost
        if its_cost >= NO_ROUTE:
            continue
        cost = its_cost + link_cost(neighbour.distance_m, range_m)
        if cost < least:
            least, parent = cost, neighbour
    if parent is None:
        return NOWHERE
    up = tuple([n for n in neighbours if n.beacon.route_cost <= least - UP_STEP])
    return Route(least, parent.id, parent.distance_m, up, parent.share)


def children(me: int, own: Route, neighbours: Sequence[Neighbour]) -> list[Neighbour]:
    """Followers of `me`. Costs must rise away from the leader: a loop of stale parents feeds nothing back."""
    return [n for n in neighbours if n.beacon.parent == me and n.beacon.route_cost > own.cost]


def is_link_bad(own: Route, *, was_bad: bool) -> bool:
    """The link up the route loses much: with hysteresis, as shares are measured."""
    return own.parent_share < (GOOD_LINK if was_bad else BAD_LINK)


def governor(own: Route, followers: Sequence[Neighbour], *, range_m: float, link_is_bad: bool = False) -> float:
    """Condition 3: the share of cruise speed, 0..1, at which no link up the route is lost, for this whole branch."""
    share = max(BAD_LINK_LEAST, min(1.0, own.parent_share / GOOD_LINK)) if link_is_bad else 1.0
    if own.parent:
        room_m = GOVERNOR_ZERO * range_m - own.parent_distance_m
        share = min(share, max(0.0, room_m / ((GOVERNOR_ZERO - GOVERNOR_FULL) * range_m)))
    for follower in followers:
        share = min(share, follower.beacon.governor)
    return share


def approach(to_goal_ned_m: Vec3, *, cruise_mps: float, stop_m: float) -> Vec3:
    """Conditions 1 and 5 (lines 27-34), the leader's: cruise towards the goal and come to rest `stop_m` before it."""
    distance_m = norm(to_goal_ned_m)
    if distance_m <= stop_m:
        return ZERO
    left_m = distance_m - stop_m
    speed_mps = min(cruise_mps, math.sqrt(2.0 * APPROACH_MPS2 * left_m), APPROACH_GAIN_PER_S * left_m)
    return scale(to_goal_ned_m, speed_mps / distance_m)


def alignment(own: Route) -> Vec3:
    """Condition 2 (lines 25-26), a follower's: the mean of the reference velocities of those nearer to the leader."""
    if not own.up:
        return ZERO
    total = ZERO
    for neighbour in own.up:
        total = add(total, neighbour.beacon.ref_ned_mps)
    return scale(total, 1.0 / len(own.up))


def separation(neighbours: Sequence[Neighbour], silent: Sequence[Vec3], *, soft_m: float) -> Vec3:
    """Condition 4 (lines 22-24): away from all nearer than `soft_m`, those that hover silent (relative) too."""
    push = ZERO
    for neighbour in neighbours:
        distance_m = neighbour.distance_m
        if 1e-6 < distance_m < soft_m:
            gain = -SEPARATION_GAIN_PER_S * (soft_m - distance_m) / distance_m
            push = add(push, scale(neighbour.rel_ned_m, gain))
    for rel in silent:
        distance_m = norm(rel)
        if 1e-6 < distance_m < soft_m:
            push = add(push, scale(rel, -SEPARATION_GAIN_PER_S * (soft_m - distance_m) / distance_m))
    return limit(push, SEPARATION_LIMIT_MPS)


def cohesion(own: Route, *, range_m: float) -> Vec3:
    """Condition 3 (lines 20-21), a follower's: towards the nearest that lead to the leader, hard on a strained link."""
    nearest = sorted(own.up, key=lambda n: (n.distance_m, n.id))[:FOLLOWED]
    pull = ZERO
    for neighbour in nearest:
        distance_m = neighbour.distance_m
        speed_mps = COHESION_GAIN_PER_S * max(0.0, distance_m - COHESION_START * range_m)
        speed_mps += max(0.0, distance_m - STRAIN_START * range_m) / max(range_m - distance_m, 0.3)
        if speed_mps > 0.0:
            pull = add(pull, scale(neighbour.rel_ned_m, speed_mps / distance_m / len(nearest)))
    return limit(pull, COHESION_LIMIT_MPS)


def line_abreast(neighbours: Sequence[Neighbour], line: LineAbreast, axis: tuple[float, float]) -> Vec3:
    """A follower's on lanes, instead of a shape that comes about by itself: to its place beside the leader.

    Followers keep the order that they are in across the lanes' axis (unit vector, north and east); so many of them are
    left of the leader as are right of it, or one less. The axis does not turn with the course: from a lane to the next
    nobody changes places. Nothing while the leader is not heard.
    """
    leader: Neighbour | None = None
    others: list[Neighbour] = []
    for neighbour in neighbours:
        if neighbour.beacon.route_cost <= 0.0:
            leader = neighbour
        elif neighbour.beacon.state is FlightState.TRANSIT:
            others.append(neighbour)
    if leader is None:
        return ZERO
    north, east = axis
    before = sum([_across_m(other.rel_ned_m, axis) < 0.0 for other in others])
    left = (len(others) + 1) // 2
    place = before - left if before < left else before - left + 1  # the leader's is 0
    across_m = _across_m(leader.rel_ned_m, axis) + place * line.pitch_m
    along_m = leader.rel_ned_m[0] * north + leader.rel_ned_m[1] * east - (place % 2) * line.depth_m
    to_place = (along_m * north - across_m * east, along_m * east + across_m * north, 0.0)
    return limit(scale(to_place, ABREAST_GAIN_PER_S), ABREAST_LIMIT_MPS)


def _across_m(rel_ned_m: Vec3, axis: tuple[float, float]) -> float:
    """To the right of the axis."""
    return rel_ned_m[1] * axis[0] - rel_ned_m[0] * axis[1]


def level(own: Route) -> Vec3:
    """Part of condition 2: fly at the height of those followed, so that no one flies in another's downwash."""
    if not own.up:
        return ZERO
    mean_down_m = sum(neighbour.rel_ned_m[2] for neighbour in own.up) / len(own.up)
    return (0.0, 0.0, LEVEL_GAIN_PER_S * mean_down_m)
