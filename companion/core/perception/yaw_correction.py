"""Scans as they would be of a vehicle whose yaw is reported right: placed by them, what is seen stands where it is."""

from __future__ import annotations

from companion.core.model.events import LidarScan, ObstacleScan


def turned_sectors(scan: ObstacleScan, turn_rad: float) -> ObstacleScan:
    """The same scan of a vehicle whose yaw is more by so much."""
    return ObstacleScan(
        scan.sensor,
        scan.ranges_m,
        scan.start_rad,
        scan.step_rad,
        scan.min_m,
        scan.max_m,
        scan.roll_rad,
        scan.pitch_rad,
        scan.yaw_rad + turn_rad,
        scan.age_s,
    )


def turned_rays(scan: LidarScan, turn_rad: float) -> LidarScan:
    """The same piece of a vehicle whose yaw is more by so much."""
    first, last = scan.first_attitude_rad, scan.last_attitude_rad
    return LidarScan(
        scan.sensor,
        scan.turn,
        scan.ranges_m,
        scan.elevation_rad,
        scan.start_rad,
        scan.step_rad,
        scan.min_m,
        scan.max_m,
        scan.age_s,
        scan.ray_time_s,
        (first[0], first[1], first[2] + turn_rad),
        (last[0], last[1], last[2] + turn_rad),
    )
