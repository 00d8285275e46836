"""Figures of a stand, and its plan."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import pytest

from mission.document.model import Sensing
from mission.stand.drawing import drawn
from mission.stand.figures import area_of, figures_of, gaps_m
from mission.stand.stand import Stand, stand_of
from tests.unit.mission.stand_kit import mission_with, trunk

SVG = "{http://www.w3.org/2000/svg}"


def grid(n: int = 10, apart_m: float = 5.0) -> Stand:
    return Stand([trunk(apart_m * i, apart_m * k) for i in range(n) for k in range(n)])


# Figures


def test_density_and_basal_area_are_of_the_area() -> None:
    figures = figures_of(grid(), area=((0, 0), (50, 0), (50, 50), (0, 50)), sensing=None)

    assert (figures.trees, figures.bushes, figures.area_ha, figures.density_per_ha) == (100, 0, 0.25, 400.0)
    assert figures.basal_area_m2_per_ha == pytest.approx(400.0 * math.pi * 0.04)
    assert figures.dbh_cm == pytest.approx((40.0, 40.0, 40.0))
    assert figures.dbh_quadratic_mean_cm == pytest.approx(40.0)
    assert figures.dbh_classes == ((40, 100),)
    assert (figures.height_m, figures.crowns_from_m) == ((20.0, 20.0), 12.0)


def test_classes_are_of_10_cm_without_holes() -> None:
    stand = Stand([trunk(0, 0, 0.05), trunk(9, 0, 0.1499), trunk(0, 9, 0.15), trunk(9, 9, 0.3)])

    assert figures_of(stand, area=None, sensing=None).dbh_classes == (
        (10, 1), (20, 1), (30, 1), (40, 0), (50, 0), (60, 1)
    )  # fmt: skip


def test_gaps_are_between_neighbours_surface_to_surface() -> None:
    """In a grid only the sides of its squares; diagonals have two other trunks on their circle, which is no between."""
    found = sorted(gap for gap, _, _ in gaps_m(grid(3)))
    sides, diagonals = found[:12], found[12:]

    assert sides == pytest.approx([4.6] * 12)
    assert diagonals == pytest.approx([5.0 * math.sqrt(2.0) - 0.4] * 8)
    assert list(gaps_m(Stand([trunk(0, 0), trunk(4, 2), trunk(8, 4)]))) == [
        pytest.approx((math.sqrt(20.0) - 0.4, 2.0, 1.0)),
        pytest.approx((math.sqrt(20.0) - 0.4, 6.0, 3.0)),
    ]
    assert list(gaps_m(Stand([trunk(0, 0), trunk(12.1, 0)]))) == []


def test_a_vehicle_passes_gaps_that_hold_it_and_its_margin() -> None:
    stand = Stand([trunk(0, 0), trunk(1.69, 0), trunk(0, 1.71)])

    figures = figures_of(stand, area=None, sensing=Sensing())
    assert (figures.passes_m, figures.gaps, figures.gaps_passed) == (1.3, 3, 2)
    wider = figures_of(stand, area=None, sensing=Sensing(margin_m=0.2))
    assert (wider.passes_m, wider.gaps_passed) == (1.1, 3)
    assert figures.too_narrow == (pytest.approx((1.29, 0.845, 0.0)),)
    assert figures.gap_least_m == pytest.approx(1.29)
    assert figures.gap_median_m == pytest.approx(1.31)


def test_the_area_of_a_map_is_told_from_its_trees() -> None:
    """Of a stand that was grown on 1.52 ha, about that."""
    mission = mission_with({"stand": {"density_per_ha": 400, "area_enu_m": [[0, 0], [190, 0], [190, 80], [0, 80]]}})
    stand = stand_of(mission)

    told = figures_of(stand, area=None, sensing=None)
    assert told.area_ha == pytest.approx(1.52, rel=0.03)
    assert figures_of(stand, area=area_of(mission), sensing=None).area_ha == pytest.approx(1.52)
    assert area_of(mission_with()) is None


def test_a_few_trees_or_a_row_have_no_density() -> None:
    few = figures_of(Stand([trunk(0, 0), trunk(5, 3), trunk(1, 9)]), area=None, sensing=None)
    row = figures_of(Stand([trunk(3.0 * k, 0) for k in range(20)]), area=None, sensing=None)

    assert (few.area_ha, few.density_per_ha, few.basal_area_m2_per_ha) == (None, None, None)
    assert row.density_per_ha is None


def test_no_trees_have_no_figures() -> None:
    with pytest.raises(ValueError, match="no trees"):
        figures_of(Stand(), area=None, sensing=None)


# The plan


def test_a_plan_shows_every_trunk_where_it_stands_north_up() -> None:
    mission = mission_with({"stand": {"density_per_ha": 200, "undergrowth_per_ha": 50}})
    stand = stand_of(mission)
    root = ET.fromstring(drawn(stand, mission, 'a "stand" & more'))

    groups = {group.get("fill"): group for group in root.iter(f"{SVG}g")}
    trunks = groups["#5b3a1e"].findall(f"{SVG}circle")
    assert [(float(c.get("cx", "")), float(c.get("cy", ""))) for c in trunks] == [
        (tree.east_m, -tree.north_m) for tree in stand.trees
    ]
    assert len(groups["#a9b665"]) == len(stand.bushes)
    assert len(groups["#4a7c43"]) == len(stand.trees)
    assert root.findtext(f"{SVG}title") == 'a "stand" & more'
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert texts[-4:] == ["d1", "d2", "20 m", "N"]
    assert texts.count("20") == texts.count("-20") == 2  # metres east, and metres north


def test_a_plan_holds_the_fence_and_the_stops() -> None:
    fence = {"polygon_enu_m": ((-30, -90), (90, -90), (90, 90), (-30, 90))}
    mission = mission_with(fence=fence, route={"stops": [{"pos_enu_m": (40.0, 50.0, 4.0)}]})
    root = ET.fromstring(drawn(Stand([trunk(60.0, 0.0)]), mission, "t"))

    lines = [line.get("points") for line in root.iter(f"{SVG}polyline")]
    assert lines[0] == "-30.00,90.00 90.00,90.00 90.00,-90.00 -30.00,-90.00 -30.00,90.00"
    assert lines[1] == "0.00,-0.00 40.00,-50.00 60.00,-0.00"
    assert "stop 1" in [text.text for text in root.iter(f"{SVG}text")]
    west, top, wide, high = map(float, root.get("viewBox", "").split())
    assert west < -35.0
    assert top < -95.0
    assert west + wide > 95.0
    assert top + high > 95.0


def test_nothing_cannot_be_drawn() -> None:
    with pytest.raises(ValueError, match="nothing to draw"):
        drawn(Stand(), None, "t")
