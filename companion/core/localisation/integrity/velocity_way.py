"""The way that the reported velocity makes, and how far it strays from reported positions while all is well.

An autopilot's velocity errs: by 0.25 m/s for seconds as real PX4 were recorded, by a hundredth of that in others. How
much one's own does is learnt in the flight, from how far both ways part within SPAN_S, beginning with the worst.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Final, final

from companion.core.localisation.integrity.position_gate import GAP_S, find_since_s, integrate_step
from companion.core.model.events import Position

WORST_M2_PER_S: Final = 0.3  # variance of the drift on an axis: recorded PX4, 0.19 to 0.27
WORST_COUNTS: Final = 1.0  # spans
MORE: Final = 1.5  # than what is learnt, which is of few spans
MEDIAN: Final = 0.69  # of an exponential's mean
SPANS_MAX: Final = 120  # that the median is of
SPAN_S: Final = 5.0  # a velocity's error is a quarter as large after it


@final
class VelocityWay:
    """One vehicle's, in the air."""

    __slots__ = ("_counts", "_last", "_read_s", "_span_left_m", "_span_s", "_spans_m2_per_s", "_sum_m2_per_s", "ne_m")

    def __init__(self) -> None:
        self.ne_m: tuple[float, float] = (0.0, 0.0)  # from where it began
        self._last: Position | None = None
        self._read_s = 0.0
        self._span_s = -1.0  # when the span began; < 0: none did
        self._span_left_m: tuple[float, float] = (0.0, 0.0)  # position less way, then
        self._counts = WORST_COUNTS
        self._sum_m2_per_s = WORST_COUNTS * WORST_M2_PER_S
        self._spans_m2_per_s: deque[float] = deque([WORST_M2_PER_S * MEDIAN], maxlen=SPANS_MAX)

    def update(self, told: Position, now_s: float) -> bool:
        """The next position with its velocity; False: after a gap, of which nothing is known."""
        before, heard_s = self._last, now_s - self._read_s
        self._last, self._read_s = told, now_s
        if before is None:
            return False
        since_s = find_since_s(before, told, heard_s)
        if not 0.0 <= since_s <= GAP_S:
            self._span_s = -1.0
            return False
        north, east, _ = integrate_step(before.vel_ned_mps, told.vel_ned_mps, since_s)
        self.ne_m = (self.ne_m[0] + north, self.ne_m[1] + east)
        self._learn(told, now_s)
        return True

    def _learn(self, told: Position, now_s: float) -> None:
        left = (told.pos_ned_m[0] - self.ne_m[0], told.pos_ned_m[1] - self.ne_m[1])
        since_s, before = now_s - self._span_s, self._span_left_m
        if self._span_s >= 0.0 and since_s < SPAN_S:
            return
        if self._span_s >= 0.0:
            north, east = left[0] - before[0], left[1] - before[1]
            self._counts += 1.0
            span_m2_per_s = (north * north + east * east) / (2.0 * since_s)
            self._sum_m2_per_s += span_m2_per_s
            self._spans_m2_per_s.append(span_m2_per_s)
        self._span_s, self._span_left_m = now_s, left

    @property
    def walk_m2_per_s(self) -> float:
        """Variance of how far the way strays, on an axis, as far as it is known."""
        return MORE * self._sum_m2_per_s / self._counts

    @property
    def usual_m2_per_s(self) -> float:
        """The same by the median of the spans: a position that is led away is not learnt before half of the time.

        It is of few spans at first, and errs to both sides: under the open sky, with a tighter fix, seed 37098 of the
        search alarmed by it without a fault.
        """
        return MORE * median(self._spans_m2_per_s) / MEDIAN
