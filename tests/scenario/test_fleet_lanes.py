"""Agents that survey a stand by lanes: each lane is flown, whoever leads, until the stand is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from companion.core.model.events import StandMeasured
from companion.core.model.states import Order, SwarmPhase
from mission.document.model import Mission
from mission.lanes.spread import PASS_M
from tests.scenario.test_fleet_stops import east_north
from tests.unit.core.core_fleet import Fleet
from tests.unit.core.core_kit import mission

AREA = [[20.0, -15.0], [60.0, -15.0], [60.0, 15.0], [20.0, 15.0]]
D1, D2 = (0.0, 0.0), (0.0, 30.0)  # east, north
ASKS = {"until": {"basal_area_pct": 10.0}}


def surveys(size: int, at_end: str = "land", covers_s: float = 0.0, **survey: Any) -> Mission:
    return mission(
        route={"d2_enu_m": (*D2, 8.0), "at_end": at_end},
        swarm={"size": size},
        coverage={"duration_s": covers_s},
        sensing={"sensor": "scan-1deg", "range_m": 8.0},
        survey={"area_enu_m": AREA, "lane_m": 15.0 if size == 1 else 10.0, **survey},
    )


def fleet(flies: Mission) -> Fleet:
    swarm = Fleet(flies, range_m=55.0)
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=90.0)
    return swarm


def fly(
    swarm: Fleet, among: list[int], *, until: Callable[[], bool], limit_s: float = 300.0
) -> list[tuple[float, float]]:
    """Where the acting leader was, a point a metre or so."""
    began_s, trail = swarm.now_s, [(math.inf, math.inf)]
    while not until():
        assert swarm.now_s - began_s < limit_s, {k: swarm.aircraft[k].state.name for k in among}
        swarm.tick()
        for leader in swarm.acting():
            here = east_north(swarm, leader)
            if math.dist(here, trail[-1]) >= 1.0:
                trail.append(here)
    return trail[1:]


def stops_of(swarm: Fleet, among: list[int]) -> set[int]:
    return {swarm.aircraft[k].agent.swarm.phases.stop for k in among}


def have_landed(swarm: Fleet, among: list[int]) -> Callable[[], bool]:
    return lambda: all(swarm.aircraft[k].state.name == "LANDED" for k in among)


def all_ends_passed(flies: Mission, trail: list[tuple[float, float]]) -> bool:
    """By a leader, each within what it passes them in, and a metre of the trail's steps."""
    ends = [end for lane in flies.lanes for end in (lane.start, lane.end)]
    return all(min(math.dist(end, here) for here in trail) <= PASS_M + 1.0 for end in ends)


def test_one_vehicle_flies_all_lanes_and_lands_at_d2() -> None:
    flies = surveys(1)
    assert len(flies.lanes) == 3
    swarm = fleet(flies)
    trail = fly(swarm, [1], until=have_landed(swarm, [1]))
    assert all_ends_passed(flies, trail)
    assert math.dist(trail[-1], D2) <= 6.0
    assert [text for text in swarm.aircraft[1].said if "lane" in text] == [
        "gathered at d1: leaving for lane 1 of 3",
        "on lane 1 of 3",
        "leaving for lane 2 of 3",
        "on lane 2 of 3",
        "leaving for lane 3 of 3",
        "on lane 3 of 3",
        "lanes done: leaving for d2",
    ]


def test_followers_of_a_leader_on_lanes_stay_with_it() -> None:
    flies = surveys(4)
    swarm = fleet(flies)
    trail = fly(swarm, [1, 2, 3, 4], until=have_landed(swarm, [1, 2, 3, 4]))
    assert all_ends_passed(flies, trail)
    assert swarm.least_m >= 4.9
    assert all(math.dist(east_north(swarm, k), D2) <= 40.0 for k in swarm.aircraft)
    assert not any("blocked" in text or "lost" in text for one in swarm.aircraft.values() for text in one.said)


def test_a_swarm_flies_lanes_abreast_both_ways_and_keeps_its_places_as_it_turns() -> None:
    flies = surveys(4)
    swarm, everyone = fleet(flies), [1, 2, 3, 4]
    orders = []
    for stop in (2, 4):  # at the ends of the first two lanes, which lead there and back
        fly(swarm, everyone, until=lambda stop=stop: stops_of(swarm, everyone) == {stop})
        north_m = {k: east_north(swarm, k)[1] for k in everyone}
        assert max(north_m.values()) - min(north_m.values()) > 0.8 * flies.swath.spread_m
        orders.append(sorted(everyone, key=north_m.__getitem__))
    assert orders[0] == orders[1]
    assert swarm.least_m >= 4.9


def test_a_new_leader_goes_on_with_the_lane_that_its_predecessor_was_on() -> None:
    flies = surveys(4)
    swarm = fleet(flies)
    trail = fly(swarm, [1, 2, 3, 4], until=lambda: stops_of(swarm, [1, 2, 3, 4]) == {3})
    swarm.run(3.0)
    (leader,) = swarm.acting()
    swarm.hung.add(leader)
    left = [k for k in swarm.aircraft if k != leader]
    gone_back = False

    def landed() -> bool:
        nonlocal gone_back
        gone_back |= min(stops_of(swarm, left)) < 3
        return have_landed(swarm, left)()

    trail += fly(swarm, left, until=landed)
    assert not gone_back
    assert all_ends_passed(flies, trail)


def test_lanes_that_are_left_are_left_out_once_the_stand_is_known() -> None:
    flies = surveys(4, at_end="return", covers_s=10.0, **ASKS)
    swarm = fleet(flies)
    everyone = [1, 2, 3, 4]
    for k in everyone:
        swarm.aircraft[k].agent.receive(StandMeasured(8.0), swarm.now_s)
    trail = fly(swarm, everyone, until=have_landed(swarm, everyone))
    assert min(math.dist(flies.lanes[0].end, here) for here in trail) <= PASS_M + 1.0  # the first is flown all the same
    assert min(math.dist(D2, here) for here in trail) <= 6.0  # d2, and then home
    assert all(math.dist(east_north(swarm, k), D1) <= 40.0 for k in everyone)
    said = swarm.aircraft[1].said
    assert said[said.index("on lane 1 of 3") :][1:3] == ["leaving for lane 2 of 3", "stand known: leaving for d2"]


def test_a_follower_that_knows_less_of_the_stand_goes_along_and_a_new_leader_does_not_turn_back() -> None:
    flies = surveys(4, **ASKS)
    swarm = fleet(flies)
    (leader,) = swarm.acting()
    swarm.aircraft[leader].agent.receive(StandMeasured(8.0), swarm.now_s)
    last = len(flies.visits) - 1
    fly(swarm, [1, 2, 3, 4], until=lambda: stops_of(swarm, [1, 2, 3, 4]) == {last})
    swarm.hung.add(leader)
    left = [k for k in swarm.aircraft if k != leader]
    fly(swarm, left, until=have_landed(swarm, left))
    assert all(math.dist(east_north(swarm, k), D2) <= 40.0 for k in left)


def test_a_lane_whose_end_is_in_a_thicket_is_passed_beside_it() -> None:
    flies = surveys(1)
    end = flies.lanes[0].end
    swarm = Fleet(flies, range_m=55.0)
    swarm.trunks = [(end[1], end[0], 2.5)]
    swarm.run(2.0)
    swarm.order(1, Order.START)
    swarm.until("TRANSIT", limit_s=90.0)
    trail = fly(swarm, [1], until=have_landed(swarm, [1]))
    rest = [point for lane in flies.lanes[1:] for point in (lane.start, lane.end)]
    assert all(min(math.dist(point, here) for here in trail) <= PASS_M + 1.0 for point in rest)
    assert swarm.aircraft[1].agent.swarm.phases.phase is SwarmPhase.LAND
    assert "leader stuck: landing" not in swarm.aircraft[1].said
