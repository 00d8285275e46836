"""Trees by a potential field: O. Khatib, "Real-Time Obstacle Avoidance for Manipulators and Mobile Robots",
International Journal of Robotics Research 5(1), 1986, as textbooks retell it; the paper itself was not at hand.

Each obstacle nearer than rho0 pushes with eta (1/rho - 1/rho0) / rho^2 away from its nearest point, rho metres off.
The push is added to the velocity that an agent without trees would fly, in place of the paper's force on a mass. As
in the paper nothing is kept for certain, and where pushes and the wish cancel the vehicle stays. Its values are tuned
(docs/reference/forest.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import limit
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Floats

SECTORS = 36  # an obstacle is the nearest point of a sector, where neither sector beside it has a nearer one
NEAREST_M = 0.05  # pushes grow without bound: no nearer than this


class Params(law.Params):
    """Lengths from the hull."""

    eta: Annotated[float, Field(gt=0.0, description="Gain of the push, m4/s.")] = 2.0
    rho0_m: Annotated[float, Field(gt=0.0, description="Nearer than this an obstacle pushes.")] = 3.0
    push_max_mps: Annotated[float, Field(gt=0.0, description="At most, of all obstacles together.")] = 5.0


def stage(mission: Mission, params: Params) -> PotentialField:
    """One vehicle's."""
    return PotentialField(mission, params)


class PotentialField:
    """Keeps no state."""

    def __init__(self, mission: Mission, params: Params) -> None:
        self._p = params
        self._speed_max_mps = mission.limits.speed_max_mps
        self._radius_m = mission.sensing.vehicle_radius_m if mission.sensing else 0.0

    def velocity(
        self,
        wanted_ned_mps: Vec3,
        own: Position,  # noqa: ARG002
        neighbours: Sequence[Neighbour],  # noqa: ARG002
        points_m: Floats,
        now_s: float,  # noqa: ARG002
    ) -> Vec3:
        """NED m/s. `points_m`: (k, 2) north and east from the vehicle to what was seen."""
        p = self._p
        north = east = 0.0
        for point_n, point_e in nearest_points(points_m).tolist():
            away_m = math.hypot(point_n, point_e)
            rho_m = max(NEAREST_M, away_m - self._radius_m)
            if rho_m < p.rho0_m:
                push = p.eta * (1.0 / rho_m - 1.0 / p.rho0_m) / (rho_m * rho_m)
                north -= push * point_n / away_m
                east -= push * point_e / away_m
        north, east, _ = limit((north, east, 0.0), p.push_max_mps)
        wanted_n, wanted_e, down = wanted_ned_mps
        return limit((wanted_n + north, wanted_e + east, down), self._speed_max_mps)


def nearest_points(points_m: Floats) -> Floats:
    """(m, 2) of points (k, 2) those that are the nearest of their obstacle."""
    if not len(points_m):
        return points_m
    away_m = np.hypot(points_m[:, 0], points_m[:, 1])
    sector = np.floor(np.arctan2(points_m[:, 1], points_m[:, 0]) / math.tau * SECTORS).astype(np.intp) % SECTORS
    order = np.argsort(-away_m, kind="stable")  # the nearest is written last
    first = np.full(SECTORS, -1)
    first[sector[order]] = order
    least_m = np.where(first >= 0, away_m[first], np.inf)
    nearest = (least_m <= np.roll(least_m, 1)) & (least_m < np.roll(least_m, -1)) & (first >= 0)
    return np.asarray(points_m[first[nearest]])
