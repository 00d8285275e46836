"""The last word on every setpoint. Knows the vehicle, its neighbours, the fence and the tree: never who leads.

Order: speed and acceleration limits, then the fence, then neighbours, then the trunk: what comes later wins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.core.peers import Neighbour
from companion.core.types import Position
from companion.core.vec import add, dot, limit, norm, scale, sub
from mission.frames import Vec3
from mission.model import CoverageShape, Mission

REACTION_S = 0.8  # radio delay, a tick and the autopilot's lag in velocity
BRAKING_SHARE = 0.6  # of the acceleration limit; the rest is left for gusts
AGE_WIDENS_MPS = 1.0  # what a silent neighbour may have strayed from its last course
MARGIN_M = 0.3  # kept beyond each limit: for lag, and for what gusts push
WAY_IN_MPS = 1.0  # at least, for a vehicle outside the fence
PASSES = 3  # over neighbours: one limit may break another

Bound = tuple[Vec3, float]  # a direction (unit vector) and the most speed along it, m/s


@dataclass(frozen=True, slots=True)
class Envelope:
    """What the last stage holds a vehicle to. Polygon: (north, east) metres in order round the fence, or empty."""

    speed_max_mps: float
    climb_max_mps: float
    acceleration_max_mps2: float
    hard_separation_m: float
    keep_out_m: float
    trunk: bool  # the tree at d2 stands from the ground up: keep out level, not in three dimensions
    altitude_min_m: float
    altitude_max_m: float
    polygon_m: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, mission: Mission) -> Envelope:
        """The limits, fence and separation of a mission."""
        return cls(
            mission.limits.speed_max_mps,
            mission.limits.climb_max_mps,
            mission.limits.acceleration_max_mps2,
            mission.separation.hard_m,
            mission.coverage.keep_out_m,
            mission.coverage.shape is CoverageShape.RING,
            mission.fence.altitude_min_m,
            mission.fence.altitude_max_m,
            tuple((y, x) for x, y in mission.fence.polygon_enu_m or ()),
        )

    def closing_mps(self, room_m: float) -> float:
        """The speed from which a vehicle still stops within `room_m`; negative: back off."""
        if room_m <= 0.0:
            return room_m
        braking = BRAKING_SHARE * self.acceleration_max_mps2
        return braking * (math.sqrt(REACTION_S**2 + 2.0 * room_m / braking) - REACTION_S)

    def admit(
        self,
        wanted: Vec3,
        last: Vec3,
        own: Position,
        neighbours: Sequence[Neighbour],
        fallen: Sequence[Vec3],
        dest_ned_m: Vec3 | None,
        *,
        dt_s: float,
    ) -> Vec3:
        """The setpoint (NED m/s) nearest to `wanted` that keeps the envelope; `last` is the one before."""
        v = self._limit_speed(wanted)
        v = add(last, limit(sub(v, last), self.acceleration_max_mps2 * dt_s))
        v = self._inside_fence(v, own.pos_ned_m)
        v = keep_within(v, self._neighbour_bounds(own.vel_ned_mps, neighbours, fallen))
        if dest_ned_m is not None:
            v = self._clear_of_tree(v, dest_ned_m)
        return self._shorten(v)

    def _limit_speed(self, v: Vec3) -> Vec3:
        v = limit(v, self.speed_max_mps)
        return (v[0], v[1], max(-self.climb_max_mps, min(self.climb_max_mps, v[2])))

    def _shorten(self, v: Vec3) -> Vec3:
        """Within the same limits, in the same direction: to cut the climb alone might close on a neighbour."""
        v = limit(v, self.speed_max_mps)
        if abs(v[2]) <= self.climb_max_mps:
            return v
        share = self.climb_max_mps / abs(v[2])
        return (v[0] * share, v[1] * share, math.copysign(self.climb_max_mps, v[2]))

    def _inside_fence(self, v: Vec3, pos_ned_m: Vec3) -> Vec3:
        altitude_m = -pos_ned_m[2]
        down_mps = min(v[2], self.closing_mps(altitude_m - self.altitude_min_m - MARGIN_M))
        down_mps = max(down_mps, -self.closing_mps(self.altitude_max_m - altitude_m - MARGIN_M))
        down_mps = max(-self.climb_max_mps, min(self.climb_max_mps, down_mps))
        v = (v[0], v[1], down_mps)
        if not self.polygon_m:
            return v
        to_edges = [to_edge(pos_ned_m, a, b) for a, b in edges(self.polygon_m)]
        if not is_inside(pos_ned_m[0], pos_ned_m[1], self.polygon_m):
            way_in = min(to_edges, key=norm)
            out_m = max(norm(way_in), 1e-6)
            speed_mps = max(WAY_IN_MPS, min(self.speed_max_mps, out_m))
            return (way_in[0] / out_m * speed_mps, way_in[1] / out_m * speed_mps, v[2])
        # Together, not one after the other: in a corner each side's cut pushes towards the other side.
        return keep_within(v, [bound for side in to_edges for bound in self._bound(side, MARGIN_M)])

    def _neighbour_bounds(
        self, own_vel_ned_mps: Vec3, neighbours: Sequence[Neighbour], fallen: Sequence[Vec3]
    ) -> list[Bound]:
        """How fast the vehicle may close on each of the others."""
        bounds: list[Bound] = []
        for rel in fallen:
            bounds += self._bound(rel, self.hard_separation_m + MARGIN_M)
        for neighbour in neighbours:
            rel = neighbour.rel_ned_m
            distance_m = norm(rel)
            if distance_m <= 1e-6:
                continue
            n = scale(rel, 1.0 / distance_m)
            room_m = distance_m - self.hard_separation_m - MARGIN_M - AGE_WIDENS_MPS * neighbour.age_s
            # Both give way: half of the allowed closing speed each, about the pair's common velocity.
            common_mps = dot(add(own_vel_ned_mps, neighbour.beacon.vel_ned_mps), n) / 2.0
            bounds.append((n, self.closing_mps(room_m) / 2.0 + common_mps))
        return bounds

    def _bound(self, to_obstacle: Vec3, keep_m: float) -> list[Bound]:
        """How fast to close on a still obstacle, so as to stop `keep_m` before it."""
        distance_m = norm(to_obstacle)
        if distance_m < 1e-6:
            return []
        return [(scale(to_obstacle, 1.0 / distance_m), self.closing_mps(distance_m - keep_m))]

    def _clear_of_tree(self, v: Vec3, dest_ned_m: Vec3) -> Vec3:
        nearest = (dest_ned_m[0], dest_ned_m[1], 0.0) if self.trunk else dest_ned_m
        return keep_within(v, self._bound(nearest, self.keep_out_m + MARGIN_M))


def keep_within(v: Vec3, bounds: Sequence[Bound]) -> Vec3:
    """`v` with each component along a bound's direction cut to its most, in turn; PASSES times, as cuts interact."""
    for _ in range(PASSES):
        within = True
        for n, most_mps in bounds:
            excess_mps = dot(v, n) - most_mps
            if excess_mps > 0.0:
                v = sub(v, scale(n, excess_mps))
                within = False
        if within:
            break
    return v


def edges(
    polygon: Sequence[tuple[float, float]],
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Its sides, each as two corners."""
    return list(zip(polygon, (*polygon[1:], *polygon[:1]), strict=True))


def to_edge(pos_ned_m: Vec3, a: tuple[float, float], b: tuple[float, float]) -> Vec3:
    """Level vector from a position to the nearest point of side a-b."""
    along = (b[0] - a[0], b[1] - a[1])
    t = ((pos_ned_m[0] - a[0]) * along[0] + (pos_ned_m[1] - a[1]) * along[1]) / (along[0] ** 2 + along[1] ** 2)
    t = max(0.0, min(1.0, t))
    return (a[0] + t * along[0] - pos_ned_m[0], a[1] + t * along[1] - pos_ned_m[1], 0.0)


def is_inside(north_m: float, east_m: float, polygon: Sequence[tuple[float, float]]) -> bool:
    """Even-odd rule."""
    inside = False
    for (n0, e0), (n1, e1) in edges(polygon):
        if (e0 > east_m) != (e1 > east_m) and north_m < (n1 - n0) * (east_m - e0) / (e1 - e0) + n0:
            inside = not inside
    return inside
