"""Noise of the scans, by the scans themselves: one turn held against the one before it.

What stands still is as far, on the next turn, as the own motion since says; by how much ranges miss that is what the
sensor errs by. A lidar that is dirty, blinded by the sun or failing so tells on itself, whatever its data sheet says.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.perception.level_scan import LevelScan, ScanClass
from companion.core.vehicle.obstacle_sensor_monitor import SENSORS_MAX

PAIRS_LEAST: Final = 6  # rays that ended in both turns: fewer tell nothing
EDGE_M: Final = 2.0  # a ray that misses by more has gone over to another thing
FOLLOW: Final = 0.3  # of a new turn in the mean
GAP_S: Final = 0.5  # after a longer gap turns are not compared
NORMAL_M: Final = 0.15  # and three sigmas of the class: edges, bark and motion between the rays
MEDIAN_OF_PAIR: Final = 0.95  # of what two turns' errors differ by, the median in their standard deviations
WIDENS: Final = 2.0  # metres more to keep for each metre of noise beyond what is normal
WIDENS_MAX_M: Final = 1.5


@final
class ScanNoise:
    """One vehicle's sensors, together. `note_turn` with each turn, placed as the flight goes."""

    __slots__ = ("_before", "_normal_m", "noise_m")

    def __init__(self, kind: ScanClass) -> None:
        self._normal_m: Final = NORMAL_M + 3.0 * kind.range_sd_m
        self._before: dict[int, tuple[LevelScan, float]] = {}  # by sensor: its last turn, and when it came
        self.noise_m = 0.0  # standard deviation of a range, as turns show it

    @property
    def wider_m(self) -> float:
        """More than the mission's margin, to be kept from all that is seen."""
        return min(WIDENS_MAX_M, WIDENS * max(0.0, self.noise_m - self._normal_m))

    def note_turn(self, sensor: int, turn: LevelScan, now_s: float) -> None:
        """A turn of a sensor; what does not go once round is not compared."""
        if not turn.is_whole or (sensor not in self._before and len(self._before) >= SENSORS_MAX):
            return
        before, before_s = self._before.get(sensor, (None, -math.inf))
        self._before[sensor] = turn, now_s
        if before is None or now_s - before_s > GAP_S or len(before.ranges_m) != len(turn.ranges_m):
            return
        misses_m = self._find_misses(before, turn)
        if len(misses_m) >= PAIRS_LEAST:
            misses_m.sort()
            noise_m = misses_m[len(misses_m) // 2] / MEDIAN_OF_PAIR
            self.noise_m += FOLLOW * (noise_m - self.noise_m)

    def _find_misses(self, before: LevelScan, turn: LevelScan) -> list[float]:
        """Of rays that ended in both turns, by how much the later range is not what the earlier one says."""
        count = len(turn.ranges_m)
        around = math.remainder(before.bearings_rad[count // 4] - before.bearings_rad[0], math.tau)
        step_rad = before.step_rad if around > 0.0 else -before.step_rad
        misses_m: list[float] = []
        for k in range(count):
            range_m, bearing_rad = turn.ranges_m[k], turn.bearings_rad[k]
            at = math.floor(math.remainder(bearing_rad - before.bearings_rad[0], math.tau) / step_rad + 0.5) % count
            was_m = before.ranges_m[at]
            if not (range_m < math.inf and was_m < math.inf):
                continue
            n = before.eyes_north_m[at] - turn.eyes_north_m[k]
            e = before.eyes_east_m[at] - turn.eyes_east_m[k]
            miss_m = abs(range_m - was_m - n * math.cos(bearing_rad) - e * math.sin(bearing_rad))
            if miss_m < EDGE_M:
                misses_m.append(miss_m)
        return misses_m
