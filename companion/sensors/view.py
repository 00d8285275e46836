"""Nearest obstacle of each direction, for people: `companion doctor`, `companion lidar --check`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.core.perception.obstacle_map import BEARINGS, at_bearing
from companion.sensors.scans import UNKNOWN_CM

DIRECTIONS: Final = ("front", "front right", "right", "rear right", "rear", "rear left", "left", "front left")
# Heights above the sensor that count, in the vehicle's own frame: as `companion lidar` has it
BAND_M: Final = (-0.5, 0.5)


class View:
    """Nearest of each sector in a while, of one sensor whose bearings are clockwise from the nose."""

    def __init__(self) -> None:
        self._nearest_m = [math.nan] * BEARINGS  # inf: nothing there

    def note_rays(
        self, ranges_m: Sequence[float], *, first_deg: float, step_deg: float, elevation_deg: float = 0.0
    ) -> None:
        """Rays side by side: inf finds nothing, nan is not measured. `elevation_deg`: above the vehicle's own level."""
        level, up = math.cos(math.radians(elevation_deg)), math.sin(math.radians(elevation_deg))
        for k, range_m in enumerate(ranges_m):
            if math.isnan(range_m):
                continue
            is_beside = math.isfinite(range_m) and BAND_M[0] <= range_m * up <= BAND_M[1]
            level_m = range_m * level if is_beside else math.inf
            at = at_bearing(math.radians(first_deg + k * step_deg))
            if not level_m >= self._nearest_m[at]:  # true of one that was not measured yet
                self._nearest_m[at] = level_m

    def describe(self) -> str:
        """As `describe_view`."""
        hits_m = [range_m for range_m in self._nearest_m if math.isfinite(range_m)]
        max_cm = round(max(hits_m, default=0.0) * 100.0)
        return describe_view([_cm(range_m, max_cm) for range_m in self._nearest_m], max_cm)


def describe_view(scan_cm: Sequence[int], max_cm: int) -> str:
    """The nearest of each of eight directions, m; `-`: nothing there, `?`: unknown in all of it.

    `scan_cm`: BEARINGS sectors, the first about the nose; max_cm + 1: nothing there, UNKNOWN_CM: unknown.
    """
    words = []
    for k, name in enumerate(DIRECTIONS):
        part = [scan_cm[(9 * k + at) % BEARINGS] for at in range(-4, 5)]
        nearest_cm = min(part)
        text = f"{nearest_cm / 100:.1f}" if nearest_cm <= max_cm else "-" if nearest_cm == max_cm + 1 else "?"
        words.append(f"{name} {text}")
    return "  ".join(words)


def _cm(range_m: float, max_cm: int) -> int:
    if math.isnan(range_m):
        return UNKNOWN_CM
    return round(range_m * 100.0) if math.isfinite(range_m) else max_cm + 1
