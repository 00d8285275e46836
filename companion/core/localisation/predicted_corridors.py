"""The corridors in which hidden vehicles may fly by now: along the course on which they were heard last, on it or back.

Two that a thicket parts hear and see nothing of one another until one of them comes round its end. So that they are not
on one another's way then, each keeps to its own side of the other's lane. A wish, and no bound: the safety filter knows
nothing of it, and a vehicle that has to crosses it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.vectors import ZERO, add, limit, scale
from mission.common.frames import Vec3

FROM_S: Final = 1.5  # after the last beacon: a trunk in between is passed by then
UNTIL_S: Final = 25.0  # by then it has turned, or is out of reach
LEAST_MPS: Final = 0.7  # slower, it had no course
REACH_M: Final = 40.0  # along the lane, to either side of where it was heard last
GAIN_PER_S: Final = 1.2
LIMIT_MPS: Final = 1.5


@final
class PredictedCorridor:
    """Of one vehicle: a position of it from here (NED m), and the level course (north, east; unit) by it."""

    __slots__ = ("course", "rel_ned_m")

    def __init__(self, rel_ned_m: Vec3, course: tuple[float, float]) -> None:
        self.rel_ned_m: Final = rel_ned_m
        self.course: Final = course


def lane(rel_ned_m: Vec3, vel_ned_mps: Vec3) -> PredictedCorridor | None:
    """Of a vehicle that was heard there last, with that velocity; None: it stood."""
    north, east, _ = vel_ned_mps
    speed_mps = math.hypot(north, east)
    return PredictedCorridor(rel_ned_m, (north / speed_mps, east / speed_mps)) if speed_mps >= LEAST_MPS else None


def keep_clear_of(lanes: Sequence[PredictedCorridor], *, clear_m: float) -> Vec3:
    """Level NED m/s, away from each lane that is nearer than `clear_m`."""
    push = ZERO
    for one in lanes:
        north, east, down = one.rel_ned_m
        n, e = one.course
        along_m, off_m = north * n + east * e, north * -e + east * n  # of the position; its lane passes at `off_m`
        if abs(along_m) <= REACH_M and abs(off_m) < clear_m and abs(down) < clear_m:
            away = -1.0 if off_m > 0.0 else 1.0
            push = add(push, scale((-e, n, 0.0), away * GAIN_PER_S * (clear_m - abs(off_m))))
    return limit(push, LIMIT_MPS)
