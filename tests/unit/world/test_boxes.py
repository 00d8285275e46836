"""Boxes as lidars see them, as hulls touch them, and as links and people find them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mission.common.frames import Vec3
from mission.document.model import VEHICLE_RADIUS_M, Mission, Sensing, Sim
from mission.document.model import Lidar as LidarErrors
from mission.schema.boxes import StandBox, box_of
from mission.stand.drawing import drawn
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.metrics import measure
from sim_bridge.trunk_attenuation import range_share
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.contacts import Contacts, Touched
from sim_bridge.world.sensors.lidar import Lidar, Scan
from sim_bridge.world.sensors.scene import Scene
from tests.unit.judge.metrics_kit import a_mission, a_recording, level

EXACT = LidarErrors(noise_m=0.0, dropout=0.0)
WALL = box_of((6.0, 0.0), length_m=2.0, width_m=8.0, height_m=10.0, rotation_deg=0.0)  # from 5 m east on

boxes = st.builds(
    box_of,
    st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
    length_m=st.floats(0.2, 9.0),
    width_m=st.floats(0.2, 9.0),
    height_m=st.floats(1.0, 20.0),
    rotation_deg=st.floats(-360, 360),
)


def scan(stand: Stand, *, up_m: float = 3.0, yaw_rad: float = 0.0, range_m: float = 8.0) -> Scan:
    sensing = Sensing(range_m=range_m)
    at = AirframeState((0.0, 0.0, -up_m), (0.0, 0.0, 0.0), (0.0, 0.0, yaw_rad), (0.0, 0.0, 0.0), False, 0.4)
    found = Lidar(Scene(stand, range_m), sensing, EXACT, seed=1, vehicle_id=1).scan(at, (), 1.0)
    assert found is not None
    return found


def touched(stand: Stand, *way_ned_m: Vec3) -> Touched | None:
    """What the last step of the way touches."""
    contacts = Contacts(stand)
    for place in way_ned_m[:-1]:
        contacts.find_contact(1, place, (0.0, 0.0, 0.0), on_ground=False)
    return contacts.find_contact(1, way_ned_m[-1], (0.0, 0.0, 0.0), on_ground=False)


def test_a_wall_is_seen_where_it_stands_and_looked_over_from_above() -> None:
    stand = Stand(boxes=[WALL])
    right = 18
    assert scan(stand).ranges_m[right] == pytest.approx(5.0, abs=1e-3)
    assert scan(stand, yaw_rad=math.pi / 2).ranges_m[0] == pytest.approx(5.0, abs=1e-3)
    assert math.isinf(scan(stand).ranges_m[54])
    assert set(scan(stand, up_m=9.8).ranges_m) == {math.inf}  # the lidar is mounted 0.25 m up
    assert set(scan(Stand(boxes=[WALL]), range_m=4.9).ranges_m) == {math.inf}


def test_a_box_turns_clockwise_as_headings_do() -> None:
    turned = box_of((0.0, 0.0), length_m=10.0, width_m=2.0, height_m=5.0, rotation_deg=30.0)
    far = (5.0 * math.cos(math.radians(30.0)), -5.0 * math.sin(math.radians(30.0)))  # its east end comes south
    assert turned.clearance_m(0.99 * far[0], 0.99 * far[1]) == 0.0
    assert turned.clearance_m(0.99 * far[0], -0.99 * far[1]) > 2.0
    assert turned.corners()[0] == pytest.approx((far[0] + 0.5, far[1] + math.cos(math.radians(30.0))))


@settings(max_examples=200)
@given(boxes, st.tuples(st.floats(-9, 9), st.floats(-9, 9)), st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
def test_a_way_beside_a_box_is_as_near_as_its_nearest_point(
    box: StandBox, a: tuple[float, float], b: tuple[float, float]
) -> None:
    shares = np.linspace(0.0, 1.0, 801).tolist()
    brute_m = min(box.clearance_m(a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1])) for s in shares)
    assert box.beside_m(a, b) == pytest.approx(brute_m, abs=math.dist(a, b) / 800 + 1e-9)
    corner_m = [math.dist(a, corner) for corner in box.corners()]
    assert box.farthest_m(*a) == pytest.approx(max(corner_m))
    assert box.clearance_m(*a) <= min(corner_m) + 1e-9


@settings(max_examples=200)
@given(boxes, st.tuples(st.floats(-9, 9), st.floats(-9, 9)), st.tuples(st.floats(-2, 2), st.floats(-2, 2)))
def test_every_box_on_the_way_is_touched_however_long_the_step(
    box: StandBox, begin: tuple[float, float], way: tuple[float, float]
) -> None:
    end = (begin[0] + way[0], begin[1] + way[1])
    clear_m = box.beside_m(begin, end)
    assume(abs(clear_m - VEHICLE_RADIUS_M) > 1e-6)
    found = touched(Stand(boxes=[box]), (begin[1], begin[0], -0.5), (end[1], end[0], -0.5))
    assert found is (Touched.BOX if clear_m < VEHICLE_RADIUS_M else None)


def test_nothing_is_touched_above_a_box() -> None:
    assert touched(Stand(boxes=[WALL]), (0.0, 6.0, -10.1)) is None
    assert touched(Stand(boxes=[WALL], grade=(0.1, 0.0)), (0.0, 6.0, -10.1)) is Touched.BOX


def test_a_box_across_a_link_counts_as_one_trunk() -> None:
    share = range_share(Sim(radio_trunks="attenuated", radio_trunk_db=6.0), Stand(boxes=[WALL]))
    assert share is not None
    assert share((0.0, 0.0, -3.0), (0.0, 12.0, -3.0)) == pytest.approx(0.501, abs=1e-3)
    assert share((5.0, 0.0, -3.0), (5.0, 12.0, -3.0)) == 1.0  # beside it
    assert share((0.0, 0.0, -13.0), (0.0, 12.0, -13.0)) == 1.0  # above it


def test_figures_tell_how_near_a_box_vehicles_came() -> None:
    mission = a_mission(
        n=1, forest={"boxes": [{"centre_enu_m": (46.0, 8.0), "length_m": 4.0, "width_m": 6.0, "height_m": 12.0}]}
    )
    found = stand_of(mission)
    assert found.boxes == (box_of((46.0, 8.0), length_m=4.0, width_m=6.0, height_m=12.0, rotation_deg=0.0),)
    low = measure(a_recording([level(e, up_m=10.0) for e in (20.0, 46.0, 60.0)]), mission)
    assert low.box_clearance_min_m == pytest.approx(5.0)
    assert measure(a_recording([level(46.0, up_m=12.1)]), mission).box_clearance_min_m is None


def test_a_plan_draws_boxes() -> None:
    assert '<polygon points="7.00,-4.00 5.00,-4.00 5.00,4.00 7.00,4.00"' in drawn(Stand(boxes=[WALL]), None, "wall")


def box(**changes: object) -> dict[str, object]:
    return {"centre_enu_m": (60.0, 30.0), "length_m": 10.0, "width_m": 4.0, "height_m": 12.0, **changes}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, ""),
        ({"centre_enu_m": (0.0, 0.0)}, "stands 0.0 m from d1: must be at least"),
        ({"centre_enu_m": (130.0, 0.0)}, "to 5.39 m from it: must stand all within, or all outside"),
        ({"centre_enu_m": (130.0, 0.0), "length_m": 2.0, "width_m": 2.0}, ""),
        ({"height_m": 0.0}, "greater than 0"),
        ({"rotation_deg": 361.0}, "less than or equal to 360"),
    ],
)
def test_boxes_stand_clear_of_the_starting_points_and_of_the_places_to_cover(
    changes: dict[str, object], says: str
) -> None:
    values = {"d1_enu_m": (0, 0, 4), "d2_enu_m": (130, 0, 4), "vel_leader_mps": 3}
    tables = {"schema": 1, "route": values, "sensing": {}, "forest": {"boxes": [box(**changes)]}}
    if not says:
        assert Mission.model_validate(tables).forest.boxes
        return
    with pytest.raises(ValueError, match=says):
        Mission.model_validate(tables)
