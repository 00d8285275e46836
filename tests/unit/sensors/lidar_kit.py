"""Pieces of raw scans for the tests: as messages, and as events."""

from __future__ import annotations

import math
from typing import Any

from companion.core.model.events import LidarScan
from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, encode_lidar_scan
from mission.common.frames import Vec3

LEVEL = (0.0, 0.0, 0.0)


def payload(**changes: Any) -> bytes:
    """90 rays of a degree from ahead on, each 3 m, 25 ms in all."""
    fields: dict[str, Any] = {
        "time_us": 1_000_000,
        "ray_time_s": 0.1 / 360,
        "first_bearing_deg": 0.0,
        "bearing_step_deg": 1.0,
        "elevation_deg": 0.0,
        "min_m": 0.2,
        "max_m": 12.0,
        "turn": 1,
        "ranges_mm": [3000] * 90,
    }
    return encode_lidar_scan(**fields | changes)


def frame(*, system: int = 3, component: int = 196, **changes: Any) -> bytes:
    return wire.frame(LIDAR_SCAN_ID, payload(**changes), seq=0, system=system, component=component)


def message(**changes: Any) -> Any:
    """As a receiver has it."""
    return wire.fields(frame(**changes))


def attitude(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Any:
    return dialect.MAVLink_attitude_message(0, roll, pitch, yaw, 0.0, 0.0, 0.0)


def scan(ranges_m: tuple[float, ...], **changes: Any) -> LidarScan:
    """A whole turn that ends now, of a vehicle that stands level, looking north."""
    count = max(1, len(ranges_m))
    first: Vec3 = changes.pop("first_attitude_rad", LEVEL)
    fields: dict[str, Any] = {
        "sensor": 196,
        "turn": 1,
        "ranges_m": ranges_m,
        "elevation_rad": 0.0,
        "start_rad": 0.0,
        "step_rad": math.tau / count,
        "min_m": 0.2,
        "max_m": 12.0,
        "age_s": 0.1,
        "ray_time_s": 0.1 / count,
        "first_attitude_rad": first,
        "last_attitude_rad": first,
    }
    return LidarScan(**fields | changes)
