"""Pieces of one turn of a lidar of one layer -> its level scan, as soon as they go once round.

What does not go once round by the time that the next turn begins is a turn all the same: where a mast, a mask or a lost
piece leaves bearings at which no ray looked, these count as not measured.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.perception.level_scan import LevelScan

LEAST_SHARE: Final = 1.0 / 3.0  # of a turn: what came of less tells no motion
ROUNDS_MAX: Final = 2.0  # of rays that came in disorder: then the lidar does not count its turns


@final
class LevelTurn:
    """`begin_piece`, then `add_ray` with each of its rays; `take_whole` after each piece, `as_far_as_seen` at last."""

    __slots__ = ("_goes_on", "_is_told", "_next_rad", "_pieces", "_rays", "_step_rad")

    def __init__(self, step_rad: float) -> None:
        """`step_rad`: from ray to ray, not 0; its sign says which way the lidar turns."""
        self._step_rad: Final = step_rad
        self._rays = LevelScan(abs(step_rad))  # in the order in which they came
        # Of each piece: when its first ray was measured, that ray's bearing from the body's own ahead, the step, its
        # first ray, and the one behind its last
        self._pieces: list[tuple[float, float, float, int, int]] = []
        self._next_rad = 0.0  # where the next piece begins, if none is lost
        self._goes_on = True  # each piece began where the one before it ended
        self._is_told = False

    def begin_piece(self, measured_s: float, start_rad: float, step_rad: float, count: int) -> None:
        """The next `count` rays: from that bearing on, clockwise from the body's own ahead."""
        rays = self._rays
        if len(rays.ranges_m) * rays.step_rad > ROUNDS_MAX * math.tau:
            self._begin_anew()
        if self._pieces and abs(math.remainder(start_rad - self._next_rad, math.tau)) > rays.step_rad:
            self._goes_on = False
        self._next_rad = start_rad + count * step_rad
        first = len(self._rays.ranges_m)
        self._pieces.append((measured_s, start_rad, step_rad, first, first + count))

    def add_ray(self, bearing_rad: float, range_m: float, eye_north_m: float, eye_east_m: float) -> None:
        """As LevelScan.add_ray."""
        self._rays.add_ray(bearing_rad, range_m, eye_north_m, eye_east_m)

    def take_whole(self) -> LevelScan | None:
        """The turn, once, when its pieces have gone once round, one after the other."""
        if not (self._goes_on and self._rays.is_whole):
            return None
        whole = self._rays
        self._begin_anew()
        return whole

    def as_far_as_seen(self) -> LevelScan | None:
        """A turn that is over and was not told: each ray at its bearing, whatever the order in which pieces came.

        From the ray that was measured first. Bearings at which none looked are not measured, from where the ray before
        them was. None: it was told, or too little of it came.
        """
        if self._is_told or not self._pieces:
            return None
        rays, step_rad = self._rays, self._rays.step_rad
        count = max(1, math.floor(math.tau / step_rad + 0.5))
        side = 1.0 if self._step_rad > 0.0 else -1.0
        pieces = sorted(self._pieces)
        first_rad = pieces[0][1]
        at_ray = [-1] * count  # of each bearing
        for _, start_rad, piece_step_rad, begin, end in pieces:
            for k in range(begin, end):
                turned_rad = side * (start_rad - first_rad + (k - begin) * piece_step_rad)
                at_ray[math.floor(turned_rad / step_rad + 0.5) % count] = k
        if count - at_ray.count(-1) < LEAST_SHARE * count:
            return None
        seen = LevelScan(step_rad)
        last = before = 0
        for k in range(count):
            ray = at_ray[k]
            if ray >= 0:
                last, before = ray, k
            bearing_rad = rays.bearings_rad[last] + side * (k - before) * step_rad
            range_m = rays.ranges_m[last] if ray >= 0 else math.nan
            seen.add_ray(bearing_rad, range_m, rays.eyes_north_m[last], rays.eyes_east_m[last])
            seen.has_looked.append(ray >= 0)
        return seen

    def _begin_anew(self) -> None:
        """What is still to come of the turn is no other."""
        self._rays, self._pieces = LevelScan(self._rays.step_rad), []
        self._goes_on = self._is_told = True
