"""Whether the vehicle sees: how old is what its obstacle sensors last told. What they saw is `obstacles`' to keep."""

from __future__ import annotations

import math

from companion.core.types import ObstacleScan

SENSORS_MAX = 8


class Sight:
    """Feed it every scan. Times are the local clock's, s.

    A vehicle may carry some sensors, as one ahead and one behind. Each looks elsewhere, so what counts is the one that
    was heard longest ago; one that was heard once is missed from then on.
    """

    def __init__(self) -> None:
        self._seen_s: dict[int, float] = {}  # by sensor: when what it last told was measured

    def see(self, scan: ObstacleScan, now_s: float) -> None:
        """A scan that arrives at `now_s`."""
        if scan.sensor in self._seen_s or len(self._seen_s) < SENSORS_MAX:
            self._seen_s[scan.sensor] = now_s - scan.age_s

    def age_s(self, now_s: float) -> float:
        """Of the oldest sensor's last scan; inf: there is none."""
        return now_s - min(self._seen_s.values()) if self._seen_s else math.inf
