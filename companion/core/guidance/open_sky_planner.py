"""The local planner under the open sky: round the mission's own trunks and vehicles that hover, in three dimensions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, final

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.leader_line import LeaderLine
from companion.core.guidance.local_planner import LocalPlanner
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.beacon import PeerReport
from companion.core.model.vectors import add, dot, norm, scale, sub
from companion.core.perception.obstacle_cloud import Obstacle, ObstacleKind
from companion.core.safety.clearance import Use, clearance_m
from mission.common.frames import Vec3
from mission.document.model import Mission

PAUSE_S: Final = 2.5  # after the last beacon of one that falls silent: it may fly on until it has stopped
LOOK_AHEAD_M: Final = 20.0
TURNS_RAD = tuple(math.radians(15.0 * k) for k in range(12))  # away from the course, to either side
SLOPES_RAD = (0.0, math.radians(35.0), math.radians(-35.0), math.radians(70.0), math.radians(-70.0))
TURN_COST: Final = 1.0  # of half a turn
SLOPE_COST: Final = 1.2  # of straight up
BLOCKED_COST: Final = 4.0  # of no room at all
OTHER_SIDE_COST: Final = 0.3


class KeepOut(NamedTuple):
    """Obstacle from the vehicle (NED m), and how far from it one passes."""

    rel_ned_m: Vec3
    clear_m: float
    upright: bool = False  # a trunk: at every height


@final
class OpenSkyPlanner(LocalPlanner):
    """One vehicle's. It turns the course of a leader, and of a follower that moves; nothing else is planned."""

    def __init__(self, mission: Mission) -> None:
        self._soft_m: Final = mission.separation.soft_m
        self._altitude_min_m: Final = mission.fence.altitude_min_m
        self._altitude_max_m: Final = mission.fence.altitude_max_m
        self._line: Final = LeaderLine()
        self._side = 0  # on which it passes what hovers, see `turn_course`

    def reset(self) -> None:
        """Forget line and side."""
        self._line.reset()
        self._side = 0

    def stop_leading(self) -> None:
        """Forget the line."""
        self._line.reset()

    def predict_corridors(
        self,
        peers: PeerTable,  # noqa: ARG002
        pos_ned_m: Vec3,  # noqa: ARG002
        now_s: float,  # noqa: ARG002
        range_m: float,  # noqa: ARG002
    ) -> Sequence[PredictedCorridor]:
        """None: under the open sky one that falls silent hovers."""
        return ()

    def must_pause(self, now: GuidanceInput) -> bool:
        """See `has_just_fallen_silent`."""
        return has_just_fallen_silent(now.around.hovering)

    def plan_leader(self, now: GuidanceInput, along: Vec3, to_goal_ned_m: Vec3, stop_m: float) -> tuple[Vec3, Vec3]:
        """Round trunks and what hovers. Followers take the course, not what leads this one vehicle back to its line."""
        cloud = now.around.cloud
        obstacles = [*cloud.hovering, *cloud.trunks]
        course = self._turn_around(along, now, obstacles, to_goal_m=norm(to_goal_ned_m) - stop_m)
        if course != along:  # on a detour nothing leads it back
            return course, course
        return course, add(course, self._line.lead_back(now, to_goal_ned_m))

    def separate(self, now: GuidanceInput, course: Vec3) -> Vec3:  # noqa: ARG002
        """From all alike."""
        return formation.separation(now.around.neighbours, now.around.silent_ned_m, soft_m=self._soft_m)

    def plan_follower(self, now: GuidanceInput, desired: Vec3) -> Vec3:
        """Round what hovers: trunks are the leader's to pass."""
        return self._turn_around(desired, now, now.around.cloud.hovering, to_goal_m=math.inf)

    def limit_reach(self, reach_m: float) -> None:
        """Of no account: `plan` leads round nothing."""

    def plan(self, now: GuidanceInput, desired: Vec3, dt_s: float) -> Vec3:  # noqa: ARG002
        """As desired: nothing was seen."""
        return desired

    def find_free(self, now: GuidanceInput) -> Callable[[float, float], bool] | None:  # noqa: ARG002
        """It sees none."""
        return None

    def heading(self) -> Vec3 | None:
        """As the swarm goes."""
        return None

    def _turn_around(
        self, desired: Vec3, now: GuidanceInput, obstacles: Sequence[Obstacle], *, to_goal_m: float
    ) -> Vec3:
        altitude_m = -now.around.own.pos_ned_m[2]
        fence_m = clearance_m(ObstacleKind.FENCE, Use.PLAN)
        course, self._side = turn_course(
            desired,
            [KeepOut(o.rel_ned_m, clearance_m(o.kind, Use.PLAN, o.keep_out_m), o.upright) for o in obstacles],
            to_goal_m=to_goal_m,
            room_up_m=self._altitude_max_m - altitude_m - fence_m,
            room_down_m=altitude_m - self._altitude_min_m - fence_m,
            side=self._side,
        )
        return course


def has_just_fallen_silent(hovering: Mapping[int, PeerReport]) -> bool:
    """A vehicle that was heard here may not have stopped yet, nor be where it is reckoned.

    No vehicle moves on until it has. What others report does not count: a false report would hold the swarm for ever.
    """
    return any([s.silent and not s.received and s.age_s < PAUSE_S for s in hovering.values()])


def turn_course(
    desired: Vec3,
    obstacles: Sequence[KeepOut],
    *,
    to_goal_m: float,
    room_up_m: float,
    room_down_m: float,
    side: int,
) -> tuple[Vec3, int]:
    """`desired` (NED m/s), turned so that it passes clear of `obstacles`; and the side it took.

    Of a fan of courses about the desired one, level and sloping where floor and ceiling leave room, the one that turns
    least for the room it has. `side`: -1 left, 0 none, 1 right, as taken before: to change it costs, or a vehicle would
    waver before an obstacle dead ahead. `to_goal_m`: what stands behind the goal is not in the way.
    """
    speed_mps = norm(desired)
    reach_m = min(LOOK_AHEAD_M, to_goal_m)
    if not obstacles or speed_mps < 1e-6 or reach_m <= 0.0:
        return desired, 0
    ahead = scale(desired, 1.0 / speed_mps)
    if _free_m(ahead, obstacles, reach_m) >= reach_m:
        return desired, 0
    heading = math.atan2(ahead[1], ahead[0])
    clear_m = max(obstacle.clear_m for obstacle in obstacles)
    best, best_side, least = desired, side, math.inf
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


def _free_m(direction: Vec3, obstacles: Sequence[KeepOut], reach_m: float) -> float:
    """Metres that a course (unit vector) goes before it comes too near to any."""
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
