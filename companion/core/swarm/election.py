"""The leader: leased KHOPCA, one leader per connected component.

Algorithm 1 of the paper (lines 4-18) is KHOPCA with the sign turned: `leaderID` is the least weight, and weights grow
by one a hop from a cluster head (`R2 + 1`). As printed it seldom ends with one leader and never replaces a lost one, so
here the head holds a lease: it counts periods, the count spreads with the beacons, and only an advancing count renews
it; echoes of a dead leader expire. `hop` is the paper's weight, with leaderID = 0: a gradient that leads to the leader.

| KHOPCA | here |
|---|---|
| rules 1 and 4: one hop more than the best neighbour; the better of two stays | `receive_lease` adopts a higher rank |
| rules 2 and 3: no better neighbour: become the head | `run_period` claims when no lease is alive |

A vehicle that goes over to another leader says so at once and not only at its next period: at two ticks a period the
news of a leader goes two hops in one.

Up the gradient, from the farthest to the leader, two things come back with the beacons: whether all there agree on this
leader (an echo: a claim is acted upon when it has reached every vehicle, however far that is), and the best candidate
to succeed it. The leader names that one as its heir. When the leader falls silent every vehicle knows which to expect,
and the heir need not wait for the echo. A leader that finds its heir better at a re-election, or must resign, leads on
until a count that it announces: there the one stops and the other begins, so there is neither a gap nor an overlap.

What no honest vehicle can have come to say is refused: a count far ahead of what has been counted, a score above a full
battery, a hand-over too far off, a way longer than the swarm. A false count that is near enough to be believed is
outcounted by the leader itself, which hears of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Protocol

from companion.core.model.beacon import Candidate, Lease
from companion.core.model.states import Role
from companion.core.swarm.role_table import RoleEvent, transition

LEASE_PERIODS: Final = 10  # without a newer count the leader is lost; 5 loses live ones at 30 % loss
ACT_PERIODS: Final = 10  # after its start a vehicle acts no sooner: it may not have heard its neighbours yet
HELD_PERIODS: Final = 5  # a claim is acted upon no sooner: that the leader lives after all would be heard by then
TOMB_PERIODS: Final = 50  # a lost leader's old counts are refused this long, when all their echoes have expired
ECHO_PERIODS = LEASE_PERIODS + HELD_PERIODS  # a neighbour's last word counts this long: silence is no agreement
HEIR_KNOWN_PERIODS = 2 * LEASE_PERIODS  # when all have heard that another is not the heir any more, or lost the leader
# while another seems better: reports come and go with the routes, ten hops off for a second
HEIR_STAYS_PERIODS: Final = 20
HANDOVER_PERIODS: Final = 20  # from its announcement until the heir takes over: the news travels 15 hops at 10 % loss
RESIGN_PERIODS: Final = 10  # the same, when the leader cannot lead any more: 7 hops
HYSTERESIS: Final = 2  # a candidate is better than the leader by at least so many steps of the score
HOP_LIMIT: Final = 250  # a chain of the largest swarm
HEIR_ABSENT_S: Final = 150.0  # no heir for so long: a leader takes 120 s to land a swarm that gets nowhere
SCORE_LIMIT: Final = 10  # a full battery
FIRST_SEQ_LIMIT = 2**31  # a clock that counts from 1970 starts below it
SEQ_LIMIT = 3 * 2**30  # three years of counting at 10 Hz later; the wire (uint32) carries more
EARLIER_SEQ_LIMIT = SEQ_LIMIT - 2**29  # what a vehicle believes of an earlier life leaves room to count on
ECHO_SEQS = 2 * HOP_LIMIT  # echoes of a lost leader are no farther behind its last count
SEQ_JUMP = 2 * ECHO_SEQS  # true news of a leader is not so far ahead; twice, so that it hears of all that is buried
TOMBS: Final = 8  # more than leases that run out can fill in TOMB_PERIODS


class View(Protocol):
    """The election as a neighbour's last beacon tells of it."""

    @property
    def lease(self) -> Lease | None:
        """The leader that it follows."""

    @property
    def hop(self) -> int:
        """Hops from that leader."""

    @property
    def agreed(self) -> bool:
        """All that it hears follow that leader, and all behind it agree."""

    @property
    def candidate(self) -> Candidate | None:
        """The best, of itself and those behind it, to succeed that leader."""


def rank(lease: Lease) -> tuple[bool, bool, int, int, int]:
    """Higher leads: an established leader before a new claim, then one whose part is the majority of those that took
    off, then predetermined priority, then score, then low id.
    """
    return (lease.established, lease.quorum, lease.priority, lease.score, -lease.leader)


def priority_of(vehicle_id: int, leader_priority: Sequence[int]) -> int:
    """Of the mission's `leader_priority`, best first: the first has the highest; 0 when not listed."""
    return len(leader_priority) - leader_priority.index(vehicle_id) if vehicle_id in leader_priority else 0


class Election:
    """One vehicle's view of which leads. `run_period` once per beacon period, `receive_lease` for every beacon."""

    __slots__ = (
        "_absent_s",
        "_count",
        "_expected",
        "_heir_for",
        "_held",
        "_hop_limit",
        "_lived",
        "_own_seq",
        "_patience",
        "_reelection_periods",
        "_tombs",
        "_unlike_heir",
        "age",
        "agreed",
        "candidate",
        "changed",
        "hop",
        "lease",
        "me",
        "priority",
        "role",
    )

    def __init__(self, me: int, priority: int, *, size: int = HOP_LIMIT, reelection_periods: int = 0) -> None:
        """`size` of the swarm, itself included; `reelection_periods` 0: a leader that can lead is never replaced."""
        self.me = me
        self.priority = priority
        self.lease: Lease | None = None
        self.hop = 0
        self.age = 0  # periods since the lease was renewed
        self.role = Role.UNLED
        self.agreed = False  # see View
        self.candidate: Candidate | None = None  # see View
        self.changed = False  # since the last step another leader is followed: news not to be kept until the next
        self._patience = ACT_PERIODS + 2 * size  # one that hears none, but is heard, must not prevent all leaders
        self._hop_limit = min(size, HOP_LIMIT)
        self._reelection_periods = reelection_periods
        self._lived = 0  # periods
        self._held = 0  # periods in which this vehicle has led without a break
        self._count = 0  # what the leader's count should be by now: its latest, and the way and time since
        self._expected = 0  # the heir of the leader that was lost
        self._heir_for = 0  # periods in which this vehicle has been the heir without a break
        self._unlike_heir = 0  # periods in which the best candidate has been another than the heir
        self._own_seq = 0  # the highest count of its own that it has said or believed
        self._tombs: dict[tuple[int, int], int] = {}  # lost leader, its last count -> periods left
        self._absent_s: dict[int, float] = {}  # heir to which the lead was handed over in vain -> time left

    @property
    def leads(self) -> bool:
        """This vehicle claims the lead, or has it: the lease is its own."""
        return self.role is Role.CLAIMANT or self.role is Role.LEADER

    @property
    def acts(self) -> bool:
        """This vehicle leads, and all in reach know."""
        return self.role is Role.LEADER

    @property
    def early(self) -> Lease | None:
        """The lease as a beacon between two steps tells it: a count back, for an heir reckons a period for each hop."""
        return self.lease and replace(self.lease, seq=max(0, self.lease.seq - 1))

    def inherits_quorum(self, within_periods: int) -> bool:
        """A leader of which it had news then hands over to this vehicle, with the majority: one stops, one begins."""
        lease = self.lease
        is_heir = lease is not None and lease.leader != self.me and lease.heir == self.me and lease.ends > 0
        return lease is not None and is_heir and lease.quorum and self.age <= within_periods

    def receive_lease(self, lease: Lease, hop: int) -> bool:
        """A neighbour's view of the leader, `hop` hops from it; True when it is news of the leader now followed."""
        if lease.leader == self.me:
            if self._plausible(lease, hop - 1):  # as its followers have heard it
                self._outcount(lease.seq)
            return False
        if not self._plausible(lease, hop):
            return False
        mine = self.lease
        if mine is None or lease.leader != mine.leader:
            if self._buried(lease) or not self._goes_over(lease):
                return False
        else:
            if lease.seq == mine.seq:
                self.hop = min(self.hop, hop + 1)
            # 0: the count of an heir that takes over is not known yet.
            if lease.seq <= mine.seq or 0 < mine.seq < lease.seq - SEQ_JUMP:
                return False
            if not lease.established:
                # Until the echo is back hops only fall: so each vehicle stays behind the one that it heard first.
                hop = min(self.hop - 1, hop)
        self.lease, self.hop, self.age = lease, hop + 1, 0
        if lease.established:
            self._expected = 0
        return True

    def _goes_over(self, lease: Lease) -> bool:
        """This vehicle gives up the leader that it follows, if any, for another; False: it stays."""
        mine = self.lease
        if mine is not None:
            succeeds = lease.leader == mine.heir and lease.established and mine.ends > 0
            if not succeeds and not self._precedes(lease, mine):
                return False
            if succeeds:
                self._bury(mine.leader, mine.ends)
            self._count = 0
        self._change_role(RoleEvent.HEAR)
        # No vehicle behind this one can have agreed on the new leader yet.
        self.changed, self.agreed, self.candidate = True, False, None
        return True

    def _plausible(self, lease: Lease, hop: int) -> bool:
        """Each bound is what a true lease can come to on its way, at worst."""
        if hop >= self._hop_limit or lease.score > SCORE_LIMIT or lease.seq > SEQ_LIMIT:
            return False
        # Early beacons tell a count back, at every hop at most.
        return not lease.ends or lease.seq < lease.ends <= lease.seq + HANDOVER_PERIODS + hop + 1

    def _outcount(self, seq: int) -> None:
        """Others say this count of this vehicle: of an earlier life, or a false one. Only a higher one is news to them.

        One farther ahead of an acting leader than its followers believe is left to run out with those that do.
        """
        if seq <= (self.lease.seq + SEQ_JUMP if self.lease is not None and self.acts else EARLIER_SEQ_LIMIT):
            self._own_seq = max(self._own_seq, seq)

    def depose(self) -> None:
        """The leader that is followed is not believed any more: as if its lease had run out."""
        if self.role is Role.FOLLOWER and self.lease is not None:
            self._expire(self.lease)

    def set_priority(self, priority: int) -> None:
        """Its own, from the next period on: reception of GNSS comes and goes."""
        self.priority = priority

    def set_quorum(self, quorum: bool) -> None:
        """A leader's: whether its part of the swarm is the majority of those that took off."""
        if self.lease is not None and self.leads:
            self.lease = replace(self.lease, quorum=quorum)

    def run_period(
        self, now_s: float, *, period_s: float, eligible: bool, score: int, heard: Sequence[View] = ()
    ) -> None:
        """One beacon period has passed. An ineligible vehicle (no position, low battery, pilot) never claims.

        `heard`: the neighbours' last beacons, none older than ECHO_PERIODS.
        """
        self._tombs = {lost: left - 1 for lost, left in self._tombs.items() if left > 1}
        if self._absent_s:
            self._absent_s = {heir: left - period_s for heir, left in self._absent_s.items() if left > period_s}
        self._lived += 1
        self.changed = False
        if self.role is Role.CLAIMANT and not eligible:
            self._give_up()
        score = min(score, SCORE_LIMIT)
        # Counting from the clock keeps a restarted leader's counts above those of its earlier life; from HOP_LIMIT, as
        # early beacons tell counts back.
        first = max(HOP_LIMIT + int(now_s / period_s) % FIRST_SEQ_LIMIT, self._own_seq)
        claim = Lease(self.me, first, self.priority, score, established=False)
        if self.role is Role.FOLLOWER:
            self._update_as_follower(claim, eligible=eligible)
        if eligible and not self.leads and self._precedes(claim, self.lease):
            self._change_role(RoleEvent.CLAIM)
            self.lease, self._held = claim, 0
        self._collect_echo(eligible, score, heard)
        if self.leads:
            self._update_as_leader(eligible, score)

    def _change_role(self, event: RoleEvent) -> None:
        """By the table of roles."""
        self.role = transition(self.role, event)

    def _give_up(self) -> None:
        """It leads, or claims to, no more, and knows of no other that does."""
        self._change_role(RoleEvent.RESIGN)
        self.lease = None

    def _precedes(self, lease: Lease, other: Lease | None) -> bool:
        """By `rank`; but among claims that of the heir of the leader just lost comes first."""
        if other is None:
            return True
        if not (lease.established or other.established) and self._expected in (lease.leader, other.leader):
            return lease.leader == self._expected
        return rank(lease) > rank(other)

    def _update_as_follower(self, claim: Lease, *, eligible: bool) -> None:
        """Another leads: until its lease runs out, or this vehicle is its heir and the time has come."""
        lease = self.lease
        assert lease is not None
        self.age += 1
        self._count = max(self._count + 1, lease.seq + self.hop + self.age - 1)
        self._heir_for = self._heir_for + 1 if lease.heir == self.me else 0
        if eligible and self._heir_for and 0 < lease.ends <= self._count:
            self._bury(lease.leader, lease.ends)
            self._change_role(RoleEvent.SUCCEED)
            self.lease, self._held = replace(claim, established=True), 0
        elif self.age >= LEASE_PERIODS:
            self._expire(lease)

    def _expire(self, lease: Lease) -> None:
        """It has lost the leader whose lease this is."""
        self._bury(lease.leader, lease.seq)
        if lease.seq == 0:  # it was handed the lead, and never counted
            self._note_absent(lease.leader)
        elif 0 < lease.ends <= self._count - HELD_PERIODS:
            self._note_absent(lease.heir)
        # An expectation that came to nothing is given up: those that expect different heirs would never agree.
        self._expected = lease.heir if lease.established else 0
        self._change_role(RoleEvent.EXPIRE)
        self.lease = None
        self._count = 0

    def _collect_echo(self, eligible: bool, score: int, heard: Sequence[View]) -> None:
        """Finds what goes up the gradient: agreement and the best candidate."""
        if self.lease is None:
            self.agreed, self.candidate = False, None
            return
        leader, hop = self.lease.leader, 0 if self.leads else self.hop
        candidates = [Candidate(self.me, self.priority, score)] if eligible and leader != self.me else []
        self.agreed = True
        for view in heard:
            if view.lease is None or view.lease.leader != leader:
                self.agreed = False
            elif view.hop > hop:
                self.agreed &= view.agreed
                best = view.candidate
                if best is None or best.vehicle in (leader, self.me) or best.vehicle in self._absent_s:
                    continue
                if best.score <= SCORE_LIMIT:
                    candidates.append(best)
        self.candidate = max(candidates, key=self._merit, default=None)

    def _merit(self, candidate: Candidate) -> tuple[int, int, bool, int]:
        """Higher succeeds; of equals this vehicle rather than one behind it, which misses a lost leader later."""
        return (candidate.priority, candidate.score, candidate.vehicle == self.me, -candidate.vehicle)

    def _update_as_leader(self, eligible: bool, score: int) -> None:
        assert self.lease is not None
        self._held += 1
        self.hop = self.age = 0
        spread = self.agreed and self._lived >= ACT_PERIODS
        expected = self._heir_for >= HEIR_KNOWN_PERIODS
        agreed = self._held >= self._patience or (self._held >= HELD_PERIODS and (spread or expected))
        if agreed and self.role is Role.CLAIMANT:
            self._change_role(RoleEvent.AGREE)
        self._own_seq = max(self._own_seq, self.lease.seq) + 1
        if self._own_seq > SEQ_LIMIT:
            # As if lost: no vehicle would hear it any more. Its next claim counts from the clock again.
            self._expected, self._own_seq = self.lease.heir, 0
            self._give_up()
            return
        lease = replace(self.lease, seq=self._own_seq, priority=self.priority, established=self.acts)
        if self.acts:
            self._expected = self._heir_for = 0
            lease = self._hand_over(self._name_heir(lease), eligible, score)
        if not eligible and (self.candidate is None or not lease.ends):
            self._give_up()
        elif 0 < lease.ends <= lease.seq:
            # Its first count, so that whatever the heir itself says is newer.
            self._change_role(RoleEvent.HAND_OVER)
            self.lease, self.hop, self._count = Lease(lease.heir, 0, 0, 0, established=True), 1, 0
        else:
            self.lease = lease

    def _name_heir(self, lease: Lease) -> Lease:
        """The best candidate, when it has been so for a while."""
        best = self.candidate
        if lease.ends or (best is not None and best.vehicle == lease.heir):
            self._unlike_heir = 0
            return lease
        self._unlike_heir += 1
        if lease.heir and self._unlike_heir < HEIR_STAYS_PERIODS:
            return lease
        self._unlike_heir = 0
        return replace(lease, heir=0 if best is None else best.vehicle)

    def _hand_over(self, lease: Lease, eligible: bool, score: int) -> Lease:
        """To an heir that precedes by the mission, is clearly better at a re-election, or at need."""
        due = self._reelection_periods > 0 and self._held % self._reelection_periods == 0
        if due:
            lease = replace(lease, score=score)
        best = self.candidate
        if lease.ends or not lease.heir or best is None or best.vehicle != lease.heir:
            return lease
        better = due and best.priority == self.priority and best.score >= score + HYSTERESIS
        if not eligible or best.priority > self.priority or better:
            wait = HANDOVER_PERIODS if eligible else RESIGN_PERIODS
            return replace(lease, ends=lease.seq + wait)
        return lease

    def _note_absent(self, heir: int) -> None:
        """It was to lead, and was not heard to: whoever names it, for a while it is no candidate here."""
        self._absent_s.pop(heir, None)
        self._absent_s[heir] = HEIR_ABSENT_S
        if len(self._absent_s) > self._hop_limit:  # as many as the swarm has members
            del self._absent_s[next(iter(self._absent_s))]

    def _bury(self, leader: int, seq: int) -> None:
        """No echo of this leader's counts is heard, for a while."""
        self._tombs.pop((leader, seq), None)
        self._tombs[leader, seq] = TOMB_PERIODS
        if len(self._tombs) > TOMBS:
            del self._tombs[next(iter(self._tombs))]

    def _buried(self, lease: Lease) -> bool:
        """An echo. Far below the last count it is another life's, or that last count was false."""
        return any(leader == lease.leader and last - ECHO_SEQS <= lease.seq <= last for leader, last in self._tombs)
