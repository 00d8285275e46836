"""The geometry of one turn of a 2-D lidar: what 720 rays meet, and the nearest of them in each of 72 sectors.

The lidar turns in the airframe's plane: rolled or pitched, its rays leave the level, see the ground or pass over a
bush. Whatever stands is an upright cylinder; the ground is a plane.

A turn is 720 rays, 0.5 degrees apart (7,200 samples a second at 10 Hz; an RPLIDAR A2 takes 8,000). A driver that has
more rays than the 72 sectors of OBSTACLE_DISTANCE keeps the shortest of each sector's, as mavros does
(mavros_extras, obstacle_distance.cpp). So does this one, with ten rays a sector: a trunk 0.1 m thick is 0.7 degrees
wide at 8 m, more than the step between two rays, and is never missed between them. Occlusion needs no care of its own:
the shortest of the shortest hides all that stands behind it on the same ray.

Nothing is cast ray by ray. For each cylinder the rays that meet it are those between its two tangents, and of a
sector's rays the one nearest to the axis is the shortest: one intersection for each cylinder and sector that it is in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from mission.common.frames import Vec3

SECTORS: Final = 72  # of OBSTACLE_DISTANCE
STEP_RAD: Final = math.tau / SECTORS
RAYS_PER_SECTOR: Final = 10
RAYS: Final = SECTORS * RAYS_PER_SECTOR
RAY_STEP_RAD: Final = STEP_RAD / RAYS_PER_SECTOR
FIRST_RAY: Final = -(RAYS_PER_SECTOR - 1) / 2.0  # sector 0 is centred ahead, as ArduPilot and PX4 read the message
UPRIGHT_MIN: Final = 0.2  # cosine of the tilt: a lidar that lies on its side has no turn to speak of

_COS: Final = [math.cos((FIRST_RAY + ray) * RAY_STEP_RAD) for ray in range(RAYS)]
_SIN: Final = [math.sin((FIRST_RAY + ray) * RAY_STEP_RAD) for ray in range(RAYS)]

# Of an upright cylinder: north and east of its axis, radius, lower and upper end; metres about the origin, up positive
Cylinder = tuple[float, float, float, float, float]
Plane = tuple[float, float, float]  # the ground below the lidar, metres up; its rise to the north and to the east


def nearest_m(
    eye_ned_m: Vec3, attitude_rad: Vec3, cylinders: Iterable[Cylinder], ground: Plane | None, max_m: float
) -> list[float]:
    """Nearest range in each sector, along the ray, in metres; inf: nothing within `max_m`; nan: no turn (see below).

    Sectors clockwise from ahead, sector 0 centred ahead, in the airframe's plane. `attitude_rad`: roll, pitch, yaw.
    All sectors are nan when the airframe is tilted by more than 78 degrees, and 0 when the lidar is inside a cylinder.
    """
    out = [math.inf] * SECTORS
    north_m, east_m, down_m = eye_ned_m
    roll, pitch, yaw = attitude_rad
    sr, cr, sp, cp, sy, cy = (
        math.sin(roll),
        math.cos(roll),
        math.sin(pitch),
        math.cos(pitch),
        math.sin(yaw),
        math.cos(yaw),
    )
    # The airframe's axes ahead (x), to the right (y) and below (z), in NED
    xn, xe, xd = cp * cy, cp * sy, -sp
    yn, ye, yd = sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp
    zn, ze, zd = cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp
    if zd < UPRIGHT_MIN:
        return [math.nan] * SECTORS
    tilt = math.hypot(zn, ze) / zd  # how far the steepest ray rises or falls in a metre, level
    slope_n, slope_e = -zn / zd, -ze / zd  # how far the plane falls in a metre to the north, to the east
    up_m = -down_m
    for axis_n, axis_e, radius_m, low_m, high_m in cylinders:
        to_n, to_e = axis_n - north_m, axis_e - east_m
        away2 = to_n * to_n + to_e * to_e
        reach_m = max_m + radius_m
        if away2 >= reach_m * reach_m:
            continue
        away_m = math.sqrt(away2)
        spread_m = (away_m + radius_m) * tilt
        room2 = away2 - radius_m * radius_m
        if up_m + spread_m <= low_m or up_m - spread_m >= high_m:
            continue
        if room2 <= 0.0:
            if low_m < up_m < high_m:
                return [0.0] * SECTORS
            first, last, at, whole = 0, RAYS - 1, 0, False  # below a crown, or above a bush: any ray may meet its end
        else:
            # The level directions to the axis and to both tangents, and the rays of the tilted plane above or below
            un, ue = to_n / away_m, to_e / away_m
            sine, cosine = radius_m / away_m, math.sqrt(room2) / away_m
            ln, le = un * cosine + ue * sine, ue * cosine - un * sine
            rn, re = un * cosine - ue * sine, ue * cosine + un * sine
            down = ln * slope_n + le * slope_e
            left = math.atan2(ln * yn + le * ye + down * yd, ln * xn + le * xe + down * xd)
            down = un * slope_n + ue * slope_e
            middle = math.atan2(un * yn + ue * ye + down * yd, un * xn + ue * xe + down * xd)
            down = rn * slope_n + re * slope_e
            right = math.atan2(rn * yn + re * ye + down * yd, rn * xn + re * xe + down * xd)
            if middle < left:
                middle += math.tau
            if right < left:
                right += math.tau
            first = math.ceil(left / RAY_STEP_RAD - FIRST_RAY)
            last = math.floor(right / RAY_STEP_RAD - FIRST_RAY)
            at = round(middle / RAY_STEP_RAD - FIRST_RAY)
            whole = low_m <= up_m - spread_m and up_m + spread_m <= high_m  # every ray passes between its ends
        ends_m = (low_m - up_m, high_m - up_m)
        _see_cylinder(out, (xn, xe, xd), (yn, ye, yd), to_n, to_e, room2, ends_m, first, last, at, whole, max_m)
    if ground is not None:
        height_m = up_m - ground[0]
        rise_n, rise_e = ground[1], ground[2]
        # A ray meets the ground after height / (a cos + b sin) metres
        a, b = rise_n * xn + rise_e * xe + xd, rise_n * yn + rise_e * ye + yd
        _see_ground(out, height_m, a, b, max_m)
    return out


def _see_cylinder(
    out: list[float],
    x: Vec3,
    y: Vec3,
    to_n: float,
    to_e: float,
    room2: float,
    ends_m: tuple[float, float],
    first: int,
    last: int,
    at: int,
    whole: bool,
    max_m: float,
) -> None:
    """A cylinder into `out`, by the rays `first` to `last`, of which `at` is the nearest to its axis.

    `x`, `y`: the lidar's axes, NED; `to_n`, `to_e`: its axis, level, `room2` the square of the way to its tangents;
    `ends_m`: above the lidar; `whole`: every ray passes between these.
    """
    xn, xe, xd = x
    yn, ye, yd = y
    ray = first
    while ray <= last:
        sector = ray // RAYS_PER_SECTOR
        end = (sector + 1) * RAYS_PER_SECTOR - 1
        if end > last:
            end = last
        if whole:  # the ray nearest to the axis is the sector's shortest
            if at > ray:
                ray = at if at < end else end
            cos, sin = _COS[ray % RAYS], _SIN[ray % RAYS]
            dn, de = cos * xn + sin * yn, cos * xe + sin * ye
            level2 = dn * dn + de * de
            along = dn * to_n + de * to_e
            clear = along * along - level2 * room2
            range_m = (along - math.sqrt(clear)) / level2 if clear > 0.0 else along / level2
        else:
            range_m = math.inf
            for each in range(ray, end + 1):
                cos, sin = _COS[each % RAYS], _SIN[each % RAYS]
                dn, de, dd = cos * xn + sin * yn, cos * xe + sin * ye, cos * xd + sin * yd
                hit_m = _entered_m(dn, de, -dd, to_n, to_e, room2, ends_m[0], ends_m[1])
                if hit_m < range_m:
                    range_m = hit_m
        sector %= SECTORS
        if range_m <= max_m and range_m < out[sector]:
            out[sector] = range_m
        ray = end + 1


def _entered_m(
    dn: float, de: float, du: float, to_n: float, to_e: float, room2: float, low_m: float, high_m: float
) -> float:
    """Distance along a ray (unit vector, `du` up) to a cylinder whose ends are `low_m` and `high_m` above the
    lidar; inf: it passes."""
    level2 = dn * dn + de * de
    along = dn * to_n + de * to_e
    clear = along * along - level2 * room2
    if clear <= 0.0:
        return math.inf
    half = math.sqrt(clear)
    enters, leaves = (along - half) / level2, (along + half) / level2
    if du == 0.0:
        return enters if low_m < 0.0 < high_m else math.inf
    at_low, at_high = low_m / du, high_m / du
    if at_low > at_high:
        at_low, at_high = at_high, at_low
    if at_low > enters:
        enters = at_low
    if at_high < leaves:
        leaves = at_high
    return enters if 0.0 <= enters < leaves else math.inf


def _see_ground(out: list[float], height_m: float, a: float, b: float, max_m: float) -> None:
    """The ground, `height_m` below the lidar, into `out`: a ray at the angle x falls a cos x + b sin x towards it a
    metre."""
    steepest = math.hypot(a, b)
    if height_m <= 0.0 or steepest * max_m <= height_m:
        return
    lowest, half = math.atan2(b, a), math.acos(height_m / (steepest * max_m))
    at = round(lowest / RAY_STEP_RAD - FIRST_RAY)
    ray = math.ceil((lowest - half) / RAY_STEP_RAD - FIRST_RAY)
    last = math.floor((lowest + half) / RAY_STEP_RAD - FIRST_RAY)
    while ray <= last:
        sector = ray // RAYS_PER_SECTOR
        end = min((sector + 1) * RAYS_PER_SECTOR - 1, last)
        shortest = min(max(at, ray), end) % RAYS
        range_m = height_m / (a * _COS[shortest] + b * _SIN[shortest])
        sector %= SECTORS
        if range_m <= max_m and range_m < out[sector]:
            out[sector] = range_m
        ray = end + 1
