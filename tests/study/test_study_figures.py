"""The table of figures of studies: each once, with what its readers need; and the backends whose flights have them."""

from __future__ import annotations

import dataclasses

import pytest

from sim_bridge.judge.metrics.figures import LESS, MORE
from sim_bridge.lab.study.backends import BACKENDS
from sim_bridge.lab.study.case import Backend
from sim_bridge.lab.study.forest.figures import Figures as AmongTrees
from sim_bridge.lab.study.point_mass import Figures as PointMass
from sim_bridge.lab.study.results.figures import BY_NAME, ESTIMATOR, FLIGHT, figures_of, nees_bounds
from sim_bridge.lab.study.results.summary import summarise


def test_each_figure_is_declared_once_with_a_better_end() -> None:
    assert len(BY_NAME) == len(FLIGHT) + len(ESTIMATOR)
    for figure in BY_NAME.values():
        assert figure.better in (LESS, MORE)
        assert figure.text.endswith(".")


def test_every_backend_is_there_and_its_flights_have_the_figure_that_they_are_known_by() -> None:
    assert set(BACKENDS) == set(Backend)
    for backend, flies in BACKENDS.items():
        assert flies.always in {figure.name for figure in figures_of(backend)}


@pytest.mark.parametrize("kind", [PointMass, AmongTrees])
def test_what_point_masses_achieve_is_in_the_table_but_what_studies_do_not_put_together(kind: type) -> None:
    names = {field.name for field in dataclasses.fields(kind)}
    beside = {
        "alone_s",
        "straight_time_s",
        "coverage_gap_ideal_deg",
        "lost",
        "sim_time_s",
        "speed_max_mps",
        "vehicle_s",
    }
    assert names - beside <= {figure.name for figure in FLIGHT}


def test_worst_is_the_other_end_and_shares_are_shown_in_percent() -> None:
    assert BY_NAME["min_separation_m"].worst([3.0, 5.0]) == 3.0
    assert BY_NAME["overhead_last"].worst([0.1, 0.2]) == 0.2
    assert (BY_NAME["overhead_last"].scale, BY_NAME["overhead_last"].shown_unit) == (100.0, "%")


def test_a_figure_of_others_is_worked_out_of_a_row() -> None:
    ratio = BY_NAME["coverage_gap_ratio"]
    assert ratio.of({"coverage_gap_deg": 99.0, "coverage_gap_ideal_deg": 90.0}) == pytest.approx(1.1)
    assert ratio.of({"coverage_gap_deg": 99.0}) is None


def test_a_figure_of_a_case_is_worked_out_of_all_its_flights_together() -> None:
    low, high = nees_bounds(2, 4)
    assert (low, high) == pytest.approx((0.367, 1.945), abs=0.001)
    row = {"key": "", "run": "a", "law": "relative-filter", "backend": "estimator", "n": 4, "settings": {}}
    rows = [
        row | {"seed": seed, "status": "flown", "rmse_m": 1.0, "nees_at": [at, 3.0]}
        for seed, at in ((1, 0.1), (2, 1.5))
    ]
    (group,) = summarise(rows)
    assert group.figures["nees_inside"].mean == 0.5  # the mean of both: 0.8 inside, 3 not
    assert group.figures["rmse_m"].count == 2
