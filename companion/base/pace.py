"""Pace at which records arrive at the base station, and how long those that are missing will take, in words."""

from __future__ import annotations

from collections import deque
from typing import Final

OVER_S: Final = 60.0  # that the pace is taken over: vehicles come into range and leave it again
EVERY_S: Final = 1.0  # between two counts that are kept


class Pace:
    """Counts of records at the base station over the last minute."""

    def __init__(self) -> None:
        self._counts = deque[tuple[float, int]](maxlen=round(OVER_S / EVERY_S) + 1)  # when, and how many were there

    def describe(self, delivered: int, made: int, now_s: float) -> str:
        """`, 55 a minute, 20 s left`, of `made` records; empty while none arrive. `now_s`: the local clock's."""
        if not self._counts or now_s - self._counts[-1][0] >= EVERY_S:
            self._counts.append((now_s, delivered))
        while now_s - self._counts[0][0] > OVER_S:
            self._counts.popleft()
        since_s, before = self._counts[0]
        if now_s - since_s < EVERY_S or delivered <= before:
            return ""
        per_s = (delivered - before) / (now_s - since_s)
        left_s = (made - delivered) / per_s
        left = "" if left_s <= 0.0 else f", {left_s:.0f} s left" if left_s < 90.0 else f", {left_s / 60.0:.0f} min left"
        return f", {60.0 * per_s:.0f} a minute{left}"
