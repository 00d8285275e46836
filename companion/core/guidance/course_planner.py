"""The course through trees: of a fan of courses and speeds, the cheapest that is verified to a stop.

Level: what is desired up or down is not touched. docs/explanation/trees.md tells why it is so, and what it brings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.safety.bounds import Bound
from companion.core.safety.response_model import CALM, CREEP_MPS, DEAD_S, SPEED_MARGIN_S, Disturbance, ResponseModel

COURSES: Final = 30  # to either side of the desired
COURSE_STEP_RAD = math.radians(5.0)
ALL_ROUND: Final = 72  # such steps
SPEEDS = (1.0, 0.67, 0.34)  # shares of the desired speed
SPEED_WIDENS = (1.0, 0.8, 0.6)  # share of the margin for gusts that each speed keeps
LOOK_AHEAD_M: Final = 8.0
AHEAD_S: Final = 0.25  # free way is measured from where the vehicle is by then
FREE_BEYOND_M: Final = 0.25  # what a free course keeps beyond a verified way's clearance
SEEN_SHARE: Final = 0.97  # of the reach: the last of it is for rounding
HOLD_S: Final = 0.3  # a candidate is flown for so long before the vehicle brakes
VERIFIED_MAX: Final = 12  # candidates that are verified in one plan

TURN_COST: Final = 0.8  # of a right angle
BLOCKED_COST: Final = 1.5  # of no free way at all
SLOW_COST: Final = 0.5  # of standing still
CHANGE_COST_S: Final = 0.033  # of each m/s away from the course before
FLIP_COST: Final = 0.15  # of passing on the other side than before
HOPELESS_COST: Final = 3.0  # of a free way shorter than the way to a stop: it is tried last
CLOSE_COST: Final = 4.0  # of closing on a neighbour too fast, and as much again for each m/s of it

REST_MPS: Final = 0.05  # below it the vehicle stands


@final
class CoursePlanner:
    """One vehicle's. `plan` at each planning tick."""

    __slots__ = ("_course", "_response", "ahead_m", "side", "verified")

    def __init__(self, response: ResponseModel) -> None:
        self._response = response
        self.reset()
        self.verified = 0  # how many candidates the last plan tried
        self.ahead_m = math.inf  # free way along the last desired

    def reset(self) -> None:
        """Forget the course."""
        self._course: tuple[float, float] = (0.0, 0.0)
        self.side = 0

    def plan(
        self,
        desired: tuple[float, float],
        vel: tuple[float, float],
        last: tuple[float, float],
        cloud: LocalObstacleCloud,
        bounds: Sequence[Bound],
        *,
        wider_m: float,
        reach_m: float,
        disturbance: Disturbance = CALM,
        beyond_m: float = FREE_BEYOND_M,
    ) -> tuple[float, float] | None:
        """Level velocity (north, east) in place of the desired; None: no candidate leads clear.

        `wider_m`: more than the cloud's clearances, for gusts; `reach_m`: how far ahead anything matters.
        `bounds`: on closing on neighbours, which cost. `beyond_m`: what a free course keeps beyond the clearances.
        """
        desired_mps = min(math.hypot(desired[0], desired[1]), self._seen_mps(cloud, disturbance))
        self.verified = 0
        if desired_mps < REST_MPS:
            self._course = (0.0, 0.0)
            return desired
        reach_m = min(LOOK_AHEAD_M, max(reach_m, 0.5))
        heading = math.atan2(desired[1], desired[0])
        free_m = self._free_ways(cloud, disturbance, vel, heading, wider_m + beyond_m, reach_m)
        self.ahead_m = free_m[COURSES]
        costs = self._costs(desired_mps, heading, free_m, reach_m, bounds, beyond_m)
        passed: list[LocalObstacleCloud | None] = [None] * len(SPEEDS)
        for _ in range(len(costs)):
            if self.verified >= VERIFIED_MAX:
                break
            least, chosen = math.inf, -1
            for k in range(len(costs)):
                if costs[k] < least:
                    least, chosen = costs[k], k
            if chosen < 0:
                break
            costs[chosen] = math.inf
            turn, z = chosen // len(SPEEDS) - COURSES, chosen % len(SPEEDS)
            speed_mps = SPEEDS[z] * desired_mps
            angle = heading + turn * COURSE_STEP_RAD
            tried = (speed_mps * math.cos(angle), speed_mps * math.sin(angle))
            if not self._is_way_seen(cloud, tried, vel, disturbance):
                continue
            self.verified += 1
            wide = passed[z]
            if wide is None:
                passed[z] = wide = cloud.widened(wider_m * SPEED_WIDENS[z] + SPEED_MARGIN_S * speed_mps)
            if self._response.is_clear(wide, vel, last, tried, HOLD_S, slews=True, disturbance=disturbance):
                self._course = tried
                side = (turn > 1) - (turn < -1)
                self.side = side or self.side
                return tried
        return None

    def _is_way_seen(
        self, cloud: LocalObstacleCloud, tried: tuple[float, float], vel: tuple[float, float], disturbance: Disturbance
    ) -> bool:
        """Nothing can stand unseen where the vehicle would come to rest: a trunk that is near hides those behind it."""
        speed_mps = math.hypot(tried[0], tried[1])
        if cloud.sight is None or speed_mps <= CREEP_MPS:
            return True
        start = _acts_at(vel, disturbance)
        ahead_m = HOLD_S * speed_mps + self._response.way_m(speed_mps)
        return cloud.sight.is_way_free(start, (tried[0] / speed_mps, tried[1] / speed_mps), ahead_m)

    def _seen_mps(self, cloud: LocalObstacleCloud, disturbance: Disturbance) -> float:
        """The speed from which a vehicle that flies on for HOLD_S stops within what it sees."""
        reach_m = SEEN_SHARE * cloud.reach_m
        return max(CREEP_MPS, self._response.speed_mps(reach_m, disturbance.dead_s + HOLD_S))

    def _free_ways(
        self,
        cloud: LocalObstacleCloud,
        disturbance: Disturbance,
        vel: tuple[float, float],
        heading: float,
        wider_m: float,
        reach_m: float,
    ) -> list[float]:
        """For each course, how far it is free, at most `reach_m`; `wider_m`: more than each point's clearance."""
        free_m = [reach_m] * (2 * COURSES + 1)
        from_n, from_e = AHEAD_S * vel[0], AHEAD_S * vel[1]
        if disturbance.under_way is not None:
            from_n, from_e = disturbance.under_way[0], disturbance.under_way[1]
        norths, easts, clears_m = cloud.norths, cloud.easts, cloud.clears_m
        for k in range(len(norths)):
            n, e = norths[k] - from_n, easts[k] - from_e
            clear_m = clears_m[k] + wider_m
            away_m2 = n * n + e * e
            if away_m2 >= (reach_m + clear_m) * (reach_m + clear_m):
                continue
            away_m = math.sqrt(away_m2)
            bearing = math.remainder(math.atan2(e, n) - heading, math.tau)
            half = math.asin(clear_m / away_m) if away_m > clear_m else math.pi / 2.0
            first = math.ceil((bearing - half) / COURSE_STEP_RAD)
            final = math.floor((bearing + half) / COURSE_STEP_RAD)
            for turn in range(first, final + 1):
                course = turn
                if turn > COURSES:  # what is near behind bars courses to both sides
                    course = turn - ALL_ROUND
                elif turn < -COURSES:
                    course = turn + ALL_ROUND
                if not -COURSES <= course <= COURSES:
                    continue
                off = turn * COURSE_STEP_RAD - bearing
                if away_m <= clear_m:
                    room_m = 0.0
                else:
                    aside = away_m * math.sin(off)
                    room_m = away_m * math.cos(off) - math.sqrt(max(0.0, clear_m * clear_m - aside * aside))
                if room_m < free_m[course + COURSES]:
                    free_m[course + COURSES] = room_m
        return free_m

    def _costs(
        self,
        desired_mps: float,
        heading: float,
        free_m: list[float],
        reach_m: float,
        bounds: Sequence[Bound],
        beyond_m: float,
    ) -> list[float]:
        """Of each course at each speed, courses from left to right."""
        costs: list[float] = []
        tight = [bound for bound in bounds if bound.most_mps < desired_mps]
        side = self.side
        old_n, old_e = self._course
        ways_m = [self._response.way_m(share * desired_mps) - beyond_m for share in SPEEDS]
        for k in range(len(free_m)):
            turn = k - COURSES
            angle = heading + turn * COURSE_STEP_RAD
            n, e = math.cos(angle), math.sin(angle)
            cost = TURN_COST * abs(turn) * COURSE_STEP_RAD / (math.pi / 2.0)
            cost += BLOCKED_COST * (1.0 - max(0.0, free_m[k]) / reach_m) * (reach_m / LOOK_AHEAD_M)
            if turn * side < 0:
                cost += FLIP_COST
            for z in range(len(SPEEDS)):
                speed_mps = SPEEDS[z] * desired_mps
                c_n, c_e = n * speed_mps, e * speed_mps
                total = cost + SLOW_COST * z / 3.0
                if free_m[k] < min(reach_m, ways_m[z]):
                    total += HOPELESS_COST
                d_n, d_e = c_n - old_n, c_e - old_e
                total += CHANGE_COST_S * math.sqrt(d_n * d_n + d_e * d_e)
                for bound in tight:
                    excess_mps = c_n * bound.along[0] + c_e * bound.along[1] - bound.most_mps
                    if excess_mps > 0.0:
                        total += CLOSE_COST * (1.0 + excess_mps)
                costs.append(total)
        return costs


def _acts_at(vel: tuple[float, float], disturbance: Disturbance) -> tuple[float, float]:
    """Place of the vehicle when the next setpoint acts, north and east from here."""
    under_way = disturbance.under_way
    if under_way is not None:
        return under_way[0] + DEAD_S * (vel[0] + under_way[2]), under_way[1] + DEAD_S * (vel[1] + under_way[3])
    return disturbance.dead_s * vel[0], disturbance.dead_s * vel[1]
