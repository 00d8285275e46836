"""What one vehicle's swarm object is made of, as a value: to put it back, to compare it, and to hash it.

Times are kept as ages, in beacon periods, and counts of leases by how far they are ahead of the clock: two vehicles
that will do the same from here on have the same value, whenever that is. What can make no difference any more is left
out: an age above all that is asked of it, a count that has been reached. Each field of each class stands in a table
with how it is kept; one that does not stand there is an error, so that a field that is added is not forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from companion.core.model.beacon import Lease
from companion.core.model.states import SwarmPhase
from companion.core.swarm.election import (
    ACT_PERIODS,
    HEIR_ABSENT_S,
    HEIR_KNOWN_PERIODS,
    HOP_LIMIT,
    Election,
)
from companion.core.swarm.partition import NetworkPartition
from companion.core.swarm.phases import Phases
from companion.core.swarm.priorities import Resignation
from companion.core.swarm.roster import DECIDES_AFTER_S, Roster
from companion.core.swarm.swarm import Swarm
from companion.core.swarm.trust.blocklist import FADES, Blocklist
from companion.core.swarm.trust.lead_watch import APART_PERIODS, LeadWatch
from companion.core.swarm.trust.phase_gate import HEARD_PERIODS, PhaseGate, _Word
from companion.core.swarm.trust.relay_watch import Patience
from companion.core.swarm.trust.trust import Trust
from companion.core.vehicle.operator_orders import FloodedOrders, OperatorOrders
from mission.common.forming import FormingTime

PERIOD_S = 0.1
EPOCH = 20_000  # the period at which every value is put back: a step has the same result whenever it is made
BOOTED = -5_000  # periods by which the clock of a board that was started again is behind the others
SECOND = 12  # periods: an age above all that is asked of those that count for one second
CLOSE_UP = 102  # the same, of ten seconds
DECIDES_PERIODS = round(DECIDES_AFTER_S / PERIOD_S) + 1
LEFT_BEHIND = HOP_LIMIT + BOOTED - 16  # no count of a living vehicle is so far behind

Value = tuple[Any, ...]
Keep = tuple[Callable[[Any, int], Any], Callable[[Any, int], Any]]  # to a value, and back; both with the period


def to_s(period: float) -> float:
    """Seconds of the clock."""
    return period * PERIOD_S


def _age(most: int) -> Keep:
    """A time, as its age, `most` at most."""

    def take(time_s: float | None, period: int) -> int | None:
        return None if time_s is None else min(most, round(period - time_s / PERIOD_S))

    return take, lambda age, period: None if age is None else to_s(period - age)


def _most(most: int) -> Keep:
    """A number that makes no more difference from there on."""
    return lambda number, _: min(most, number), lambda number, _: number


def _least_count(least: int) -> Keep:
    """A count of periods, from the clock; none below `least`. 0: it is not known yet."""
    return (
        lambda count, period: None if count == 0 else max(least, count - period),
        lambda ahead, period: 0 if ahead is None else period + ahead,
    )


def take_lease(lease: Lease | None, period: int) -> Value | None:
    """Of a lease: who, its counts from the clock, and the rest."""
    if lease is None:
        return None
    seq, ends = (count - period if count else None for count in (lease.seq, lease.ends))
    return (lease.leader, seq, ends, lease.priority, lease.score, lease.established, lease.heir, lease.quorum)


def give_lease(value: Value | None, period: int) -> Lease | None:
    """The same, back."""
    if value is None:
        return None
    leader, seq, ends, priority, score, established, heir, quorum = value
    seq, ends = (0 if ahead is None else ahead + period for ahead in (seq, ends))
    return Lease(leader, seq, priority, score, established, heir, ends, quorum)


def _take_tombs(tombs: dict[tuple[int, int], int], period: int) -> Value:
    return tuple(sorted((left, leader, seq - period) for (leader, seq), left in tombs.items()))


def _give_tombs(value: Value, period: int) -> dict[tuple[int, int], int]:
    return {(leader, ahead + period): left for left, leader, ahead in value}


def _take_words(words: dict[int, _Word], period: int) -> Value:
    """Those that still count."""
    aged = ((sender, word, round(period - word.at_s / PERIOD_S)) for sender, word in sorted(words.items()))
    return tuple(
        (k, word.phase, word.stop, word.leader, word.hop, age) for k, word, age in aged if age <= HEARD_PERIODS
    )


def _give_words(value: Value, period: int) -> dict[int, _Word]:
    return {k: _Word(phase, stop, leader, hop, to_s(period - age)) for k, phase, stop, leader, hop, age in value}


AS_IT_IS: Keep = (lambda value, _: value, lambda value, _: value)


def new(value: Callable[[int], Any]) -> Keep:
    """It is made anew in each period, or makes no difference here: not kept."""
    return lambda _, __: None, lambda _, period: value(period)


ELECTION: dict[str, Keep] = {
    "lease": (take_lease, give_lease),
    "hop": AS_IT_IS,
    "age": AS_IT_IS,
    "role": AS_IT_IS,
    "agreed": AS_IT_IS,
    "candidate": AS_IT_IS,
    "changed": AS_IT_IS,
    "_lived": _most(ACT_PERIODS),
    "_count": _least_count(LEFT_BEHIND),
    "_expected": AS_IT_IS,
    "_heir_for": _most(HEIR_KNOWN_PERIODS),
    "_unlike_heir": AS_IT_IS,
    "_tombs": (_take_tombs, _give_tombs),
    # For minutes: longer than is explored. Only which it is is kept.
    "_absent_s": (
        lambda absent, _: tuple(sorted(absent)),
        lambda absent, _: dict.fromkeys(absent, HEIR_ABSENT_S),
    ),
}
ROSTER: dict[str, Keep] = {
    "done": AS_IT_IS,
    "present": AS_IT_IS,
    "flown": AS_IT_IS,
    "_flies": AS_IT_IS,
    "_untold": AS_IT_IS,
    "_behind": new(lambda _: []),  # found anew before it is asked for
    # Nobody falls silent within range here: whom one does not hear any more it takes to have left
    "_doubted": new(lambda _: 0),
    "_doubted_s": new(lambda _: None),
    "_quorum_s": _age(SECOND),
    "_counted_s": _age(DECIDES_PERIODS),
}
PARTITION: dict[str, Keep] = {
    # These count for two minutes: longer than is explored. Only whether they are there is kept.
    "_partitioned_s": _age(0),
    "_whole_s": _age(0),
    "_contact_s": _age(SECOND),
    "waits_for": new(lambda _: []),  # slows the swarm down, and decides nothing
}
PHASES: dict[str, Keep] = {
    "phase": AS_IT_IS,
    "stop": AS_IT_IS,
    "saw_begin": AS_IT_IS,
    "_started": AS_IT_IS,
    "_ticked_s": _age(1),
    # By a clock that stands still while an operator holds the swarm: see `Shelf`.
    "_met_since_s": _age(SECOND),
    "_arrived_s": _age(CLOSE_UP),
    # It always comes nearer to its goal here: none is stuck.
    "_nearest_m": new(lambda _: math.inf),
    "_nearer_s": new(to_s),
    "_led_s": new(lambda _: -math.inf),
}
OPERATOR: dict[str, Keep] = {"started": AS_IT_IS, "aborts": AS_IT_IS, "lands": AS_IT_IS, "_holds": AS_IT_IS}
BLOCKLIST: dict[str, Keep] = {
    "_proven": (lambda proven, _: tuple(sorted(proven)), lambda proven, _: set(proven)),
    "_doubts": (
        lambda doubts, _: tuple(sorted((k, round(doubt / FADES)) for k, doubt in doubts.items())),
        lambda doubts, _: {k: steps * FADES for k, steps in doubts},
    ),
    # For a minute since it contradicted last: longer than is explored. Only whether it is blocked is kept.
    "_doubted": (
        lambda doubted, _: tuple(sorted(doubted)),
        lambda doubted, period: dict.fromkeys(doubted, to_s(period)),
    ),
    "_news": new(lambda _: []),  # said to an operator
}
LEADS: dict[str, Keep] = {
    "_usurpers": (lambda usurpers, _: tuple(sorted(usurpers)), lambda usurpers, _: set(usurpers)),
    "_unled_s": (
        lambda unled_s, period: min(APART_PERIODS + 1, round(min(1e6, period - unled_s / PERIOD_S))),
        lambda age, period: to_s(period - age),
    ),
    "_named": new(lambda _: set()),  # said to an operator, as the next
    "_news": new(lambda _: []),
    # All stand still here, and no time of a mission's is up: no leader gets lost, or nowhere.
    "_bound": new(lambda _: (SwarmPhase.ASSEMBLE, 0)),
    "_way_ned_m": new(lambda _: []),
    "_way_stop": new(lambda _: -1),
    "_left": new(lambda _: 0),
    "_moved_ned_m": new(lambda _: None),
    "_moved_s": new(to_s),
    "_leader": new(lambda _: 0),
    "_led_s": new(lambda _: -math.inf),
    "_within_m": new(lambda _: math.inf),
}
TRUST: dict[str, Keep] = {"_defiant": new(lambda _: set())}  # until the next period: of blocks, longer than explored
GATE: dict[str, Keep] = {
    "_words": (_take_words, _give_words),
    # The same
    "_pos_ned_m": new(lambda _: None),
    "_from_ned_m": new(lambda _: None),
    "_farthest_m": new(lambda _: 0.0),
}
PATIENCE: dict[str, Keep] = {"_since_s": new(lambda _: {}), "_over_s": new(lambda _: {})}  # of speed: decides nothing
RESIGNATION: dict[str, Keep] = {"_at_s": _age(CLOSE_UP), "_is_low": AS_IT_IS}
SWARM: dict[str, Keep] = {
    "launched": AS_IT_IS,
    "route": new(lambda _: None),  # found anew before it is asked for
    "governor": new(lambda _: 1.0),
}
# The same in all states, made of the mission or of what is not explored; or kept by hand below.
CONSTANT: dict[type, Sequence[str]] = {
    Election: ("me", "priority", "_patience", "_hop_limit", "_reelection_periods", "_held", "_own_seq"),
    Roster: ("_me", "_everyone", "_excluded"),  # as the blocklist
    NetworkPartition: (
        "recovery",
        "_timer",
        "_alone_is_company",
        "_alone_beacons_s",
        "_layers",
        "_held_m",
        "_layer_m",
        "_clear_m",
    ),
    Phases: (
        "_visits",
        "_mission",
        "_all",
        "_majority",
        "gather_limit_s",
        "_until",  # no survey here, as the next two
        "_knows_stand",
        "_gave_up",
        "since_s",
        "_forming",
        "_held_s",
        "_held_before_s",
    ),
    OperatorOrders: (),
    FloodedOrders: (),
    Blocklist: ("_most",),
    Patience: (),
    Resignation: (),
    LeadWatch: ("_apart_s", "_beacons", "_holds", "_limits_s", "_width_m"),
    PhaseGate: ("_me", "_heard_s", "_lane_ways_s", "_durations_s", "_at_end", "_back_m", "may_turn_back"),
    # Nobody gives up a leader, see LEADS: no accusations
    Trust: (
        *("_me", "_priorities", "blocklist", "_courses", "gate", "_leads", "_accusations", "_given_up"),
        *("_patience", "_fastest_mps", "_least_range_m", "_period_s", "_own_words_s"),
    ),
    Swarm: (
        "me",
        "operator",
        "_reception",
        "_priorities",
        "_resignation",
        "trust",
        "election",
        "phases",
        "roster",
        "partition",
        "_is_link_bad",
        "backtracking",
        "_home",
        "_reports",
        "_mission",
        "_size",
        "_period_s",
    ),
}
TIMED_PHASES = (SwarmPhase.ASSEMBLE, SwarmPhase.COVERAGE)  # how long they last is asked within the bound


class Shelf:
    """Takes a vehicle's swarm object as a value, and puts a value back into it."""

    def __init__(self, swarm: Swarm) -> None:
        """ValueError: a field of which no table says how it is kept."""
        self._swarm = swarm
        parts = (
            (swarm, SWARM),
            (swarm.operator, OPERATOR),
            (swarm.election, ELECTION),
            (swarm.roster, ROSTER),
            (swarm.partition, PARTITION),
            (swarm.phases, PHASES),
            (swarm.trust, TRUST),
            (swarm.trust.blocklist, BLOCKLIST),
            (swarm.trust._courses, BLOCKLIST),
            (swarm.trust.gate, GATE),
            (swarm.trust._leads, LEADS),
            (swarm.trust._patience, PATIENCE),
            (swarm._resignation, RESIGNATION),
        )
        for part, kept in parts:
            unknown = set(_fields(part)) - kept.keys() - set(CONSTANT[type(part)])
            if unknown:
                raise ValueError(f"{type(part).__name__}: {', '.join(sorted(unknown))}: say how it is kept")
        self._fields = [(part, name, *keep) for part, kept in parts for name, keep in kept.items()]

    def take(self, period: int, clock: int) -> Value:
        """The value at the end of a `period`. `clock`: by how much the vehicle's own is off."""
        election, phases = self._swarm.election, self._swarm.phases
        own = max(HOP_LIMIT + clock - 1, election._own_seq - period)  # below, its next claim counts from the clock
        held = min(election._patience, election._held) if election.leads else 0
        stood = round(phases._held_s / PERIOD_S)
        since = 0
        if phases.phase in TIMED_PHASES:
            since = min(SECOND, round(period + clock - stood - phases.since_s / PERIOD_S))
        stood_now = stood - round(
            phases._held_before_s / PERIOD_S
        )  # in this phase: counts as time that may have passed
        own_words = self._take_own_words(period, clock)
        rest = [
            take(getattr(part, name), _now(part, name, period, clock, stood)) for part, name, take, _ in self._fields
        ]
        return (own, since, held, min(SECOND, stood_now), own_words, *rest)

    def give(self, value: Value, period: int, clock: int) -> None:
        """The other way round."""
        election, phases, blocklist = self._swarm.election, self._swarm.phases, self._swarm.trust.blocklist
        own, since, held, stood, own_words, *rest = value
        election._own_seq, election._held = own + period, held
        for (part, name, _, give), kept in zip(self._fields, rest, strict=True):
            setattr(part, name, give(kept, _now(part, name, period, clock, stood)))
        phases._held_s, phases._held_before_s = to_s(stood), 0.0
        phases.since_s = to_s(period + clock - stood - since)
        phases._forming = FormingTime(phases._visits[phases.stop].duration_s, phases.since_s)
        self._give_own_words(own_words, period, clock)
        self._swarm.roster.exclude(blocklist.bits())
        self._swarm.partition._timer.end()
        self._swarm.take_reports()

    def _take_own_words(self, period: int, clock: int) -> Value:
        """What each member's own beacon said last of the leader: of one that said that it leads, the lease; and when.

        And of a leader the count that it should have by now, as far as another's word of it is held against that.
        """
        trust, found = self._swarm.trust, []
        for sender, (at_s, lease) in sorted(trust._leads._beacons.items()):
            age = round(period + clock - at_s / PERIOD_S)
            if age > APART_PERIODS:
                continue  # as if it had never been heard
            if lease is None or lease.leader != sender:
                found.append((sender, age, None, None))
                continue
            believed = trust._own_words_s.get(sender)
            seq, said_s = (lease.seq, to_s(period + clock)) if believed is None else believed
            ahead = seq - (round(said_s / PERIOD_S) - clock)
            ends = lease.ends - period if lease.ends else None
            found.append(
                (sender, age, (ahead, ends, lease.established, lease.heir, lease.quorum), believed is not None)
            )
        return tuple(found)

    def _give_own_words(self, value: Value, period: int, clock: int) -> None:
        trust = self._swarm.trust
        trust._leads._beacons, trust._own_words_s = {}, {}
        for sender, age, said, is_believed in value:
            lease = None
            if said is not None:
                ahead, ends, established, heir, quorum = said
                seq = ahead + period
                lease = Lease(sender, seq, 0, 0, established, heir, 0 if ends is None else ends + period, quorum)
                if is_believed:
                    trust._own_words_s[sender] = (seq, to_s(period + clock))
            trust._leads._beacons[sender] = (to_s(period + clock - age), lease)


MISSION_TIMES = ("_met_since_s", "_arrived_s", "_nearer_s")  # that stand still while the swarm is held


def _now(part: object, name: str, period: int, clock: int, stood: int) -> int:
    """Times are the vehicle's own, counts of leases are everybody's. `stood`: periods for which it has been held."""
    if name in MISSION_TIMES:
        return period + clock - stood
    return period + clock if name.endswith("_s") or isinstance(part, (PhaseGate, Blocklist)) else period


def _fields(part: Any) -> list[str]:
    """Names of all that an object holds."""
    slots = [name for kind in type(part).__mro__ for name in getattr(kind, "__slots__", ())]
    return [*slots, *getattr(part, "__dict__", {})]
