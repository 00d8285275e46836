"""The UAV Testing Competition's layouts: what is read, the shortest way beside ours, the page's table, one flight."""

from __future__ import annotations

import math

import pytest

from mission.check.forest_notes import widest_way_m
from mission.schema.boxes import box_of
from mission.stand.stand import stand_of
from tests.referees.referee import Case, with_section
from tests.referees.shortest import shortest_m
from tests.referees.uav_testing import SOFT_M, WAYS, fly_layout, layouts, mission_of
from tests.referees.uav_testing_table import TITLE, section

BOX = box_of((10.0, 0.0), length_m=4.0, width_m=6.0, height_m=10.0, rotation_deg=0.0)
ALONE = Case("m1_test_0", 1, 1, "recorded")
FLOWN = ALONE.row("clear", clearance_m=1.7, way_m=60.0, shortest_m=50.0)


def test_every_layout_is_a_mission_that_can_be_flown() -> None:
    found = layouts()
    assert len(found) == 30
    for name, (number, boxes) in found.items():
        mission = mission_of(Case(name, 4, 1, "recorded"))
        assert len(boxes) == 2
        assert math.isfinite(shortest_m(WAYS[number], [box.block for box in mission.forest.boxes], SOFT_M))


def test_the_shortest_way_goes_round_the_corners_at_the_clearance() -> None:
    ends = ((0.0, 0.0), (20.0, 0.0))
    assert shortest_m(((0.0, 5.0), (20.0, 5.0)), [BOX], 1.5) == pytest.approx(20.0)
    # To the tangent of the circle about the corner at 8 east, 3 north, round it, straight on, and the same again
    off_m = math.hypot(8.0, 3.0)
    tangent_m = math.sqrt(off_m**2 - 1.0)
    turned = math.asin(1.0 / off_m) + math.atan2(3.0, 8.0)
    assert shortest_m(ends, [BOX], 1.0) == pytest.approx(2.0 * (tangent_m + turned) + 4.0, rel=2e-3)
    assert shortest_m((*ends, (0.0, 0.0)), [BOX], 1.0) == pytest.approx(2.0 * shortest_m(ends, [BOX], 1.0))


def test_without_a_way_there_is_none() -> None:
    walls = [
        box_of(
            (10.0, 10.0 * k), length_m=22.0 if k else 1.0, width_m=1.0 if k else 21.0, height_m=9.0, rotation_deg=0.0
        )
        for k in (-1, 0, 1)
    ]
    walls.append(box_of((-1.0, 0.0), length_m=1.0, width_m=21.0, height_m=9.0, rotation_deg=0.0))
    assert shortest_m(((5.0, 0.0), (20.0, 0.0)), walls, 0.5) == math.inf


def test_boxes_narrow_the_widest_way_that_people_are_told_of() -> None:
    mission = mission_of(ALONE)
    d1, d2 = mission.route.d1_enu_m, mission.route.d2_enu_m
    assert widest_way_m(stand_of(mission), d1, d2, arrival_distance_m=3.0) > 2.0 * SOFT_M


def test_the_page_keeps_its_other_sections() -> None:
    page = f"# Referees\n\nWords.\n\n## {TITLE}\n\nold\n\n## Another\n\nkept\n"
    new = section([FLOWN, {**FLOWN, "n": 4, "way_m": None, "grade": "late"}], "abc")
    found = with_section(page, TITLE, new)
    assert "| m1_test_0 | 50.0 | clear | 1.70 | 60 (+20%) | late | 1.70 | not arrived |" in found
    assert found.startswith("# Referees\n\nWords.\n\n##")
    assert found.endswith("\n\n## Another\n\nkept\n")
    assert "\nold\n" not in found
    assert with_section("# Referees\n", TITLE, new).count(TITLE) == 1


def test_a_layout_is_flown_clear_of_its_boxes() -> None:
    flown = fly_layout(ALONE)
    assert flown["grade"] == "clear", flown["verdict"]
    assert flown["clearance_m"] >= SOFT_M
    assert flown["way_m"] is not None
    assert flown["shortest_m"] <= flown["way_m"] < 1.5 * flown["shortest_m"]
