"""A part that has lost the others: where it looks for them, in which order, and when it gives up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from companion.core.model.vectors import norm, sub
from companion.core.swarm.partition_recovery import (
    AGAIN_S,
    AHEAD_M,
    APPROACH_LIMIT_S,
    BEYOND,
    HERE_S,
    KEPT,
    LED_MPS,
    LINGER_S,
    LISTEN_S,
    LOST_S,
    ON_S,
    REACHED_M,
    RETRACE_LIMIT_S,
    STANDS_S,
    STEP_M,
    LinkTrail,
    LostPeerTimer,
    PartitionRecovery,
    Stage,
)
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3

HOLD_S = failsafe_engine.row(Cause.OTHERS_LOST).delay_s
WAIT_S = failsafe_engine.row(Cause.OTHERS_LOST).limit_s

PERIOD_S = 0.1
TWO, THREE = 0b010, 0b100  # vehicles, as bits


def at(north_m: float, east_m: float = 0.0) -> Vec3:
    return (north_m, east_m, -8.0)


def flown(trail: LinkTrail, *, to_m: int, heard_until_m: int, heard: int = TWO) -> None:
    """North from 0, hearing `heard` up to there."""
    for north_m in range(to_m + 1):
        trail.record_links(at(float(north_m)), heard if north_m <= heard_until_m else 0)


def walked_back(trail: LinkTrail, here: Vec3) -> list[Vec3]:
    """The places that are gone to, one after the other, each reached exactly."""
    places: list[Vec3] = []
    while (place := trail.next_waypoint(here)) is not None:
        here = place
        places.append(place)
        assert len(places) < 1000
    return places


# --- the way back ---


def test_way_back_ends_just_behind_the_last_place_at_which_the_lost_were_heard() -> None:
    trail = LinkTrail()
    flown(trail, to_m=20, heard_until_m=12)
    assert trail.turn_back(TWO)
    last = walked_back(trail, at(20.0))[-1]
    assert norm(sub(last, at(12.0 - BEYOND))) <= REACHED_M


def test_way_back_follows_the_own_way_round_corners() -> None:
    trail = LinkTrail()
    for place in [*(at(float(k)) for k in range(10)), *(at(9.0, float(k)) for k in range(1, 10))]:
        trail.record_links(place, TWO if place == at(0.0) else 0)
    assert trail.turn_back(TWO)
    places = walked_back(trail, at(9.0, 9.0))
    own_way = [at(float(k)) for k in range(10)] + [at(9.0, float(k)) for k in range(1, 10)]
    assert all(place in own_way for place in places)
    assert places[-1] == at(0.0)


def test_whom_it_has_never_heard_there_is_no_way_back_to() -> None:
    trail = LinkTrail()
    flown(trail, to_m=20, heard_until_m=12)
    assert not trail.turn_back(THREE)
    assert trail.next_waypoint(at(20.0)) is None


def test_trail_keeps_the_newest_places_only() -> None:
    trail = LinkTrail()
    flown(trail, to_m=KEPT + 50, heard_until_m=10)
    assert not trail.turn_back(TWO)
    for k in range(10_000):
        trail.record_links(at(math.sin(k) * 100.0), 0)
    assert trail._trail.count == len(trail._linked) == KEPT


def test_what_was_heard_while_it_hung_at_a_place_counts_for_the_place() -> None:
    trail = LinkTrail()
    trail.record_links(at(0.0), TWO)
    trail.record_links(at(0.2), THREE)
    assert trail.turn_back(TWO)
    assert trail.turn_back(THREE)


def test_way_back_is_gone_some_metres_at_a_time() -> None:
    trail = LinkTrail()
    flown(trail, to_m=20, heard_until_m=2)
    assert trail.turn_back(TWO)
    place = trail.next_waypoint(at(20.0))
    assert place is not None
    assert AHEAD_M - STEP_M < 20.0 - place[0] <= AHEAD_M


# --- the search ---


class Lost:
    """A leader's search, period by period; it goes where the search says, at 3 m/s."""

    def __init__(self, *, heard_at: Vec3 | None = None, ahead: Sequence[Vec3] = (), can_move: bool = True) -> None:
        self.search, self.now_s, self.lost_s = PartitionRecovery(), 100.0, 0.0
        self.pos = at(20.0)
        self.heard_at = heard_at
        self.ahead = [(place, 35.0) for place in ahead]
        self.can_move = can_move
        self.stages: list[Stage] = []
        flown(self.search.trail, to_m=20, heard_until_m=12)

    def here(self, seconds: float = HERE_S + PERIOD_S) -> None:
        """The others are here again for so long."""
        for _ in range(round(seconds / PERIOD_S) + 1):
            self.now_s += PERIOD_S
            self.search.end(self.now_s)

    def run(self, seconds: float, *, lost: int = TWO) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.now_s += PERIOD_S
            self.lost_s += PERIOD_S
            self.search.update(
                self.now_s, self.pos, lost_s=self.lost_s, lost=lost, heard_at=self.heard_at, ahead=self.ahead
            )
            if not self.stages or self.stages[-1] is not self.search.stage:
                self.stages.append(self.search.stage)
            if self.search.goal is not None and self.can_move:
                way = sub(self.search.goal[0], self.pos)
                step_m = min(3.0 * PERIOD_S, max(0.0, norm(way) - self.search.goal[1]))
                if step_m > 0.0:
                    self.pos = at(*(self.pos[k] + way[k] / norm(way) * step_m for k in (0, 1)))


def test_it_holds_then_retraces_then_approaches_then_goes_ahead_then_waits() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    lost.run(120.0)
    assert lost.stages == [Stage.HOLD, Stage.RETRACE, Stage.APPROACH, Stage.AHEAD, Stage.WAIT]
    assert lost.search.goal is None
    assert norm(sub(lost.pos, at(130.0))) >= 35.0  # outside


def test_it_looks_at_each_place_that_the_swarm_was_bound_for_one_after_the_other() -> None:
    lost = Lost(ahead=[at(130.0), at(130.0, 200.0), at(0.0)])
    places: list[Vec3] = []
    there_s: dict[Vec3, float] = {}
    for _ in range(3000):
        lost.run(PERIOD_S)
        if lost.search.stage is Stage.AHEAD and lost.search.goal is not None:
            place, outside_m = lost.search.goal
            if place not in places:
                places.append(place)
            if norm(sub(place, lost.pos)) <= outside_m + REACHED_M:
                there_s[place] = there_s.get(place, 0.0) + PERIOD_S
    assert places == [at(130.0), at(130.0, 200.0), at(0.0)]
    assert all(LISTEN_S <= there_s[place] <= LISTEN_S + 1.0 for place in places)
    assert lost.search.stage is Stage.WAIT


def test_shadow_that_passes_moves_nobody() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    lost.run(HOLD_S - 2 * PERIOD_S)
    lost.here()
    assert lost.stages == [Stage.HOLD]
    assert lost.pos == at(20.0)


def test_when_the_others_are_here_again_it_goes_nowhere_and_a_new_loss_begins_with_a_hold() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    lost.run(3.0)
    assert lost.search.goal is not None
    lost.here()
    assert lost.search.goal is None
    lost.lost_s = 0.0
    lost.run(HOLD_S - 2 * PERIOD_S)
    assert lost.search.stage is Stage.HOLD


def test_others_that_are_heard_for_a_moment_only_do_not_make_it_begin_anew() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    lost.run(3.0)
    lost.here(1.0)
    assert lost.search.goal is None
    lost.run(PERIOD_S)
    assert lost.search.stage is Stage.RETRACE
    assert lost.search.goal is not None


def test_back_at_its_last_link_it_gives_the_others_time_to_come_back_to_theirs() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    for _ in range(300):
        lost.run(PERIOD_S)
        if lost.search.stage is Stage.RETRACE and lost.search.goal is None:
            break
    assert lost.search.stage is Stage.RETRACE
    here = lost.pos
    lost.run(LINGER_S - 2 * PERIOD_S)
    assert lost.pos == here
    lost.run(1.0)
    assert lost.search.stage is Stage.APPROACH


@pytest.mark.parametrize("stage", [Stage.RETRACE, Stage.APPROACH])
def test_one_that_cannot_get_there_soon_goes_on_to_the_next(stage: Stage) -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)], can_move=False)
    lost.run(HOLD_S + 2.0 * STANDS_S + LINGER_S + 1.0)
    assert stage in lost.stages
    assert lost.search.stage is Stage.AHEAD


def test_one_that_moves_but_gets_nowhere_goes_on_after_a_bounded_time() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)], can_move=False)
    for _ in range(round((HOLD_S + RETRACE_LIMIT_S + APPROACH_LIMIT_S + 1.0) / PERIOD_S)):
        lost.pos = at(60.0, 3.0 * math.sin(lost.now_s))
        lost.run(PERIOD_S)
    assert lost.search.stage is Stage.AHEAD


def test_without_a_place_to_look_at_it_waits_where_the_last_link_was() -> None:
    lost = Lost()
    lost.run(20.0)
    assert lost.stages == [Stage.HOLD, Stage.RETRACE, Stage.WAIT]
    assert norm(sub(lost.pos, at(12.0 - BEYOND))) <= REACHED_M


# --- the majority's patience ---


def test_each_that_is_lost_is_waited_for_once_and_for_a_bounded_time() -> None:
    patience, waited = LostPeerTimer(), 0
    for period in range(600):
        waited += patience.update(TWO, period * PERIOD_S, PartitionRecovery()) == [2]
    assert waited == pytest.approx(WAIT_S / PERIOD_S, abs=1)


def test_branch_that_changes_its_parent_is_not_waited_for() -> None:
    patience = LostPeerTimer()
    for period in range(600):
        missing = TWO if period % 20 < (LOST_S - 0.2) / PERIOD_S else 0
        assert patience.update(missing, period * PERIOD_S, PartitionRecovery()) == []


def test_one_that_comes_back_and_is_lost_again_soon_is_waited_for_when_the_swarm_has_gone_on_for_a_while() -> None:
    """What cuts it off stands on the way: to wait before it would part them again, to fly on for good too."""
    patience, waited = LostPeerTimer(), []
    for period in range(400):
        now_s = period * PERIOD_S
        if patience.update(0 if 6.0 <= now_s < 12.0 else TWO, now_s, PartitionRecovery()):
            waited.append(now_s)
    first = [now_s for now_s in waited if now_s < 6.0]
    again = [now_s for now_s in waited if now_s >= 6.0]
    assert first[0] == pytest.approx(LOST_S)
    assert again[0] == pytest.approx(12.0 + LOST_S + ON_S)
    assert again[-1] - again[0] == pytest.approx(WAIT_S, abs=2 * PERIOD_S)


def gone_on(back_s: float, on_s: float) -> PartitionRecovery:
    search = PartitionRecovery()
    search.note_course(-3.0, back_s)
    search.note_course(3.0, on_s)
    return search


def test_one_that_is_lost_after_the_swarm_has_gone_back_and_on_is_waited_for_later_too() -> None:
    patience, search = LostPeerTimer(), gone_on(45.0, 48.0)
    due = [k for k in range(100) if patience.update(TWO, 50.0 + k * PERIOD_S, search)]
    assert due[0] * PERIOD_S == pytest.approx(LOST_S + ON_S)


def test_loss_is_a_new_one_unless_they_have_gone_back_lately_and_then_on() -> None:
    assert gone_on(90.0, 95.0).is_again(100.0)
    assert not PartitionRecovery().is_again(100.0)
    assert not gone_on(100.0 - AGAIN_S, 95.0).is_again(100.0)
    assert not gone_on(90.0, 102.0).is_again(100.0)
    on_its_way_back = gone_on(90.0, 95.0)
    on_its_way_back.note_course(-3.0, 99.0)
    on_its_way_back.note_course(0.5 * LED_MPS, 99.5)
    assert not on_its_way_back.is_again(100.0)


def test_one_that_was_led_back_and_on_goes_ahead_when_it_leads_those_that_are_lost_again() -> None:
    """All parts must do the same: one that goes back while the others go ahead stays alone."""
    lost = Lost(ahead=[at(130.0)])
    lost.search.note_course(-3.0, lost.now_s - 2.0)
    lost.search.note_course(3.0, lost.now_s - 1.0)
    lost.here(PERIOD_S)
    lost.run(4.0)
    assert lost.stages == [Stage.AHEAD]


def test_one_that_is_parted_again_as_soon_as_they_go_on_does_not_go_back_once_more() -> None:
    lost = Lost(heard_at=at(-40.0), ahead=[at(130.0)])
    lost.search.note_course(-3.0, lost.now_s)
    lost.run(3.0)
    assert lost.search.stage is Stage.RETRACE
    lost.search.note_course(3.0, lost.now_s)
    lost.here(2 * PERIOD_S)
    lost.run(2 * PERIOD_S)
    assert lost.search.stage is Stage.AHEAD


def test_one_that_cuts_a_corner_of_its_way_back_does_not_turn_round_for_it() -> None:
    trail = LinkTrail()
    for place in [*(at(float(k)) for k in range(10)), *(at(9.0, float(k)) for k in range(1, 10))]:
        trail.record_links(place, TWO if place == at(0.0) else 0)
    assert trail.turn_back(TWO)
    assert trail.next_waypoint(at(9.0, 3.0)) is not None
    ahead = trail.next_waypoint(at(6.5, 0.5))
    assert ahead is not None
    assert ahead[0] < 6.5


def test_a_part_that_is_lost_again_soon_goes_ahead_and_not_back_once_more() -> None:
    lost = Lost(ahead=[at(130.0)])
    lost.run(4.0)
    assert lost.stages == [Stage.HOLD, Stage.RETRACE]
    lost.search.note_course(-3.0, lost.now_s)
    lost.search.note_course(3.0, lost.now_s + 1.0)
    lost.here()
    lost.lost_s, lost.stages = 0.0, []
    lost.run(4.0)
    assert lost.stages == [Stage.AHEAD]
    lost.now_s += AGAIN_S
    lost.here()
    lost.lost_s, lost.stages = 0.0, []
    lost.run(2.0)
    assert Stage.AHEAD not in lost.stages[:2]


def test_another_that_is_lost_later_is_waited_for_anew() -> None:
    patience = LostPeerTimer()
    for period in range(300):
        patience.update(TWO, period * PERIOD_S, PartitionRecovery())
    assert patience.update(TWO | THREE, 30.0, PartitionRecovery()) == []
    assert patience.update(TWO | THREE, 30.0 + LOST_S, PartitionRecovery()) == [3]
