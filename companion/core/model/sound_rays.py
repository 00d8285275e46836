"""Whether a piece of a lidar's raw scan can be: the one place at which what any sensor makes up is dropped.

What comes as SWARM_LIDAR_SCAN is within these bounds already; sensors of installed packages tell events of their own.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.events import LidarScan

REACH_MAX_M: Final = 1_000.0
AGE_MAX_S: Final = 60.0
RAY_TIME_MAX_S: Final = 0.1
ANGLE_MAX_RAD: Final = 1_000.0  # of a yaw that turned on and on
STEP_MIN_RAD: Final = math.radians(0.009)  # no lidar is finer
STEP_MAX_RAD: Final = math.radians(31.0)
SLACK: Final = 1e-6


def can_be(scan: LidarScan) -> bool:
    """All of its numbers are finite and within what a lidar on a vehicle may tell."""
    if not (0.0 <= scan.min_m <= scan.max_m <= REACH_MAX_M and scan.max_m > 0.0):  # all false for NaN
        return False
    if not (abs(scan.age_s) <= AGE_MAX_S and 0.0 <= scan.ray_time_s <= RAY_TIME_MAX_S):
        return False
    if not (abs(scan.start_rad) <= math.tau + SLACK and abs(scan.elevation_rad) <= math.pi / 2.0 + SLACK):
        return False
    count, step_rad = len(scan.ranges_m), abs(scan.step_rad)
    if count == 0 or (count > 1 and not (step_rad >= STEP_MIN_RAD and (count - 1) * step_rad <= math.tau + SLACK)):
        return False
    if not step_rad <= max(STEP_MAX_RAD, math.tau / count + SLACK):
        return False
    for angle_rad in (*scan.first_attitude_rad, *scan.last_attitude_rad):
        if not abs(angle_rad) <= ANGLE_MAX_RAD:
            return False
    for range_m in scan.ranges_m:  # noqa: SIM110 - a generator is slow where it is compiled
        if range_m < 0.0:
            return False
    return True
