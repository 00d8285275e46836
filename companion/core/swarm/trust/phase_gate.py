"""The gate for announced phases: one step at a time, as the mission has them, and not by one relay's word alone.

A phase is its leader's to announce. Who hears the leader goes by the leader's own word; who does not, by two members'
where it has two ways to the leader. A leader itself goes over to a phase further on when two say so (it has joined a
part that is). What the mission never does, or not so soon, is refused whoever says so; but that the swarm lands is not
where the leader and another say it: an operator may have told them. Of positions only differences count, by the own
odometry, and a follower never asks where d2 is (rule 5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, final

from companion.core.model.beacon import Beacon
from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import LANE_GIVE_UP_S, STUCK_LAND_S, Phases, progress_of
from mission.common.frames import Vec3
from mission.document.model import AtEnd, Mission, PositionUncertain

HEARD_PERIODS: Final = 15  # so long a member's last word counts, as in an election's echo
WITNESSES: Final = 2  # F + 1: one of them is honest
EARLY_SHARE: Final = 0.8  # of a time by the mission: news of a phase takes as long as it is late
EARLY_S: Final = 1.0
BACK_SHARE: Final = 0.3  # of the way that it has been from d1: nearer, it is back there


@dataclass(slots=True, init=False)
class _Word:
    """A member's last word of the phase."""

    phase: Final[SwarmPhase]
    stop: Final[int]
    leader: Final[int]
    hop: Final[int]
    at_s: Final[float]

    def __init__(self, phase: SwarmPhase, stop: int, leader: int, hop: int, at_s: float) -> None:
        self.phase = phase
        self.stop = stop
        self.leader = leader
        self.hop = hop
        self.at_s = at_s


@final
class PhaseGate:
    """One vehicle's; bounded by the swarm's size."""

    __slots__ = (
        "_at_end",
        "_back_m",
        "_durations_s",
        "_farthest_m",
        "_from_ned_m",
        "_heard_s",
        "_lane_ways_s",
        "_me",
        "_pos_ned_m",
        "_words",
        "may_turn_back",
    )

    def __init__(self, mission: Mission, me: int) -> None:
        self._me: Final = me
        self._heard_s: Final = HEARD_PERIODS / mission.radio.beacon_rate_hz
        until = None if mission.survey is None else mission.survey.until
        most_s = math.inf if until is None else until.after_s  # from then on a leader may know the stand well enough
        self._durations_s: Final = [min(visit.duration_s, most_s) for visit in mission.visits]
        # The least time on the way to each lane's end, in a straight line, at full speed; a leader may give it up
        near_m, speed_mps = 2.0 * mission.route.arrival_distance_m, mission.limits.speed_max_mps
        self._lane_ways_s: Final = [
            min(LANE_GIVE_UP_S, max(0.0, math.dist(here, there) - near_m) / speed_mps)
            for here, there in pairwise(mission.way_enu_m)
        ]
        self._at_end: Final = mission.route.at_end
        self._back_m: Final = mission.radio.full_range_m  # a straggler is landed where it hears of it
        vehicles = range(1, mission.swarm.size + 1)
        loses = not all([mission.has_satellites(k) for k in vehicles])
        self.may_turn_back = loses and mission.swarm.position_uncertain is PositionUncertain.RETURN
        self._words: dict[int, _Word] = {}
        self._pos_ned_m: Vec3 | None = None
        self._from_ned_m: Vec3 | None = None  # where it was when the swarm left d1
        self._farthest_m = 0.0  # from there

    def note_position(self, pos_ned_m: Vec3, phase: SwarmPhase) -> None:
        """Each period: the own odometry."""
        self._pos_ned_m = pos_ned_m
        if phase <= SwarmPhase.GATHER:
            self._from_ned_m, self._farthest_m = pos_ned_m, 0.0
        elif self._from_ned_m is not None:
            self._farthest_m = max(self._farthest_m, math.dist(pos_ned_m, self._from_ned_m))

    def store(self, beacon: Beacon, now_s: float) -> None:
        """A member's word."""
        lease = beacon.lease
        if lease is not None:
            hop = 0 if lease.leader == beacon.sender else max(1, beacon.hop)
            self._words[beacon.sender] = _Word(beacon.phase, beacon.stop, lease.leader, hop, now_s)
        else:
            self._words.pop(beacon.sender, None)

    def is_believed(self, beacon: Beacon, phases: Phases, hop: int, now_s: float, *, is_news: bool) -> bool:
        """The phase that this beacon tells may be gone over to. `hop`: the own distance from the leader.

        `is_news`: its lease has just renewed that of the leader that is followed.
        """
        lease = beacon.lease
        if lease is None:
            return False
        said = progress_of(beacon.phase, beacon.stop)
        if said <= progress_of(phases.phase, phases.stop):
            return False  # no news
        fresh = {k: w for k, w in self._words.items() if now_s - w.at_s <= self._heard_s}
        followers = {k: w for k, w in fresh.items() if w.leader == lease.leader}
        agree = [k for k, w in followers.items() if progress_of(w.phase, w.stop) >= said]
        if lease.leader == self._me:
            needed = WITNESSES if phases.phase > SwarmPhase.ASSEMBLE and len(fresh) > 1 else 1
        elif beacon.sender == lease.leader:
            needed = 1
        else:
            nearer = sum([w.hop < hop for w in followers.values()])
            needed = WITNESSES if lease.leader in followers or nearer > 1 or not is_news else 1
        steps = phases.is_step(beacon.phase, beacon.stop)
        if not steps and phases.phase > SwarmPhase.ASSEMBLE and len(fresh) > 1:
            needed = WITNESSES  # it has missed some: so the leader's word alone will not do
        if len(agree) < needed:
            return False
        may_be_ordered = beacon.phase is SwarmPhase.LAND and lease.leader in agree and len(agree) >= WITNESSES
        return not steps or may_be_ordered or self.is_possible(beacon.phase, beacon.stop, phases, now_s)

    def is_possible(self, phase: SwarmPhase, stop: int, phases: Phases, now_s: float) -> bool:
        """The mission has this step, and not sooner. Who has not seen the phase before begin knows no times."""
        since_s = phases.most_elapsed_s(now_s) if phases.saw_begin else math.inf
        match phases.phase, phase:
            case SwarmPhase.GATHER, SwarmPhase.LAND:
                return since_s >= EARLY_SHARE * phases.gather_limit_s
            case (SwarmPhase.TRANSIT, SwarmPhase.TRANSIT):
                skips = stop + 1 == len(self._durations_s) and phases.may_skip_lanes(phases.stop)
                return skips or self._may_pass(stop, phases.stop, since_s)
            case (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
                return not phases.is_passed(stop)
            case (SwarmPhase.TRANSIT, SwarmPhase.RETURN):
                return self.may_turn_back
            case (SwarmPhase.TRANSIT, SwarmPhase.LAND):
                return since_s >= EARLY_SHARE * STUCK_LAND_S
            case (SwarmPhase.RETURN, SwarmPhase.LAND):
                return since_s >= EARLY_SHARE * STUCK_LAND_S or self._is_back()
            case (SwarmPhase.COVERAGE, _):
                return self._may_leave(phase, stop, phases.stop, since_s)
        return True

    def is_foul(self, beacon: Beacon, phases: Phases, now_s: float) -> bool:
        """A step that the mission does not have now; to land when it is back, only a straggler cannot see."""
        said = progress_of(beacon.phase, beacon.stop)
        if said <= progress_of(phases.phase, phases.stop) or phases.phase is SwarmPhase.RETURN:
            return False
        return phases.is_step(beacon.phase, beacon.stop) and not self.is_possible(
            beacon.phase, beacon.stop, phases, now_s
        )

    def _may_pass(self, stop: int, at_stop: int, since_s: float) -> bool:
        """It may go on from a lane's end: whoever leads has had the time to fly there."""
        return stop == at_stop + 1 and since_s >= EARLY_SHARE * self._lane_ways_s[at_stop] - EARLY_S

    def _may_leave(self, phase: SwarmPhase, stop: int, at_stop: int, since_s: float) -> bool:
        """It may go on from a tree."""
        if phase is SwarmPhase.RETURN and self.may_turn_back:
            return True
        if since_s < EARLY_SHARE * self._durations_s[at_stop] - EARLY_S:
            return False
        is_last = at_stop + 1 == len(self._durations_s)
        match phase:
            case SwarmPhase.TRANSIT:
                return stop == at_stop + 1 and not is_last
            case SwarmPhase.RETURN:
                return is_last and self._at_end is AtEnd.RETURN
            case _:
                return is_last and self._at_end is AtEnd.LAND

    def _is_back(self) -> bool:
        """By the own odometry it is about as near to where it left d1 as it was then."""
        if self._pos_ned_m is None or self._from_ned_m is None:
            return True
        away_m = math.dist(self._pos_ned_m, self._from_ned_m)
        return away_m <= max(self._back_m, BACK_SHARE * self._farthest_m)
