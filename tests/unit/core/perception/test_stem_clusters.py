"""Stems in a level scan: what is as wide and round as a stem is one, where it stands; the rest is none."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from companion.core.perception.landmarks.stem_clusters import STEMS_MAX, Stem, find_stems
from companion.core.perception.level_scan import LevelScan
from tests.unit.core.perception.scan_kit import FINE, SECTORS, level_scan, ring


def axis_of(stem: Stem) -> tuple[float, float]:
    away_m = stem.surface_m + stem.radius_m
    return (
        stem.eye_north_m + away_m * math.cos(stem.bearing_rad),
        stem.eye_east_m + away_m * math.sin(stem.bearing_rad),
    )


@pytest.mark.parametrize("bearing_deg", [0.0, 37.0, 180.0, 359.5])
@pytest.mark.parametrize(("away_m", "radius_m"), [(3.0, 0.1), (5.0, 0.25), (8.0, 0.4)])
def test_a_stem_is_found_where_it_stands_and_as_thick_as_it_is(
    bearing_deg: float, away_m: float, radius_m: float
) -> None:
    at = (away_m * math.cos(math.radians(bearing_deg)), away_m * math.sin(math.radians(bearing_deg)))
    (stem,) = find_stems(level_scan([(*at, radius_m)]), FINE)
    ray_m = away_m * math.radians(1.0)  # as wide as the rays are apart there
    assert math.dist(axis_of(stem), at) < 0.02 + 0.6 * ray_m
    assert stem.radius_m == pytest.approx(radius_m, abs=0.02 + 0.6 * ray_m)
    assert stem.surface_m == pytest.approx(away_m - radius_m, abs=0.04)


@pytest.mark.parametrize("gone_m", [(0.2, 0.0), (0.4, 0.0), (-0.3, 0.0), (0.2, 0.05)])
@pytest.mark.parametrize(("away_m", "radius_m"), [(3.0, 0.1), (6.0, 0.2), (8.0, 0.35)])
@pytest.mark.parametrize("off_m", [-0.1, 0.0, 0.15])
def test_a_stem_at_the_seam_of_a_turn_is_one_though_the_vehicle_flies_at_it(
    gone_m: tuple[float, float], away_m: float, radius_m: float, off_m: float
) -> None:
    """Its first rays are from 0.2 to 0.4 m farther off than its last: two halves, or not round, and so no stem."""
    (stem,) = find_stems(level_scan([(away_m, off_m, radius_m)], gone_m=gone_m), FINE)
    ray_m = away_m * math.radians(1.0)
    assert math.dist(axis_of(stem), (away_m, off_m)) < 0.02 + 0.6 * ray_m + abs(gone_m[1])
    assert stem.radius_m == pytest.approx(radius_m, abs=0.02 + 0.6 * ray_m + abs(gone_m[1]))


@pytest.mark.parametrize("nears_m", [-0.3, 0.2, 0.3])
@pytest.mark.parametrize("off_m", [-0.2, 0.0, 0.2])
def test_a_hull_at_the_seam_that_comes_or_goes_is_where_it_was_last(nears_m: float, off_m: float) -> None:
    """The turn's first rays met it elsewhere than its last: head-on vehicles were no stems, and known too late."""
    scan, late = (level_scan([(6.0 + m, off_m, 0.35)]) for m in (nears_m, 0.0))
    scan.ranges_m[180:] = late.ranges_m[180:]
    (stem,) = find_stems(scan, FINE)
    assert math.dist(axis_of(stem), (6.0, off_m)) < 0.12


def test_sectors_tell_a_stem_without_its_width() -> None:
    (stem,) = find_stems(level_scan([(4.0, 0.0, 0.2)], rays=72), SECTORS)
    assert stem.surface_m == pytest.approx(3.8, abs=0.06)
    assert abs(stem.bearing_rad) < math.radians(3.0)
    assert stem.across_sd_m > 0.08


def test_a_wall_and_a_thicket_are_no_stems() -> None:
    wall = LevelScan(math.radians(1.0))
    for k in range(360):
        bearing = math.radians(k)
        ahead = math.cos(bearing)
        wall.add_ray(bearing, 4.0 / ahead if ahead > 0.3 else math.inf, 0.0, 0.0)
    assert find_stems(wall, FINE) == []
    thicket = level_scan([(5.0, 0.0, 0.15), (5.0, 0.8, 0.15), (5.3, -0.7, 0.1)])
    assert find_stems(thicket, FINE) == []


def test_a_flat_thing_as_wide_as_a_stem_is_none() -> None:
    plank = LevelScan(math.radians(1.0))
    for k in range(360):
        off = math.remainder(math.radians(k), math.tau)
        plank.add_ray(math.radians(k), 2.0 / math.cos(off) if abs(off) < 0.3 else math.inf, 0.0, 0.0)
    assert find_stems(plank, FINE) == []


def test_one_ray_that_was_not_measured_is_bridged_and_one_that_went_on_is_not() -> None:
    scan = level_scan([(4.0, 0.0, 0.3)])
    (whole,) = find_stems(scan, FINE)
    scan.ranges_m[1] = math.nan
    (bridged,) = find_stems(scan, FINE)
    assert bridged.rays == whole.rays
    scan.ranges_m[1] = math.inf
    assert len(find_stems(scan, FINE)) != 1 or find_stems(scan, FINE)[0].rays < whole.rays


def test_an_edge_behind_something_nearer_is_known_less_well() -> None:
    free = find_stems(level_scan([(6.0, 0.0, 0.3)]), FINE)[0]
    behind = [s for s in find_stems(level_scan([(6.0, 0.0, 0.3), (2.0, 0.15, 0.1)]), FINE) if s.surface_m > 4.0]
    assert behind
    assert behind[0].is_hidden
    assert not free.is_hidden
    assert behind[0].across_sd_m > 2.0 * free.across_sd_m


def test_a_scan_of_nothing_and_one_of_nothing_measured_have_no_stems() -> None:
    assert find_stems(level_scan([]), FINE) == []
    unmeasured = LevelScan(math.radians(1.0))
    for k in range(360):
        unmeasured.add_ray(math.radians(k), math.nan, 0.0, 0.0)
    assert find_stems(unmeasured, FINE) == []
    assert find_stems(LevelScan(1.0), FINE) == []


def test_a_dense_stand_has_stems_on_all_sides() -> None:
    """The first 48 in the order of the scan were read, and nothing beyond 290 degrees."""
    stems = find_stems(level_scan(ring(60, 11.0), rays=720), FINE)
    assert len(stems) == 60
    assert max(stem.bearing_rad % math.tau for stem in stems) > math.radians(353.0)


def test_of_more_stems_than_are_bounded_the_nearest_are_taken_in_the_order_of_the_scan() -> None:
    near, far = ring(10, 9.0, 0.3), ring(110, 20.0, 0.15)
    stems = find_stems(level_scan([*near, *far], rays=1440, max_m=25.0), FINE)
    assert 80 < len(stems) <= STEMS_MAX
    assert sum(stem.surface_m < 10.0 for stem in stems) == 10
    bearings = [stem.bearing_rad % math.tau for stem in stems]
    assert sum(after < before for before, after in pairwise(bearings)) <= 1  # where it goes on round
