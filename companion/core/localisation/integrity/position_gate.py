"""The gate of the own position: jumps are taken off it, and one that freezes is carried on by the velocity.

What flies and is told to others never jumps by more than a separation bears: a position that moves JUMP_M farther
between two readings than its velocity allows goes on where it was. Which of the two was right, nothing here knows: the
vehicle may be off by as much as was taken off, and says so, until the position comes back.

A position that is repeated to the bit while the vehicle moves, or is commanded to, is none: no estimator that lives
does that.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO, add, norm, sub
from mission.common.frames import Vec3

JUMP_M: Final = 3.0
GAP_S: Final = 1.0  # after a longer one nothing can be said of the way between
ACCELERATION_MPS2: Final = 6.0  # of a vehicle between two readings, at most
BACK_M: Final = 1.0  # nearer to where it is reported than that, a position has come back
MOVES_MPS: Final = 0.3  # a vehicle that moves slower may seem to stand
COMMANDED_MPS: Final = 0.5
FROZEN_SHARE: Final = 0.25  # of the way since a position froze: a velocity may be wrong by as much
AHEAD_S: Final = 1.0  # of a frozen position's error, which is said


@final
class PositionGate:
    """One vehicle's. Feed it every position; `commanded_ned_mps` is what its autopilot is to fly."""

    __slots__ = (
        "_frozen_since_s",
        "_last",
        "_level",
        "_read_s",
        "_reckoned_ned_m",
        "commanded_ned_mps",
        "jumped_s",
        "off_ned_m",
    )

    def __init__(self, *, level: bool) -> None:
        """`level`: level jumps too; else of heights alone."""
        self._level: Final = level
        self._last: Position | None = None
        self._read_s = 0.0
        self._frozen_since_s: float | None = None
        self._reckoned_ned_m: Vec3 = ZERO  # the way by the velocity, while the position is frozen
        self.commanded_ned_mps: Vec3 = ZERO
        self.jumped_s = -math.inf  # when it jumped last
        self.off_ned_m: Vec3 = ZERO  # believed less reported, by jumps

    @property
    def believed_less_reported_ned_m(self) -> Vec3:
        """By jumps, and by the way since it froze."""
        return add(self.off_ned_m, self._reckoned_ned_m)

    def receive_position(self, told: Position, now_s: float, *, airborne: bool, trusts_jump: bool = False) -> Position:
        """A position as reported; the one to fly by. `trusts_jump`: it comes back to a fix that it had lost."""
        before, heard_s = self._last, now_s - self._read_s
        self._last, self._read_s = told, now_s
        since_s = 0.0 if before is None else find_since_s(before, told, heard_s)
        if before is None or not airborne:
            self.off_ned_m = self._reckoned_ned_m = ZERO
            self._frozen_since_s = None
            return told
        if 0.0 < since_s <= GAP_S:
            self._judge_step(before, told, since_s, now_s, trusts_jump=trusts_jump)
        elif since_s != 0.0:
            self._frozen_since_s, self._reckoned_ned_m = None, ZERO
        off = self.believed_less_reported_ned_m
        return told if off == ZERO else Position(add(told.pos_ned_m, off), told.vel_ned_mps, told.boot_s)

    def _judge_step(self, before: Position, told: Position, since_s: float, now_s: float, *, trusts_jump: bool) -> None:
        vel = told.vel_ned_mps
        way = integrate_step(before.vel_ned_mps, vel, since_s)
        if told.pos_ned_m == before.pos_ned_m:
            if norm(vel) > MOVES_MPS or norm(self.commanded_ned_mps) > COMMANDED_MPS:
                if self._frozen_since_s is None:
                    self._frozen_since_s = now_s - since_s
                self._reckoned_ned_m = add(self._reckoned_ned_m, way)
            return
        expected = add(way, self._reckoned_ned_m)
        self._frozen_since_s, self._reckoned_ned_m = None, ZERO
        jump = sub(sub(told.pos_ned_m, before.pos_ned_m), expected)
        if not self._level:
            jump = (0.0, 0.0, jump[2])
        most_m = JUMP_M + 0.5 * ACCELERATION_MPS2 * since_s * since_s
        if norm(jump) <= most_m:
            return
        if trusts_jump:
            self._forget_taken_off(jump)
            return
        self.take_off(jump, now_s)

    def take_off(self, jump_ned_m: Vec3, now_s: float) -> None:
        """A jump of the reported position, which this or somebody else has found."""
        self.jumped_s = now_s
        self.off_ned_m = sub(self.off_ned_m, jump_ned_m)
        if norm(self.off_ned_m) <= BACK_M:
            self.off_ned_m = ZERO

    def _forget_taken_off(self, jump: Vec3) -> None:
        """Back at a fix, level or in height, as far as it jumped there: what was taken off was of what went before."""
        north, east, down = self.off_ned_m
        if math.hypot(jump[0], jump[1]) > BACK_M:
            north = east = 0.0
        self.off_ned_m = (north, east, 0.0 if abs(jump[2]) > BACK_M else down)

    def frozen_s(self, now_s: float) -> float:
        """For how long its position has been repeated though it moves; 0: it is not."""
        return 0.0 if self._frozen_since_s is None else now_s - self._frozen_since_s

    @property
    def is_off(self) -> bool:
        """A jump was taken off, and the position has not come back."""
        return self.off_ned_m != ZERO

    def error_m(self, now_s: float) -> float:
        """Level error that the position flown by may have; 0: none that this knows of."""
        error_m = math.hypot(self.off_ned_m[0], self.off_ned_m[1])
        if self._frozen_since_s is not None and self._last is not None:
            vel = self._last.vel_ned_mps
            error_m += (self.frozen_s(now_s) + AHEAD_S) * FROZEN_SHARE * math.hypot(vel[0], vel[1])
        return error_m


def integrate_step(before_mps: Vec3, after_mps: Vec3, since_s: float) -> Vec3:
    """The way between two readings by their velocities, m."""
    half_s = 0.5 * since_s
    return (
        half_s * (before_mps[0] + after_mps[0]),
        half_s * (before_mps[1] + after_mps[1]),
        half_s * (before_mps[2] + after_mps[2]),
    )


def find_since_s(before: Position, told: Position, heard_s: float) -> float:
    """Between two readings, by the autopilot's own time where it tells it; < 0: it began anew."""
    if before.boot_s is not None and told.boot_s is not None:
        return told.boot_s - before.boot_s
    return max(0.0, heard_s)
