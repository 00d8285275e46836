"""Whether the vehicle sees: how old is what its obstacle sensors last told. What they saw is `scan_map`'s to keep."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.events import ObstacleScan
from companion.core.vehicle import failsafe
from companion.core.vehicle.failsafe import Cause, Finding

SENSORS_MAX: Final = 8
NO_SCAN = "no obstacle scan"


class Sight:
    """Feed it every scan. Times are the local clock's, s.

    A vehicle may carry some sensors, as one ahead and one behind. Each looks elsewhere, so what counts is the one that
    was heard longest ago; one that was heard once is missed from then on.
    """

    def __init__(self, stale_s: float | None = None) -> None:
        """`stale_s`: how old a scan may be to be flown by; None: this vehicle does not fly by any."""
        self._stale_s = stale_s
        self._seen_s: dict[int, float] = {}  # by sensor: when what it last told was measured
        self._blind_since_s: float | None = None

    def see(self, scan: ObstacleScan, now_s: float) -> None:
        """A scan that arrives at `now_s`."""
        if scan.sensor in self._seen_s or len(self._seen_s) < SENSORS_MAX:
            self._seen_s[scan.sensor] = now_s - scan.age_s

    def age_s(self, now_s: float) -> float:
        """Of the oldest sensor's last scan; inf: there is none."""
        return now_s - min(self._seen_s.values()) if self._seen_s else math.inf

    def sensors(self, now_s: float) -> dict[int, bool]:
        """Those that were heard ever -> whether what they told last is fresh."""
        stale_s = math.inf if self._stale_s is None else self._stale_s
        return {sensor: now_s - seen_s <= stale_s for sensor, seen_s in self._seen_s.items()}

    def missing(self, now_s: float) -> str:
        """Why it must not fly by what it sees; empty: it may."""
        blind = self._stale_s is not None and self.age_s(now_s) > self._stale_s
        return NO_SCAN if blind else ""

    def findings(self, now_s: float, *, airborne: bool) -> list[Finding]:
        """By the table of failsafes."""
        if not self.missing(now_s):
            self._blind_since_s = None
            return []
        if self._blind_since_s is None:
            self._blind_since_s = now_s
        found = [Finding(Cause.OBSTACLES_STALE)]
        if airborne and now_s - self._blind_since_s >= failsafe.BLIND_LAND_S:
            found.append(Finding(Cause.OBSTACLES_LOST))
        return found
