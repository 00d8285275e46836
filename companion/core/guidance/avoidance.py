"""Positions to pass and to stay at: aside of the tree that the leader flies to, and beside vehicles that hover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.core.model.vectors import ZERO, add, norm, sub
from mission.common.frames import Vec3

PASS_LOOK_AHEAD_M: Final = 25.0  # of those that pass the tree before their leader comes to it
PASS_LIMIT_MPS: Final = 1.5  # theirs too
PASS_SPEED_MPS: Final = 0.3  # slower, there is no course
DEAD_AHEAD_M: Final = 0.5
BEARINGS: Final = 24  # bearings that are tried for another position
SEARCH_STEP_M: Final = 1.0
SEARCH_LIMIT_M: Final = 60.0


def pass_tree(ref_ned_mps: Vec3, dest_ned_m: Vec3, *, clear_m: float, to_the_right: bool) -> Vec3:
    """A follower's, on the way: sideways, so as to pass the tree at `clear_m` when it comes there before the leader.

    One that flew straight at it would stop there, in the way of a leader that has to come close to d2. `to_the_right`
    decides for one with the tree dead ahead.
    """
    speed_mps = math.hypot(ref_ned_mps[0], ref_ned_mps[1])
    if speed_mps < PASS_SPEED_MPS:
        return ZERO
    north, east = ref_ned_mps[0] / speed_mps, ref_ned_mps[1] / speed_mps
    ahead_m = dest_ned_m[0] * north + dest_ned_m[1] * east
    right_m = dest_ned_m[1] * north - dest_ned_m[0] * east  # of the course: where the tree is
    short_m = clear_m - abs(right_m)
    if not 0.0 < ahead_m < PASS_LOOK_AHEAD_M or short_m <= 0.0:
        return ZERO
    side_mps = min(PASS_LIMIT_MPS, short_m * speed_mps / ahead_m)
    if right_m > DEAD_AHEAD_M or (abs(right_m) <= DEAD_AHEAD_M and not to_the_right):
        side_mps = -side_mps
    return (-side_mps * east, side_mps * north, 0.0)


def find_clear_position(to_goal_ned_m: Vec3, standing: Sequence[Vec3], *, clear_m: float) -> Vec3:
    """The nearest position to a goal, at its height, `clear_m` from every vehicle that hovers there; all relative.

    Of positions as near, the one towards the vehicle itself. The goal itself where none is within SEARCH_LIMIT_M.
    """
    if _is_clear(to_goal_ned_m, standing, clear_m):
        return to_goal_ned_m
    back = math.atan2(-to_goal_ned_m[1], -to_goal_ned_m[0])
    turns = sorted((math.tau * k / BEARINGS for k in range(BEARINGS)), key=lambda turn: min(turn, math.tau - turn))
    away_m = SEARCH_STEP_M
    while away_m <= SEARCH_LIMIT_M:
        for turn in turns:
            offset = (away_m * math.cos(back + turn), away_m * math.sin(back + turn), 0.0)
            position = add(to_goal_ned_m, offset)
            if _is_clear(position, standing, clear_m):
                return position
        away_m += SEARCH_STEP_M
    return to_goal_ned_m


def _is_clear(position: Vec3, standing: Sequence[Vec3], clear_m: float) -> bool:
    return all(norm(sub(rel, position)) >= clear_m for rel in standing)
