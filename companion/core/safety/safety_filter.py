"""The last word on every setpoint. Knows the vehicle, its neighbours, what hangs still, the fence and the mission's own
trunk: never which vehicle leads, and of what others say only where they are and how fast.

Precedence, highest first; what stands lower never buys anything at the cost of what stands higher:

1. a finite wish and a finite position, else rest;
2. what an obstacle sensor saw: the way to a stop keeps clear of it (`stopping`);
3. floor, ceiling, polygon, the mission's own trunk (`limits`);
4. separation, from neighbours and from those that fell silent in the air (`separations`);
5. the wish.

Last, a setpoint moves away from the one before by no more than a tick of the acceleration limit, except towards rest,
as far as 2, 3 or 4 demand it. `apply` says what is promised.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import ZERO, add, dot, is_finite, limit, norm, scale, sub
from companion.core.safety.obstacles import Trunk, trunks
from companion.core.safety.stopping import LocalObstacleCloud, ResponseModel
from mission.common.frames import Vec3
from mission.document.model import Mission

REACTION_S: Final = 0.8  # radio delay, a tick and the autopilot's lag in velocity
BEHIND_S: Final = 0.9  # behind one that may stop at once: its braking is told late, too
BRAKING_SHARE: Final = 0.6  # of the acceleration limit; the rest is left for gusts
AGE_WIDENS_MPS: Final = 1.0  # what a silent neighbour may have strayed from its last course
MARGIN_M: Final = 0.3  # kept beyond each limit: for lag, and for what gusts push
UNSHARED_M: Final = 0.7  # of the separation, that one takes which a trunk keeps from giving way
SILENT_STRAY_M: Final = 0.5  # one that hangs silent is only reckoned to be where it is
BACK_OFF_PER_S: Final = 1.2  # m/s for each metre beyond a limit; more would hunt where positions come 0.3 s late
BACK_OFF_MAX_MPS: Final = 1.0
WAY_IN_MPS: Final = 1.0  # at least, for a vehicle outside the fence
PASSES: Final = 8  # over the bounds: one cut may break another
TOLERANCE_MPS: Final = 0.01  # to which bounds are kept
SHARES = (1.0, 0.5)  # of a setpoint that are tried before rest, where it does not lead clear of trunks
ESCAPE_MAX_MPS: Final = 1.0
ESCAPE_GAIN_M: Final = 0.02  # less is not worth to leave rest for
AGAINST: Final = 0.5  # of the speed, to brake harder than rest does
RELAXATIONS: Final = 5  # halvings, in search of the least that bounds which contradict one another must give


@final
class Bound:
    """The most speed (m/s) along a direction (unit vector). No dataclass, as `peers.Neighbour`."""

    __slots__ = ("along", "most_mps")

    def __init__(self, along: Vec3, most_mps: float) -> None:
        self.along: Final = along
        self.most_mps: Final = most_mps


@dataclass(frozen=True, slots=True)
class SafetyFilter:
    """What the last stage holds a vehicle to. Polygon: (north, east) metres in order round the fence, or empty."""

    speed_max_mps: float
    climb_max_mps: float
    acceleration_max_mps2: float
    hard_separation_m: float
    trunks: tuple[Trunk, ...]  # the mission's own
    altitude_min_m: float
    altitude_max_m: float
    polygon_m: tuple[tuple[float, float], ...]

    @property
    def stopping(self) -> ResponseModel:
        """How the vehicle comes to rest."""
        return ResponseModel(self.acceleration_max_mps2, BRAKING_SHARE * self.acceleration_max_mps2)

    @classmethod
    def of(cls, mission: Mission) -> SafetyFilter:
        """The limits, fence, trunks and separation of a mission."""
        return cls(
            mission.limits.speed_max_mps,
            mission.limits.climb_max_mps,
            mission.limits.acceleration_max_mps2,
            mission.separation.hard_m,
            trunks(mission),
            mission.fence.altitude_min_m,
            mission.fence.altitude_max_m,
            tuple((y, x) for x, y in mission.fence.polygon_enu_m or ()),
        )

    def closing_mps(self, room_m: float) -> float:
        """The speed from which a vehicle still stops within `room_m`; negative: back off."""
        if room_m <= 0.0:
            return max(-BACK_OFF_MAX_MPS, BACK_OFF_PER_S * room_m)
        return _stops_from_mps(room_m, REACTION_S, BRAKING_SHARE * self.acceleration_max_mps2)

    def apply(
        self,
        wanted: Vec3,
        last: Vec3,
        own: Position,
        neighbours: Sequence[Neighbour],
        silent: Sequence[Vec3],
        *,
        dt_s: float,
        drift_ned_mps: Vec3 = ZERO,
        points: LocalObstacleCloud | None = None,
    ) -> Vec3:
        """The setpoint (NED m/s) nearest to `wanted` that keeps the safety_filter; `last` is the one before.

        `own`: with its true velocity. `silent`: relative positions of those that hang still. `drift_ned_mps`: the true
        velocity less the told one, which is what the autopilot steers.

        Promised of the setpoint v of any input, with L the `limits` and S the `separations` of `own`:

        - v is finite, within the speed limits, and no further than `acceleration_max_mps2 * dt_s` from k `last` for
          some k in 0..1, where `last` kept them;
        - along each bound of L it is at most max(0, its most) + TOLERANCE_MPS; where a bound of L is negative and not
          contradicted by another, it points away;
        - along each bound of S it is at most max(0, its most) + TOLERANCE_MPS, unless a bound of L is negative; where
          those of S contradict one another, more by at most what the most negative one asks for, as little as can be.

        With `points`, what an obstacle sensor saw, it is as much of that v (0..1) as leads to rest clear of them all
        (`ResponseModel.is_clear`), or rest: where v points away from a limit or a neighbour, trunks come first.
        """
        if not (is_finite(wanted) and is_finite(own.pos_ned_m)):
            return ZERO
        wanted = self._way_in(own.pos_ned_m) or wanted
        north, east, down = limit(sub(wanted, drift_ned_mps), self.speed_max_mps)
        wish = (north, east, max(-self.climb_max_mps, min(self.climb_max_mps, down)))
        limits = _told(self.limits(own.pos_ned_m), drift_ned_mps)
        separations = self.separations(
            own.vel_ned_mps, neighbours, silent, drift_ned_mps, among_trees=points is not None
        )
        v = self._shorten(_nearest(wish, limits, separations))
        last = self._shorten(last) if is_finite(last) else ZERO
        v = _reach(v, last, [*limits, *separations], self.acceleration_max_mps2 * dt_s)
        return v if points is None else self._clear(v, last, own, points, limits, drift_ned_mps, dt_s)

    def _clear(
        self,
        v: Vec3,
        last: Vec3,
        own: Position,
        points: LocalObstacleCloud,
        limits: Sequence[Bound],
        drift: Vec3,
        dt_s: float,
    ) -> Vec3:
        """`v`, or as much of it as leads to rest clear of what was seen; else rest, which was verified a tick ago."""
        if not is_finite(own.vel_ned_mps):
            return ZERO
        stopping = self.stopping
        vel = (own.vel_ned_mps[0], own.vel_ned_mps[1])
        before = (last[0] + drift[0], last[1] + drift[1])
        for share in SHARES:
            told = (share * v[0] + drift[0], share * v[1] + drift[1])
            if stopping.is_clear(points, vel, before, told, dt_s, slews=False):
                return scale(v, share) if share < 1.0 else v
        return self._escape(vel, before, points, limits, drift)

    def _escape(
        self,
        vel: tuple[float, float],
        last: tuple[float, float],
        points: LocalObstacleCloud,
        limits: Sequence[Bound],
        drift: Vec3,
    ) -> Vec3:
        """Where nothing is verified: true rest, or what keeps further from what is near and within `limits`."""
        push_n, push_e = points.push(0.0, ESCAPE_MAX_MPS)
        best, most_m = ZERO, -1.0
        ways = ((0.0, 0.0), (push_n, push_e), (push_n - AGAINST * vel[0], push_e - AGAINST * vel[1]))
        for k in range(len(ways)):  # the first is rest: it may leave the limits, as it leans against the wind
            v = self._shorten(sub((ways[k][0], ways[k][1], 0.0), drift))
            if k > 0 and not all([dot(v, bound.along) <= max(0.0, bound.most_mps) + TOLERANCE_MPS for bound in limits]):
                continue
            nearest_m = self.stopping.nearest_m(points, vel, last, (v[0] + drift[0], v[1] + drift[1]))
            if nearest_m > most_m + ESCAPE_GAIN_M:
                best, most_m = v, nearest_m
        return best

    def limits(self, pos_ned_m: Vec3) -> list[Bound]:
        """Floor, ceiling, the sides of the polygon (outside: the way further out), the mission's own trunks."""
        altitude_m = -pos_ned_m[2]
        bounds = [
            Bound((0.0, 0.0, 1.0), self.closing_mps(altitude_m - self.altitude_min_m - MARGIN_M)),
            Bound((0.0, 0.0, -1.0), self.closing_mps(self.altitude_max_m - altitude_m - MARGIN_M)),
        ]
        sides = to_edges(pos_ned_m, self.polygon_m)
        if sides and is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            for side in sides:
                bounds += self._bound(side, MARGIN_M)
        elif sides:
            way_in = min(sides, key=norm)
            out_m = norm(way_in)
            if out_m > 1e-6:
                bounds.append(Bound(scale(way_in, -1.0 / out_m), self.closing_mps(-out_m - MARGIN_M)))
        for trunk in self.trunks:
            to_it = trunk.seen_from(pos_ned_m)
            bounds += self._bound((to_it[0], to_it[1], 0.0) if trunk.upright else to_it, trunk.keep_out_m + MARGIN_M)
        return bounds

    def separations(
        self,
        own_vel_ned_mps: Vec3,
        neighbours: Sequence[Neighbour],
        silent: Sequence[Vec3],
        drift_ned_mps: Vec3 = ZERO,
        *,
        among_trees: bool = False,
    ) -> list[Bound]:
        """How fast the vehicle may close on each of the others: of the told velocity, which `drift_ned_mps` amends.

        `among_trees`: those that give way may stop at once, before a trunk.
        """
        bounds: list[Bound] = []
        for rel in silent:
            bounds += self._bound(rel, self.hard_separation_m + MARGIN_M + SILENT_STRAY_M)
        bounds = _told(bounds, drift_ned_mps)
        own_x, own_y, own_z = own_vel_ned_mps
        drift_x, drift_y, drift_z = drift_ned_mps
        for neighbour in neighbours:  # written out: this runs for every neighbour in every tick
            distance_m = neighbour.distance_m
            if not 1e-6 < distance_m < math.inf:
                continue
            share, (x, y, z), (vx, vy, vz) = 1.0 / distance_m, neighbour.rel_ned_m, neighbour.vel_ned_mps
            n = x, y, z = x * share, y * share, z * share
            room_m = distance_m - self.hard_separation_m - MARGIN_M - AGE_WIDENS_MPS * neighbour.age_s
            its_mps, own_mps = vx * x + vy * y + vz * z, own_x * x + own_y * y + own_z * z
            if neighbour.gives_way:  # half of the allowed closing speed each, about the pair's common velocity
                most_mps = self.closing_mps(room_m) / 2.0 + self._believed((own_mps + its_mps) / 2.0)
                if among_trees:
                    most_mps = min(most_mps, self._behind_mps(room_m + UNSHARED_M, self._believed(its_mps)))
            else:
                most_mps = self.closing_mps(room_m) + self._believed(its_mps)
            bounds.append(Bound(n, most_mps - (x * drift_x + y * drift_y + z * drift_z)))
        return bounds

    def _behind_mps(self, room_m: float, its_mps: float) -> float:
        """How fast to fly behind one at `its_mps` that may brake by all it has; towards one, as `closing_mps`."""
        if its_mps <= 0.0:
            return self.closing_mps(room_m) + its_mps
        room_m += its_mps * its_mps / (2.0 * self.acceleration_max_mps2)
        if room_m <= 0.0:
            return self.closing_mps(room_m)
        return _stops_from_mps(room_m, BEHIND_S, self.acceleration_max_mps2)

    def _believed(self, speed_mps: float) -> float:
        """No vehicle is faster than the limit; 0 for what is no number."""
        if speed_mps - speed_mps != 0.0:  # not finite
            return 0.0
        return max(-self.speed_max_mps, min(self.speed_max_mps, speed_mps))

    def _bound(self, to_obstacle: Vec3, keep_m: float) -> list[Bound]:
        """How fast to close on a still obstacle, so as to stop `keep_m` before it."""
        distance_m = norm(to_obstacle)
        if not 1e-6 < distance_m < math.inf:
            return []
        return [Bound(scale(to_obstacle, 1.0 / distance_m), self.closing_mps(distance_m - keep_m))]

    def _way_in(self, pos_ned_m: Vec3) -> Vec3 | None:
        """Level velocity back to the polygon; None for a vehicle inside, where the wish counts."""
        if not self.polygon_m or is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            return None
        way_in = min(to_edges(pos_ned_m, self.polygon_m), key=norm)
        out_m = max(norm(way_in), 1e-6)
        return scale(way_in, max(WAY_IN_MPS, min(self.speed_max_mps, out_m)) / out_m)

    def _shorten(self, v: Vec3) -> Vec3:
        """Within the speed limits, in the same direction: to cut the climb alone might close on a neighbour."""
        v = limit(v, self.speed_max_mps)
        if abs(v[2]) <= self.climb_max_mps:
            return v
        return scale(v, self.climb_max_mps / abs(v[2]))


def _stops_from_mps(room_m: float, reaction_s: float, braking_mps2: float) -> float:
    return braking_mps2 * (math.sqrt(reaction_s * reaction_s + 2.0 * room_m / braking_mps2) - reaction_s)


def _told(bounds: list[Bound], drift_ned_mps: Vec3) -> list[Bound]:
    """Bounds of the true velocity as bounds of the told one."""
    if drift_ned_mps == ZERO:
        return bounds
    return [Bound(bound.along, bound.most_mps - dot(bound.along, drift_ned_mps)) for bound in bounds]


def _nearest(wish: Vec3, limits: Sequence[Bound], separations: Sequence[Bound]) -> Vec3:
    """Near `wish`, within all bounds; where they contradict one another, near rest and within `limits` at least."""
    v = keep_within(wish, [*separations, *limits])
    if _holds(v, separations) and _holds(v, limits):
        return v
    v = keep_within(ZERO, limits)
    if not _holds(v, limits):
        return ZERO
    low, high = 0.0, max((-bound.most_mps for bound in separations), default=0.0)
    for _ in range(RELAXATIONS if high > 0.0 else 0):
        give_mps = (low + high) / 2.0
        relaxed = [Bound(bound.along, bound.most_mps + give_mps) for bound in separations]
        tried = keep_within(ZERO, [*relaxed, *limits])
        if _holds(tried, relaxed) and _holds(tried, limits):
            v, high = tried, give_mps
        else:
            low = give_mps
    return v


def _reach(v: Vec3, last: Vec3, bounds: Sequence[Bound], step_mps: float) -> Vec3:
    """As far towards `v` as one tick goes: from `last`, shortened as far as the bounds demand."""
    share = 1.0
    for bound in bounds:
        # A bound that others have overruled asks for no more than `v` has of it.
        along_mps, most_mps = dot(last, bound.along), max(max(bound.most_mps, 0.0), dot(v, bound.along))
        if along_mps > most_mps:
            share = min(share, most_mps / along_mps)
    start = scale(last, share)
    return add(start, limit(sub(v, start), step_mps))


def _holds(v: Vec3, bounds: Sequence[Bound]) -> bool:
    return all(dot(v, bound.along) <= bound.most_mps + TOLERANCE_MPS for bound in bounds)


def keep_within(v: Vec3, bounds: Sequence[Bound]) -> Vec3:
    """`v` with each component along a bound's direction cut to its most, in turn; the later bounds win."""
    x, y, z = v
    for _ in range(PASSES):  # the hottest loop of a tick: `dot`, `sub` and `scale` written out
        within = True
        for bound in bounds:
            along_x, along_y, along_z = bound.along
            excess_mps = x * along_x + y * along_y + z * along_z - bound.most_mps
            if excess_mps > 0.0:
                x, y, z = x - along_x * excess_mps, y - along_y * excess_mps, z - along_z * excess_mps
                within = within and excess_mps <= TOLERANCE_MPS / 4.0
        if within:
            break
    return (x, y, z)


def to_edges(pos_ned_m: Vec3, polygon: Sequence[tuple[float, float]]) -> list[Vec3]:
    """As `to_edge`, of each of its sides in order."""
    return [to_edge(pos_ned_m, polygon[k], polygon[(k + 1) % len(polygon)]) for k in range(len(polygon))]


def to_edge(pos_ned_m: Vec3, a: tuple[float, float], b: tuple[float, float]) -> Vec3:
    """Level vector from a position to the nearest point of side a-b."""
    along = (b[0] - a[0], b[1] - a[1])
    t = ((pos_ned_m[0] - a[0]) * along[0] + (pos_ned_m[1] - a[1]) * along[1]) / (along[0] ** 2 + along[1] ** 2)
    t = max(0.0, min(1.0, t))
    return (a[0] + t * along[0] - pos_ned_m[0], a[1] + t * along[1] - pos_ned_m[1], 0.0)


def is_inside(north_m: float, east_m: float, polygon: Sequence[tuple[float, float]]) -> bool:
    """Even-odd rule."""
    inside = False
    for k in range(len(polygon)):  # this runs in every tick
        (n0, e0), (n1, e1) = polygon[k - 1], polygon[k]
        if (e0 > east_m) != (e1 > east_m) and north_m < (n1 - n0) * (east_m - e0) / (e1 - e0) + n0:
            inside = not inside
    return inside
