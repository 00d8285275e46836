"""True state of a vehicle, reported by its simulator past the autopilot's estimates.

PX4's SIH says it in HIL_STATE_QUATERNION, ArduPilot's SITL in SIM_STATE and SIMSTATE. Hardware says neither.
SIMSTATE has neither height nor velocity: those are then the estimate's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from companion.mavlink import dialect
from mission.common.frames import Vec3, Wgs84

TRUTH_HZ: Final = 50.0  # a vehicle at 3 m/s has moved by 6 cm until the next
# MAV_AUTOPILOT of its heartbeat -> what an autopilot is asked for.
TRUTH_STREAMS: Final[Mapping[int, tuple[int, ...]]] = MappingProxyType(
    {
        dialect.MAV_AUTOPILOT_PX4: (dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,),
        dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: (dialect.MAVLINK_MSG_ID_SIM_STATE, dialect.MAVLINK_MSG_ID_SIMSTATE),
    }
)
TRUTH_IDS: Final = frozenset(id_ for ids in TRUTH_STREAMS.values() for id_ in ids)


@dataclass(frozen=True, slots=True)
class Truth:
    """True position, velocity and attitude of a vehicle, by its simulator."""

    position: Wgs84
    vel_ned_mps: Vec3
    attitude_rad: Vec3  # roll, pitch, yaw
    rates_radps: Vec3 = (0.0, 0.0, 0.0)  # body p, q, r
    has_height: bool = True  # False: height and velocity are the autopilot's estimates


def position_of(lat_e7: int, lon_e7: int, alt_m: float) -> Wgs84 | None:
    """From 1e-7 degrees; ArduPilot sends zeros until it knows."""
    if (lat_e7, lon_e7) == (0, 0) or abs(lat_e7) > 900_000_000 or abs(lon_e7) > 1_800_000_000:
        return None
    return Wgs84(lat_e7 / 1e7, lon_e7 / 1e7, alt_m) if math.isfinite(alt_m) else None


def truth_of(m: Any, before: Truth | None, estimated: Wgs84 | None, vel_ned_mps: Vec3) -> Truth | None:
    """The truth in message `m` (of TRUTH_IDS), or `before` where it tells nothing.

    `estimated`, `vel_ned_mps`: by the autopilot, for what SIMSTATE lacks. One that has told a height is not asked to do
    without.
    """
    match m.get_msgId():
        case dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
            position, vel = position_of(m.lat, m.lon, m.alt / 1e3), (m.vx / 100.0, m.vy / 100.0, m.vz / 100.0)
            attitude, rates = _attitude_rad(m.attitude_quaternion), rates_of(m.rollspeed, m.pitchspeed, m.yawspeed)
        case dialect.MAVLINK_MSG_ID_SIM_STATE:
            # Without the extensions (old firmware) its degrees are floats, up to 0.8 m off: not taken.
            position, vel = position_of(m.lat_int, m.lon_int, m.alt), (m.vn, m.ve, m.vd)
            attitude, rates = (m.roll, m.pitch, m.yaw), rates_of(m.xgyro, m.ygyro, m.zgyro)
        case dialect.MAVLINK_MSG_ID_SIMSTATE if estimated is not None and not (before and before.has_height):
            position, vel = position_of(m.lat, m.lng, estimated.alt_m), vel_ned_mps
            attitude, rates = (m.roll, m.pitch, m.yaw), rates_of(m.xgyro, m.ygyro, m.zgyro)
        case _:
            return before
    if position is None or attitude is None or not all(map(math.isfinite, (*vel, *attitude))):
        return before
    return Truth(position, vel, attitude, rates, m.get_msgId() != dialect.MAVLINK_MSG_ID_SIMSTATE)


def rates_of(p: float, q: float, r: float) -> Vec3:
    """Body rates, rad/s, of a message; none where it has none."""
    return (p, q, r) if math.isfinite(p + q + r) else (0.0, 0.0, 0.0)


def _attitude_rad(wxyz: Sequence[float]) -> Vec3 | None:
    """Roll, pitch, yaw of a quaternion; None where it is none."""
    w, x, y, z = wxyz
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < size < 1.1:  # NaN too
        return None
    w, x, y, z = w / size, x / size, y / size, z / size
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def told_by(ids: Collection[int], truths: Mapping[int, Truth]) -> str:
    """Names, for a flight's verdict, what rests on estimates; empty: nothing. `truths`: of those that tell."""
    without = [k for k in ids if k not in truths]
    level = [k for k in ids if k in truths and not truths[k].has_height]
    parts = []
    if without:
        parts.append("by estimates" + _of(without, ids))
    if level:
        parts.append("heights by estimates" + _of(level, ids))
    return ", ".join(parts)


def _of(some: Collection[int], ids: Collection[int]) -> str:
    return "" if len(some) == len(ids) else f" of {', '.join(map(str, some))}"
