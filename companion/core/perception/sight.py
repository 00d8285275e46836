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
SHARES = (1.0, 0.7, 0.45)  # of a way, at which it is looked at
HALF_M: Final = 0.6  # of its width: a hull, and most of the margin
NEAR_M: Final = 1.5  # nearer than that the obstacle map has what there is
BEYOND_M: Final = 0.3  # so much farther than a place must a ray go on


@final
class Sight:
    """Turns, the last one first, and where the vehicle is: as of one tick."""

    __slots__ = ("_here_e", "_here_n", "_max_m", "_turns")

    def __init__(self, turns: Sequence[LevelScan], here: tuple[float, float], max_m: float) -> None:
        """`max_m`: range of the sensor. What is farther no turn has seen, whatever its rays met."""
        self._turns = turns
        self._here_n, self._here_e = here
        self._max_m: Final = max_m

    def is_free(self, north_m: float, east_m: float) -> bool:
        """A place, metres from the vehicle: a turn saw that nothing stands there, or none has looked at all."""
        n, e = self._here_n + north_m, self._here_e + east_m
        for turn in self._turns:
            away_m = math.hypot(n - turn.eyes_north_m[0], e - turn.eyes_east_m[0])
            if away_m + BEYOND_M <= self._max_m and turn.sees_beyond(n, e, BEYOND_M):
                return True
        return not self._turns

    def is_way_free(self, start: tuple[float, float], way: tuple[float, float], ahead_m: float) -> bool:
        """The same of all places about a way, HALF_M to either side.

        `start`: metres from the vehicle; `way`: its direction, a unit vector. Both north and east.
        """
        if not self._turns:
            return True
        start_n, start_e = start
        north, east = way
        half_seen_rad = 1.5 * self._turns[0].step_rad  # by a look: three rays
        for share in SHARES:
            away_m = share * ahead_m
            if away_m < NEAR_M:
                continue
            half_rad = math.asin(min(1.0, HALF_M / away_m))
            looks = max(1, math.ceil(half_rad / half_seen_rad))
            for k in range(looks):
                turn_rad = half_rad * (2 * k + 1 - looks) / looks
                n, e = away_m * math.cos(turn_rad), away_m * math.sin(turn_rad)
                if not self.is_free(start_n + n * north - e * east, start_e + n * east + e * north):
                    return False
        return True


@final
class SightHistory:
    """One vehicle's, in the frame in which its turns are placed."""

    __slots__ = ("_sensors", "_taken_s", "_turns")

    def __init__(self) -> None:
        self._turns: list[LevelScan] = []  # the last one first
        self._sensors: list[int] = []  # of each
        self._taken_s: list[float] = []

    def note_turn(self, sensor: int, turn: LevelScan, now_s: float) -> None:
        """A whole turn; one that does not go once round says nothing of the rest."""
        if not turn.is_whole:
            return
        its = [k for k in range(len(self._turns)) if self._sensors[k] == sensor]
        if len(its) > 1 and self._is_near(its[0], its[1]):  # it only stood in for the next
            del self._turns[its[0]], self._sensors[its[0]], self._taken_s[its[0]]
        self._turns.insert(0, turn)
        self._sensors.insert(0, sensor)
        self._taken_s.insert(0, now_s)
        while len(self._turns) > KEPT or now_s - self._taken_s[-1] > KEPT_S:
            self._turns.pop()
            self._sensors.pop()
            self._taken_s.pop()

    def seen_from(self, placed_ned_m: Vec3, max_m: float) -> Sight:
        """All that was seen lately, from there; `max_m`: range of the sensor."""
        return Sight(tuple(self._turns), (placed_ned_m[0], placed_ned_m[1]), max_m)

    def _is_near(self, newest: int, before: int) -> bool:
        """A turn is hardly apart from the one before it."""
        n = self._turns[newest].eyes_north_m[0] - self._turns[before].eyes_north_m[0]
        e = self._turns[newest].eyes_east_m[0] - self._turns[before].eyes_east_m[0]
        return math.sqrt(n * n + e * e) < APART_M and self._taken_s[newest] - self._taken_s[before] < APART_S
