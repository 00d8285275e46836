"""UTM eastings and northings to and from WGS84: the zones that stem maps are handed over in.

The transverse Mercator projection by Krüger's series to the fourth order of the third flattening (Karney 2011,
"Transverse Mercator with an accuracy of a few nanometers", Journal of Geodesy 85, 475-485, equations 7 to 36): better
than 1 mm anywhere near its zone.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from mission.common.frames import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS_M

SCALE = 0.9996
FALSE_EASTING_M = 500_000.0
FALSE_NORTHING_M = 10_000_000.0  # on the southern half

_ZONE = re.compile(r"(?:UTM[ _]?(?:zone[ _]?)?)?(\d{1,2})[ _]?([NS])", re.IGNORECASE)
_EPSG = re.compile(r"(?:EPSG:{1,2})?(326|327|258)(\d\d)", re.IGNORECASE)  # WGS84 north, south; ETRS89

_E = math.sqrt(ECCENTRICITY_SQUARED)
_F = 1.0 - math.sqrt(1.0 - ECCENTRICITY_SQUARED)
_N = _F / (2.0 - _F)
_RADIUS_M = SEMI_MAJOR_AXIS_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_BETA = (
    _N / 2.0 - 2.0 * _N**2 / 3.0 + 37.0 * _N**3 / 96.0 - _N**4 / 360.0,
    _N**2 / 48.0 + _N**3 / 15.0 - 437.0 * _N**4 / 1440.0,
    17.0 * _N**3 / 480.0 - 37.0 * _N**4 / 840.0,
    4397.0 * _N**4 / 161280.0,
)
_ALPHA = (
    _N / 2.0 - 2.0 * _N**2 / 3.0 + 5.0 * _N**3 / 16.0 + 41.0 * _N**4 / 180.0,
    13.0 * _N**2 / 48.0 - 3.0 * _N**3 / 5.0 + 557.0 * _N**4 / 1440.0,
    61.0 * _N**3 / 240.0 - 103.0 * _N**4 / 140.0,
    49561.0 * _N**4 / 161280.0,
)


_NATIONAL = {"3006": 33, "3067": 35}  # SWEREF99 TM, ETRS-TM35FIN: a zone each, used beyond its edges


@dataclass(frozen=True, slots=True)
class Zone:
    """One of the 120 halves of zones."""

    number: int
    south: bool

    def __str__(self) -> str:
        return f"UTM {self.number}{'S' if self.south else 'N'}"

    @property
    def epsg(self) -> int:
        """Its code, on WGS84."""
        return (32700 if self.south else 32600) + self.number


def zone_of(text: str) -> Zone | None:
    """`32N`, `UTM 32N`, `EPSG:32632`, `EPSG:25832` (ETRS89: within 1 m of WGS84, the same for all trees), or None."""
    named = _ZONE.fullmatch(text.strip())
    if named:
        number, south = int(named[1]), named[2] in "sS"
    else:
        coded = _EPSG.fullmatch(text.strip())
        if not coded:
            national = _NATIONAL.get(text.strip().upper().removeprefix("EPSG:"))
            return None if national is None else Zone(national, south=False)
        number, south = int(coded[2]), coded[1] == "327"
    return Zone(number, south) if 1 <= number <= 60 else None


def to_wgs84(east_m: float, north_m: float, zone: Zone) -> tuple[float, float]:
    """Latitude and longitude, degrees, of a point of `zone`."""
    xi = (north_m - (FALSE_NORTHING_M if zone.south else 0.0)) / (SCALE * _RADIUS_M)
    eta = (east_m - FALSE_EASTING_M) / (SCALE * _RADIUS_M)
    xi_sphere, eta_sphere = xi, eta
    for k, beta in enumerate(_BETA, start=1):
        xi_sphere -= beta * math.sin(2 * k * xi) * math.cosh(2 * k * eta)
        eta_sphere -= beta * math.cos(2 * k * xi) * math.sinh(2 * k * eta)
    lon_rad = math.atan2(math.sinh(eta_sphere), math.cos(xi_sphere))
    tangent = _geodetic_tangent(math.sin(xi_sphere) / math.hypot(math.sinh(eta_sphere), math.cos(xi_sphere)))
    lon_deg = math.degrees(lon_rad) + 6.0 * zone.number - 183.0
    return math.degrees(math.atan(tangent)), math.remainder(lon_deg, 360.0)


def zone_at(lat_deg: float, lon_deg: float) -> Zone:
    """The zone of a place, by its longitude alone (Norway and Svalbard have exceptions)."""
    return Zone(int((math.remainder(lon_deg, 360.0) + 180.0) // 6.0) % 60 + 1, lat_deg < 0.0)


def from_wgs84(lat_deg: float, lon_deg: float, zone: Zone) -> tuple[float, float]:
    """Easting and northing in `zone`, m, of a point given in degrees."""
    tangent = math.tan(math.radians(lat_deg))
    lon_rad = math.radians(math.remainder(lon_deg - (6.0 * zone.number - 183.0), 360.0))
    root = math.hypot(1.0, tangent)
    sigma = math.sinh(_E * math.atanh(_E * tangent / root))
    conformal = tangent * math.hypot(1.0, sigma) - sigma * root
    xi_sphere = math.atan2(conformal, math.cos(lon_rad))
    eta_sphere = math.asinh(math.sin(lon_rad) / math.hypot(conformal, math.cos(lon_rad)))
    xi, eta = xi_sphere, eta_sphere
    for k, alpha in enumerate(_ALPHA, start=1):
        xi += alpha * math.sin(2 * k * xi_sphere) * math.cosh(2 * k * eta_sphere)
        eta += alpha * math.cos(2 * k * xi_sphere) * math.sinh(2 * k * eta_sphere)
    false_northing_m = FALSE_NORTHING_M if zone.south else 0.0
    return FALSE_EASTING_M + SCALE * _RADIUS_M * eta, false_northing_m + SCALE * _RADIUS_M * xi


def _geodetic_tangent(conformal: float) -> float:
    """The tangent of the geodetic latitude from that of the conformal one; Newton's method, equations 19 to 21."""
    tangent = conformal / (1.0 - ECCENTRICITY_SQUARED)
    for _ in range(5):  # two are enough
        root = math.hypot(1.0, tangent)
        sigma = math.sinh(_E * math.atanh(_E * tangent / root))
        found = tangent * math.hypot(1.0, sigma) - sigma * root
        slope = (1.0 - ECCENTRICITY_SQUARED) / (1.0 + (1.0 - ECCENTRICITY_SQUARED) * tangent**2)
        tangent += (conformal - found) / math.hypot(1.0, found) / (root * slope)
    return tangent
