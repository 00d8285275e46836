"""Whatever rays a survey is given, it tells stems or none: nothing raises."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.events import LidarScan
from companion.survey.alignment import JointFit, ScanCorrections
from companion.survey.rays import Band, RayCollector
from companion.survey.stem_fit import LEAST_RAYS, StemFit
from companion.survey.stem_rays import COLUMNS, StemRays
from mission.schema.kinds import RAW_LIDARS, SensorClass
from tests.unit.survey.survey_kit import passing, rays_at, stem_of
from tests.unit.survey.test_rays import pose_at, trunk_at

LIDAR = RAW_LIDARS[SensorClass.MULTI_LAYER]
odd = st.sampled_from([0.0, -0.0, math.nan, math.inf, -math.inf, 1e-30, 3e38, -3e38])
single = st.floats(-50.0, 50.0, width=32) | odd
edges = st.sampled_from([0.0, 1.0, 2.0, 3.0])
scans = st.integers(0, 5).map(float)
ray = st.tuples(single, single, single, single, single, edges | odd, single, scans | odd, single)
starts = st.tuples(single, single, single)
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numbers that are none; their fits are dropped


def fits_of(stems: list[StemRays], *, cut_m: float = 0.0) -> list[StemFit | None]:
    joint = JointFit([(stem, cut_m) for stem in stems], LIDAR, 0.01, ScanCorrections())
    for _ in joint.steps():
        pass
    for k in range(len(stems)):
        joint.state_of(k)
        joint.cloud_of(k)
    return [joint.fit_of(k) for k in range(len(stems))]


def stem_with(rows: list[tuple[float, ...]], start: tuple[float, float, float]) -> StemRays:
    return stem_of(array("f", [number for row in rows for number in row]), start)


@given(st.lists(st.tuples(st.lists(ray, max_size=40), starts), max_size=4), single)
def test_no_rays_raise(stems: list[tuple[list[tuple[float, ...]], tuple[float, float, float]]], cut_m: float) -> None:
    for fit in fits_of([stem_with(*stem) for stem in stems], cut_m=cut_m):
        assert fit is None or math.isfinite(fit.diameter_m + fit.diameter_sd_m + fit.north_m)


@given(ray, st.integers(0, 400))
def test_one_ray_many_times_raises_nothing(row: tuple[float, ...], times: int) -> None:
    fits_of([stem_with([row] * times, (1.0, 1.0, 0.1))])


def test_nothing_to_fit_is_no_fit() -> None:
    assert fits_of([]) == []


@pytest.mark.parametrize("count", [0, 1, LEAST_RAYS - 1])
def test_a_stem_of_too_few_rays_leaves_the_others_fits_as_they_are(count: int) -> None:
    good = rays_at(lambda _: 0.12, passing(), np.random.default_rng(1))
    alone = fits_of([stem_of(good)], cut_m=1.3)
    few = stem_of(good[: COLUMNS * count], (0.0, 0.0, 0.1))
    assert fits_of([few, stem_of(good)], cut_m=1.3) == [None, *alone]
    assert alone != [None]


def test_rays_without_numbers_leave_the_others_fits_as_they_are() -> None:
    good = rays_at(lambda _: 0.12, passing(), np.random.default_rng(1))
    broken = stem_with([(math.nan,) * COLUMNS] * 30, (0.0, 0.0, 0.1))
    lost = stem_of(good, (math.nan, math.nan, 0.1))  # tracked nowhere: its rays tell where it is, or nothing does
    alone = fits_of([stem_of(good)], cut_m=1.3)
    assert fits_of([broken, stem_of(good)], cut_m=1.3) == [None, *alone]
    assert fits_of([lost, stem_of(good)], cut_m=1.3)[1] is not None


def test_a_singular_adjustment_is_no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> Any:
        raise np.linalg.LinAlgError("Singular matrix")

    good = rays_at(lambda _: 0.12, passing(), np.random.default_rng(1))
    monkeypatch.setattr(np.linalg, "solve", refuse)
    assert fits_of([stem_of(good)], cut_m=1.3) == [None]


@given(
    st.lists(single | st.floats(0.0, 12.0), max_size=8),
    st.tuples(*[single] * 6),
    st.tuples(single, single, single),
    st.tuples(single, single, single),
)
def test_no_piece_of_a_scan_raises(
    ranges_m: list[float], numbers: tuple[float, ...], first: tuple[float, float, float], last: tuple[float, ...]
) -> None:
    start_rad, step_rad, elevation_rad, age_s, ray_time_s, north_m = numbers
    collector = RayCollector(Band(0.5, 2.1, by_eye=False), 7.0)
    for number in range(3):
        piece = LidarScan(
            1, number, tuple(ranges_m), elevation_rad, start_rad, step_rad, 0.1, math.inf, age_s, ray_time_s,
            first, last,
        )  # fmt: skip
        collector.integrate(piece, pose_at(0.1 * number, [trunk_at(3.0, 1.0, 0.1 * number)]), 0.1 * number)
        lost = pose_at(0.1 * number, [trunk_at(north_m, 1.0, 0.1 * number)])
        collector.integrate(piece, lost, 0.1 * number)
    collector.take_passed(9.0, None)
