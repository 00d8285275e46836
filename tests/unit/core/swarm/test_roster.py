"""Which vehicles took off, which are here, and whether that is the majority."""

from __future__ import annotations

from companion.core.localisation.link_share import SILENCE_MAX_S
from companion.core.model.states import SwarmPhase
from companion.core.swarm.election import HELD_PERIODS, LEASE_PERIODS
from companion.core.swarm.roster import DECIDES_AFTER_S, Roster, ids
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_kit import beacon

QUORUM_LOST_S = failsafe_engine.row(Cause.NO_MAJORITY).delay_s

TRANSIT = SwarmPhase.TRANSIT
MAJORITY = [beacon(k, present=1 << (k - 1), phase=TRANSIT) for k in (2, 3, 4, 5)]  # of eight, with vehicle 1


def roster(*present: int, flown: int, me: int = 1, size: int = 8) -> Roster:
    one = Roster(me, size)
    one.update_flown(beacon(2, flown=flown))
    one.mark_airborne()
    one.collect_branches([beacon(k, present=1 << (k - 1), phase=TRANSIT) for k in present], done=True, phase=TRANSIT)
    return one


def test_more_than_half_of_those_that_took_off_are_a_quorum() -> None:
    for present, held in (((2, 3, 4), False), ((2, 3, 4, 5), True)):
        one = roster(*present, flown=0b11111111)
        one.has_quorum(10.0)
        assert one.has_quorum(10.0 + QUORUM_LOST_S + 0.1) is held


def test_those_that_never_took_off_are_not_missed() -> None:
    one = roster(2, 3, flown=0b111)
    one.has_quorum(10.0)
    assert one.has_quorum(20.0)
    assert one.missing_peers() == 0


def test_those_last_heard_on_the_ground_are_not_missed() -> None:
    one = roster(2, flown=0b11111)
    assert ids(one.missing_peers()) == [3, 4, 5]
    assert ids(one.missing_peers(grounded=0b11000)) == [3]
    one.has_quorum(10.0)
    assert not one.has_quorum(20.0)
    assert one.has_quorum(20.0, grounded=0b11000)


def test_branch_that_is_not_heard_for_a_moment_is_not_lost() -> None:
    one = roster(2, 3, 4, 5, flown=0b11111111)
    assert one.has_quorum(10.0)
    one.collect_branches([], done=False, phase=TRANSIT)
    assert one.has_quorum(10.0 + QUORUM_LOST_S - 0.1)
    assert not one.has_quorum(10.0 + QUORUM_LOST_S + 0.1)


def test_new_leader_has_no_majority_before_it_has_counted_one() -> None:
    one = roster(flown=0b11111111)
    assert not one.has_quorum(10.0)
    one.collect_branches(MAJORITY, done=True, phase=TRANSIT)
    assert one.has_quorum(11.0)
    one.collect_branches([], done=False, phase=TRANSIT)
    one.begin_lead(None)
    assert not one.has_quorum(11.1)


def test_heir_has_the_majority_that_it_was_handed_for_a_moment_to_hear_who_is_there() -> None:
    one = roster(flown=0b11111111)
    one.begin_lead(10.0)
    assert one.has_quorum(10.1)
    assert not one.may_decide(10.1)  # it guides, and decides nothing
    assert not one.has_quorum(10.0 + QUORUM_LOST_S + 0.1)


def test_leader_decides_when_it_has_had_the_majority_for_a_while() -> None:
    one = roster(flown=0b11111111)
    one.collect_branches(MAJORITY, done=True, phase=TRANSIT)
    assert one.has_quorum(10.0)
    assert not one.may_decide(9.9 + DECIDES_AFTER_S)
    one.collect_branches([], done=False, phase=TRANSIT)
    assert one.has_quorum(10.1)  # for a moment only: that is no loss
    one.collect_branches(MAJORITY, done=True, phase=TRANSIT)
    assert one.has_quorum(10.1 + DECIDES_AFTER_S)
    assert one.may_decide(10.1 + DECIDES_AFTER_S)


def test_leader_that_had_lost_the_majority_waits_anew() -> None:
    one = roster(flown=0b11111111)
    one.collect_branches(MAJORITY, done=True, phase=TRANSIT)
    assert one.has_quorum(10.0)
    one.collect_branches([], done=False, phase=TRANSIT)
    assert not one.has_quorum(20.0)
    one.collect_branches(MAJORITY, done=True, phase=TRANSIT)
    assert one.has_quorum(30.0)
    assert not one.may_decide(30.0)


def test_before_any_has_taken_off_a_leader_decides_at_once() -> None:
    one = Roster(1, 8)
    assert one.has_quorum(10.0)
    assert one.may_decide(10.0)


def test_by_then_a_leader_whose_majority_has_gone_over_has_noticed() -> None:
    """From the last news of it on: by the worst radio, two hops off. Others have another one that acts by then."""
    others_act_s = 0.1 * (LEASE_PERIODS + HELD_PERIODS - 1)
    assert others_act_s + DECIDES_AFTER_S > 2 * SILENCE_MAX_S + SILENCE_MAX_S + QUORUM_LOST_S


def test_done_counts_only_in_the_same_phase_and_presence_in_any() -> None:
    one = Roster(1, 3)
    branches = [
        beacon(2, done=0b10, present=0b10, phase=SwarmPhase.GATHER),
        beacon(3, done=0b100, present=0b100, phase=TRANSIT),
    ]
    one.collect_branches(branches, done=False, phase=TRANSIT)
    assert (one.done, one.present) == (0b100, 0b111)


def test_done_counts_only_at_the_same_stop() -> None:
    one = Roster(1, 3)
    branches = [beacon(k, done=1 << (k - 1), present=1 << (k - 1), phase=TRANSIT, stop=k - 2) for k in (2, 3)]
    one.collect_branches(branches, done=False, phase=TRANSIT, stop=1)
    assert (one.done, one.present) == (0b100, 0b111)


def test_vehicles_that_the_mission_does_not_know_count_for_nothing() -> None:
    one = Roster(1, 3)
    one.update_flown(beacon(2, flown=(1 << 256) - 1))
    one.collect_branches([beacon(2, done=0xFF00, present=0xFF02, phase=TRANSIT)], done=True, phase=TRANSIT)
    assert (one.done, one.present, one.flown) == (1, 0b11, 0b111)
