"""Frames: the mission's ENU metres (as in the paper), NED, and WGS84. The only place that converts.

A `LocalFrame` is the plane tangent to the WGS84 ellipsoid at the mission's origin, scaled with the two radii
of curvature there. Everyone who shares the origin shares the plane exactly, and it departs from the true
local tangent frame by less than 2 cm within 300 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

Vec3 = tuple[float, float, float]

SEMI_MAJOR_AXIS_M = 6378137.0  # WGS84
ECCENTRICITY_SQUARED = 6.69437999014e-3  # WGS84


@dataclass(slots=True, init=False, unsafe_hash=True)
class Wgs84:
    """A point: geodetic latitude and longitude in degrees, altitude above mean sea level in metres."""

    lat_deg: Final[float]
    lon_deg: Final[float]
    alt_m: Final[float]

    def __init__(self, lat_deg: float, lon_deg: float, alt_m: float) -> None:
        self.lat_deg = lat_deg
        self.lon_deg = lon_deg
        self.alt_m = alt_m


def enu_to_ned(enu: Vec3) -> Vec3:
    """East-north-up to north-east-down; its own inverse up to naming."""
    return (enu[1], enu[0], -enu[2])


def ned_to_enu(ned: Vec3) -> Vec3:
    """North-east-down to east-north-up."""
    return (ned[1], ned[0], -ned[2])


class LocalFrame:
    """NED metres about `origin`, to and from WGS84."""

    __slots__ = ("_east_m_per_rad", "_north_m_per_rad", "origin")

    def __init__(self, origin: Wgs84) -> None:
        self.origin = origin
        lat_rad = math.radians(origin.lat_deg)
        w = 1.0 - ECCENTRICITY_SQUARED * math.sin(lat_rad) ** 2
        meridian_m = SEMI_MAJOR_AXIS_M * (1.0 - ECCENTRICITY_SQUARED) / w**1.5
        prime_vertical_m = SEMI_MAJOR_AXIS_M / math.sqrt(w)
        self._north_m_per_rad = meridian_m + origin.alt_m
        self._east_m_per_rad = (prime_vertical_m + origin.alt_m) * math.cos(lat_rad)

    def to_wgs84(self, pos_ned_m: Vec3) -> Wgs84:
        """NED metres from the origin -> WGS84."""
        return Wgs84(
            self.origin.lat_deg + math.degrees(pos_ned_m[0] / self._north_m_per_rad),
            self.origin.lon_deg + math.degrees(pos_ned_m[1] / self._east_m_per_rad),
            self.origin.alt_m - pos_ned_m[2],
        )

    def to_ned(self, point: Wgs84) -> Vec3:
        """WGS84 -> NED metres from the origin."""
        return (
            math.radians(point.lat_deg - self.origin.lat_deg) * self._north_m_per_rad,
            math.radians(math.remainder(point.lon_deg - self.origin.lon_deg, 360.0)) * self._east_m_per_rad,
            self.origin.alt_m - point.alt_m,
        )
