"""SWARM_LIDAR_SCAN: a piece of a lidar's raw scan <-> its payload, for drivers, the simulator and the companion.

What arrives is believed within the bounds of its table (schema/tables/measurements.py); all else is None.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any, Final

from companion.mavlink import dialect
from companion.mavlink.schema.tables.measurements import LIDAR_SCAN, RAYS_MAX

LIDAR_SCAN_ID: Final = dialect.MAVLINK_MSG_ID_SWARM_LIDAR_SCAN
NOT_MEASURED_MM: Final = 0
# Not measured either, and no padding: of a piece's last ray, so that all of them are counted. No lidar measures 1 mm
LAST_NOT_MEASURED_MM: Final = 1
NOTHING_MM: Final = 0xFFFF
STEP_MIN_DEG: Final = 0.01  # no lidar is finer
# Of a level lidar's rays, so many are to be measured. An LD19 has 0.62 of those of half a degree, which is too few
RAYS_MIN_SHARE: Final = 0.67
_PAYLOAD: Final = Struct("<" + "".join(row.code for row in LIDAR_SCAN.on_wire))
_BOUNDS: Final = tuple((row.name, row.least, row.most) for row in LIDAR_SCAN.fields if row.is_checked)


@dataclass(frozen=True, slots=True)
class LidarPiece:
    """Rays of one layer in the order of their times, in the vehicle's own frame.

    Ray k looks at the bearing `first_bearing_deg + k * bearing_step_deg`, clockwise from ahead, and was measured
    `k * ray_time_s` after `time_us`, by the driver's clock.
    """

    time_us: int
    ray_time_s: float
    first_bearing_deg: float
    bearing_step_deg: float  # negative: counter-clockwise
    elevation_deg: float  # above the vehicle's level plane
    min_m: float
    max_m: float
    turn: int  # modulo 256
    ranges_m: tuple[float, ...]  # min_m..max_m; inf: nothing within max_m; nan: not measured, but for one of them


def encode_lidar_scan(
    *,
    time_us: int,
    ray_time_s: float,
    first_bearing_deg: float,
    bearing_step_deg: float,
    elevation_deg: float,
    min_m: float,
    max_m: float,
    turn: int,
    ranges_mm: Sequence[int],
) -> bytes:
    """The payload of a piece of at most RAYS_MAX rays. struct.error when a number does not fit its field."""
    told_mm = list(ranges_mm)
    if told_mm and told_mm[-1] == NOT_MEASURED_MM:
        told_mm[-1] = LAST_NOT_MEASURED_MM
    padding = [NOT_MEASURED_MM] * (RAYS_MAX - len(told_mm))
    return _PAYLOAD.pack(
        time_us,
        ray_time_s,
        first_bearing_deg,
        bearing_step_deg,
        elevation_deg,
        round(min_m * 100.0),
        round(max_m * 100.0),
        *told_mm,
        *padding,
        turn & 0xFF,
    )


def decode_lidar_scan(m: Any) -> LidarPiece | None:
    """A message, with its fields as attributes; None: it makes no sense, or no ray was measured."""
    for name, least, most in _BOUNDS:
        if not least <= getattr(m, name) <= most:  # false for NaN
            return None
    if abs(m.bearing_step) < STEP_MIN_DEG or m.near_cm > m.far_cm:
        return None
    ranges_mm = list(m.ranges_mm)
    while ranges_mm and ranges_mm[-1] == NOT_MEASURED_MM:
        ranges_mm.pop()
    if all([mm <= LAST_NOT_MEASURED_MM for mm in ranges_mm]) or (len(ranges_mm) - 1) * abs(m.bearing_step) > 360.0:
        return None  # a lidar that measures nothing at all is to fall silent, not to seem fresh
    near_m, far_m = m.near_cm / 100.0, m.far_cm / 100.0
    return LidarPiece(
        time_us=m.time_usec,
        ray_time_s=m.ray_time,
        first_bearing_deg=m.first_bearing,
        bearing_step_deg=m.bearing_step,
        elevation_deg=m.ray_elevation,
        min_m=near_m,
        max_m=far_m,
        turn=m.turn_number,
        ranges_m=tuple([_range_m(mm, near_m, far_m) for mm in ranges_mm]),
    )


def _range_m(mm: int, near_m: float, far_m: float) -> float:
    if mm <= LAST_NOT_MEASURED_MM:
        return math.nan
    range_m = mm / 1000.0
    if mm == NOTHING_MM or range_m > far_m:
        return math.inf
    return max(range_m, near_m)
