"""Which vehicles took off, which are here, and whether that is the majority."""

from __future__ import annotations

from companion.core.localisation.link_share import SILENCE_MAX_S
from companion.core.model.states import SwarmPhase
from companion.core.swarm.election import HELD_PERIODS, LEASE_PERIODS
from companion.core.swarm.roster import DECIDES_AFTER_S, DOUBTED_S, Roster, ids
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from tests.unit.core.core_kit import beacon

QUORUM_LOST_S = failsafe_engine.row(Cause.NO_MAJORITY).delay_s

TRANSIT = SwarmPhase.TRANSIT
MAJORITY = [beacon(k, present=1 << (k - 1), phase=TRANSIT) for k in (2, 3, 4, 5)]  # of eight, with vehicle 1


def roster(*present: int, flown: int, me: int = 1, size: int = 8) -> Roster:
    one = Roster(me, size)
    one.update_flown(beacon(2, flown=flown))
    one.mark_airborne(takes_off=True)
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


def anew(*present: int, flown: int = 0, size: int = 8) -> Roster:
    """Vehicle 1's, which was started in the air."""
    one = Roster(1, size)
    one.update_flown(beacon(2, flown=flown))
    one.mark_airborne(takes_off=False)
    one.collect_branches([beacon(k, present=1 << (k - 1), phase=TRANSIT) for k in present], done=True, phase=TRANSIT)
    return one


def test_who_was_started_in_the_air_makes_no_majority_of_those_that_it_hears() -> None:
    """Three of ten, whose companions stood still while they were cut off: two leaders decided at once (seed 12043)."""
    one = anew(2, 3, flown=0b111, size=10)
    assert not one.has_quorum(10.0)
    assert not one.may_decide(20.0)
    assert ids(one.missing_peers()) == [4, 5, 6, 7, 8, 9, 10]
    assert one.flown == 0b111  # what it does not know it does not tell


def test_who_was_started_in_the_air_counts_the_majority_of_the_mission_but_for_the_grounded() -> None:
    assert anew(2, 3, 4, 5, flown=0b11111).has_quorum(10.0)
    assert not anew(2, 3, flown=0b111).has_quorum(10.0)
    assert anew(2, 3, flown=0b111).has_quorum(10.0, grounded=0b11111000)
    assert not anew(2, 3, 4, 5, flown=0b111).has_quorum(10.0, grounded=0b11000)  # on the ground, they add nothing


def test_who_was_started_in_the_air_knows_who_took_off_when_it_follows_the_majority() -> None:
    one = anew(2, 3, flown=0b111)
    one.note_following(None, majority=False)
    assert not one.has_quorum(10.0)
    one.note_following(None, majority=True)
    one.mark_airborne(takes_off=False)
    assert one.has_quorum(11.0)
    assert not one.missing_peers()


def test_who_takes_off_knows_with_whom() -> None:
    one = anew(2, 3, flown=0b111)
    one.mark_airborne(takes_off=True)
    assert one.has_quorum(10.0)


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
    one.note_following(None, majority=False)
    assert not one.has_quorum(11.1)


def test_heir_has_the_majority_that_it_was_handed_for_a_moment_to_hear_who_is_there() -> None:
    one = roster(flown=0b11111111)
    one.note_following(10.0, majority=False)
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


# --- those that fell silent here ---


def told(*branches: tuple[int, int], silent: int, flown: int = 0b11111111, me: int = 1) -> Roster:
    """`branches`: of whom, and which it says are in it."""
    one = Roster(me, 8)
    one.mark_launched(flown)
    words = [beacon(k, present=present, phase=TRANSIT) for k, present in branches]
    one.collect_branches(words, done=True, phase=TRANSIT, silent=silent)
    return one


def counts(one: Roster, *, grounded: int = 0) -> bool:
    """It has the majority, and still has it when its doubts have had their time."""
    assert one.has_quorum(10.0, grounded=grounded)
    assert one.has_quorum(10.0 + DOUBTED_S - 0.1, grounded=grounded)
    one.has_quorum(10.0 + DOUBTED_S, grounded=grounded)
    return one.has_quorum(10.0 + DOUBTED_S + QUORUM_LOST_S, grounded=grounded)


def test_one_branchs_word_of_those_that_fell_silent_here_makes_no_majority() -> None:
    one = told((2, 0b11111110), (3, 0b100), silent=0b11111000)
    assert not counts(one)
    assert one.present == 0b11111111
    assert ids(one.missing_peers()) == [4, 5, 6, 7, 8]
    assert one.find_linked() == 0b111


def test_those_that_are_heard_again_in_time_were_never_missed() -> None:
    one = told((2, 0b11111110), (3, 0b100), silent=0b11111000)
    assert one.has_quorum(10.0)
    assert one.has_quorum(9.9 + DOUBTED_S)
    one.collect_branches([beacon(2, present=0b11111110, phase=TRANSIT)], done=True, phase=TRANSIT)
    assert one.has_quorum(10.0 + DOUBTED_S)
    assert not one.missing_peers()
    assert one.may_decide(10.0 + DECIDES_AFTER_S)


def test_who_begins_to_lead_doubts_nobody_yet() -> None:
    one = told((2, 0b11111110), (3, 0b100), silent=0b11111000)
    assert not counts(one)
    one.note_following(None, majority=False)
    assert not one.missing_peers()
    assert one.has_quorum(20.0)


def test_its_word_counts_of_those_that_were_never_heard_here() -> None:
    one = told((2, 0b11111110), silent=0)
    assert counts(one)
    assert not one.missing_peers()
    assert one.find_linked() == 0b11111111


def test_where_the_others_are_the_majority_its_word_counts_of_the_rest() -> None:
    one = told((2, 0b11100010), (3, 0b11100), silent=0b11100000)
    assert counts(one)
    assert not one.missing_peers()


def test_one_branch_lies_at_most() -> None:
    """A chain: the leader in its middle hears its two neighbours, and lost the others out of sight."""
    one = told((3, 0b111), (5, 0b11110000), silent=0b11100011, me=4)
    assert counts(one)
    assert not one.missing_peers()


def test_a_part_without_the_majority_misses_whom_it_missed() -> None:
    one = told((2, 0b1110), silent=0b1000)
    for now_s in (10.0, 20.0):
        assert not one.has_quorum(now_s)
        assert ids(one.missing_peers()) == [5, 6, 7, 8]


def test_those_on_the_ground_are_not_missed_whatever_one_branch_says() -> None:
    assert counts(told((2, 0b11111110), (3, 0b100), silent=0b11111000), grounded=0b11110000)


def test_before_another_decides_a_leader_goes_by_no_branchs_word_alone() -> None:
    others_act_s = 0.1 * (LEASE_PERIODS + HELD_PERIODS - 1)
    assert others_act_s + DECIDES_AFTER_S > SILENCE_MAX_S + DOUBTED_S + QUORUM_LOST_S


def test_who_is_heard_here_has_done_what_it_says_itself() -> None:
    one = Roster(1, 4)
    all_done = beacon(2, done=0b1110, present=0b1110, phase=TRANSIT)
    for own, done in (
        (beacon(3, done=0b100, phase=TRANSIT), 0b1111),
        (beacon(3, done=0, phase=TRANSIT), 0b1011),
        (beacon(3, done=0b100, phase=SwarmPhase.GATHER), 0b1011),
        (beacon(3, done=0b100, phase=TRANSIT, stop=1), 0b1011),
    ):
        one.collect_branches([all_done], done=True, phase=TRANSIT, heard=[all_done, own])
        assert one.done == done


def test_of_a_blocked_member_that_is_heard_others_say_what_it_has_done() -> None:
    """Its own words do not count here; where they do, they go up the routes."""
    one = Roster(1, 3)
    one.exclude(0b100)
    one.collect_branches([beacon(2, done=0b110, phase=TRANSIT)], done=True, phase=TRANSIT, heard=[beacon(3)])
    assert one.done == 0b111
