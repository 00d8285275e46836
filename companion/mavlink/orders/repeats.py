"""The times at which an order is sent again. Of frames of which half are lost 2^-8 take two periods a hop."""

from __future__ import annotations

import math
from typing import Final

BURST_S: Final = 0.5  # twice in each tick
NEW_S: Final = 2.0  # then as often as beacons,
NEW_PERIOD_S: Final = 0.1
LATE_PERIOD_S: Final = 1.0  # and then so often, for those that come late
SLACK_S: Final = 0.01  # of a tick's time


class Repeats:
    """Of one order."""

    __slots__ = ("_late_period_s", "_sent_s", "begun_s")

    def __init__(self, begun_s: float = -math.inf, *, late_period_s: float = LATE_PERIOD_S) -> None:
        self.begun_s = begun_s
        self._sent_s = -math.inf
        self._late_period_s = late_period_s

    def copies(self, now_s: float) -> int:
        """Datagrams to send with this tick."""
        age_s = now_s - self.begun_s
        copies, period_s = (2, 0.0) if age_s < BURST_S else (1, NEW_PERIOD_S if age_s < NEW_S else self._late_period_s)
        if now_s - self._sent_s < period_s - SLACK_S:
            return 0
        self._sent_s = now_s
        return copies
