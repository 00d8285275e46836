"""The phases of a swarm: the table of what takes it from one to the next, by its leader's decision, and their goals."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from companion.core.model.states import SwarmPhase
from mission.common.forming import GAP_WINDOW_S, FormingTime
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import AtEnd, Mission
from mission.lanes.spread import PASS_M

GATHER_LIMIT_S: Final = 45.0  # beyond the climb: then those that are there depart
CLOSE_UP_LIMIT_S: Final = 10.0  # for stragglers to come to rest once the leader has arrived
TOO_FEW_LAND_S: Final = 120.0  # later still: without a majority at d1 those that are there land
STUCK_LAND_S: Final = 120.0  # a leader that comes no nearer to its goal for so long lands the swarm where it is
PROGRESS_M: Final = 1.0
PAUSE_S: Final = 2.0  # a leader that did not lead for so long has its time anew
DWELL_S: Final = 1.0  # a condition holds this long before it counts
LANE_WAIT_S: Final = 5.0  # within the arrival distance: a trunk stands there
LANE_GIVE_UP_S: Final = 90.0  # farther off, but not two ends in succession
ENDS_OF_LANE: Final = 2  # visits
STOP_SHARE: Final = 0.8  # of the arrival distance: the leader comes to rest inside of it


class PhaseEvent(Enum):
    """The conditions under which a leader takes the swarm on; the value says each in words."""

    STAND_KNOWN = "the first lane has been flown, and the leader knows the stand as well as the mission asks for"
    PASSED = f"the leader is at the end of a lane; or near it, or for {LANE_GIVE_UP_S:.0f} s, and comes no nearer"
    STUCK = f"the leader has come no nearer to its goal for {STUCK_LAND_S:.0f} s, and waited for nobody"
    ASSEMBLED = "the flight is allowed, and all are ready; or a majority is, and the time is up"
    GATHERED = "the leader is at d1, and all have gathered there; or a majority has, and the time is up"
    TOO_FEW = f"too few have gathered at d1, {TOO_FEW_LAND_S:.0f} s after the time was up"
    ARRIVED = "the leader is at its goal, which is no end of a lane"
    NEXT_TREE = "the time at this tree is up, and another one follows"
    COVERED_RETURNS = "the time at the last tree is up, the ring has formed or cannot, and the mission ends at d1"
    COVERED_LANDS = "the time at the last tree is up, the ring has formed or cannot, and the mission ends there"
    CLOSED_UP = "the leader is at d1, and all are; or stragglers have had their time"


# In each phase the first event that has happened decides. At the end of a mission that holds none does.
TRANSITIONS: dict[SwarmPhase, list[tuple[PhaseEvent, SwarmPhase]]] = {
    SwarmPhase.ASSEMBLE: [(PhaseEvent.ASSEMBLED, SwarmPhase.GATHER)],
    SwarmPhase.GATHER: [(PhaseEvent.GATHERED, SwarmPhase.TRANSIT), (PhaseEvent.TOO_FEW, SwarmPhase.LAND)],
    SwarmPhase.TRANSIT: [
        (PhaseEvent.STAND_KNOWN, SwarmPhase.TRANSIT),
        (PhaseEvent.PASSED, SwarmPhase.TRANSIT),
        (PhaseEvent.STUCK, SwarmPhase.LAND),
        (PhaseEvent.ARRIVED, SwarmPhase.COVERAGE),
    ],
    SwarmPhase.COVERAGE: [
        (PhaseEvent.NEXT_TREE, SwarmPhase.TRANSIT),
        (PhaseEvent.COVERED_RETURNS, SwarmPhase.RETURN),
        (PhaseEvent.COVERED_LANDS, SwarmPhase.LAND),
    ],
    SwarmPhase.RETURN: [(PhaseEvent.STUCK, SwarmPhase.LAND), (PhaseEvent.CLOSED_UP, SwarmPhase.LAND)],
    SwarmPhase.LAND: [],
}


class Phases:
    """The phase as this vehicle knows it, from the leader's beacons or as leader by its own decision."""

    def __init__(self, mission: Mission, now_s: float = 0.0) -> None:
        self.phase = SwarmPhase.ASSEMBLE
        self.stop = 0  # which of the mission's visits it is bound for, or at
        self.saw_begin = True  # of the phase: not one of which it has heard later
        self._visits = mission.visits
        self._mission = mission
        self._all = (1 << mission.swarm.size) - 1
        self._majority = mission.swarm.size // 2 + 1
        self.since_s = now_s
        self._forming = FormingTime(self._mission.coverage.duration_s, now_s)
        self._until = None if mission.survey is None else mission.survey.until
        self._knows_stand = False  # by the own records, as well as the mission asks for
        self._started = False  # the operator's word is known
        self._gave_up = False  # the lane's end before this goal
        self._met_since_s: float | None = None
        self._arrived_s: float | None = None
        self._nearest_m, self._nearer_s, self._led_s = math.inf, now_s, -math.inf
        climb_s = mission.route.d1_enu_m[2] / mission.limits.climb_max_mps
        self.gather_limit_s: Final = GATHER_LIMIT_S + 2.0 * climb_s
        self._held_s, self._ticked_s = 0.0, now_s  # all times here stand still while an operator holds the swarm
        self._held_before_s = 0.0  # of it: before this phase

    def obey(self, now_s: float, *, holds: bool, lands: bool) -> None:
        """Each tick: whether an operator's order stops the phases' time, or ends the mission."""
        if holds:
            self._held_s += now_s - self._ticked_s
        self._ticked_s = now_s
        if lands and self.phase is not SwarmPhase.LAND:
            self._enter_phase(SwarmPhase.LAND, self._mission_s(now_s))

    def _mission_s(self, now_s: float) -> float:
        """`now_s` by a clock that does not run while an operator holds the swarm."""
        return now_s - self._held_s

    def is_step(self, following: SwarmPhase, its_stop: int) -> bool:
        """This phase leads to that one at once, by the table of phases; the mission may not have it so soon."""
        if self.phase is SwarmPhase.TRANSIT and following is SwarmPhase.TRANSIT:
            last = len(self._visits) - 1
            # To who has missed the end of the first lane a step is missing, and the leader's word is not false
            skips = its_stop == last and self.may_skip_lanes(self.stop)
            return self._is_passing and (its_stop == self.stop + 1 or skips)
        return is_step(self.phase, self.stop, following, its_stop)

    def elapsed_s(self, now_s: float) -> float:
        """Since this phase began, without the time for which an operator held this vehicle."""
        return self._mission_s(now_s) - self.since_s

    def most_elapsed_s(self, now_s: float) -> float:
        """The same with that time: as long as it may be for a leader that was not held."""
        return now_s - self._held_before_s - self.since_s

    def adopt_phase(self, phase: SwarmPhase, now_s: float, stop: int = 0) -> None:
        """The leader has announced `phase`, at `stop`. A swarm only goes on, so an older word changes nothing."""
        if stop < len(self._visits) and progress_of(phase, stop) > progress_of(self.phase, self.stop):
            self.saw_begin = self.is_step(phase, stop)
            self.stop = stop
            self._enter_phase(phase, self._mission_s(now_s))

    def goal(self) -> tuple[Vec3, float] | None:
        """A leader's goal now (NED m about the origin), and how far from it it comes to rest, in metres."""
        route = self._mission.route
        match self.phase:
            case SwarmPhase.GATHER:
                return enu_to_ned(route.d1_enu_m), 0.0
            case SwarmPhase.RETURN:
                return enu_to_ned(route.d1_enu_m), 0.0
            case SwarmPhase.TRANSIT:
                visit = self._visits[self.stop]
                return enu_to_ned(visit.pos_enu_m), 0.0 if visit.is_passed else STOP_SHARE * route.arrival_distance_m
            case _:
                return None

    def stops_ahead(self) -> list[Vec3]:
        """The positions where the swarm will be found from now on, in their order (NED m about the origin)."""
        route = self._mission.route
        d1 = enu_to_ned(route.d1_enu_m)
        if self.phase in (SwarmPhase.GATHER, SwarmPhase.RETURN):
            return [d1]
        if self.phase not in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            return []
        positions = [enu_to_ned(visit.pos_enu_m) for visit in self._visits[self.stop :]]
        return [*positions, d1] if route.at_end is AtEnd.RETURN else positions

    def decide_phase(self, done: int, *, to_goal_m: float, started: bool, now_s: float, waits: bool = False) -> bool:
        """One period as leader; `done` as in the beacon, from all branches. True when the phase has changed.

        `waits`: for others, so that it need come no nearer to its goal.
        """
        now_s = self._mission_s(now_s)
        self._update_progress(to_goal_m, now_s, waits=waits)
        if self.phase is SwarmPhase.ASSEMBLE and started and not self._started:
            self._started, self.since_s = True, now_s
        for event, phase in TRANSITIONS[self.phase]:
            if self._has_happened(event, done, to_goal_m, now_s):
                self.saw_begin = True
                if event is PhaseEvent.PASSED:
                    self._gave_up = to_goal_m > self._mission.route.arrival_distance_m
                if event is PhaseEvent.NEXT_TREE or event is PhaseEvent.PASSED:
                    self.stop += 1
                elif event is PhaseEvent.STAND_KNOWN:
                    self.stop = len(self._visits) - 1
                self._enter_phase(phase, now_s)
                return True
        return False

    def _has_happened(self, event: PhaseEvent, done: int, to_goal_m: float, now_s: float) -> bool:
        at_goal = to_goal_m <= self._mission.route.arrival_distance_m
        match event:
            case PhaseEvent.STAND_KNOWN:
                return self._knows_stand and self.may_skip_lanes(self.stop)
            case PhaseEvent.PASSED:
                return self._is_passing and self._has_passed(to_goal_m, now_s)
            case PhaseEvent.STUCK:
                return not at_goal and now_s - self._nearer_s > STUCK_LAND_S
            case PhaseEvent.ASSEMBLED:
                return self._started and self._complete(done, self._mission.swarm.start_timeout_s, now_s)
            case PhaseEvent.GATHERED:
                return at_goal and self._complete(done, self.gather_limit_s, now_s)
            case PhaseEvent.TOO_FEW:
                return self._is_overdue(now_s - TOO_FEW_LAND_S)
            case PhaseEvent.ARRIVED:
                return at_goal and not self._is_passing
            case PhaseEvent.NEXT_TREE:
                return self._is_covered(now_s) and not self._at_last
            case PhaseEvent.COVERED_RETURNS:
                return self._is_covered(now_s) and self._at_last and self._mission.route.at_end is AtEnd.RETURN
            case PhaseEvent.COVERED_LANDS:
                return self._is_covered(now_s) and self._at_last and self._mission.route.at_end is AtEnd.LAND
            case PhaseEvent.CLOSED_UP:
                return self._closed_up(done, at_goal=at_goal, now_s=now_s)

    def _has_passed(self, to_goal_m: float, now_s: float) -> bool:
        """The leader is at the end of a lane, or as near as it gets to it."""
        waited_s = now_s - self._nearer_s
        is_near = to_goal_m <= self._mission.route.arrival_distance_m
        given_up = waited_s > LANE_GIVE_UP_S and not self._gave_up
        return to_goal_m <= PASS_M or (is_near and waited_s > LANE_WAIT_S) or given_up

    def _update_progress(self, to_goal_m: float, now_s: float, *, waits: bool) -> None:
        """Notes when the leader last came nearer to its goal, on the way to d2 or back; later by what it waits."""
        led_s, self._led_s = self._led_s, now_s
        under_way = self.phase in (SwarmPhase.TRANSIT, SwarmPhase.RETURN)
        if not under_way or now_s - led_s > PAUSE_S or to_goal_m <= self._nearest_m - PROGRESS_M:
            self._nearest_m, self._nearer_s = to_goal_m, now_s
        elif waits:
            self._nearer_s += now_s - led_s

    def is_passed(self, stop: int) -> bool:
        """This visit is the end of a lane."""
        return self._visits[stop].is_passed

    def may_skip_lanes(self, stop: int) -> bool:
        """From the way to this visit the mission has a leader go on to d2 at once: the first lane has been flown."""
        return self._until is not None and stop >= ENDS_OF_LANE and self.is_passed(stop)

    @property
    def _is_passing(self) -> bool:
        return self.is_passed(self.stop)

    @property
    def _at_last(self) -> bool:
        """At the last tree, or on the way there."""
        return self.stop + 1 == len(self._visits)

    def note_stand(self, basal_area_pct: float | None) -> None:
        """The interval of the basal area, by the records that this vehicle has (`StandMeasured`).

        A leader ends coverage by it, but never before `until.after_s`, and leaves out lanes, but never the first; who
        follows it goes by the time and the lane alone.
        """
        until = self._until
        self._knows_stand = until is not None and basal_area_pct is not None and basal_area_pct <= until.basal_area_pct

    def is_near_end(self, now_s: float) -> bool:
        """The swarm is at the last tree, and whether it has formed counts from now on (see `note_unformed`)."""
        if self.phase is not SwarmPhase.COVERAGE or not self._at_last:
            return False
        now_s, until = self._mission_s(now_s), self._until
        is_near_least = until is not None and now_s - self.since_s >= until.after_s - GAP_WINDOW_S
        return is_near_least or self._forming.is_near_end(now_s)

    def note_unformed(self, now_s: float) -> None:
        """The ring or sphere is not formed now: the leader goes on with its coverage."""
        self._forming.note_unformed(self._mission_s(now_s))

    def _is_covered(self, now_s: float) -> bool:
        """The swarm has been at this tree for its time, or knows the stand; and has formed about the last one."""
        until = self._until
        is_enough = self._knows_stand and until is not None and now_s - self.since_s >= until.after_s
        if self._at_last:
            return self._forming.is_over(now_s) or (is_enough and self._forming.has_formed(now_s))
        return is_enough or now_s - self.since_s >= self._visits[self.stop].duration_s

    def turn_back(self, now_s: float) -> bool:
        """A leader's, which knows no better than to go back; True: that is news."""
        if self.phase not in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            return False
        self._enter_phase(SwarmPhase.RETURN, self._mission_s(now_s))
        return True

    def overdue(self, now_s: float) -> bool:
        """The swarm waits at d1 for longer than it should have to."""
        return self._is_overdue(self._mission_s(now_s))

    def _is_overdue(self, now_s: float) -> bool:
        return self.phase is SwarmPhase.GATHER and now_s - self.since_s >= self.gather_limit_s

    def _complete(self, done: int, limit_s: float, now_s: float) -> bool:
        """All are done for DWELL_S, or a majority is when the time is up."""
        if done != self._all:
            self._met_since_s = None
            return now_s - self.since_s >= limit_s and done.bit_count() >= self._majority
        if self._met_since_s is None:
            self._met_since_s = now_s
        return now_s - self._met_since_s >= DWELL_S

    def _closed_up(self, done: int, *, at_goal: bool, now_s: float) -> bool:
        """All are at d1, or have had their time since the leader arrived."""
        if self._arrived_s is None:
            if not at_goal:
                return False
            self._arrived_s = now_s
        return done == self._all or now_s - self._arrived_s >= CLOSE_UP_LIMIT_S

    def _enter_phase(self, phase: SwarmPhase, now_s: float) -> None:
        """From now on."""
        self.phase = phase
        self.since_s = self._nearer_s = now_s
        self._held_before_s = self._held_s
        self._nearest_m = math.inf
        self._forming = FormingTime(self._visits[self.stop].duration_s, now_s)
        self._met_since_s = self._arrived_s = None


def progress_of(phase: SwarmPhase, stop: int) -> tuple[bool, int, SwarmPhase]:
    """Greater: further on. The end of a mission is the end, from wherever."""
    return (phase >= SwarmPhase.RETURN, stop if phase < SwarmPhase.RETURN else 0, phase)


def is_step(phase: SwarmPhase, stop: int, following: SwarmPhase, its_stop: int) -> bool:
    """The one leads to the other at once, by the table of phases, lanes left out; the mission may not have it."""
    match phase:
        case SwarmPhase.ASSEMBLE:
            return following is SwarmPhase.GATHER
        case SwarmPhase.GATHER:
            return following is SwarmPhase.LAND or (following is SwarmPhase.TRANSIT and its_stop == 0)
        case SwarmPhase.TRANSIT:
            return following >= SwarmPhase.RETURN or (following is SwarmPhase.COVERAGE and its_stop == stop)
        case SwarmPhase.COVERAGE:
            return following >= SwarmPhase.RETURN or (following is SwarmPhase.TRANSIT and its_stop == stop + 1)
        case _:
            return following is SwarmPhase.LAND
