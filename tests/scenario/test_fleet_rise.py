"""A leader that rises to deliver records: only the leader of a majority, only in a column that it has seen free."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from companion.core.agent import TICK_S
from companion.core.guidance.guidance_input import Desired
from companion.core.model.stand import RecordsWaiting
from companion.core.model.states import FlightMode, FlightState, Order
from companion.core.model.vectors import ZERO
from companion.core.perception.columns.column import Column
from companion.core.rise.rise import BACK_S, CLIMBS_M, ColumnRise, Stage
from companion.core.safety.setpoint import Setpoint
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.rules.rise_rules import ALOFT_MAX_S
from tests.unit.core.core_fleet import Aircraft, Fleet
from tests.unit.core.core_kit import mission
from tests.unit.core.rise.column_kit import see_column

pytestmark = pytest.mark.sources
UP_M, CEILING_M, TOP_M = 8.0, 10.0, 25.0
HEARD_UP_M = 18.0  # from here on the base station hears a vehicle
WAITING = 40


def surveys(size: int = 4, rise_to_m: float | None = TOP_M, **tables: dict[str, Any]) -> Mission:
    values: dict[str, Any] = {
        "route": {"d2_enu_m": (60.0, 0.0, UP_M), "at_end": "land"},
        "swarm": {"size": size},
        "coverage": {"duration_s": 40.0, "radius_m": 12.0},
        "fence": {"altitude_max_m": CEILING_M},
        "sensing": {"sensor": "multi-layer", "range_m": 40.0},
        "survey": {} if rise_to_m is None else {"rise_to_m": rise_to_m},
    }
    return mission(**(values | tables))


class Surveyors(Fleet):
    """A fleet whose base station hears who is above the crowns alone, and acknowledges a record in each tick."""

    def __init__(self, flies: Mission, *, sees: bool = True) -> None:
        super().__init__(flies, range_m=55.0)
        self.waiting, self.sees = WAITING, sees
        self.hears = True  # the base station, who is up
        self.highest_m = dict.fromkeys(self.aircraft, 0.0)
        self.up_at_once = 0  # most vehicles above the ceiling at a time
        self.told_s = 0.0

    def tick(self) -> None:
        super().tick()
        flying = [one for one in self.aircraft.values() if one.altitude_m > CEILING_M + 1.0]
        self.up_at_once = max(self.up_at_once, len(flying))
        for one in self.aircraft.values():
            self.highest_m[one.id] = max(self.highest_m[one.id], one.altitude_m)
        if self.hears and any(one.altitude_m > HEARD_UP_M and one.id not in self.mute for one in flying):
            self.waiting = max(0, self.waiting - 1)
        if self.now_s - self.told_s >= 1.0:
            self.told_s = self.now_s
            for one in self.aircraft.values():
                one.agent.receive(RecordsWaiting(self.waiting), self.now_s)
                if self.sees:
                    see_all(self, one)

    def leader(self) -> Aircraft:
        (leader,) = self.acting()
        return self.aircraft[leader]

    def until_true(self, holds: Callable[[], bool], *, limit_s: float) -> None:
        began_s = self.now_s
        while not holds():
            assert self.now_s - began_s < limit_s, {k: (a.state.name, a.altitude_m) for k, a in self.aircraft.items()}
            self.tick()


def see_all(swarm: Fleet, one: Aircraft) -> None:
    for column in columns_of(one):
        if not column.is_free(swarm.now_s, from_up_m=column.floor_up_m):
            see_column(column, swarm.now_s)


def columns_of(one: Aircraft) -> list[Column]:
    return one.agent.perception.columns.columns  # type: ignore[attr-defined]


def rise_of(one: Aircraft) -> ColumnRise:
    assert isinstance(one.agent.rise, ColumnRise)
    return one.agent.rise


def covering(flies: Mission | None = None, *, sees: bool = True) -> Surveyors:
    swarm = Surveyors(flies or surveys(), sees=sees)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("COVERAGE", limit_s=120.0)
    return swarm


def risen(flies: Mission | None = None) -> tuple[Surveyors, Aircraft]:
    """The leader is halfway up."""
    swarm = covering(flies)
    swarm.hears = False
    leader = swarm.leader()
    swarm.until_true(lambda: leader.altitude_m > 15.0, limit_s=90.0)
    return swarm, leader


def comes_down(swarm: Surveyors, one: Aircraft, *, limit_s: float = 30.0) -> float:
    """How far, level, it is off its column until it is down again."""
    axis, off_m = one.pos_ned_m, 0.0
    began_s = swarm.now_s
    while one.altitude_m > CEILING_M:
        assert swarm.now_s - began_s < limit_s, (one.state, one.altitude_m, one.said[-3:])
        swarm.tick()
        off_m = max(off_m, math.dist(axis[:2], one.pos_ned_m[:2]))
    return off_m


def test_the_leader_rises_delivers_comes_down_and_the_swarm_goes_on() -> None:
    swarm = covering()
    leader = swarm.leader()
    swarm.until("LANDED", limit_s=240.0)
    assert swarm.waiting == 0
    assert HEARD_UP_M < swarm.highest_m[leader.id] <= TOP_M
    assert max(m for k, m in swarm.highest_m.items() if k != leader.id) <= CEILING_M
    assert f"records: {WAITING} waiting; rising to 25 m" in leader.said
    assert "rise ends: all records delivered" in leader.said
    assert leader.said.count("rise ends: all records delivered") == 1
    assert swarm.least_m >= 4.5


def test_without_the_key_nobody_rises_and_records_stay() -> None:
    swarm = Surveyors(surveys(rise_to_m=None), sees=False)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("LANDED", limit_s=240.0)
    assert swarm.waiting == WAITING
    assert max(swarm.highest_m.values()) <= CEILING_M


def test_what_is_delivered_from_below_makes_nobody_rise() -> None:
    swarm = covering()
    swarm.waiting = 0
    swarm.until("LANDED", limit_s=240.0)
    assert max(swarm.highest_m.values()) <= CEILING_M


def test_while_the_base_station_acknowledges_nobody_rises() -> None:
    swarm = covering()
    for _ in range(30):
        swarm.waiting -= 1
        swarm.run(1.0)
    assert max(swarm.highest_m.values()) <= CEILING_M


def test_where_no_column_is_known_free_it_stays_and_says_so_once() -> None:
    swarm = covering(sees=False)
    leader = swarm.leader()
    swarm.until("LANDED", limit_s=240.0)
    assert max(swarm.highest_m.values()) <= CEILING_M
    assert leader.said.count("not rising: column above not known free") == 1


def test_a_column_near_by_is_taken_where_the_nearest_has_a_branch() -> None:
    swarm = covering()
    leader = swarm.leader()
    here = leader.pos_ned_m
    near = sorted(columns_of(leader), key=lambda c: math.dist((c.north_m, c.east_m), here[:2]))
    near[0].add_ray((near[0].north_m, near[0].east_m - 5.0, -16.0), (0.0, 1.0, 0.0), 5.0, 40.0, swarm.now_s)
    swarm.until_true(lambda: leader.altitude_m > 15.0, limit_s=90.0)
    assert math.dist((near[0].north_m, near[0].east_m), leader.pos_ned_m[:2]) > 1.5


def test_no_column_is_taken_in_which_another_hovers() -> None:
    swarm = covering(surveys(5))
    leader = swarm.leader()
    near = min(columns_of(leader), key=lambda c: math.dist((c.north_m, c.east_m), leader.pos_ned_m[:2]))
    other = next(one for one in swarm.aircraft.values() if one is not leader)
    swarm.hung = {other.id}  # its autopilot holds it there
    there = (near.north_m + 4.0, near.east_m)
    other.put((*there, -UP_M))
    swarm.run(60.0)
    assert all(math.dist(there, one.pos_ned_m[:2]) > 4.5 for one in swarm.aircraft.values() if one is not other)


def test_off_its_column_it_does_not_climb_and_farther_off_it_is_not_in_it_any_more() -> None:
    swarm, leader = risen()
    for off_m, falls in ((0.7, False), (1.5, True)):
        rise = rise_of(leader)
        north, east = rise._axis_ne_m
        heights_m = []
        for _ in range(50):  # a wind that it cannot hold
            leader.put((north + off_m, east, leader.pos_ned_m[2]))
            swarm.tick()
            heights_m.append(leader.altitude_m)
        assert heights_m[-1] < heights_m[20] + 0.1  # a second for its speed to end
        assert (heights_m[-1] < heights_m[20] - 0.5) is falls


def test_blown_off_its_column_on_the_way_down_it_comes_back_at_its_height_for_a_while() -> None:
    swarm, leader = risen()
    swarm.waiting = 0
    swarm.until_true(lambda: rise_of(leader).stage is Stage.DESCENDS, limit_s=5.0)
    swarm.run(1.0)
    north, east = rise_of(leader)._axis_ne_m
    before_m = leader.altitude_m
    leader.put((north + 2.0, east, leader.pos_ned_m[2]))
    while math.dist(leader.pos_ned_m[:2], (north, east)) > CLIMBS_M:
        swarm.tick()
    assert leader.altitude_m > before_m - 1.0  # its speed ends
    swarm.run(0.2)
    held_m = []
    for _ in range(round((BACK_S + 3.0) / TICK_S)):  # a wind that it cannot hold
        leader.put((north + 2.0, east, leader.pos_ned_m[2]))
        swarm.tick()
        held_m.append(leader.altitude_m)
    assert held_m[round(BACK_S / TICK_S) - 2] > held_m[20] - 0.3
    assert held_m[-1] < held_m[20] - 1.0


def test_others_are_not_led_up_and_keep_out_from_under_it() -> None:
    swarm, leader = risen()
    other = next(one for one in swarm.aircraft.values() if one is not leader)
    # A gust has carried it almost under the leader
    north, east, _ = leader.pos_ned_m
    other.put((north - 3.0, east, other.pos_ned_m[2]))
    swarm.run(8.0)
    assert math.dist(other.pos_ned_m[:2], leader.pos_ned_m[:2]) > 4.5
    assert other.altitude_m < CEILING_M


def test_who_is_below_keeps_clear_of_one_that_is_up_as_if_it_were_beside() -> None:
    """Whatever brings it there: a gust, a hold, a way that is led round a trunk."""
    swarm, leader = risen()
    other = next(one for one in swarm.aircraft.values() if one is not leader)
    around: list[Surroundings] = []
    kept = other.agent.safety_filter

    class Watched:
        def apply(self, desired: Vec3, now: Surroundings, *, dt_s: float) -> Setpoint:
            around.append(now)
            return kept.apply(desired, now, dt_s=dt_s)

    other.agent.safety_filter = Watched()
    swarm.run(1.0)
    (there,) = [n.rel_ned_m for n in around[-1].neighbours if n.id == leader.id]
    assert there[2] == 0.0
    assert math.hypot(*there[:2]) == pytest.approx(math.dist(other.pos_ned_m[:2], leader.pos_ned_m[:2]), abs=1.0)


def test_a_branch_seen_above_has_it_come_down_in_its_column() -> None:
    swarm, leader = risen()
    column = rise_of(leader)._column
    assert column is not None
    column.add_ray((column.north_m, column.east_m - 5.0, -20.0), (0.0, 1.0, 0.0), 5.0, 40.0, swarm.now_s)
    assert comes_down(swarm, leader) < 0.5
    assert swarm.highest_m[leader.id] < 18.0
    assert "rise ends: column above not known free" in leader.said


def test_a_branch_below_it_does_not() -> None:
    swarm, leader = risen()
    column = rise_of(leader)._column
    assert column is not None
    column.add_ray((column.north_m, column.east_m - 5.0, -11.0), (0.0, 1.0, 0.0), 5.0, 40.0, swarm.now_s)
    swarm.run(5.0)
    assert leader.altitude_m > 18.0


def test_a_low_battery_brings_it_down() -> None:
    swarm, leader = risen()
    leader.battery_percent = 19
    assert comes_down(swarm, leader) < 0.5
    assert "rise ends: battery below 20 %" in leader.said


def test_its_time_brings_it_down_and_it_goes_on_without_being_doubted() -> None:
    """Its followers believe in a coverage that is so much longer, and it does not prolong it again."""
    swarm, leader = risen()
    swarm.until_true(lambda: leader.altitude_m < CEILING_M, limit_s=ALOFT_MAX_S + 30.0)
    assert "rise ends: 90 s are up" in leader.said
    swarm.until("LANDED", limit_s=120.0)
    assert not any("blocked" in text for one in swarm.aircraft.values() for text in one.said)
    assert sum("rising to" in text for text in leader.said) == 1


@pytest.mark.parametrize("order", [Order.HOLD, Order.LAND, Order.ABORT])
def test_an_order_brings_it_down_in_its_column(order: Order) -> None:
    swarm, leader = risen()
    swarm.order(leader.id, order)
    assert comes_down(swarm, leader, limit_s=40.0) < 0.5
    if order is Order.HOLD:
        swarm.run(5.0)
        assert leader.state is FlightState.HOLD
        assert leader.altitude_m > UP_M - 1.0


def test_a_pilot_who_takes_it_over_is_left_alone() -> None:
    swarm, leader = risen()
    leader.mode = FlightMode.OTHER
    swarm.run(1.0)
    assert leader.state is FlightState.RELEASED
    assert not any(type(action).__name__ == "VelocitySetpoint" for action in leader.actions)
    assert rise_of(leader).stage is Stage.RESTS


def test_a_leader_that_is_deposed_comes_down_at_once_and_alone() -> None:
    """Cut off from the others, it leads no majority."""
    swarm, leader = risen()
    swarm.apart = {leader.id}
    assert comes_down(swarm, leader) < 0.5
    assert "rise ends: not leading a majority" in leader.said


def test_a_part_without_the_majority_does_not_rise() -> None:
    swarm = covering()
    leader = swarm.leader()
    swarm.apart = {leader.id}
    swarm.run(60.0)
    assert swarm.highest_m[leader.id] <= CEILING_M


def test_when_the_companion_of_a_leader_that_is_up_dies_the_next_waits_below() -> None:
    """Its autopilot hovers up there: nobody passes under it, and nobody else rises while it is there."""
    swarm, leader = risen(surveys(coverage={"duration_s": 150.0, "radius_m": 12.0}))
    swarm.hung = {leader.id}
    swarm.run(60.0)
    assert leader.altitude_m > 14.0
    assert swarm.leader() is not leader
    assert "not rising: another vehicle is up" in swarm.leader().said
    assert not any("rising to" in text for text in swarm.leader().said)
    assert swarm.up_at_once == 1
    for one in swarm.aircraft.values():
        if one is not leader:
            assert swarm.highest_m[one.id] <= CEILING_M
            assert math.dist(one.pos_ned_m[:2], leader.pos_ned_m[:2]) > 4.5


def test_a_companion_that_starts_anew_up_there_comes_down_where_it_is() -> None:
    swarm, leader = risen()
    leader.agent.rise = type(rise_of(leader))(swarm.mission, leader.agent.perception, TOP_M, 40.0)  # type: ignore[arg-type]
    swarm.run(2.0 * TICK_S)
    assert rise_of(leader).stage is Stage.DESCENDS
    assert comes_down(swarm, leader) < 0.5


def test_the_filter_alone_brings_down_whoever_is_above_the_ceiling() -> None:
    """Whatever the stage desires: without a column that is free nobody stays there."""
    swarm, leader = risen()
    leader.agent.rise.steer_rise = lambda desired: Desired(ZERO, ZERO, desired.yaw_rad)  # type: ignore[method-assign]
    rise_of(leader).stage = Stage.DESCENDS
    swarm.until_true(lambda: leader.altitude_m < CEILING_M, limit_s=30.0)
