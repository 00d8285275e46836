"""Sight: where rays went on in the last turns of the sensor, so that nothing can stand there unseen.

A trunk that is near hides what stands behind it: in OBSTACLE_DISTANCE all of a sector's 5 degrees, in a raw scan its
own width. What a turn did not look at may hold anything, however free its bearing was before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.level_scan import LevelScan
from mission.common.frames import Vec3

KEPT: Final = 8  # turns
APART_M: Final = 0.4  # from one eye to the next of those that are kept
APART_S: Final = 0.3  # or so long: what moves may have come there since
KEPT_S: Final = 3.0
BEYOND_M: Final = 0.3  # so much farther than a place must a ray go on


@final
class Sight:
    """Turns, the last one first, and where the vehicle is: as of one tick."""

    __slots__ = ("_here_e", "_here_n", "_turns")

    def __init__(self, turns: Sequence[LevelScan], here: tuple[float, float]) -> None:
        self._turns = turns
        self._here_n, self._here_e = here

    def is_free(self, north_m: float, east_m: float) -> bool:
        """A place, metres from the vehicle: a turn saw that nothing stands there, or none has looked at all."""
        n, e = self._here_n + north_m, self._here_e + east_m
        for turn in self._turns:
            if turn.sees_beyond(n, e, BEYOND_M):
                return True
        return not self._turns


@final
class SightHistory:
    """One vehicle's, in the frame in which its turns are placed."""

    __slots__ = ("_taken_s", "_turns")

    def __init__(self) -> None:
        self._turns: list[LevelScan] = []  # the last one first
        self._taken_s: list[float] = []

    def note_turn(self, turn: LevelScan, now_s: float) -> None:
        """A whole turn; one that does not go once round says nothing of the rest."""
        if not turn.is_whole:
            return
        if len(self._turns) > 1 and self._is_newest_near():  # it only stood in for the next
            del self._turns[0], self._taken_s[0]
        self._turns.insert(0, turn)
        self._taken_s.insert(0, now_s)
        while len(self._turns) > KEPT or now_s - self._taken_s[-1] > KEPT_S:
            self._turns.pop()
            self._taken_s.pop()

    def seen_from(self, placed_ned_m: Vec3) -> Sight:
        """All that was seen lately, from there."""
        return Sight(tuple(self._turns), (placed_ned_m[0], placed_ned_m[1]))

    def _is_newest_near(self) -> bool:
        """The newest is hardly apart from the one before it."""
        newest, before = self._turns[0], self._turns[1]
        n = newest.eyes_north_m[0] - before.eyes_north_m[0]
        e = newest.eyes_east_m[0] - before.eyes_east_m[0]
        return math.sqrt(n * n + e * e) < APART_M and self._taken_s[0] - self._taken_s[1] < APART_S
