"""Axes of MAVLink (north-east-down, front-right-down) turned to those of ROS and Foxglove (REP 103): east-north-up
about the mission's origin, front-left-up about a vehicle."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.judge.metrics.arrays import Floats


def to_enu(ned: Floats) -> Floats:
    """(..., 3) north, east, down -> east, north, up."""
    enu: Floats = ned[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    return enu


def quaternions_enu(attitude_rad: Floats) -> Floats:
    """(T, 3) roll, pitch, yaw, front-right-down in NED -> (T, 4) x, y, z, w of front-left-up in ENU."""
    roll, pitch, yaw = attitude_rad.T / 2.0
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(-pitch), np.sin(-pitch)
    cy, sy = np.cos(math.pi / 4.0 - yaw), np.sin(math.pi / 4.0 - yaw)
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def to_flu(enu: Floats, quaternions: Floats) -> Floats:
    """(T, 3) vectors east, north, up -> as a vehicle of (T, 4) `quaternions` x, y, z, w has them: front, left, up."""
    axis, w = -quaternions[:, :3], quaternions[:, 3:]  # the other way about
    twice = 2.0 * np.cross(axis, enu)
    flu: Floats = enu + w * twice + np.cross(axis, twice)
    return flu
