"""The local planner with an obstacle sensor: through the local obstacle cloud, level, round walls, out of dead ends.

Planned at 10 Hz (`course_planner`); the safety filter verifies every setpoint once more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final, final

from companion.core.guidance import formation
from companion.core.guidance.course_planner import FREE_BEYOND_M, CoursePlanner
from companion.core.guidance.dead_end_recovery import DeadEndRecovery
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.leader_line import LeaderLine
from companion.core.guidance.local_planner import LocalPlanner, not_against
from companion.core.guidance.search.detour import Detour
from companion.core.guidance.search.known_places import KnownPlaces
from companion.core.guidance.search.path_search import WIDER_M
from companion.core.localisation.peer_table import PeerTable
from companion.core.localisation.predicted_corridors import PredictedCorridor
from companion.core.model.beacon import PeerReport
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import add, norm, scale
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, ObstacleKind
from companion.core.safety.bounds import Bound
from companion.core.safety.clearance import Use, clearance_m
from companion.core.safety.descent import LANDING_ROOM_M
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.height_layers import list_layers
from mission.document.model import Mission, Sensing

GUST_MARGIN_S: Final = 1.0  # more margin for each m/s by which gusts change
GUST_MARGIN_MAX_M: Final = 1.2
PUSH_WIDENS: Final = 0.6  # share of that margin within which a vehicle is pushed away
PUSH_MAX_MPS: Final = 0.8
PLAN_S: Final = 0.1
HASTE: Final = 1.3  # of the leader's speed, among trees: one that a tree has held up catches up
GUSTS_LEAST: Final = 0.6  # of it in gusts: the more they change, the slower
ROOM_BEYOND_M: Final = 0.2  # more than a landing wants: a push fades out where it ends
LEADER_GIVES: Final = 0.3  # of its push away from the others, among trees
# While it misses one that may be under way at its height: two at this speed see one another's hulls in time to stop
UNHEARD_MPS: Final = 2.0
UNHEARD_FROM_S: Final = 1.5  # since that one was heard: no burst of losses
UNHEARD_UNTIL_S: Final = 15.0  # for longer, and a majority would not get on whenever one hovers for good
ALL_ROUND_DEG: Final = 355.0  # with a sensor that sees less, a vehicle faces where it flies


@final
class SensingPlanner(LocalPlanner):
    """One vehicle's: courses planned at 10 Hz, wider in gusts."""

    def __init__(self, mission: Mission, sensing: Sensing, safety_filter: SafetyFilter) -> None:
        self._clear_m: Final = sensing.vehicle_radius_m + sensing.margin_m
        self.wider_m = 0.0  # more than that, in gusts: as of the last plan
        self._soft_m: Final = mission.separation.soft_m
        self._cruise_mps: Final = mission.route.vel_leader_mps
        self._has_layers: Final = len(list_layers(mission)) > 1
        self._looks_ahead: Final = sensing.field_of_view_deg < ALL_ROUND_DEG
        self._filter: Final = safety_filter
        self._courses: Final = CoursePlanner(safety_filter.response)
        self._detour: Final = Detour(FREE_BEYOND_M)
        self._recovery: Final = DeadEndRecovery()
        self._line: Final = LeaderLine()
        self._planned_for: tuple[float, float] = (0.0, 0.0)  # what is desired, or the way out of a dead end
        self._since_s = PLAN_S
        self._course: tuple[float, float] | None = None
        self._reach_m = math.inf  # how far ahead anything is in the way: a leader stops at its goal

    @property
    def clear_m(self) -> float:
        """Clearance of a vehicle that stays: more in gusts."""
        return self._clear_m + PUSH_WIDENS * self.wider_m

    def reset(self) -> None:
        """Forget the course."""
        self._courses.reset()
        self._detour.reset()
        self._recovery.reset()
        self._line.reset()
        self._since_s, self._course = PLAN_S, None

    def stop_leading(self) -> None:
        """The next lead has a line of its own."""
        self._line.reset()

    def predict_corridors(
        self, peers: PeerTable, pos_ned_m: Vec3, now_s: float, range_m: float
    ) -> Sequence[PredictedCorridor]:
        """Of those that were heard near by."""
        return peers.predict_corridors(pos_ned_m, now_s, range_m=range_m)

    def must_pause(self, now: GuidanceInput) -> bool:  # noqa: ARG002
        """Never: among trees vehicles are hidden for moments all the time, and what is near is seen."""
        return False

    def plan_leader(self, now: GuidanceInput, along: Vec3, to_goal_ned_m: Vec3, stop_m: float) -> tuple[Vec3, Vec3]:
        """Straight on, at the height of the line. Followers take the course, not the dodges: each makes its own."""
        self._reach_m = norm(to_goal_ned_m) - stop_m
        others = [*now.around.silent_ned_m, *[vehicle.rel_ned_m for vehicle in now.around.seen if not vehicle.heard]]
        push = formation.separation(now.around.neighbours, others, soft_m=self._soft_m)
        desired = add(along, not_against(scale(push, LEADER_GIVES), along))
        return along, add(desired, self._line.lead_to_height(now, to_goal_ned_m))

    def separate(self, now: GuidanceInput, course: Vec3) -> Vec3:
        """From neighbours and vehicles seen; from those that hover as far as that is not against the course.

        They are obstacles to the course planner: pushed back against its course, a follower stands before one with
        nothing left to desire, and nobody looks for the way round.
        """
        unheard = [vehicle for vehicle in now.around.seen if not vehicle.heard]
        moving_ned_m = [vehicle.rel_ned_m for vehicle in unheard if not vehicle.rests]
        resting_ned_m = [vehicle.rel_ned_m for vehicle in unheard if vehicle.rests]
        push = formation.separation(now.around.neighbours, moving_ned_m, soft_m=self._soft_m)
        away = formation.separation((), [*now.around.silent_ned_m, *resting_ned_m], soft_m=self._soft_m)
        return add(push, not_against(away, course))

    def plan_follower(self, now: GuidanceInput, desired: Vec3) -> Vec3:  # noqa: ARG002
        """As desired: `plan` leads it past."""
        return desired

    def limit_reach(self, reach_m: float) -> None:
        """For courses and detours."""
        self._reach_m = reach_m

    def plan(self, now: GuidanceInput, desired: Vec3, dt_s: float) -> Vec3:
        """Through what the sensor saw, past what hovers and the mission's own trunks."""
        around, reach_m = now.around, self._reach_m
        self._reach_m = math.inf
        self.wider_m = min(GUST_MARGIN_MAX_M, GUST_MARGIN_S * around.disturbance.change_mps)
        if now.phase is SwarmPhase.LAND:  # to room to land in: pushed there
            self.wider_m = max(self.wider_m, (LANDING_ROOM_M + ROOM_BEYOND_M - self._clear_m) / PUSH_WIDENS)
        level_mps = math.hypot(desired[0], desired[1])
        haste = max(GUSTS_LEAST, HASTE - around.disturbance.change_mps)
        most_mps = haste * self._cruise_mps
        searches = now.state is FlightState.SEEKING
        # In one height who looks for others is as fast as ever: to be late where they wait would lose them. In layers
        # they wait for long, and another part that looks for others may be in this one.
        if searches if self._has_layers else not searches and is_anyone_unheard(around.hovering.values()):
            most_mps = min(most_mps, UNHEARD_MPS)
        if level_mps > most_mps:
            desired = (desired[0] * most_mps / level_mps, desired[1] * most_mps / level_mps, desired[2])
        self._since_s += dt_s
        if self._since_s >= PLAN_S - 1e-9:
            self._since_s = 0.0
            last = add(around.commanded_ned_mps, around.drift_ned_mps)
            bounds = self._filter.separations(around)
            self._course = self._find_course(desired, around, last, bounds, reach_m)
        course = self._course
        return (0.0, 0.0, desired[2]) if course is None else (course[0], course[1], desired[2])

    def find_free(self, now: GuidanceInput) -> Callable[[float, float], bool] | None:
        """Clear of all within the sensor's range."""
        cloud = now.around.cloud
        within_m2 = cloud.sensor_m * cloud.sensor_m
        clear_m = clearance_m(ObstacleKind.SCANNED, Use.STAY, self.clear_m)
        near = [(n, e) for n, e in zip(cloud.norths, cloud.easts, strict=True) if n * n + e * e <= within_m2]
        return lambda north_m, east_m: all([math.hypot(n - north_m, e - east_m) >= clear_m for n, e in near])

    def heading(self) -> Vec3 | None:
        """With a narrow view, where it plans to, not what it flies: a trunk is passed sideways, and stays in view."""
        north, east = self._planned_for
        return (north, east, 0.0) if self._looks_ahead else None

    def _fence_from(self, around: Surroundings) -> list[tuple[float, float]]:
        """The corners of the fence from the vehicle, north and east."""
        north, east, _ = around.placed.pos_ned_m
        return [(n - north, e - east) for n, e in self._filter.polygon_m]

    def _find_course(
        self,
        desired: Vec3,
        around: Surroundings,
        last_ned_mps: Vec3,
        bounds: Sequence[Bound],
        reach_m: float,
    ) -> tuple[float, float] | None:
        """`desired` (NED m/s), turned and slowed so that it leads clear; None where nothing is found to."""
        own, cloud, told, fence = around.own, around.cloud, around.told_ned_m, self._fence_from(around)
        passed = with_known(cloud)
        # What others say alone is flown round, and moves nobody.
        push_n, push_e = (with_known(cloud, without=told) if told else passed).push_away(
            PUSH_WIDENS * self.wider_m, PUSH_MAX_MPS
        )
        here = (own.pos_ned_m[0], own.pos_ned_m[1])
        known = [
            (passed.norths[k], passed.easts[k], passed.clears_m[k])
            for k in range(len(cloud.norths), len(passed.norths))
        ]
        courses, seen = self._courses, cloud.seen_before
        # Round what stands: those that hover are passed by courses, as neighbours are
        trunks = KnownPlaces(known[len(cloud.hovering) :], fence)
        led = self._detour.lead((desired[0], desired[1]), here, reach_m, PLAN_S, seen, trunks)
        places = KnownPlaces(known, fence)
        want = self._recovery.redirect(led, here, courses.side, courses.ahead_m, PLAN_S, seen, places)
        self._planned_for = want
        return self._courses.plan(
            (want[0] + push_n, want[1] + push_e),
            (own.vel_ned_mps[0], own.vel_ned_mps[1]),
            (last_ned_mps[0], last_ned_mps[1]),
            passed,
            bounds,
            wider_m=self.wider_m,
            reach_m=reach_m,
            disturbance=around.disturbance,
            beyond_m=WIDER_M if self._recovery.follows_way else FREE_BEYOND_M,  # as the search for the way had it
        )


def is_anyone_unheard(hovering: Iterable[PeerReport]) -> bool:
    """True while one that fell silent in the air lately may be anywhere, and on its way here."""
    return any([report.silent and UNHEARD_FROM_S <= report.age_s <= UNHEARD_UNTIL_S for report in hovering])


def with_known(cloud: LocalObstacleCloud, *, without: Sequence[Vec3] = ()) -> LocalObstacleCloud:
    """The cloud with its known obstacles as points, at every height; `without` those that hover at these places."""
    passed = cloud.copy()
    for obstacles in ([one for one in cloud.hovering if one.rel_ned_m not in without], cloud.trunks):
        for obstacle in obstacles:
            clear_m = clearance_m(obstacle.kind, Use.PLAN, obstacle.keep_out_m)
            passed.add_points([obstacle.rel_ned_m[0]], [obstacle.rel_ned_m[1]], clear_m)
    return passed
