"""Missions of several trees: the places on the way, and that each obeys the laws that d2 does."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from mission.document import simulator
from mission.document.load import dump_mission, parse_mission
from mission.document.model import Mission, Visit
from mission.stand.stand import stand_of

Tables = dict[str, Any]
FENCE = [[-40, -60], [170, -60], [170, 90], [-40, 90]]


def tables(*stops: Tables, route: Tables | None = None, **changes: Tables) -> Tables:
    way = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3, "stops": list(stops), **(route or {})}
    return {"schema": 1, "route": way, **changes}


def stop(east_m: float, north_m: float, up_m: float = 8.0, duration_s: float | None = None) -> Tables:
    return {"pos_enu_m": [east_m, north_m, up_m], "duration_s": duration_s}


def flown(*stops: Tables, **changes: Tables) -> Mission:
    return Mission.model_validate(tables(*stops, **changes))


def refusal(*stops: Tables, **changes: Tables) -> str:
    try:
        flown(*stops, **changes)
    except ValidationError as error:
        return str(error)
    return ""


def test_a_mission_without_stops_visits_d2_alone() -> None:
    assert flown().visits == (Visit((130.0, 0.0, 8.0), 60.0),)
    assert flown().route.points_enu_m == ((0.0, 0.0, 8.0), (130.0, 0.0, 8.0))
    assert flown().route.length_m == 130.0


def test_stops_are_visited_in_their_order_and_d2_last() -> None:
    mission = flown(stop(60, 20, duration_s=30.0), stop(60, 60), coverage={"duration_s": 45})

    assert mission.visits == (
        Visit((60.0, 20.0, 8.0), 30.0),
        Visit((60.0, 60.0, 8.0), 45.0),
        Visit((130.0, 0.0, 8.0), 45.0),
    )
    assert mission.route.length_m == pytest.approx(math.hypot(60, 20) + 40.0 + math.hypot(70, 60))
    assert parse_mission(dump_mission(mission)) == mission


def test_each_stop_has_a_tree_of_the_stand_where_rings_are_flown() -> None:
    low = {"d1_enu_m": [0, 0, 4], "d2_enu_m": [130, 0, 4]}
    stand = stand_of(flown(stop(60, 20, 4.0), route=low, forest={"stand": {"density_per_ha": 50}}))

    for place in ((60.0, 20.0), (130.0, 0.0)):
        assert [(t.east_m, t.north_m) for t in stand.near(*place, 0.01)] == [place]


@pytest.mark.parametrize(
    ("good", "bad", "changes", "says"),
    [
        (
            [stop(60, 20)],
            [stop(0, 0)],
            {},
            "route.stops[0].pos_enu_m = [0.0, 0.0, 8.0]: must differ from the deployment",
        ),
        ([stop(60, 20)], [stop(60, 20), stop(60, 20)], {}, "route.stops[1].pos_enu_m = [60.0, 20.0, 8.0]: must differ"),
        (
            [stop(60, 20)],
            [stop(130, 0)],
            {},
            "route.d2_enu_m = [130.0, 0.0, 8.0]: must differ from the place before it",
        ),
        (
            [stop(124, 0)],
            [stop(126, 0)],
            {},
            "route.arrival_distance_m = 5.0: must be less than the 4.0 m from stops[0] to d2",
        ),
        ([stop(60, 20, 18)], [stop(12, 20, 22)], {"swarm": {"size": 1}}, "climb or descend at 1.54 m/s"),
        (
            [stop(60, 20, 29.7)],
            [stop(60, 20, 29.8)],
            {},
            "route.stops[0].pos_enu_m = [60.0, 20.0, 29.8]: must be inside",
        ),
        ([stop(60, 70)], [stop(60, 71)], {"fence": {"polygon_enu_m": FENCE}}, "is 19.0 m inside the fence: must be at"),
        ([stop(60, 70)], [stop(60, 95)], {"fence": {"polygon_enu_m": FENCE}}, "route.stops[0].pos_enu_m = [60.0, 95.0"),
        (
            [stop(60, 20)],
            [stop(10, 0)],
            {},
            "route.d1_enu_m = [0.0, 0.0, 8.0]: is 10.0 m from the trunk at stops[0]: must be at least 15.9 m",
        ),
        (
            [stop(60, 20, duration_s=236.0)],
            [stop(60, 20, duration_s=235.0)],
            {"coverage": {"radius_m": 100, "duration_s": 0}, "swarm": {"size": 12}, "radio": {"full_range_m": 56}},
            "route.stops[0].duration_s = 235.0: must be at least 236 s for a ring wider than full_range_m",
        ),
        (
            [stop(60, 20)],
            [stop(60, 20, duration_s=70.0)],
            {"coverage": {"duration_s": 10}, "sim": {"time_limit_s": 90}},
            "sim.time_limit_s = 90.0: must be above 110.3 s",
        ),
        (
            [stop(60, 20)],
            [stop(60, 20)] * 21,
            {},
            "route.stops",
        ),
    ],
)
def test_a_stop_obeys_the_laws_of_d2(good: list[Tables], bad: list[Tables], changes: Tables, says: str) -> None:
    assert refusal(*good, **changes) == ""
    assert says in refusal(*bad, **changes)


def test_a_trunk_beside_a_stop_reaches_no_farther_than_the_swarm_keeps_out() -> None:
    def tree(radius_m: float) -> Tables:
        return {"trees": [{"base_enu_m": [61, 20], "trunk_radius_m": radius_m, "height_m": 20}]}

    assert refusal(stop(60, 20), forest=tree(1.0)) == ""
    assert "forest.trees[0].trunk_radius_m = 1.1: reaches 2.10 m from stops[0]" in refusal(
        stop(60, 20), forest=tree(1.1)
    )


def test_a_sphere_at_a_stop_is_inside_the_fence_too() -> None:
    high = {"coverage": {"shape": "sphere"}, "route": {"d2_enu_m": [130, 0, 30]}, "fence": {"altitude_max_m": 60}}

    assert refusal(stop(60, 20, 30), **high) == ""
    assert "reaches from 2.0 to 32.0 m" in refusal(stop(60, 20, 17), **high)


def test_the_fence_holds_the_way_home_from_the_last_tree() -> None:
    """d1 south west, a stop south east, d2 north east: only the way back cuts the corner."""
    corner = [[-50, -50], [200, -50], [200, 200], [100, 200], [100, 50], [-50, 50]]
    fenced = {"fence": {"polygon_enu_m": corner}}
    there = {"d2_enu_m": [150, 150, 8]}

    assert refusal(stop(150, 0), route=there, **fenced) == ""
    assert "must hold the straight way d2 to d1" in refusal(stop(150, 0), route={**there, "at_end": "return"}, **fenced)


def test_what_the_simulated_vehicles_cannot_do_is_found_on_every_leg() -> None:
    steep = flown(stop(60, 20, 28), route={"d2_enu_m": [90, 20, 8]}, limits={"climb_max_mps": 3})
    assert "descend at 1.66 m/s" in str(simulator.problems(steep, "m")[0])

    windy = flown(stop(60, 20), sim={"wind_mps": [0, -14.2, 0]})
    (beyond,) = simulator.problems(windy, "m")
    assert "asks for 15.4 m/s through the air" in str(beyond)
    assert simulator.problems(flown(sim={"wind_mps": [0, -14.2, 0]}), "m") == ()
