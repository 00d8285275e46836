"""Ranges to boxes in one turn of a 2-D lidar: as scan.py, which says what a turn is, does of cylinders."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.stand.stand import StandBox
from sim_bridge.world.sensors.scan import FIRST_RAY, RAY_STEP_RAD, RAYS, RAYS_PER_SECTOR, SECTORS

Floats = NDArray[np.float64]

_TURN: Final = (FIRST_RAY + np.arange(RAYS)) * RAY_STEP_RAD
_AHEAD: Final = np.column_stack([np.cos(_TURN), np.sin(_TURN)])  # of each ray: along the airframe's x and y
LEAST: Final = 1e-12  # of a unit vector: below it a ray runs along a face, and never meets it


def nearest_box_m(eye_ned_m: Vec3, attitude_rad: Vec3, boxes: Iterable[tuple[StandBox, float]], max_m: float) -> Floats:
    """Range to the nearest box in each sector, along the ray, in metres; inf: none within `max_m`; 0: it is inside one.

    Sectors as scan.nearest_m. `boxes`: each with its top's height, up. They reach as far down as the ground does.
    """
    out = np.full(SECTORS, math.inf)
    rays = _AHEAD @ _axes_ned(attitude_rad)
    for box, top_up_m in boxes:
        x, y = box.local(eye_ned_m[1], eye_ned_m[0])
        way_x, way_y = rays[:, 1] * box.cos - rays[:, 0] * box.sin, rays[:, 1] * box.sin + rays[:, 0] * box.cos
        enters, leaves = np.zeros(RAYS), np.full(RAYS, math.inf)
        for start, way, low, high in (
            (x, way_x, -box.along_m, box.along_m),
            (y, way_y, -box.across_m, box.across_m),
            (-eye_ned_m[2], -rays[:, 2], -math.inf, top_up_m),
        ):
            first, last = within(start, way, low, high)
            enters, leaves = np.maximum(enters, first), np.minimum(leaves, last)
        hits = np.where((enters < leaves) & (enters <= max_m), enters, math.inf)
        out = np.minimum(out, hits.reshape(SECTORS, RAYS_PER_SECTOR).min(axis=1))
    return out


def within(start: float | Floats, way: Floats, low: float, high: float) -> tuple[Floats, Floats]:
    """Distances along each ray at which it comes between two faces, and leaves them again."""
    along = np.abs(way) < LEAST
    step = np.where(along, 1.0, way)
    one, other = (low - start) / step, (high - start) / step
    inside = (low < start) & (start < high)
    first = np.where(along, np.where(inside, -math.inf, math.inf), np.minimum(one, other))
    last = np.where(along, np.where(inside, math.inf, -math.inf), np.maximum(one, other))
    return first, last


def _axes_ned(attitude_rad: Vec3) -> Floats:
    """(2, 3): the airframe's axes ahead and to the right, NED."""
    roll, pitch, yaw = attitude_rad
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    sy, cy = math.sin(yaw), math.cos(yaw)
    ahead = (cp * cy, cp * sy, -sp)
    right = (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp)
    return np.array([ahead, right])
