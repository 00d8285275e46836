"""Judges members' words before election, phases and routes take them in: see the modules beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, final

from companion.core.guidance.formation import Route
from companion.core.model.beacon import Beacon, Lease
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import Role
from companion.core.model.vectors import limit, norm
from companion.core.swarm.election import SEQ_JUMP, Election
from companion.core.swarm.phases import Phases
from companion.core.swarm.picture import Picture
from companion.core.swarm.priorities import Priorities
from companion.core.swarm.trust.accusations import ACCUSERS, Accusations
from companion.core.swarm.trust.blocklist import DOUBT_LIMIT, Blocklist, strip_beacon, strip_course
from companion.core.swarm.trust.lead_watch import APART_PERIODS, LeadWatch
from companion.core.swarm.trust.phase_gate import PhaseGate
from companion.core.swarm.trust.relay_watch import LEAST_COST, Patience, breaks_route, find_contradicting
from mission.document.model import Mission

RANGE_STEP_M: Final = 0.1  # in which beacons tell the range of a radio
PERIODS_BESIDE: Final = 2  # that a leader's count goes on beyond what time has passed: an early beacon, a late tick
PLAIN_LIE: Final = 3.0  # what no lost beacon explains weighs more
PHASE_LIE: Final = 0.5  # over T_L a leader may come to its senses


@final
class Trust:
    """One vehicle's. `sanitise_beacon` and `receive_beacon` each beacon, `run_period` each beacon period."""

    def __init__(self, mission: Mission, me: int, priorities: Priorities) -> None:
        self._me, self._priorities = me, priorities
        self.blocklist = Blocklist(mission.swarm.size)
        self._courses = Blocklist(mission.swarm.size)
        self.gate = PhaseGate(mission, me)
        self._leads = LeadWatch(mission)
        self._accusations = Accusations()
        self._given_up = 0  # the last leader that was, by what is observed here
        self._defiant: set[int] = set()  # that are blocked, and said in the last period that they lead
        self._patience = Patience()
        self._fastest_mps = mission.limits.speed_max_mps
        self._least_range_m = min(mission.radio.transit_range_m, mission.radio.full_range_m)
        self._period_s = 1.0 / mission.radio.beacon_rate_hz
        self._own_words_s: dict[int, tuple[int, float]] = {}  # by leader: the count of its own last beacon, and when

    # --- each beacon ---

    def sanitise_beacon(self, beacon: Beacon, now_s: float) -> Beacon:
        """The same without what no member truly says: a priority, reference, range, route that none has."""
        if self.blocklist.has(beacon.sender):
            if _is_claim(beacon):
                self._defiant.add(beacon.sender)
            return strip_beacon(beacon)
        candidate = beacon.candidate
        if candidate is not None and (
            self.blocklist.has(candidate.vehicle)
            or not self._priorities.may_have(candidate.priority, candidate.vehicle)
        ):
            beacon = replace(beacon, candidate=None)
        if norm(beacon.ref_ned_mps) > self._fastest_mps:
            beacon = replace(beacon, ref_ned_mps=limit(beacon.ref_ned_mps, self._fastest_mps))
        if beacon.range_m < self._least_range_m - RANGE_STEP_M:
            beacon = replace(beacon, range_m=self._least_range_m)
        if breaks_route(beacon):
            self._courses.note_doubt(beacon.sender, "route cost is false", PLAIN_LIE, now_s)
        lease = beacon.lease
        leads = lease is not None and lease.leader == beacon.sender
        if not leads and beacon.route_cost < LEAST_COST:
            beacon = replace(beacon, route_cost=LEAST_COST)
        # A route over one that leads unasked would take its followers from the leader's count of its part.
        is_false = not self._may_lead(beacon.sender, now_s) if leads else self._courses.has(beacon.sender)
        return strip_course(beacon) if is_false else beacon

    def receive_lease(self, beacon: Beacon, election: Election, now_s: float) -> bool:
        """A new beacon of another member, for the election: its lease, as far as it counts; True: it is news."""
        lease, sender = beacon.lease, beacon.sender
        self._accusations.receive_beacon(beacon, now_s)
        before = self._leads.find_own_word(sender, now_s)
        self._leads.note_claim(beacon, election, now_s)
        if _leaps(before, lease):
            self._give_up(sender, "counts far ahead of itself", now_s)
        if lease is None or self.blocklist.has(lease.leader) or not self._may_lead(lease.leader, now_s):
            return False
        if not self._priorities.may_have(lease.priority, lease.leader):
            return False
        if sender == lease.leader:
            self._own_words_s[sender] = (lease.seq, now_s)
        believed = self._correct_lease(sender, lease, now_s)
        return believed is not None and election.receive_lease(believed, beacon.hop)

    def _correct_lease(self, sender: int, lease: Lease, now_s: float) -> Lease | None:
        """A relay's word of a leader that is heard here: its count as far as time has passed, the rest its own."""
        own = None if sender == lease.leader else self._leads.find_own_word(lease.leader, now_s)
        if own is None:
            return lease
        seq, at_s = self._own_words_s.get(lease.leader, (own.seq, now_s))
        if lease.seq > seq + int((now_s - at_s) / self._period_s) + PERIODS_BESIDE:
            return None
        said = (lease.heir, lease.ends, lease.established, lease.quorum)
        if said == (own.heir, own.ends, own.established, own.quorum):
            return lease
        return replace(lease, heir=own.heir, ends=own.ends, established=own.established, quorum=own.quorum)

    def believes_phase(
        self, beacon: Beacon, election: Election, phases: Phases, now_s: float, *, is_news: bool
    ) -> bool:
        """The phase that it tells may be gone over to: it is of the leader that is followed, and see `PhaseGate`."""
        self.gate.store(beacon, now_s)
        lease, mine = beacon.lease, election.lease
        if lease is None or mine is None or lease.leader != mine.leader or election.role is Role.CLAIMANT:
            return False
        if self.gate.is_believed(beacon, phases, election.hop, now_s, is_news=is_news):
            return True
        if beacon.sender == mine.leader and self.gate.is_foul(beacon, phases, now_s):
            self.blocklist.note_doubt(beacon.sender, "phase is false", PHASE_LIE, now_s)
        return False

    # --- each beacon period ---

    def run_period(
        self, picture: Picture, election: Election, phases: Phases, *, is_held: bool
    ) -> list[tuple[int, str]]:
        """Find those that are not believed any more, and give up the leader that is one; which, and why in words.

        `is_held`: by an operator, so no leader can get it anywhere.
        """
        now_s, own, lease = picture.now_s, picture.own, election.lease
        if own is not None:
            follows = picture.is_steered and not is_held and election.role is Role.FOLLOWER and lease is not None
            leader = lease.leader if follows and lease is not None else 0
            self.gate.note_position(own.pos_ned_m, phases.phase)
            fault = self._leads.find_fault(own.pos_ned_m, picture.dest_ned_m, phases, now_s, leader=leader)
            if fault:
                self._give_up(leader, fault, now_s)
        self._bar_defiant(lease, now_s)
        self.blocklist.fade(now_s)
        self._courses.fade(now_s)
        if self._given_up and not self.accused:
            self._leads.forgive(self._given_up)
            self._given_up = 0
        if lease is not None and (self.blocklist.has(lease.leader) or not self._may_lead(lease.leader, now_s)):
            election.depose()
        return [*self.blocklist.take_news(), *self._courses.take_news(), *self._leads.take_news()]

    @property
    def accused(self) -> int:
        """The leader that this vehicle has given up by what it observes itself, while it is blocked; 0: none."""
        return self._given_up if self.blocklist.has(self._given_up) else 0

    def bars_lead(self, now_s: float) -> bool:
        """Enough of the others say that this vehicle leads astray; or it alone has given up whom two of them follow.

        That one was rather pushed off the way than led: it holds, and claims no lead beside theirs.
        """
        if self._accusations.is_accused(self._me, now_s):
            return True
        leader = self.accused
        is_alone = leader > 0 and self._accusations.count_accusers(leader, now_s) == 0
        return is_alone and self._leads.count_followers(leader, now_s) >= ACCUSERS

    def _may_lead(self, vehicle: int, now_s: float) -> bool:
        """Nothing that is observed here contradicts it, and not two of the others."""
        return self._leads.may_lead(vehicle) and not self._accusations.is_accused(vehicle, now_s)

    def _give_up(self, leader: int, why: str, now_s: float) -> None:
        """By what is observed here it leads astray."""
        self.blocklist.note_doubt(leader, why, DOUBT_LIMIT, now_s)
        if self.blocklist.has(leader):  # it doubts no more than a third
            self._given_up = leader

    def _bar_defiant(self, lease: Lease | None, now_s: float) -> None:
        """Keep those blocked that go on to say that they lead, as long as another leads the majority."""
        if lease is not None and lease.established and lease.quorum:
            for vehicle in sorted(self._defiant - {lease.leader}):
                self.blocklist.note_doubt(vehicle, "leads on", 0.0, now_s)
        self._defiant.clear()

    def find_views(self, heard: Sequence[Beacon]) -> list[Beacon]:
        """The beacons whose views of the leader count."""
        return [beacon for beacon in heard if not self.blocklist.has(beacon.sender)]

    def check_route(self, route: Route, neighbours: Sequence[Neighbour], lease: Lease | None, now_s: float) -> None:
        """A follower's route: of those that it goes by, one may hand down what is not so."""
        false = 0 if lease is None else find_contradicting(route, neighbours, lease.leader)
        if false:
            self._courses.note_doubt(false, "hands down a false course", 1.0, now_s)

    def filter_followers(self, followers: list[Neighbour], now_s: float, *, range_m: float) -> list[Neighbour]:
        """The followers whose governor counts. `range_m`: that the formation keeps."""
        return self._patience.filter_followers(followers, now_s, range_m=range_m)


def _is_claim(beacon: Beacon) -> bool:
    """Its sender says that it leads, and may act."""
    lease = beacon.lease
    return lease is not None and lease.leader == beacon.sender and lease.established


def _leaps(before: Lease | None, lease: Lease | None) -> bool:
    """Of one acting leader's own words the second counts further than a count that others told it can have brought it.

    One that starts anew, or counted to the end, does not act for longer than the first counts.
    """
    if before is None or lease is None or lease.leader != before.leader:
        return False
    return before.established and lease.established and lease.seq > before.seq + SEQ_JUMP + APART_PERIODS
