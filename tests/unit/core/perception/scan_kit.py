"""Level scans of round stems, as a sensor on a vehicle that stands level would make them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.core.model.events import ObstacleScan
from companion.core.perception.level_scan import LevelScan, ScanClass
from mission.schema.kinds import SensorClass

Stem = tuple[float, float, float]  # north, east, radius
FINE = ScanClass(SensorClass.SCAN_1DEG)
SECTORS = ScanClass(SensorClass.SECTORS)


def range_to(stems: Sequence[Stem], eye: tuple[float, float], bearing_rad: float, max_m: float) -> float:
    """The nearest of them along a ray; inf: none."""
    nearest_m = math.inf
    way_n, way_e = math.cos(bearing_rad), math.sin(bearing_rad)
    for north, east, radius in stems:
        n, e = north - eye[0], east - eye[1]
        along, aside = n * way_n + e * way_e, abs(e * way_n - n * way_e)
        if aside < radius and along > 0.0:
            nearest_m = min(nearest_m, along - math.sqrt(radius * radius - aside * aside))
    return nearest_m if nearest_m <= max_m else math.inf


def ring(count: int, away_m: float, radius_m: float = 0.1) -> list[Stem]:
    """Stems at equal distances round the origin, the first of them north of it."""
    step = math.tau / count
    return [(away_m * math.cos(k * step), away_m * math.sin(k * step), radius_m) for k in range(count)]


def level_scan(
    stems: Sequence[Stem],
    eye: tuple[float, float] = (0.0, 0.0),
    *,
    turned_rad: float = 0.0,
    rays: int = 360,
    gone_m: tuple[float, float] = (0.0, 0.0),
    max_m: float = 12.0,
) -> LevelScan:
    """One turn that ends at a place. `turned_rad`: by which its reported yaw is too large; `gone_m`: meanwhile."""
    scan = LevelScan(math.tau / rays)
    for k in range(rays):
        bearing, left = k * math.tau / rays, (k + 1 - rays) / rays
        at = (eye[0] + left * gone_m[0], eye[1] + left * gone_m[1])
        scan.add_ray(bearing + turned_rad, range_to(stems, at, bearing, max_m), *at)
    return scan


def sectors(stems: Sequence[Stem], eye: tuple[float, float], yaw_rad: float, off_rad: float = 0.0) -> ObstacleScan:
    """72 sectors of a vehicle that looks along `yaw_rad`, and reports `off_rad` more."""
    step = math.tau / 72
    ranges_m = tuple(
        min(range_to(stems, eye, yaw_rad + (k + j / 10.0 - 0.45) * step, 8.0) for j in range(10)) for k in range(72)
    )
    return ObstacleScan(196, ranges_m, 0.0, step, 0.2, 8.0, yaw_rad=yaw_rad + off_rad)
