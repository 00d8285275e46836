"""A leader that trees held up flies faster than it cruises, until it has made that up.

What counts is how much nearer to its goal it has come, against how much nearer its cruise would have brought it. Where
the swarm itself asks it to be slow, it is not late.
"""

from __future__ import annotations

from typing import Final, final

MOST: Final = 1.15  # of the cruise speed: its followers may fly 1.3 of it, and must keep up
PER_M: Final = 0.1  # of the cruise speed more for each metre late
LATE_MAX_M: Final = 12.0  # what is beyond is given up
PAUSE_S: Final = 0.5  # after a longer pause, or
JUMP_M: Final = 1.0  # with a goal that is suddenly as much nearer or further, it is another way


@final
class Pace:
    """One leader's. `follow` in each tick."""

    __slots__ = ("_late_m", "_left_m", "_now_s")

    def __init__(self) -> None:
        self.rest()

    def rest(self) -> None:
        """Not on a way: nothing to make up."""
        self._late_m = self._left_m = 0.0
        self._now_s = -1e9

    def follow(self, left_m: float, should_mps: float, now_s: float) -> float:
        """The share of its cruise speed to fly, 1 to MOST; `left_m` to the goal, `should_mps`: what it would fly."""
        since_s, gained_m = now_s - self._now_s, self._left_m - left_m
        if 0.0 <= since_s <= PAUSE_S and abs(gained_m) <= JUMP_M:
            self._late_m = max(0.0, min(LATE_MAX_M, self._late_m + should_mps * since_s - gained_m))
        else:
            self._late_m = 0.0
        self._left_m, self._now_s = left_m, now_s
        return min(MOST, 1.0 + PER_M * self._late_m)
