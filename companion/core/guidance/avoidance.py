"""The way round what stands still: trunks, and vehicles that hang in the air."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.core.model.vectors import ZERO, add, dot, norm, scale, sub
from companion.core.safety.obstacles import Obstacle
from mission.common.frames import Vec3

PASS_LOOK_AHEAD_M: Final = 25.0  # of those that pass the tree before their leader comes to it
PASS_LIMIT_MPS: Final = 1.5  # theirs too
PASS_SPEED_MPS: Final = 0.3  # slower, there is no course
DEAD_AHEAD_M: Final = 0.5
LOOK_AHEAD_M: Final = 20.0
TURNS_RAD = tuple(math.radians(15.0 * k) for k in range(12))  # away from the course, to either side
SLOPES_RAD = (0.0, math.radians(35.0), math.radians(-35.0), math.radians(70.0), math.radians(-70.0))
TURN_COST: Final = 1.0  # of half a turn
SLOPE_COST: Final = 1.2  # of straight up
BLOCKED_COST: Final = 4.0  # of no room at all
OTHER_SIDE_COST: Final = 0.3
PLACES: Final = 24  # bearings that are tried for another place
PLACE_STEP_M: Final = 1.0
PLACE_LIMIT_M: Final = 60.0


def pass_by(ref_ned_mps: Vec3, dest_ned_m: Vec3, *, clear_m: float, to_the_right: bool) -> Vec3:
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


def way_round(
    wanted: Vec3,
    obstacles: Sequence[Obstacle],
    *,
    to_goal_m: float,
    room_up_m: float,
    room_down_m: float,
    side: int,
) -> tuple[Vec3, int]:
    """`wanted` (NED m/s), turned so that it passes clear of `obstacles`; and the side it took.

    Of a fan of courses about the wanted one, level and sloping where floor and ceiling leave room, the one that turns
    least for the room it has. `side`: -1 left, 0 none, 1 right, as taken before: to change it costs, or a vehicle would
    waver before an obstacle dead ahead. `to_goal_m`: what stands behind the goal is not in the way.
    """
    speed_mps = norm(wanted)
    reach_m = min(LOOK_AHEAD_M, to_goal_m)
    if not obstacles or speed_mps < 1e-6 or reach_m <= 0.0:
        return wanted, 0
    ahead = scale(wanted, 1.0 / speed_mps)
    if _free_m(ahead, obstacles, reach_m) >= reach_m:
        return wanted, 0
    heading = math.atan2(ahead[1], ahead[0])
    clear_m = max(obstacle.clear_m for obstacle in obstacles)
    best, best_side, least = wanted, side, math.inf
    for slope in SLOPES_RAD:
        if (slope > 0.0 and room_up_m < clear_m) or (slope < 0.0 and room_down_m < clear_m):
            continue
        for turn in TURNS_RAD:
            for its_side in (1, -1) if turn > 0.0 else (0,):
                course = heading + its_side * turn
                flat = math.cos(slope)
                direction = (flat * math.cos(course), flat * math.sin(course), -math.sin(slope))
                free_m = _free_m(direction, obstacles, LOOK_AHEAD_M)
                cost = TURN_COST * turn / math.pi + SLOPE_COST * abs(slope) / (math.pi / 2.0)
                cost += BLOCKED_COST * max(0.0, 1.0 - free_m / reach_m)
                cost += OTHER_SIDE_COST if its_side * side < 0 else 0.0
                if cost < least - 1e-9:
                    best, best_side, least = scale(direction, speed_mps), its_side or side, cost
    return best, best_side


def _free_m(direction: Vec3, obstacles: Sequence[Obstacle], reach_m: float) -> float:
    """How far a course (unit vector) goes before it comes too near to any."""
    free_m = reach_m
    for (north, east, down), clear_m, upright in obstacles:
        rel, course, share = (north, east, down), direction, 1.0
        if upright:  # seen from above
            share = math.hypot(direction[0], direction[1])
            if share < 1e-6:
                continue
            rel, course = (north, east, 0.0), (direction[0] / share, direction[1] / share, 0.0)
        ahead_m = dot(rel, course)
        if ahead_m <= 0.0:
            continue
        aside = sub(rel, scale(course, ahead_m))
        short = clear_m * clear_m - dot(aside, aside)
        if short > 0.0:
            free_m = min(free_m, max(0.0, ahead_m - math.sqrt(short)) / share)
    return free_m


def give_way(to_goal_ned_m: Vec3, standing: Sequence[Vec3], *, clear_m: float) -> Vec3:
    """The nearest place to a goal, at its height, `clear_m` from every vehicle that stands there; relative positions.

    Of places as near, the one towards the vehicle itself. The goal itself where no place is within PLACE_LIMIT_M.
    """
    if _is_clear(to_goal_ned_m, standing, clear_m):
        return to_goal_ned_m
    back = math.atan2(-to_goal_ned_m[1], -to_goal_ned_m[0])
    turns = sorted((math.tau * k / PLACES for k in range(PLACES)), key=lambda turn: min(turn, math.tau - turn))
    away_m = PLACE_STEP_M
    while away_m <= PLACE_LIMIT_M:
        for turn in turns:
            offset = (away_m * math.cos(back + turn), away_m * math.sin(back + turn), 0.0)
            place = add(to_goal_ned_m, offset)
            if _is_clear(place, standing, clear_m):
                return place
        away_m += PLACE_STEP_M
    return to_goal_ned_m


def _is_clear(place: Vec3, standing: Sequence[Vec3], clear_m: float) -> bool:
    return all(norm(sub(rel, place)) >= clear_m for rel in standing)
