"""The way that the reported velocity makes, and how far it may stray from positions that are true.

An autopilot's velocity errs: by 0.25 m/s for seconds as real PX4 were recorded, by a hundredth of that in others. How
much one's own does is learnt in the flight, from how far both ways part within SPAN_S. What few spans show may be
chance: a vehicle counts as better than the worst that was recorded once even the most that they leave possible is.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass
from typing import Final, final

from companion.core.localisation.integrity.position_gate import GAP_S, find_since_s, integrate_step
from companion.core.model.events import Position

SPAN_S: Final = 5.0  # a velocity's error is a quarter as large after it
SPANS_MAX: Final = 25  # that are told apart: longer than a fix monitor looks back
LONGER: Final = 1.4  # variance per second over half a minute, of that over a span: as recorded
WORST_M2_PER_S: Final = 0.36  # of the drift on an axis, in the long run: recorded PX4, 0.21 to 0.35
BETTER_M2_PER_S: Final = 0.1  # half of the least of these
PRIOR_SPANS: Final = 0.1  # that the worst counts as: little, as other makes are a hundred times better
CHANCE: Final = 28.0  # squared sigmas, as of an alarm: how rare it is that there is more than the most
KNOWN_LEAST: Final = 2  # spans whose spread is known


@dataclass(frozen=True, slots=True)
class _Mark:
    """The end of a span."""

    at_s: float
    left_ne_m: tuple[float, float]  # position less way
    spans: int  # by then
    sum_m2_per_s: float  # of them, each as a variance on an axis


@final
class VelocityWay:
    """One vehicle's, in the air."""

    __slots__ = ("_last", "_marks", "_read_s", "_spans_begin_anew", "guessed_m", "ne_m")

    def __init__(self) -> None:
        self.ne_m: tuple[float, float] = (0.0, 0.0)  # from where it began
        self.guessed_m = 0.0  # by which it may be off by all gaps: the faster of the velocities before and after
        self._last: Position | None = None
        self._read_s = 0.0
        self._marks: deque[_Mark] = deque(maxlen=SPANS_MAX)
        self._spans_begin_anew = True

    def update(self, told: Position, now_s: float) -> bool:
        """The next position with its velocity; False: after a gap, whose way is guessed."""
        before, heard_s = self._last, now_s - self._read_s
        self._last, self._read_s = told, now_s
        if before is None:
            return False
        since_s = find_since_s(before, told, heard_s)
        is_gap = not 0.0 <= since_s <= GAP_S
        since_s = heard_s if since_s < 0.0 else since_s
        north, east, _ = integrate_step(before.vel_ned_mps, told.vel_ned_mps, since_s)
        self.ne_m = (self.ne_m[0] + north, self.ne_m[1] + east)
        if is_gap:
            self._spans_begin_anew = True
            self.guessed_m += since_s * max(math.hypot(*one.vel_ned_mps[:2]) for one in (before, told))
            return False
        self._learn(told, now_s)
        return True

    def _learn(self, told: Position, now_s: float) -> None:
        left = (told.pos_ned_m[0] - self.ne_m[0], told.pos_ned_m[1] - self.ne_m[1])
        last = self._marks[-1] if self._marks else _Mark(now_s, left, 0, 0.0)
        if not self._marks or self._spans_begin_anew:
            self._marks.append(_Mark(now_s, left, last.spans, last.sum_m2_per_s))
            self._spans_begin_anew = False
        elif now_s - last.at_s >= SPAN_S:
            sum_m2_per_s = last.sum_m2_per_s + _spread_m2_per_s(last, now_s, left)
            self._marks.append(_Mark(now_s, left, last.spans + 1, sum_m2_per_s))

    def walk_since(self, then_s: float) -> float:
        """Variance of how far the way strays in a second, on an axis, m2, should the position have left it at `then_s`.

        Spans until then count as they are; those since then by how far they part from their mean, which is the drift.
        What they show is a variance of so many degrees of freedom: the most that they leave possible is where Student's
        ratio is as rare as a normal one of CHANCE.
        """
        marks = self._marks
        spans, total = PRIOR_SPANS, PRIOR_SPANS * WORST_M2_PER_S / LONGER
        until, since = bisect_right(marks, then_s, key=_end_s) - 1, bisect_left(marks, then_s, key=_end_s)
        if until >= 0:
            spans += marks[until].spans
            total += marks[until].sum_m2_per_s
        if since < len(marks) and marks[-1].spans - marks[since].spans >= KNOWN_LEAST:
            first, last = marks[since], marks[-1]
            spans += last.spans - first.spans - 1
            total += last.sum_m2_per_s - first.sum_m2_per_s - _spread_m2_per_s(first, last.at_s, last.left_ne_m)
        likely = LONGER * total / spans
        freedom = 2.0 * spans
        most = likely * freedom * math.expm1(min(CHANCE / freedom, CHANCE)) / CHANCE
        return most if most < BETTER_M2_PER_S else max(likely, WORST_M2_PER_S)


def _spread_m2_per_s(then: _Mark, now_s: float, left_ne_m: tuple[float, float]) -> float:
    north, east = left_ne_m[0] - then.left_ne_m[0], left_ne_m[1] - then.left_ne_m[1]
    return (north * north + east * east) / (2.0 * (now_s - then.at_s))


def _end_s(mark: _Mark) -> float:
    return mark.at_s
