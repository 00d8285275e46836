"""Real stem maps: what is read, the shortest way on a grid, the table, and one line where the plots are installed."""

from __future__ import annotations

import math

import pytest

from mission.schema.trees import StandTree
from tests.referees.grid import Disc, shortest_way_m
from tests.referees.referee import Case
from tests.referees.stem_maps import PLOTS, UP_M, as_stems, cases, discs_of, fly_line, line, missing
from tests.referees.stem_maps_table import section

TREE = StandTree(3.0, 4.0, 0.2, 20.0, 12.0, 2.5, "spruce")
ALONE = Case("waka east 1", 1, 1, "recorded", "scan-1deg")
FLOWN = ALONE.row("clear", contacts_crowns=0, way_m=110.0, shortest_m=100.0)


def test_a_plot_is_read_as_a_stem_map() -> None:
    table = '"x","y","d"\n2.5,0.731,0.21\n2.5,0.729,0.3\n56,38,0.25\n'
    assert as_stems(table, PLOTS["spruces"]) == (
        "east_m,north_m,dbh_cm,species\n2.50,0.73,30.00,spruce\n56.00,38.00,25.00,spruce\n"
    )


def test_ten_lines_cross_each_plot_from_before_it_to_behind_it() -> None:
    assert len({case.name for case in cases()}) == 30
    assert line("waka east 2") == ((-20.0, 35.0), (120.0, 35.0))
    assert line("spruces north 3") == ((28.0, -20.0), (28.0, 58.0))


def test_crowns_stand_in_the_way_only_at_their_height() -> None:
    assert discs_of(TREE, 0.65) == [Disc(3.0, 4.0, 0.2 + 0.65)]
    low = StandTree(3.0, 4.0, 0.05, UP_M + 1.0, UP_M - 1.0, 1.2)
    assert discs_of(low, 0.65)[0].radius_m == pytest.approx(1.85)
    assert discs_of(StandTree(3.0, 4.0, 0.02, UP_M - 0.5, 1.0, 1.0), 0.65) == []


def test_the_shortest_way_round_a_disc_is_two_tangents_and_an_arc() -> None:
    here, there = (0.0, 0.0), (20.0, 0.0)
    assert shortest_way_m(here, there, [Disc(10.0, 3.0, 2.0)]) == pytest.approx(20.0)
    radius_m = 3.0
    tangent_m = math.sqrt(10.0**2 - radius_m**2)
    arc_m = radius_m * 2.0 * math.asin(radius_m / 10.0)
    way_m = shortest_way_m(here, there, [Disc(10.0, 0.0, radius_m)])
    assert way_m == pytest.approx(2.0 * tangent_m + arc_m, rel=2e-3)
    assert way_m > 20.5


def test_a_way_may_lie_far_from_the_line() -> None:
    wall = [Disc(10.0, north_m, 1.0) for north_m in range(-60, 20)]
    assert shortest_way_m((0.0, 0.0), (20.0, 0.0), wall) == pytest.approx(2.0 * math.hypot(10.0, 20.0), rel=0.02)


def test_without_a_way_there_is_none() -> None:
    ring = [Disc(5.0 * math.cos(k / 4.0), 5.0 * math.sin(k / 4.0), 1.0) for k in range(26)]
    assert shortest_way_m((0.0, 0.0), (20.0, 0.0), ring) == math.inf


def test_the_table_has_each_line_and_leaves_out_what_was_not_flown() -> None:
    other = {**FLOWN, "n": 8, "name": "waka east 2", "grade": "contact", "contacts_crowns": 1}
    text = section([FLOWN, other], "abc")
    assert "| waka | `scan-1deg` | 1 | 1 | 1 | 0 | 0 | 0 (0) | +10.0%, +10.0% (of 1) |" in text
    assert "| waka | `scan-1deg` | 8 | 1 | 0 | 0 | 0 | 1 (1) |  |" in text
    assert "| waka east 1 | clear, +10.0% |  |" in text
    assert "| waka east 2 |  | contact |" in text


@pytest.mark.skipif(bool(missing()), reason="r-cran-spatstat.data is not installed")
def test_a_line_is_flown_across_a_plot() -> None:
    row = fly_line(Case("spruces north 3", 1, 1, "recorded", "scan-1deg"))
    assert row["grade"] == "clear", row["verdict"]
    assert 0.99 * row["shortest_m"] <= row["way_m"] < 1.3 * row["shortest_m"]
