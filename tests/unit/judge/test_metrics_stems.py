"""Measured stems against trees: found, false, off, and trees that nobody passed."""

from __future__ import annotations

import pytest

from companion.survey.observation import STEM_KIND, Grade, StemObservation, encode
from mission.document.model import Mission
from mission.schema.trees import StandTree
from mission.stand.stand import Stand
from sim_bridge.judge.metrics.stems import StemFigures, definitions, measure_stems
from tests.unit.judge.metrics_kit import a_recording

SURVEYING = Mission.model_validate(
    {
        "schema": 1,
        "route": {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [40.0, 0.0, 4.0], "vel_leader_mps": 2.0},
        "sensing": {"sensor": "scan-1deg"},
        "survey": {},
    }
)
PLACES = ((5.0, 3.0), (10.0, -3.0), (15.0, 4.0), (20.0, 20.0))  # east, north; the last one is out of reach
STAND = Stand([StandTree(east, north, 0.1, 15.0, 10.0, 2.0) for east, north in PLACES])
WAY = a_recording([[[0.5 * k, 0.0, 4.0]] for k in range(57)], dt_s=0.25)  # 28 m to the east


def stem(north_m: float, east_m: float, dbh_m: float = 0.2, grade: Grade = Grade.GOOD) -> tuple[int, bytes]:
    return STEM_KIND, encode(
        StemObservation(
            1, 1.0, 5.0, north_m, east_m, 0.02, 1.0, 1.3, dbh_m, 0.01, dbh_m, 0.01, True, None, 0.7, 200, grade, ""
        )
    )


def figures(*records: tuple[int, bytes]) -> StemFigures:
    found = measure_stems({1: records}, WAY, SURVEYING, STAND)
    assert found is not None
    return found


def test_trees_within_reach_of_the_way_are_passed() -> None:
    assert figures().stems_passed == 3
    assert figures().stems_found_share == 0.0
    assert figures().stems_dbh_rmse_m is None


def test_stems_are_held_against_the_nearest_tree() -> None:
    found = figures(stem(3.3, 5.0, 0.22), stem(-2.7, 10.0, 0.2))
    assert found.stems_found == 2
    assert found.stems_found_share == pytest.approx(2.0 / 3.0)
    assert found.stems_false_share == 0.0
    assert found.stems_dbh_bias_m == pytest.approx(0.01)
    assert found.stems_dbh_rmse_m == pytest.approx(0.02 / 2.0**0.5)
    assert found.stems_dbh_within_share == 1.0
    assert found.stems_position_rmse_m == pytest.approx(0.3, abs=1e-6)
    assert found.stems_relative_rmse_m == pytest.approx(0.0, abs=1e-6)  # both are off alike


def test_a_stem_where_no_tree_is_is_false() -> None:
    found = figures(stem(3.0, 5.0), stem(0.0, 18.0))
    assert found.stems_measured == 2
    assert found.stems_false_share == 0.5


def test_poor_ones_do_not_count_and_thin_ones_are_not_false() -> None:
    found = figures(stem(3.0, 5.0, grade=Grade.POOR), stem(-3.0, 10.0, 0.09))
    assert found.stems_measured == 0
    assert found.stems_found == 1  # the thin one is a tree of 20 cm all the same
    assert found.stems_dbh_bias_m == pytest.approx(-0.11)


def test_without_a_survey_there_are_no_figures() -> None:
    plain = SURVEYING.model_copy(update={"survey": None})
    assert measure_stems({1: []}, WAY, plain, STAND) is None


def test_trees_are_passed_by_true_places_though_nothing_was_recorded() -> None:
    """A full disk kept the later half; one whose companion is dead measures nothing, nor does one on the ground."""
    half = measure_stems({1: [stem(3.0, 5.0)]}, WAY, SURVEYING, STAND)
    assert half is not None
    assert (half.stems_found, half.stems_passed) == (1, 3)
    for column in ({"agent_alive": False}, {"on_ground": True}):
        none = measure_stems({1: []}, a_recording([[[5.0, 0.0, 4.0]]], **column), SURVEYING, STAND)
        assert none is not None
        assert (none.stems_passed, none.stems_found_share) == (0, None)


def test_every_figure_is_defined() -> None:
    assert set(definitions()) == set(figures().as_dict())
