"""Trees by headings: the law that ours replaces, under the same scans.

Of 61 headings the one that turns least for the room that it has, slower the less room there is; then half-planes that
no velocity may cross, one for each neighbour and each point of a trunk. It gets what an agent without trees would fly,
and the flight software's own map of what was seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import dot, norm, scale
from companion.core.safety.bounds import Bound, keep_within
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Floats

HEADINGS: Floats = np.radians(np.linspace(-150.0, 150.0, 61))
STUCK_MPS, STUCK_S, COMMIT_S = 0.25, 2.0, 5.0
BRAKING_MPS2, REACTION_S = 2.0, 0.6  # b(x) below


class Params(law.Params):
    """As it was measured first, with perfect sight of trees."""

    look_ahead_m: Annotated[float, Field(gt=0.0, description="How far a heading is looked along.")] = 10.0
    clear_m: Annotated[float, Field(gt=0.0, description="Kept between a vehicle's centre and bark.")] = 0.85
    blocked_cost: Annotated[float, Field(ge=0.0, description="Of no room at all; a quarter turn costs 1.")] = 1.5
    flip_cost: Annotated[float, Field(ge=0.0, description="Of the other side than before.")] = 0.15


def stage(mission: Mission, params: Params) -> HeadingScan:
    """One vehicle's."""
    return HeadingScan(mission, params)


class HeadingScan:
    """Remembers on which side it passes."""

    def __init__(self, mission: Mission, params: Params) -> None:
        self._p, self._hard_m = params, mission.separation.hard_m
        self._speed_max_mps = mission.limits.speed_max_mps
        self._side = 0.0
        self._slow_since_s: float | None = None
        self._committed_until_s = -math.inf

    def velocity(
        self, wanted_ned_mps: Vec3, own: Position, neighbours: Sequence[Neighbour], points_m: Floats, now_s: float
    ) -> Vec3:
        """NED m/s. `points_m`: (k, 2) north and east from the vehicle to what was seen."""
        speed_mps = math.hypot(wanted_ned_mps[0], wanted_ned_mps[1])
        v = wanted_ned_mps
        if speed_mps > 1e-6 and len(points_m):
            v = self._turned(wanted_ned_mps, speed_mps, own, points_m, now_s)
        bounds = [*self._neighbours(own, neighbours), *self._trunks(points_m)]  # the later win
        v = keep_within(v, bounds)
        length = norm(v)
        return v if length <= self._speed_max_mps else scale(v, self._speed_max_mps / length)

    def _turned(self, wanted: Vec3, speed_mps: float, own: Position, points_m: Floats, now_s: float) -> Vec3:
        p = self._p
        ahead = math.atan2(wanted[1], wanted[0])
        free_m = free_along(points_m, ahead + HEADINGS, p.clear_m, p.look_ahead_m)
        self._commit(math.hypot(own.vel_ned_mps[0], own.vel_ned_mps[1]), float(free_m[30]), now_s)
        cost = np.abs(HEADINGS) / (math.pi / 2.0) + p.blocked_cost * (1.0 - free_m / p.look_ahead_m)
        flips = np.sign(HEADINGS) * self._side < 0.0
        cost = cost + np.where(flips, math.inf if now_s < self._committed_until_s else p.flip_cost, 0.0)
        best = int(cost.argmin())
        if best != 30:
            self._side = float(np.sign(HEADINGS[best]))
        course = ahead + float(HEADINGS[best])
        speed_mps = min(speed_mps, max(0.0, braking_mps(float(free_m[best]))))
        return (speed_mps * math.cos(course), speed_mps * math.sin(course), wanted[2])

    def _commit(self, speed_mps: float, free_m: float, now_s: float) -> None:
        """Stuck before something: one side, and no other for a while."""
        if speed_mps >= STUCK_MPS or free_m >= self._p.look_ahead_m:
            self._slow_since_s = None
        elif self._slow_since_s is None:
            self._slow_since_s = now_s
        elif now_s - self._slow_since_s >= STUCK_S and now_s >= self._committed_until_s:
            self._side = -self._side or 1.0
            self._committed_until_s = now_s + COMMIT_S

    def _neighbours(self, own: Position, neighbours: Sequence[Neighbour]) -> list[Bound]:
        bounds = []
        for n in neighbours:
            if n.distance_m > 1e-6:
                along = scale(n.rel_ned_m, 1.0 / n.distance_m)
                shared = dot(own.vel_ned_mps, along) + dot(n.vel_ned_mps, along)
                bounds.append(Bound(along, (braking_mps(n.distance_m - self._hard_m) + shared) / 2.0))
        return bounds

    def _trunks(self, points_m: Floats) -> list[Bound]:
        bounds = []
        for north_m, east_m in points_m.tolist():
            away_m = math.hypot(north_m, east_m)
            if 1e-6 < away_m < 5.0:
                along = (north_m / away_m, east_m / away_m, 0.0)
                bounds.append(Bound(along, braking_mps(away_m - self._p.clear_m)))
        return bounds


def braking_mps(room_m: float) -> float:
    """The speed from which a vehicle stops within `room_m`; negative: back off."""
    if room_m <= 0.0:
        return room_m
    return BRAKING_MPS2 * (-REACTION_S + math.sqrt(REACTION_S**2 + 2.0 * room_m / BRAKING_MPS2))


def free_along(points_m: Floats, headings_rad: Floats, clear_m: float, reach_m: float) -> Floats:
    """(h,) how far each heading goes before it comes closer than `clear_m` to a point (k, 2), at most `reach_m`."""
    cos, sin = np.cos(headings_rad)[:, None], np.sin(headings_rad)[:, None]
    along = cos * points_m[:, 0] + sin * points_m[:, 1]
    across = cos * points_m[:, 1] - sin * points_m[:, 0]
    short = clear_m * clear_m - across * across
    meets = (short > 0.0) & (along > 0.0)
    free_m = np.where(meets, np.maximum(0.0, along - np.sqrt(np.maximum(short, 0.0))), reach_m)
    return np.asarray(np.minimum(free_m.min(axis=1, initial=reach_m), reach_m))
