"""Each gate makes a measurement that fails it no better than its grade, and says why."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.survey.grading import GATES, grade_fit
from companion.survey.observation import REASON_MAX, Grade
from companion.survey.stem_fit import StemFit
from companion.survey.taper import Taper, is_at_breast_height

SOUND = StemFit(
    north_m=0.0,
    east_m=0.0,
    position_sd_m=0.01,
    diameter_m=0.25,
    diameter_sd_m=0.005,
    lean_rad=None,
    arc_share=0.8,
    inner_share=0.0,
    rms_m=0.012,
    rays=300,
)


def test_what_passes_all_is_good() -> None:
    assert grade_fit(SOUND, 0.005) == (Grade.GOOD, "")


@pytest.mark.parametrize(
    ("changes", "dbh_sd_m", "grade", "reason"),
    [
        ({"rays": 20}, 0.005, Grade.POOR, "few rays"),
        ({"rays": 60}, 0.005, Grade.FAIR, "few rays"),
        ({"arc_share": 0.2}, 0.005, Grade.POOR, "seen from one side"),
        ({"arc_share": 0.4}, 0.005, Grade.FAIR, "seen from one side"),
        ({"inner_share": 0.2}, 0.005, Grade.POOR, "rays end within the stem"),
        ({"inner_share": 0.05}, 0.005, Grade.FAIR, "rays end within the stem"),
        ({"rms_m": 0.05}, 0.005, Grade.POOR, "not round"),
        ({"rms_m": 0.03}, 0.005, Grade.FAIR, "not round"),
        ({}, 0.05, Grade.POOR, "diameter uncertain"),
        ({}, 0.03, Grade.FAIR, "diameter uncertain"),
        ({"rays": 60, "rms_m": 0.05}, 0.005, Grade.POOR, "not round"),  # the worse one counts
    ],
)
def test_a_gate_that_is_failed_is_named(changes: dict[str, Any], dbh_sd_m: float, grade: Grade, reason: str) -> None:
    assert grade_fit(replace(SOUND, **changes), dbh_sd_m) == (grade, reason)


def test_reasons_fit_their_records() -> None:
    assert max(len(gate.reason) for gate in GATES) <= REASON_MAX


def test_a_cut_higher_up_comes_to_breast_height_by_taper_and_its_error() -> None:
    dbh_m, sd_m = Taper(0.01, 0.004).at_breast_height(0.25, 0.006, cut_up_m=4.3, cut_sd_m=0.5)
    assert dbh_m == pytest.approx(0.28)
    assert sd_m == pytest.approx((0.006**2 + (0.004 * 3.0) ** 2 + 0.005**2) ** 0.5)


def test_a_cut_at_breast_height_stays_as_it_is() -> None:
    assert Taper(0.01, 0.004).at_breast_height(0.25, 0.006, cut_up_m=1.3, cut_sd_m=0.0) == (0.25, 0.006)
    assert is_at_breast_height(1.55)
    assert not is_at_breast_height(4.0)
