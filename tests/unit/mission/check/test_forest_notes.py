"""What is said of a mission in its stand: ways between trunks, crowns, and the ground."""

from __future__ import annotations

from typing import Any

import pytest

from mission.check.forest_notes import notes_of, widest_way_m
from mission.stand.stand import Stand, StandTree
from tests.unit.mission.stand_kit import mission_with, trunk


def wall(hole_m: float) -> Stand:
    """Trunks across the way at 30 m, shoulder to shoulder over the whole corridor, but for a hole."""
    norths = [k * 0.3 for k in range(-150, 151)]
    return Stand(
        [trunk(30.0, n) for n in norths if hole_m == 0.0 or abs(n - 10.0) > hole_m / 2.0 + 0.2] + [trunk(60.0, 0.0)]
    )


def test_the_widest_way_goes_round_and_tells_how_wide_it_is() -> None:
    here, there = (0.0, 0.0), (60.0, 0.0)

    assert widest_way_m(wall(0.0), here, there, arrival_distance_m=5.0) == 0.0
    assert widest_way_m(wall(3.0), here, there, arrival_distance_m=5.0) == pytest.approx(3.0, abs=0.7)


def test_trunks_where_the_leader_has_arrived_do_not_narrow_a_way() -> None:
    """Wherever beside d2 the tree stands, as stem maps have it, and others next to it."""
    here, there = (0.0, 0.0), (60.0, 0.0)
    stand = Stand([trunk(30.0, 0.0), trunk(0.0, 1.2), trunk(58.4, -1.4), trunk(60.0, 1.9)])

    assert widest_way_m(stand, here, there, arrival_distance_m=5.0) == 6.0
    assert widest_way_m(stand, here, there, arrival_distance_m=0.5) == pytest.approx(3.2, abs=0.5)


def test_notes_say_what_the_route_meets() -> None:
    closed = list(notes_of(wall(0.0), mission_with()))
    assert closed == ["no way from d1 to d2 is 1.30 m wide between trunks"]

    (narrow,) = notes_of(wall(3.0), mission_with())
    assert narrow.startswith("the widest way from d1 to d2 is about ")

    (slit,) = notes_of(wall(1.0), mission_with())
    assert slit.startswith("no way from d1 to d2 is 1.30 m wide between trunks: the widest is about ")

    bare = list(notes_of(Stand([trunk(40.0, 9.0)]), mission_with(sensing=None)))
    assert bare == [
        "no [sensing]: companions know the trunks at d2 and the stops alone",
        "no trunk stands within coverage.keep_out_m = 2 m of d2: the nearest is 21.7 m away",
    ]


def test_notes_say_which_crowns_hang_into_the_way() -> None:
    low = Stand([trunk(30.0, 1.0, base_m=3.5), trunk(35.0, 2.5, base_m=2.0), trunk(60.0, 0.0)])

    assert list(notes_of(low, mission_with())) == [
        "the fence, 2 to 10 m up, reaches into 2 crowns: the lowest from 2.0 m up",
        "1 crown hangs into the straight way from d1 to d2: the lowest from 3.5 m up",
    ]


def test_notes_are_of_every_leg() -> None:
    stops = {"stops": [{"pos_enu_m": (60.0, 40.0, 4.0)}]}

    assert "no trunk stands within coverage.keep_out_m = 2 m of stops[0]: the nearest is 29.8 m away" in list(
        notes_of(wall(0.0), mission_with(route=stops))
    )


# Crowns in the fence


def test_a_fence_that_reaches_into_crowns_is_told() -> None:
    """Crowns that end below it, begin above it, or hang outside are not in it."""
    stand = Stand([trunk(60.0, 0.0, base_m=5.6), trunk(30.0, 20.0, base_m=4.8), trunk(9.0, 20.0, base_m=6.0)])
    bush = StandTree(10.0, 20.0, 0.3, 1.5, 0.5, 2.0)
    fence = {"altitude_max_m": 6.0, "polygon_enu_m": ((-30, -45), (90, -45), (90, 45), (-30, 45))}
    outside = trunk(30.0, 48.0, base_m=3.0)
    inside = mission_with(fence=fence)

    told = "the fence, 2 to 6 m up, reaches into {}: the lowest from {} m up"
    assert list(notes_of(Stand([*stand.trees, bush, outside]), inside)) == [told.format("2 crowns", 4.8)]
    boundless = mission_with(fence={"altitude_max_m": 6.0})
    assert list(notes_of(Stand([*stand.trees, outside]), boundless)) == [told.format("3 crowns", "3.0")]
    assert list(notes_of(stand, mission_with(fence={"altitude_max_m": 4.8}))) == []


def test_crowns_on_a_slope_are_where_the_ground_puts_them() -> None:
    stand = Stand([trunk(60.0, 0.0, base_m=7.0)], grade=(-0.02, 0.0))

    assert list(notes_of(stand, mission_with(fence={"altitude_max_m": 6.0}))) == [
        "the fence, 2 to 6 m up, reaches into 1 crown: the lowest from 5.8 m up"
    ]


# Sloping ground


def slope(rise: float, up_m: float, **changes: Any) -> list[str]:
    """What is said of a ring of 15 m about d2, 60 m east, on ground that rises to the east."""
    route = {"d2_enu_m": (60.0, 0.0, up_m)}
    mission = mission_with({"grade": (rise, 0.0)}, route=route, **changes)
    return list(notes_of(Stand([trunk(60.0, 0.0, base_m=25.0)], grade=(rise, 0.0)), mission))


def test_ground_that_rises_above_the_fences_floor_is_told() -> None:
    told = "the ground rises to 3.0 m within 15.0 m of d2, above the fence's floor: fence.altitude_min_m = 2 counts "

    assert slope(0.04, 8.0) == [told + "from the origin"]
    assert slope(0.04, 8.0, fence={"altitude_min_m": 3.5}) == []
    assert slope(0.02, 4.0) == []
    assert slope(-0.04, 4.0) == []


def test_a_ring_that_meets_the_slope_is_told() -> None:
    (_, low) = slope(0.04, 3.7)
    assert low == ("the ground rises to 3.0 m within 15.0 m of d2: the lowest of the places about d2 is 0.7 m above it")
    assert slope(0.04, 3.5, coverage={"radius_m": 30.0})[1].endswith(
        "the lowest of the places about d2 is 0.1 m below it"
    )


def test_places_about_d1_are_the_starting_points() -> None:
    route = {"d1_enu_m": (0.0, 0.0, 2.3), "d2_enu_m": (60.0, 0.0, 10.0)}
    fence = {"altitude_min_m": 1.9, "altitude_max_m": 20.0}
    mission = mission_with({"grade": (0.1, 0.0)}, swarm={"size": 8}, route=route, fence=fence)
    told = list(notes_of(Stand([trunk(60.0, 0.0, base_m=25.0)], grade=(0.1, 0.0)), mission))

    assert (
        told[0] == "the ground rises to 1.4 m within 13.6 m of d1: the lowest of the places about d1 is 0.9 m above it"
    )


def test_a_sphere_comes_nearer_to_a_slope_than_a_ring() -> None:
    ring = slope(0.3, 33.5, fence={"altitude_max_m": 60.0})
    sphere = slope(0.3, 33.5, fence={"altitude_max_m": 60.0}, coverage={"shape": "sphere"})

    assert len(ring) == 1
    assert sphere[1].endswith("the lowest of the places about d2 is 0.2 m below it")
