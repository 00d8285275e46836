"""Surroundings by hand, and what the safety filter makes of a desired velocity in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, Obstacle, ObstacleKind, Trunk
from companion.core.safety.response_model import CALM, Disturbance
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3

HARD_M = 5.0  # of those that hover


def surroundings(
    own: Position,
    neighbours: Sequence[Neighbour] = (),
    silent: Sequence[Vec3] = (),
    *,
    last: Vec3 = ZERO,
    drift: Vec3 = ZERO,
    trunks: Sequence[Trunk] = (),
    points: LocalObstacleCloud | None = None,
    disturbance: Disturbance = CALM,
) -> Surroundings:
    """`silent`: relative, of those that hover silent; `points`: what was scanned."""
    cloud = LocalObstacleCloud(
        math.inf if points is None else points.reach_m,
        (False,) if points is None else points.blind,
        trunks=[trunk.seen_from(own.pos_ned_m) for trunk in trunks],
        hovering=[Obstacle(ObstacleKind.SILENT, rel, HARD_M) for rel in silent],
    )
    if points is not None:
        for n, e, clear_m in zip(points.norths, points.easts, points.clears_m, strict=True):
            cloud.add_points([n], [e], clear_m)
    hovering = {k: PeerReport(k, rel, 20.0, silent=True) for k, rel in enumerate(silent, start=100)}
    return Surroundings(
        own, neighbours, hovering, cloud, bias_ned_mps=drift, disturbance=disturbance, commanded_ned_mps=last
    )


def applied(
    safety_filter: SafetyFilter,
    desired: Vec3,
    last: Vec3,
    own: Position,
    neighbours: Sequence[Neighbour] = (),
    silent: Sequence[Vec3] = (),
    *,
    dt_s: float,
    drift: Vec3 = ZERO,
    trunks: Sequence[Trunk] = (),
    points: LocalObstacleCloud | None = None,
    disturbance: Disturbance = CALM,
) -> Vec3:
    """The setpoint; with `points` of a vehicle that has an obstacle sensor."""
    if points is not None and not safety_filter.senses:
        safety_filter = replace(safety_filter, senses=True)
    around = surroundings(
        own, neighbours, silent, last=last, drift=drift, trunks=trunks, points=points, disturbance=disturbance
    )
    return safety_filter.apply(desired, around, dt_s=dt_s).vel_ned_mps
