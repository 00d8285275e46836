"""The end of a coverage: its time is up, and the ring has formed or does not form."""

from __future__ import annotations

import pytest

from mission.common.forming import FORMING_LIMIT_S, GAP_WINDOW_S, FormingTime, ring_tolerance_m

DURATION_S = 20.0


@pytest.fixture
def time() -> FormingTime:
    """Since 100 s."""
    return FormingTime(DURATION_S, 100.0)


def test_formed_coverage_is_over_when_its_time_is_up(time: FormingTime) -> None:
    assert not time.is_over(119.9)
    assert time.is_over(120.0)


def test_unformed_one_has_to_be_formed_for_a_whole_window(time: FormingTime) -> None:
    time.note_unformed(118.0)
    assert not time.is_over(120.0)
    assert not time.is_over(118.0 + GAP_WINDOW_S)  # the verdict looks at both ends of its window
    assert time.is_over(118.1 + GAP_WINDOW_S)


def test_one_that_never_forms_ends_after_a_stated_time(time: FormingTime) -> None:
    for tenths in range(1000, 1801):
        time.note_unformed(tenths / 10.0)
        assert time.is_over(tenths / 10.0) is (tenths / 10.0 >= 120.0 + FORMING_LIMIT_S)


def test_limit_counts_anew_from_a_change_that_is_noted(time: FormingTime) -> None:
    time.note_unformed(200.0)
    assert not time.is_over(200.0, changed_s=150.0)
    assert time.is_over(200.0, changed_s=110.0)
    assert not time.is_over(119.0, changed_s=10.0)


def test_only_the_end_counts(time: FormingTime) -> None:
    assert not time.is_near_end(114.9)
    assert time.is_near_end(115.0)


def test_no_coverage_is_over_at_once() -> None:
    time = FormingTime(0.0, 100.0)
    time.note_unformed(100.0)
    assert time.is_over(100.0)


@pytest.mark.parametrize(("radius_m", "within_m"), [(5.0, 2.0), (20.0, 2.0), (100.0, 10.0)])
def test_wide_ring_allows_a_tenth_of_its_radius(radius_m: float, within_m: float) -> None:
    assert ring_tolerance_m(radius_m) == within_m
