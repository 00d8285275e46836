"""Columns: free by own rays that went through all of it, and by nothing else."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.perception.columns.column import LEAST_PASSES, STALE_S, Column
from companion.core.perception.columns.column_map import COLUMNS_MAX, TURNS, ColumnMap
from mission.common.frames import Vec3
from tests.unit.core.rise.column_kit import see_column, see_from
from tests.unit.sensors.lidar_kit import scan

TREE, RING_M, CLEAR_M, FLOOR_M, TOP_M = (50.0, 0.0), 12.0, 0.65, 4.6, 20.6
AT: Vec3 = (20.0, 0.0, -4.0)  # 18 m from the ring


def column(north_m: float = 0.0, east_m: float = 0.0) -> Column:
    return Column(north_m, east_m, radius_m=CLEAR_M + 0.5, floor_up_m=FLOOR_M, top_up_m=TOP_M)


def laid() -> ColumnMap:
    found = ColumnMap(clear_m=CLEAR_M, top_up_m=TOP_M)
    found.lay_ring(TREE, radius_m=RING_M, floor_up_m=FLOOR_M)
    return found


def test_a_column_through_which_rays_went_on_all_sides_is_free_up_to_its_top() -> None:
    one = column()
    assert not one.is_free(10.0, from_up_m=FLOOR_M)
    see_column(one, 10.0)
    assert one.is_free(10.0, from_up_m=FLOOR_M)
    assert one.free_up_m(10.0, from_up_m=FLOOR_M) == TOP_M


def test_one_ray_frees_no_cell() -> None:
    one = column()
    see_column(one, 10.0, times=LEAST_PASSES - 1)
    assert one.free_up_m(10.0, from_up_m=FLOOR_M) == FLOOR_M
    see_column(one, 10.0, times=1)
    assert one.is_free(10.0, from_up_m=FLOOR_M)


def test_a_branch_in_it_bars_it_and_below_it_is_free() -> None:
    one = column()
    see_column(one, 10.0)
    eye = (-8.0, 0.0, -10.0)
    one.add_ray(eye, (0.8, 0.0, -0.6), 10.0, 40.0, 11.0)  # it ends on the axis, 16 m up
    assert one.free_up_m(11.0, from_up_m=FLOOR_M) == pytest.approx(15.6)
    assert one.is_free(11.0, from_up_m=17.0)  # for who is above it


def test_a_branch_that_reaches_in_from_beside_bars_it_and_one_that_stands_clear_does_not() -> None:
    for north_m, is_barred in ((1.3, True), (2.2, False)):
        one = column()
        see_column(one, 10.0)
        one.add_ray((north_m, -10.0, -12.0), (0.0, 1.0, 0.0), 10.0, 40.0, 11.0)
        assert one.is_free(11.0, from_up_m=FLOOR_M) is not is_barred


def test_a_cell_that_no_ray_went_through_bars_it() -> None:
    one = column()
    see_column(one, 10.0, hidden_up_m=(12.6, 13.6))
    assert one.free_up_m(10.0, from_up_m=FLOOR_M) == pytest.approx(12.6)


def test_what_is_behind_a_hit_is_not_seen() -> None:
    one = column()
    for _ in range(LEAST_PASSES):
        for up_m in [4.0 + 0.1 * k for k in range(180)]:
            for east_m in (-1.2, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2):
                # Bark 0.5 m before the axis: the far half was never seen
                one.add_ray((-6.0, east_m, -up_m), (1.0, 0.0, 0.0), 3.0, 40.0, 10.0)
    assert one.free_up_m(10.0, from_up_m=FLOOR_M) <= FLOOR_M


def test_what_was_seen_grows_old() -> None:
    one = column()
    see_column(one, 10.0)
    assert one.is_free(10.0 + STALE_S, from_up_m=FLOOR_M)
    assert not one.is_free(10.1 + STALE_S, from_up_m=FLOOR_M)
    see_column(one, 20.0 + STALE_S)
    assert one.is_free(20.0 + STALE_S, from_up_m=FLOOR_M)


def test_a_hit_counts_until_it_has_grown_old_whatever_passes_since() -> None:
    one = column()
    one.add_ray((0.0, -10.0, -12.0), (0.0, 1.0, 0.0), 10.0, 40.0, 10.0)
    see_column(one, 20.0)
    assert not one.is_free(20.0, from_up_m=FLOOR_M)
    assert one.is_free(10.1 + STALE_S, from_up_m=FLOOR_M)


def test_columns_are_laid_evenly_on_the_ring_and_bounded() -> None:
    columns = laid().columns
    assert len(columns) == COLUMNS_MAX
    for one in columns:
        assert math.dist((one.north_m, one.east_m), TREE) == pytest.approx(RING_M)
    small = ColumnMap(clear_m=CLEAR_M, top_up_m=TOP_M)
    small.lay_ring(TREE, radius_m=4.0, floor_up_m=FLOOR_M)
    assert len(small.columns) == 10


def test_a_lidar_that_comes_nearer_sees_columns_free_from_beside_and_never_its_own() -> None:
    """The layers of a Mid-360, -7 to 52 degrees: the top is seen from far off, and from its foot nothing is."""
    seen = laid()
    for k in range(30):
        see_from(seen, (10.0 + 0.9 * k, 0.0, -4.0), 0.6 * k, max_m=40.0)
    free = seen.find_free((38.0, 0.0, -4.0), 20.0, within_m=3.0)
    assert (round(free[0].north_m), round(free[0].east_m)) == (38, 0)
    below = laid()
    for k in range(12):
        see_from(below, (38.0, 0.0, -4.0), 1.5 * k, max_m=40.0)
    assert below.find_free((38.0, 0.0, -4.0), 20.0, within_m=1.0) == []


def test_a_lidar_that_hangs_sees_none() -> None:
    seen = laid()
    for k in range(30):
        see_from(seen, (10.0 + 0.9 * k, 0.0, -4.0), 0.6 * k, max_m=40.0, side=-1.0)
    assert seen.find_free((38.0, 0.0, -4.0), 20.0, within_m=100.0) == []


def test_a_sensor_that_reaches_less_far_sees_no_top() -> None:
    seen = laid()
    for k in range(30):
        see_from(seen, (10.0 + 0.9 * k, 0.0, -4.0), 0.6 * k, max_m=15.0)
    assert seen.find_free((38.0, 0.0, -4.0), 20.0, within_m=3.0) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_change_nothing(bad: float) -> None:
    seen = laid()
    seen.integrate(scan((bad,) * 360, turn=TURNS, elevation_rad=0.5), Position(AT, ZERO), 1.0)
    seen.integrate(scan((9.0,) * 360, turn=TURNS, elevation_rad=bad), Position(AT, ZERO), 1.0)
    seen.integrate(scan((9.0,) * 360, turn=TURNS, elevation_rad=0.5), Position((bad, 0.0, 0.0), ZERO), 1.0)
    assert seen.find_free(AT, 1.0, within_m=100.0) == []


def test_who_laid_none_looks_at_no_ray() -> None:
    seen = ColumnMap(clear_m=CLEAR_M, top_up_m=TOP_M)
    seen.integrate(scan((9.0,) * 360, turn=TURNS), Position(AT, ZERO), 1.0)
    assert seen.columns == []
    seen.lay_ring(TREE, radius_m=RING_M, floor_up_m=FLOOR_M)
    seen.clear()
    assert seen.find_free(AT, 1.0, within_m=100.0) == []
