"""The watch on a leader, by what is observed here: how it came to lead, and where its lead has brought this one.

While a leader is heard of, no other one in radio contact can come to lead but by its hand-over: each that hears the
leader's lease follows it. So one that follows it, or claims in vain, and says a moment later that it leads, is not
believed, as long as that leader itself is heard of and says that it leads. (One that was not heard meanwhile may come
from another part: that one is, by the election's rank. And a leader without the majority, or who follows one, judges
nobody: the other may have it.)

A leader that brings this vehicle far from the way that it was told when the swarm set out, or gets it nowhere for
longer than one waits that keeps the mission's times, is given up: by the own odometry, of which only differences count.
The next one, or the same where it is let lead again, is asked to take it no farther off, and has a minute.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.beacon import Beacon, Lease
from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import add
from companion.core.swarm.election import Election
from companion.core.swarm.phases import STUCK_LAND_S, TOO_FEW_LAND_S, Phases
from mission.common.forming import FORMING_LIMIT_S
from mission.common.frames import Vec3
from mission.document.model import AtEnd, Mission
from mission.rules.rise_rules import longest_rise_s

FRESH_PERIODS: Final = 5  # since news of the leader: those in radio contact have had some, too
APART_PERIODS: Final = 15  # not heard for so long, one may have lost the leader and come to lead elsewhere
CORRIDOR_M: Final = (
    15.0  # beside the way d1-d2, and how far a follower may move in its formation: detours are that wide
)
LEFT_PERIODS: Final = 20  # T_L
SLACK_S: Final = 60.0  # beyond the mission's own times
BACK_M: Final = 5.0  # beyond where one took over that has to bring it back: a detour
MOVED_M: Final = 5.0
GIVEN_UP: Final = -1  # in the place of a leader's id
TOLD_S: Final = 2.0  # after a phase has begun: by then who hands down a false vector hands down none any more


@final
class LeadWatch:
    """One vehicle's; bounded by the swarm's size."""

    __slots__ = (
        "_apart_s",
        "_beacons",
        "_bound",
        "_holds",
        "_leader",
        "_led_s",
        "_left",
        "_limits_s",
        "_moved_ned_m",
        "_moved_s",
        "_named",
        "_news",
        "_unled_s",
        "_usurpers",
        "_way_ned_m",
        "_way_stop",
        "_width_m",
        "_within_m",
    )

    def __init__(self, mission: Mission) -> None:
        self._width_m: Final = CORRIDOR_M + mission.radio.transit_range_m
        beyond_s = FORMING_LIMIT_S + SLACK_S + longest_rise_s(mission)
        self._limits_s: Final = [visit.duration_s + beyond_s for visit in mission.visits]
        self._holds: Final = mission.route.at_end is AtEnd.HOLD
        self._apart_s: Final = APART_PERIODS / mission.radio.beacon_rate_hz
        self._beacons: dict[int, tuple[float, Lease | None]] = {}  # by sender: when, and whom it followed
        self._usurpers: set[int] = set()
        self._unled_s = -math.inf  # when it had no leader last, or a claim
        self._named: set[int] = set()  # in a word for the operator, once
        self._news: list[tuple[int, str]] = []
        self._bound = (SwarmPhase.ASSEMBLE, 0)  # phase and visit
        # Where it was when the swarm left d1, and where it was told then, and at each tree, that the way leads.
        self._way_ned_m: list[Vec3] = []
        self._way_stop = -1  # the visit that it leads to
        self._left = 0  # periods beside the way
        self._leader = 0  # that is followed,
        self._led_s = -math.inf  # since when, where it is not the first
        self._within_m = math.inf  # of the way it has to keep: it took over there
        self._moved_ned_m: Vec3 | None = None
        self._moved_s = 0.0

    # --- how one came to lead ---

    def note_claim(self, beacon: Beacon, election: Election, now_s: float) -> bool:
        """A member's own beacon; False: it says that it leads, as it cannot have come to."""
        sender, lease, mine = beacon.sender, beacon.lease, election.lease
        if mine is None or not mine.established:
            self._unled_s = now_s
        before = self._beacons.get(sender)
        self._beacons[sender] = (now_s, lease)
        if not _leads(sender, lease):
            self._usurpers.discard(sender)
            return True
        # Where none led a moment ago two may have come to lead at once: the election settles that.
        is_young = now_s - self._unled_s <= self._apart_s
        if is_young or mine is None or mine.leader == sender or not self._is_fresh(election, mine):
            self._usurpers.discard(sender)
            return True
        if sender in self._usurpers:
            return False
        if before is None or now_s - before[0] > self._apart_s or _leads(sender, before[1]):
            return True  # as it was when it was met
        if self._hands_over(mine, sender, now_s):
            return True
        self._usurpers.add(sender)
        if sender not in self._named:
            self._named.add(sender)
            self._news.append((sender, "leads unasked"))
        return False

    def may_lead(self, vehicle: int) -> bool:
        """Nothing here contradicts it."""
        return vehicle not in self._usurpers

    def find_own_word(self, leader: int, now_s: float) -> Lease | None:
        """The lease as its leader's own last beacon has it; None: it is not heard, or does not lead."""
        heard = self._beacons.get(leader)
        if heard is None or now_s - heard[0] > self._apart_s or heard[1] is None or heard[1].leader != leader:
            return None
        return heard[1]

    def _hands_over(self, mine: Lease, sender: int, now_s: float) -> bool:
        """The leader has announced this heir: by its own word, where it is heard."""
        own = self.find_own_word(mine.leader, now_s) or mine
        return own.heir == sender and own.ends > 0

    @staticmethod
    def _is_fresh(election: Election, mine: Lease) -> bool:
        return mine.quorum and (election.acts or election.age <= FRESH_PERIODS)

    def count_followers(self, leader: int, now_s: float) -> int:
        """Members but itself that are heard to follow it."""
        followers = 0
        for sender, (at_s, lease) in self._beacons.items():
            is_fresh = now_s - at_s <= self._apart_s and sender != leader
            followers += is_fresh and lease is not None and lease.leader == leader
        return followers

    def forgive(self, leader: int) -> None:
        """It was given up, and may lead again: as one that takes over."""
        if self._leader == leader:
            self._leader = GIVEN_UP

    def take_news(self) -> list[tuple[int, str]]:
        """Vehicles that lead unasked, and why in words, since this was asked last."""
        news, self._news = self._news, []
        return news

    # --- where its lead has brought this one ---

    def find_fault(self, pos_ned_m: Vec3, dest_ned_m: Vec3 | None, phases: Phases, now_s: float, *, leader: int) -> str:
        """Each period: why the leader is given up, in words; empty: it is not.

        `leader`: by whose lead it is steered; 0: it is not, or by nobody's. `dest_ned_m`: the vector to d2, or the
        visit before it, as it is told: never the mission's (rule 5).
        """
        phase, is_new = phases.phase, (phases.phase, phases.stop) != self._bound
        if self._moved_ned_m is None or math.dist(pos_ned_m, self._moved_ned_m) > MOVED_M or is_new:
            self._moved_ned_m, self._moved_s = pos_ned_m, now_s
        # In its first period what was told is still of the visit before.
        self._note_way(pos_ned_m, None if is_new else dest_ned_m, phases, now_s)
        self._bound = (phase, phases.stop)
        if not leader or not phases.saw_begin:
            self._left, self._moved_s = 0, now_s
            return ""
        beside_m = self._beside_m(pos_ned_m, phases.stop)
        if leader != self._leader:
            self._begin_lead(leader, beside_m, now_s)
        since_s = phases.elapsed_s(now_s)
        has_had_time = now_s - self._led_s > SLACK_S
        match phase:
            case SwarmPhase.GATHER:
                limit_s = phases.gather_limit_s + TOO_FEW_LAND_S + SLACK_S
                return "waits too long" if has_had_time and since_s > limit_s else ""
            case SwarmPhase.COVERAGE:
                ends = not (self._holds and phases.stop + 1 == len(self._limits_s))
                is_late = ends and since_s > self._limits_s[phases.stop]
                return "covers too long" if has_had_time and is_late else ""
            case SwarmPhase.TRANSIT | SwarmPhase.RETURN:
                if now_s - self._moved_s > STUCK_LAND_S + SLACK_S:
                    return "gets nowhere"
                self._within_m = max(self._width_m, min(self._within_m, beside_m + BACK_M))
                self._left = self._left + 1 if beside_m > self._within_m else 0
                return "leaves the way" if self._left > LEFT_PERIODS else ""
        return ""

    def _begin_lead(self, leader: int, beside_m: float, now_s: float) -> None:
        """Another leads than before: what was is not its doing."""
        if self._leader:
            self._left, self._moved_s, self._led_s = 0, now_s, now_s
            self._within_m = max(self._width_m, beside_m + BACK_M)
        else:
            self._within_m = self._width_m
        self._leader = leader

    def _note_way(self, pos_ned_m: Vec3, dest_ned_m: Vec3 | None, phases: Phases, now_s: float) -> None:
        """Keep where it sets out, and where to: what is told last within TOLD_S."""
        if phases.phase <= SwarmPhase.GATHER:
            self._way_ned_m, self._way_stop = [pos_ned_m], -1
        sets_out = phases.phase is SwarmPhase.TRANSIT and phases.elapsed_s(now_s) <= TOLD_S
        if sets_out and dest_ned_m is not None and self._way_ned_m:
            self._way_ned_m = [*self._way_ned_m[: 1 + phases.stop], add(pos_ned_m, dest_ned_m)]
            self._way_stop = phases.stop

    def _beside_m(self, pos_ned_m: Vec3, stop: int) -> float:
        """Level distance from the way, there and back, by the own odometry.

        0 where it was not told where the way to this visit leads.
        """
        if self._way_stop != stop:
            return 0.0
        before = self._way_ned_m[-1]
        least_m = math.inf
        for place in self._way_ned_m:
            least_m = min(least_m, _level_distance_m(pos_ned_m, before, place))
            before = place
        return least_m


def _leads(sender: int, lease: Lease | None) -> bool:
    return lease is not None and lease.leader == sender and lease.established


def _level_distance_m(here: Vec3, a: Vec3, b: Vec3) -> float:
    """From the line a-b."""
    along = (b[0] - a[0], b[1] - a[1])
    length2 = max(along[0] ** 2 + along[1] ** 2, 1e-9)
    share = max(0.0, min(1.0, ((here[0] - a[0]) * along[0] + (here[1] - a[1]) * along[1]) / length2))
    return math.hypot(here[0] - a[0] - share * along[0], here[1] - a[1] - share * along[1])
