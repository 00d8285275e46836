"""The vector to d2 of a follower: others' words, as far as its own odometry bears them out."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.destination import DEST_OFF_M, FOLLOW_M, FOLLOW_MPS, TOLD_S, Destination
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import add, norm
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.core_kit import mission, neighbour

TRUE: Vec3 = (0.0, 50.0, 0.0)
NEXT: Vec3 = (60.0, 70.0, 0.0)  # the vector to the next visit
FALSE: Vec3 = (400.0, 0.0, 0.0)  # off it
HERE: Vec3 = (0.0, 0.0, -8.0)
TICK_S = 0.05
LEADER = 1
STOPS = mission(route={"stops": [{"pos_enu_m": (50.0, 0.0, 8.0), "duration_s": 12.0}]})


def told(vector: Vec3) -> list[Neighbour]:
    return [neighbour(2, (5.0, 0.0, 0.0), dest_ned_m=vector)]


def after(seconds: float, vector: Vec3, followed: Destination, *, from_s: float = 0.0) -> Vec3:
    for k in range(1, round(seconds / TICK_S) + 1):
        followed.update_follower(HERE, 0, told(vector), from_s + k * TICK_S, leader=LEADER)
    assert followed.ned_m is not None
    return followed.ned_m


class Follower:
    """One that has been told of the first visit by all of 1 (the leader) to 4, whom it hears; 9 lies of the next."""

    def __init__(self, *heard: int) -> None:
        self.heard, self.now_s = heard, 0.0
        self.dest = Destination(STOPS)
        self.run(2.0, 0)

    def hear(self, vehicle: int, stop: int, error_m: float = 0.0) -> Neighbour:
        vector = TRUE if stop == 0 else NEXT if vehicle != 9 else add(NEXT, FALSE)
        return neighbour(vehicle, (5.0, 0.0, 0.0), dest_ned_m=vector, stop=stop, position_error_m=error_m)

    def run(self, seconds: float, stop: int, *, late: tuple[int, ...] = ()) -> Vec3 | None:
        """`late`: who still tells of the visit before."""
        for _ in range(max(1, round(seconds / TICK_S))):
            self.now_s += TICK_S
            up = [self.hear(k, 0 if k in late else stop) for k in self.heard]
            self.dest.update_follower(HERE, stop, up, self.now_s, leader=LEADER)
        return self.dest.ned_m


def test_what_differs_a_little_counts_at_once_and_to_the_bit() -> None:
    followed = Destination(mission())
    assert after(1.0, TRUE, followed) == TRUE
    near = (1.0, 51.0, 0.5)
    assert after(TICK_S, near, followed, from_s=1.0) == near


@pytest.mark.parametrize("seconds", [0.05, 2.0, 10.0])
def test_a_false_word_moves_it_as_fast_as_odometry_may_drift(seconds: float) -> None:
    followed = Destination(mission())
    after(1.0, TRUE, followed)
    moved_m = math.dist(after(seconds, (0.0, 1000.0, 0.0), followed, from_s=1.0), TRUE)
    assert moved_m == pytest.approx(FOLLOW_M + FOLLOW_MPS * seconds, abs=0.1)


def test_who_did_not_know_its_place_takes_others_words() -> None:
    followed = Destination(mission())
    after(1.0, TRUE, followed)
    followed.forget_odometry()
    assert after(TICK_S, (30.0, 50.0, 0.0), followed, from_s=1.0) == (30.0, 50.0, 0.0)


@pytest.mark.parametrize("heard", [(1, 9), (9, 1), (1, 2, 9), (2, 3, 9), (2, 3, 4, 9)])
def test_a_false_word_of_another_visit_moves_it_by_no_more_than_one_on_the_way(heard: tuple[int, ...]) -> None:
    follower = Follower(*heard)
    at_once = follower.run(TICK_S, 1)
    assert at_once == NEXT
    later = follower.run(1.1, 1)
    assert later is not None
    assert math.dist(later, NEXT) <= FOLLOW_M + FOLLOW_MPS * 1.2


@pytest.mark.parametrize("heard", [(1, 9), (2, 9), (2, 3, 9)])
def test_a_false_word_of_another_visit_moves_the_fence_by_no_more_than_one_on_the_way(heard: tuple[int, ...]) -> None:
    follower = Follower(*heard)
    true = enu_to_ned(STOPS.visits[1].pos_enu_m)
    before = follower.dest.offset_ned_m(HERE)
    there = (true[0] - NEXT[0] - HERE[0], true[1] - NEXT[1] - HERE[1], 0.0)  # as the leader has it: it tells so
    for _ in range(22):
        follower.run(TICK_S, 1)
        offset = follower.dest.offset_ned_m(HERE)
        assert min(math.dist(offset, there), math.dist(offset, before)) <= FOLLOW_M + FOLLOW_MPS * 1.2


@pytest.mark.parametrize("heard", [(1,), (1, 2), (2,), (2, 3), (2, 3, 4)])
def test_it_goes_over_to_another_visit_in_the_tick_in_which_all_tell_it(heard: tuple[int, ...]) -> None:
    follower = Follower(*heard)
    assert follower.run(TICK_S, 1) == NEXT


def test_it_goes_over_with_its_leader_whatever_others_still_tell() -> None:
    follower = Follower(1, 2, 3)
    assert follower.run(TICK_S, 1, late=(2, 3)) == NEXT
    assert follower.run(0.3, 1, late=(2, 3)) == NEXT


def test_without_the_leader_it_waits_a_second_for_those_that_come_later() -> None:
    follower = Follower(2, 9)
    assert follower.run(TOLD_S - 2 * TICK_S, 1, late=(2,)) is None
    assert follower.run(TICK_S, 1) is None  # then they contradict each other
    alone = Follower(2, 3)
    assert alone.run(TOLD_S - 2 * TICK_S, 1, late=(3,)) is None
    assert alone.run(4 * TICK_S, 1, late=(3,)) == NEXT


def test_of_two_that_contradict_each_other_it_takes_neither_until_one_is_gone() -> None:
    follower = Follower(2, 9)
    before = follower.dest.offset_ned_m(HERE)
    assert follower.run(5.0, 1) is None
    assert follower.dest.offset_ned_m(HERE) == before
    follower.heard = (2,)
    assert follower.run(TICK_S, 1) == NEXT


@pytest.mark.parametrize(("apart_m", "error_m", "goes"), [(0.9, 0.0, True), (1.1, 0.0, False), (1.1, 2.0, True)])
def test_two_agree_as_nearly_as_honest_ones_do(apart_m: float, error_m: float, *, goes: bool) -> None:
    follower = Follower(2, 3)
    one = follower.hear(2, 1)
    other = neighbour(
        3,
        (5.0, 0.0, 0.0),
        dest_ned_m=add(NEXT, (apart_m * DEST_OFF_M, 0.0, 0.0)),
        stop=1,
        position_error_m=error_m,
    )
    follower.dest.update_follower(HERE, 1, [one, other], follower.now_s + TICK_S, leader=LEADER)
    assert (follower.dest.ned_m is not None) is goes


def test_who_comes_to_lead_before_it_is_told_goes_on_from_where_it_was() -> None:
    follower = Follower(2, 9)
    follower.run(2.0, 1)
    follower.dest.update_anchored_leader(add(HERE, (1.0, 0.0, 0.0)), 1, None, 0.0)
    on = [there - here for there, here in zip(STOPS.visits[1].pos_enu_m, STOPS.visits[0].pos_enu_m, strict=True)]
    assert follower.dest.ned_m is not None
    assert norm(add(follower.dest.ned_m, (1.0 - TRUE[0] - on[1], -TRUE[1] - on[0], 0.0))) < 1e-9
