"""Ages of what the vehicle's obstacle sensors have reported last. What they saw is `obstacle_map`'s to keep."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.events import AnyScan, LidarScan

SENSORS_MAX: Final = 8
ESTABLISHED_SCANS: Final = 5  # in a row: a component that sends fewer is no sensor of this vehicle
PAUSE_S: Final = 2.0  # between two of a row, at most
NO_SCAN = "no obstacle scan"


class ObstacleSensorMonitor:
    """Times the scans of obstacle sensors: feed it every one, and `update` it each tick. Local clock, s.

    A vehicle may carry some sensors, as one ahead and one behind. Each looks elsewhere, so what counts is the one that
    was heard longest ago. Once established, by ESTABLISHED_SCANS, it is missed from then on; until the first is, all
    that were heard count.
    """

    def __init__(self, stale_s: float = math.inf) -> None:
        """`stale_s`: how old a scan may be to be flown by; inf: this vehicle does not fly by any."""
        self.no_scan_s = 0.0  # for how long `no_scan`
        self._stale_s = stale_s
        self._scanned_s: dict[int, float] = {}  # by sensor: when its last scan was measured
        self._in_a_row: dict[int, int] = {}  # by sensor: scans, up to ESTABLISHED_SCANS
        self._turns: dict[int, int] = {}  # by sensor: of what came last in pieces
        self._no_scan_since_s: float | None = None

    def record_scan(self, scan: AnyScan, now_s: float) -> None:
        """Note a scan that arrives at `now_s`; one that cannot be is none, whatever age it tells."""
        if isinstance(scan, LidarScan) and not scan.can_be:
            return
        sensor, measured_s = scan.sensor, now_s - scan.age_s
        if sensor not in self._scanned_s and len(self._scanned_s) >= SENSORS_MAX:
            self._forget_strays(now_s)
            if len(self._scanned_s) >= SENSORS_MAX:
                return
        in_a_row = self._in_a_row.get(sensor, 0)
        if in_a_row < ESTABLISHED_SCANS and not self._goes_on_turning(scan):
            goes_on = measured_s - self._scanned_s.get(sensor, -math.inf) <= PAUSE_S
            self._in_a_row[sensor] = in_a_row + 1 if goes_on else 1
        self._scanned_s[sensor] = measured_s

    def _goes_on_turning(self, scan: AnyScan) -> bool:
        """Another piece of the turn before: all of them are one scan."""
        if not isinstance(scan, LidarScan):
            return False
        before = self._turns.get(scan.sensor)
        self._turns[scan.sensor] = scan.turn
        return before == scan.turn

    def _forget_strays(self, now_s: float) -> None:
        for sensor, scanned_s in list(self._scanned_s.items()):
            if self._in_a_row[sensor] < ESTABLISHED_SCANS and now_s - scanned_s > PAUSE_S:
                del self._scanned_s[sensor], self._in_a_row[sensor]

    def update(self, now_s: float) -> None:
        """Time how long scans have been missing."""
        if not self.missing(now_s):
            self._no_scan_since_s, self.no_scan_s = None, 0.0
            return
        if self._no_scan_since_s is None:
            self._no_scan_since_s = now_s
        self.no_scan_s = now_s - self._no_scan_since_s

    @property
    def no_scan(self) -> bool:
        """At the last update there was none to be flown by."""
        return self._no_scan_since_s is not None

    def age_s(self, now_s: float) -> float:
        """Of the oldest sensor's last scan; inf: there is none."""
        if not self._scanned_s:
            return math.inf
        counted_s = [at_s for k, at_s in self._scanned_s.items() if self._in_a_row[k] >= ESTABLISHED_SCANS]
        return now_s - min(counted_s or self._scanned_s.values())

    def missing(self, now_s: float) -> str:
        """Reason why it must not fly by its scans; empty: it may."""
        return NO_SCAN if self.age_s(now_s) > self._stale_s else ""
