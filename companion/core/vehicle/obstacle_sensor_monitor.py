"""Ages of what the vehicle's obstacle sensors have reported last. What they saw is `obstacle_map`'s to keep."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.events import ObstacleScan

SENSORS_MAX: Final = 8
NO_SCAN = "no obstacle scan"


class ObstacleSensorMonitor:
    """Times the scans of obstacle sensors: feed it every one, and `update` it each tick. Local clock, s.

    A vehicle may carry some sensors, as one ahead and one behind. Each looks elsewhere, so what counts is the one that
    was heard longest ago; one that was heard once is missed from then on.
    """

    def __init__(self, stale_s: float = math.inf) -> None:
        """`stale_s`: how old a scan may be to be flown by; inf: this vehicle does not fly by any."""
        self.no_scan_s = 0.0  # for how long `no_scan`
        self._stale_s = stale_s
        self._scanned_s: dict[int, float] = {}  # by sensor: when its last scan was measured
        self._no_scan_since_s: float | None = None

    def record_scan(self, scan: ObstacleScan, now_s: float) -> None:
        """Note a scan that arrives at `now_s`."""
        if scan.sensor in self._scanned_s or len(self._scanned_s) < SENSORS_MAX:
            self._scanned_s[scan.sensor] = now_s - scan.age_s

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
        return now_s - min(self._scanned_s.values()) if self._scanned_s else math.inf

    def sensors(self, now_s: float) -> dict[int, bool]:
        """Sensors that were ever heard -> their last scan is fresh."""
        return {sensor: now_s - scanned_s <= self._stale_s for sensor, scanned_s in self._scanned_s.items()}

    def missing(self, now_s: float) -> str:
        """Reason why it must not fly by its scans; empty: it may."""
        return NO_SCAN if self.age_s(now_s) > self._stale_s else ""
