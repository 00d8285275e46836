"""Returns of a lidar -> scans of 72 sectors, and the message that carries one: OBSTACLE_DISTANCE (MAVLink, 330)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from companion.lidar.driver import Return
from companion.lidar.mounting import SECTOR_DEG, SECTORS, Mounting
from companion.mavlink import dialect

SCAN_MAX_S: Final = 0.5  # a lidar at 2 Hz; what took longer has a gap in it, and shows a past
UNKNOWN_CM: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Limits:
    """Of a lidar: what it measures, and which of that is an obstacle at the vehicle's height."""

    min_m: float
    max_m: float
    period_s: float | None = None  # of a scan; None: a revolution, however long
    band_m: tuple[float, float] = (-math.inf, math.inf)  # above the lidar's plane, as the vehicle stands


class SectorScan:
    """Collects returns: a scan, in cm for each sector, is the nearest valid return of each.

    max_m + 1 cm: pulses went there, and none came back from within max_m. UINT16_MAX, unknown: no pulse is known to
    have gone there, or some came back from closer than min_m (dirt, the airframe), or the sector is masked.
    """

    def __init__(self, limits: Limits, mounting: Mounting) -> None:
        self._limits = limits
        self._mask = mounting.mask
        self._sectors = mounting.sectors()
        self._band_m = mounting.band_m(*limits.band_m)
        self._began_s: float | None = None
        self._nearest_m = [math.inf] * SECTORS
        self._is_seen = [False] * SECTORS
        self._is_blocked = [False] * SECTORS

    def update(self, returns: Iterable[Return], now_s: float) -> list[list[int]]:
        """Scans that these complete. `now_s`: when they were read, monotonic."""
        scans: list[list[int]] = []
        period_s = self._limits.period_s
        if period_s is not None and self._began_s is not None and now_s - self._began_s >= period_s:
            self._complete(scans, now_s)
        low_m, high_m = self._band_m
        min_m, sectors, nearest_m = self._limits.min_m, self._sectors, self._nearest_m
        for azimuth_cdeg, range_m, up_m, starts in returns:
            if starts or self._began_s is None:
                self._complete(scans, now_s)
            at = sectors[azimuth_cdeg]
            if not low_m <= up_m <= high_m:  # but the lidar looks there
                self._is_seen[at] = True
            elif range_m >= min_m:
                if range_m < nearest_m[at]:
                    nearest_m[at] = range_m
            elif range_m > 0.0:
                self._is_blocked[at] = True
            else:
                self._is_seen[at] = True
        return scans

    def _complete(self, scans: list[list[int]], now_s: float) -> None:
        """Begin a scan; the one before is whole, if there is one."""
        if self._began_s is not None and now_s - self._began_s <= SCAN_MAX_S:
            scans.append(self._scan_cm())
        self._began_s = now_s
        self._nearest_m[:] = [math.inf] * SECTORS
        self._is_seen[:] = self._is_blocked[:] = [False] * SECTORS

    def _scan_cm(self) -> list[int]:
        return [self._sector_cm(at) for at in range(SECTORS)]

    def _sector_cm(self, at: int) -> int:
        max_m = self._limits.max_m
        if at in self._mask:
            return UNKNOWN_CM
        if self._nearest_m[at] <= max_m:
            return round(self._nearest_m[at] * 100.0)
        if self._is_blocked[at] or not (self._is_seen[at] or self._nearest_m[at] < math.inf):
            return UNKNOWN_CM
        return round(max_m * 100.0) + 1


def obstacle_distance(
    scan_cm: Sequence[int], limits: Limits, now_s: float
) -> dialect.MAVLink_obstacle_distance_message:
    """The message of a scan. Its time is that of the local clock when the scan was complete."""
    return dialect.MAVLink_obstacle_distance_message(
        time_usec=round(now_s * 1e6),
        sensor_type=dialect.MAV_DISTANCE_SENSOR_LASER,
        distances=list(scan_cm),
        increment=round(SECTOR_DEG),
        min_distance=round(limits.min_m * 100.0),
        max_distance=round(limits.max_m * 100.0),
        increment_f=SECTOR_DEG,
        angle_offset=0.0,
        frame=dialect.MAV_FRAME_BODY_FRD,
    )
