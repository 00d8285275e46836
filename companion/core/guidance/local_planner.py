"""The way through what the obstacle sensor saw: from what a vehicle wishes to what it can fly, level.

Planned at 10 Hz (`planner`); the last stage verifies every setpoint once more (`safety`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.guidance.course_planner import CoursePlanner
from companion.core.guidance.dead_end_recovery import DeadEndRecovery
from companion.core.model.events import Position
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.safety.disturbance import DisturbanceEstimator
from companion.core.safety.safety_filter import Bound, SafetyFilter
from companion.core.safety.stopping import STEP_S, LocalObstacleCloud
from mission.common.frames import Vec3
from mission.document.model import Sensing

GUST_MARGIN_S: Final = 1.0  # more margin for each m/s by which gusts change
GUST_SHARE: Final = 0.6  # of that change, by which the way to a stop is reckoned with
GUST_MARGIN_MAX_M: Final = 1.2
PUSH_WIDENS: Final = 0.6  # share of that margin within which a vehicle is pushed away
PUSH_MAX_MPS: Final = 0.8
PLAN_S: Final = 0.1
BEYOND_M: Final = 1.0  # points this far beyond the sensor's range still matter: they were seen on the way


@final
class SensingPlanner:
    """One vehicle's."""

    __slots__ = (
        "_clear_m",
        "_course",
        "_courses",
        "_recovery",
        "_since_s",
        "_stale_s",
        "_stopping",
        "gusts",
        "wants",
        "wider_m",
    )

    def __init__(self, sensing: Sensing, safety_filter: SafetyFilter) -> None:
        self._clear_m: Final = sensing.vehicle_radius_m + sensing.margin_m
        self.wider_m = 0.0  # more than that, in gusts
        self.gusts: Final = DisturbanceEstimator()
        self._stale_s: Final = sensing.stale_s
        self._stopping: Final = safety_filter.stopping
        self._courses: Final = CoursePlanner(safety_filter.stopping)
        self._recovery: Final = DeadEndRecovery()
        self.wants: tuple[float, float] = (0.0, 0.0)  # what was planned for: the wish, or the way out of a dead end
        self._since_s = PLAN_S
        self._course: tuple[float, float] | None = None

    @property
    def clear_m(self) -> float:
        """What a vehicle that stays keeps clear: more in gusts."""
        return self._clear_m + PUSH_WIDENS * self.wider_m

    def rest(self) -> None:
        """Not steered."""
        self._courses.rest()
        self._recovery.rest()
        self.gusts.rest()
        self._since_s, self._course = PLAN_S, None

    def estimate_disturbance(self, own: Position, told_ned_mps: Vec3, dt_s: float) -> Vec3:
        """What wind adds to the setpoints, NED m/s; it widens what is kept clear. `told`: the last setpoint."""
        vel = own.vel_ned_mps
        told = (told_ned_mps[0], told_ned_mps[1])
        self.gusts.estimate_disturbance((vel[0], vel[1]), told, dt_s, self._stopping.acceleration_mps2)
        self.wider_m = min(GUST_MARGIN_MAX_M, GUST_MARGIN_S * self.gusts.change_mps)
        return (*self.gusts.level_mps, 0.0)

    def look(self, seen: ObstacleMap, own: Position, now_s: float) -> LocalObstacleCloud:
        """What stands about the vehicle, as far as scans saw. While they are stale, all is blind."""
        points = LocalObstacleCloud(
            seen.max_m - self._clear_m,
            seen.blind(now_s, fresh_s=self._stale_s),
            GUST_SHARE * self.gusts.change_mps,
            self.gusts.under_way(STEP_S, self._stopping.acceleration_mps2),
        )
        norths, easts = seen.near(own.pos_ned_m, seen.max_m + BEYOND_M)
        points.add(norths, easts, self._clear_m)
        return points

    def course(
        self,
        wish: Vec3,
        own: Position,
        last_ned_mps: Vec3,
        points: LocalObstacleCloud,
        bounds: Sequence[Bound],
        *,
        reach_m: float,
        dt_s: float,
    ) -> Vec3:
        """`wish` (NED m/s), turned and slowed so that it leads clear; rest where nothing is found to."""
        self._since_s += dt_s
        if self._since_s >= PLAN_S - 1e-9:
            self._since_s = 0.0
            vel = (own.vel_ned_mps[0], own.vel_ned_mps[1])
            last = (last_ned_mps[0], last_ned_mps[1])
            push_n, push_e = points.push(PUSH_WIDENS * self.wider_m, PUSH_MAX_MPS)
            here = (own.pos_ned_m[0], own.pos_ned_m[1])
            want = self._recovery.wish((wish[0], wish[1]), here, self._courses.side, self._courses.ahead_m, PLAN_S)
            self.wants = want
            self._course = self._courses.plan(
                (want[0] + push_n, want[1] + push_e),
                vel,
                last,
                points,
                bounds,
                clear_m=self._clear_m,
                wider_m=self.wider_m,
                reach_m=reach_m,
            )
        course = self._course
        return (0.0, 0.0, wish[2]) if course is None else (course[0], course[1], wish[2])
