"""What the leader decides: when the swarm goes on to its next phase, and where it goes."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.states import SwarmPhase
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import AtEnd, Mission

GATHER_LIMIT_S: Final = 45.0  # beyond the climb: then those that are there depart
CLOSE_UP_LIMIT_S: Final = 10.0  # for stragglers to come to rest once the leader has arrived
TOO_FEW_LAND_S: Final = 120.0  # later still: without a majority at d1 those that are there land
STUCK_LAND_S: Final = 120.0  # a leader that comes no nearer to its goal for so long lands the swarm where it is
PROGRESS_M: Final = 1.0
PAUSE_S: Final = 2.0  # a leader that did not lead for so long has its time anew
DWELL_S: Final = 1.0  # a condition holds this long before it counts
STOP_SHARE: Final = 0.8  # of the arrival distance: the leader comes to rest inside of it


class Phases:
    """The phase as this vehicle knows it, from the leader's beacons or as leader by its own decision."""

    def __init__(self, mission: Mission, now_s: float = 0.0) -> None:
        self.phase = SwarmPhase.ASSEMBLE
        self.stop = 0  # which of the mission's visits it is bound for, or at
        self._visits = mission.visits
        self._mission = mission
        self._all = (1 << mission.swarm.size) - 1
        self._majority = mission.swarm.size // 2 + 1
        self._since_s = now_s
        self._started_s: float | None = None  # when the operator's word was first known
        self._met_since_s: float | None = None
        self._arrived_s: float | None = None
        self._nearest_m, self._nearer_s, self._led_s = math.inf, now_s, -math.inf
        climb_s = mission.route.d1_enu_m[2] / mission.limits.climb_max_mps
        self._gather_limit_s = GATHER_LIMIT_S + 2.0 * climb_s

    def adopt_phase(self, phase: SwarmPhase, now_s: float, stop: int = 0) -> None:
        """The leader has announced `phase`, at `stop`. A swarm only goes on, so an older word changes nothing."""
        if stop < len(self._visits) and _progress(phase, stop) > _progress(self.phase, self.stop):
            self.stop = stop
            self._enter(phase, now_s)

    def goal(self) -> tuple[Vec3, float] | None:
        """Where a leader goes now (NED m about the origin) and how far from it it comes to rest, in metres."""
        route = self._mission.route
        match self.phase:
            case SwarmPhase.GATHER:
                return enu_to_ned(route.d1_enu_m), 0.0
            case SwarmPhase.RETURN:
                return enu_to_ned(route.d1_enu_m), 0.0
            case SwarmPhase.TRANSIT:
                return enu_to_ned(self._visits[self.stop].pos_enu_m), STOP_SHARE * route.arrival_distance_m
            case _:
                return None

    def places_ahead(self) -> list[Vec3]:
        """Where the swarm will be found from now on, one place after the other (NED m about the origin)."""
        route = self._mission.route
        d1 = enu_to_ned(route.d1_enu_m)
        if self.phase in (SwarmPhase.GATHER, SwarmPhase.RETURN):
            return [d1]
        if self.phase not in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            return []
        places = [enu_to_ned(visit.pos_enu_m) for visit in self._visits[self.stop :]]
        return [*places, d1] if route.at_end is AtEnd.RETURN else places

    def decide_phase(self, done: int, *, to_goal_m: float, started: bool, now_s: float) -> bool:
        """One period as leader; `done` as in the beacon, from all branches. True when the phase has changed."""
        entered = self.phase
        if self._is_stuck(to_goal_m, now_s):
            self._enter(SwarmPhase.LAND, now_s)
        match self.phase:
            case SwarmPhase.ASSEMBLE:
                if self._started_s is None and started:
                    self._started_s = self._since_s = now_s
                if started and self._complete(done, self._mission.swarm.start_timeout_s, now_s):
                    self._enter(SwarmPhase.GATHER, now_s)
            case SwarmPhase.GATHER:
                at_d1 = to_goal_m <= self._mission.route.arrival_distance_m
                if at_d1 and self._complete(done, self._gather_limit_s, now_s):
                    self._enter(SwarmPhase.TRANSIT, now_s)
                elif self.overdue(now_s - TOO_FEW_LAND_S):
                    self._enter(SwarmPhase.LAND, now_s)
            case SwarmPhase.TRANSIT:
                if to_goal_m <= self._mission.route.arrival_distance_m:
                    self._enter(SwarmPhase.COVERAGE, now_s)
            case SwarmPhase.COVERAGE:
                if now_s - self._since_s >= self._visits[self.stop].duration_s:
                    if self.stop + 1 < len(self._visits):
                        self.stop += 1
                        self._enter(SwarmPhase.TRANSIT, now_s)
                    else:
                        self._enter(AFTER_COVERAGE[self._mission.route.at_end], now_s)
            case SwarmPhase.RETURN:
                if self._closed_up(done, to_goal_m, now_s):
                    self._enter(SwarmPhase.LAND, now_s)
            case SwarmPhase.LAND:
                pass
        return self.phase is not entered

    def _is_stuck(self, to_goal_m: float, now_s: float) -> bool:
        """On the way to d2 or back, and no nearer for STUCK_LAND_S."""
        led_s, self._led_s = self._led_s, now_s
        under_way = self.phase in (SwarmPhase.TRANSIT, SwarmPhase.RETURN)
        if not under_way or now_s - led_s > PAUSE_S or to_goal_m <= self._nearest_m - PROGRESS_M:
            self._nearest_m, self._nearer_s = to_goal_m, now_s
        at_goal = to_goal_m <= self._mission.route.arrival_distance_m
        return under_way and not at_goal and now_s - self._nearer_s > STUCK_LAND_S

    def turn_back(self, now_s: float) -> bool:
        """A leader's, which knows no better than to go back; True: that is news."""
        if self.phase not in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            return False
        self._enter(SwarmPhase.RETURN, now_s)
        return True

    def overdue(self, now_s: float) -> bool:
        """The swarm waits at d1 for longer than it should have to."""
        return self.phase is SwarmPhase.GATHER and now_s - self._since_s >= self._gather_limit_s

    def _complete(self, done: int, limit_s: float, now_s: float) -> bool:
        """All are done for DWELL_S, or a majority is when the time is up."""
        if done != self._all:
            self._met_since_s = None
            return now_s - self._since_s >= limit_s and done.bit_count() >= self._majority
        if self._met_since_s is None:
            self._met_since_s = now_s
        return now_s - self._met_since_s >= DWELL_S

    def _closed_up(self, done: int, to_goal_m: float, now_s: float) -> bool:
        if self._arrived_s is None:
            if to_goal_m > self._mission.route.arrival_distance_m:
                return False
            self._arrived_s = now_s
        return done == self._all or now_s - self._arrived_s >= CLOSE_UP_LIMIT_S

    def _enter(self, phase: SwarmPhase, now_s: float) -> None:
        self.phase = phase
        self._since_s = self._nearer_s = now_s
        self._nearest_m = math.inf
        self._met_since_s = self._arrived_s = None


def _progress(phase: SwarmPhase, stop: int) -> tuple[bool, int, SwarmPhase]:
    """Greater: further on. The end of a mission is the end, from wherever."""
    return (phase >= SwarmPhase.RETURN, stop if phase < SwarmPhase.RETURN else 0, phase)


AFTER_COVERAGE = {
    AtEnd.HOLD: SwarmPhase.COVERAGE,
    AtEnd.LAND: SwarmPhase.LAND,
    AtEnd.RETURN: SwarmPhase.RETURN,
}
