"""The map of what an obstacle sensor saw: where its points are, what it leaves out, what it forgets."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import ObstacleScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_map import CELLS_MAX, MEMORY_S, ObstacleMap
from mission.common.frames import Vec3

SECTORS = 72
STEP_RAD = math.tau / SECTORS
HERE = Position((100.0, -50.0, -8.0), ZERO)


def scan(
    hits: dict[int, float] | None = None, *, unmeasured: tuple[int, ...] = (), sectors: int = SECTORS, **changes: float
) -> ObstacleScan:
    """Nothing near, but what `hits` says: sector -> range."""
    ranges = [math.inf] * sectors
    for k, range_m in (hits or {}).items():
        ranges[k] = range_m
    for k in unmeasured:
        ranges[k] = math.nan
    start_rad = changes.pop("start_rad", 0.0)
    return ObstacleScan(0, tuple(ranges), start_rad, STEP_RAD, 0.2, 8.0, **changes)


def points(seen: ObstacleMap, own: Position = HERE) -> list[tuple[float, float]]:
    return [(round(n, 3), round(e, 3)) for n, e in zip(*seen.find_near(own.pos_ned_m, 20.0), strict=True)]


def at(north_m: float, east_m: float, vel_ned_mps: Vec3 = ZERO) -> Position:
    return Position((HERE.pos_ned_m[0] + north_m, HERE.pos_ned_m[1] + east_m, HERE.pos_ned_m[2]), vel_ned_mps)


def test_report_of_a_neighbour_leaves_out_no_hit_that_is_nearer_than_neighbours_come() -> None:
    for away_m, kept in ((4.4, [(4.4, 0.0)]), (4.6, [])):
        seen = ObstacleMap(near_m=4.5)
        seen.integrate_scan(scan({0: away_m}), HERE, 0.0, ignore=[(away_m, 0.0, 0.0)])
        assert points(seen) == kept


def test_hit_is_a_point_in_the_direction_of_its_sector() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0, 18: 3.0}), HERE, 0.0)  # ahead, and to the right
    assert points(seen) == [(4.0, 0.0), (0.0, 3.0)]


def test_point_is_turned_by_heading_and_keeps_its_level_distance_under_tilt() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}, yaw_rad=math.pi / 2, pitch_rad=-0.3), HERE, 0.0)
    assert points(seen) == [(0.0, round(4.0 * math.cos(0.3), 3))]
    seen = ObstacleMap()
    seen.integrate_scan(scan({18: 4.0}, roll_rad=0.3), HERE, 0.0)
    assert points(seen) == [(0.0, round(4.0 * math.cos(0.3), 3))]


@pytest.mark.parametrize("attitude_rad", [(0.2, -0.1, 2.0), (-0.3, 0.25, -1.0), (0.1, 0.3, 0.0), (0.0, 0.2, 1.6)])
@pytest.mark.parametrize("sector", [0, 9, 18, 33, 54])
def test_point_is_where_the_ray_of_a_leaning_and_turned_vehicle_ends(
    attitude_rad: tuple[float, float, float], sector: int
) -> None:
    """Turned about one axis after the other: roll about the body's, then pitch, then yaw."""
    roll, pitch, yaw = attitude_rad
    x, y, z = 4.0 * math.cos(sector * STEP_RAD), 4.0 * math.sin(sector * STEP_RAD), 0.0
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), z * math.cos(pitch) - x * math.sin(pitch)
    x, y = x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)
    seen = ObstacleMap()
    seen.integrate_scan(scan({sector: 4.0}, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw), HERE, 0.0)
    assert points(seen) == [pytest.approx((x, y), abs=1e-3)]
    assert seen.ray_fall(math.atan2(y, x)) == pytest.approx(z / math.hypot(x, y))


@pytest.mark.parametrize(("aside", "gone"), [(0.3, True), (0.48, False)])
def test_ray_that_passes_at_the_edge_of_a_sector_sees_nothing_through(aside: float, gone: bool) -> None:
    """In shares of a sector from its middle."""
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}), HERE, 0.0)
    for k in range(1, 9):
        seen.integrate_scan(scan(yaw_rad=aside * STEP_RAD), HERE, 0.1 * k)
    assert (len(seen) == 0) == gone


def test_points_are_carried_by_odometry_wherever_its_frame_has_its_origin() -> None:
    for offset_m in (0.0, 5000.0):
        seen, start = ObstacleMap(), at(offset_m, -offset_m)
        seen.integrate_scan(scan({0: 4.0}), start, 0.0)
        assert points(seen, at(offset_m + 1.0, 0.5 - offset_m)) == [(3.0, -0.5)]


def test_scan_that_tells_its_age_is_placed_where_the_vehicle_was_then() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}, age_s=0.1), at(0.3, 0.0, (3.0, 0.0, 0.0)), 0.0)
    assert points(seen) == [(4.0, 0.0)]


def test_ground_and_neighbours_are_no_obstacles() -> None:
    low = Position((0.0, 0.0, -3.0), ZERO)
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 7.0}, pitch_rad=-0.35), low, 0.0)  # 0.6 m above the ground
    assert len(seen) == 0
    seen.integrate_scan(scan({0: 6.0, 36: 6.0}), HERE, 0.0, ignore=[(6.5, 0.5, 0.4)])
    assert points(seen) == [(-6.0, 0.0)]
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 6.0}), HERE, 0.0, ignore=[(6.5, 0.5, -6.0)])  # above it: not what was hit
    assert points(seen) == [(6.0, 0.0)]


def test_point_is_kept_while_it_is_hit_and_forgotten_after() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0, 18: 3.0}), HERE, 0.0)
    for k in range(1, 60):
        seen.integrate_scan(scan({18: 3.0}, unmeasured=(0,)), HERE, 0.1 * k)
        assert ((4.0, 0.0) in points(seen)) == (0.1 * k <= MEMORY_S)
        assert (0.0, 3.0) in points(seen)


def test_point_that_two_scans_saw_through_is_gone_but_not_after_one() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}), HERE, 0.0)
    seen.integrate_scan(scan(), HERE, 0.1)
    assert points(seen) == [(4.0, 0.0)]
    seen.integrate_scan(scan({0: 4.0}), HERE, 0.2)
    seen.integrate_scan(scan(), HERE, 0.3)
    assert points(seen) == [(4.0, 0.0)]
    seen.integrate_scan(scan(), HERE, 0.4)
    assert points(seen) == []


@pytest.mark.parametrize("before", [{0: 2.0}, {1: 8.0}])
def test_point_is_not_seen_through_by_a_shorter_ray_or_another_bearing(before: dict[int, float]) -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}), HERE, 0.0)
    for k in range(1, 9):
        seen.integrate_scan(scan(before, unmeasured=(0,) if 0 not in before else ()), HERE, 0.1 * k)
    assert (4.0, 0.0) in points(seen)


def test_noise_of_one_point_is_smoothed() -> None:
    seen = ObstacleMap()
    for k in range(30):
        seen.integrate_scan(scan({0: 4.1 + (0.05 if k % 2 else -0.05)}), HERE, 0.1 * k)
    ((north_m, _),) = points(seen)
    assert north_m == pytest.approx(4.1, abs=0.03)


def test_map_has_a_bound_and_drops_the_longest_unseen() -> None:
    seen = ObstacleMap()
    more = CELLS_MAX + 100
    for k in range(more):
        seen.integrate_scan(scan({0: 4.0}, unmeasured=tuple(range(1, SECTORS))), at(0.0, 1.0 * k), 0.001 * k)
    assert len(seen) == CELLS_MAX
    last = at(0.0, more - 1.0)
    assert (4.0, 0.0) in points(seen, last)


def test_bearing_is_blind_unless_it_was_measured_lately() -> None:
    seen = ObstacleMap()
    assert all(seen.find_blind(0.0, fresh_s=0.3))
    half = scan(sectors=37, start_rad=-math.pi / 2)  # to both sides of ahead
    seen.integrate_scan(half, HERE, 1.0)
    blind = seen.find_blind(1.1, fresh_s=0.3)
    assert [k for k in range(SECTORS) if blind[k]] == list(range(19, 54))
    assert all(seen.find_blind(1.4, fresh_s=0.3))
    seen.integrate_scan(scan(unmeasured=(9, 10, 11, 30), yaw_rad=0.4 * STEP_RAD), HERE, 2.0)
    blind = seen.find_blind(2.0, fresh_s=0.3)  # one that was missed alone is hidden by those beside it
    assert [k for k in range(SECTORS) if blind[k]] == [9, 10, 11]


def test_bearing_is_as_old_as_the_scan_that_measured_it_and_not_as_its_arrival() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan(age_s=0.2), HERE, 1.0)
    assert not any(seen.find_blind(1.1, fresh_s=0.3))
    assert all(seen.find_blind(1.15, fresh_s=0.3))


def test_scan_that_comes_late_makes_no_bearing_older() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan(pitch_rad=-0.1), HERE, 1.0)
    falls = seen.ray_fall(0.0)
    seen.integrate_scan(scan(age_s=0.5), HERE, 1.05)
    assert not any(seen.find_blind(1.3, fresh_s=0.3))
    assert seen.ray_fall(0.0) == falls > 0.0


def test_of_sensors_that_see_differently_far_the_nearer_limit_counts() -> None:
    seen, ahead = ObstacleMap(), range(-9, 10)
    far = tuple([math.inf if (k in ahead or k - SECTORS in ahead) else math.nan for k in range(SECTORS)])
    behind = tuple([math.nan if math.isinf(range_m) else math.inf for range_m in far])
    for k in range(4):
        seen.integrate_scan(ObstacleScan(197, behind, 0.0, STEP_RAD, 0.2, 8.0), HERE, 0.1 * k)
        seen.integrate_scan(ObstacleScan(196, far, 0.0, STEP_RAD, 0.2, 40.0), HERE, 0.1 * k)
        assert seen.max_m == 8.0


def test_scan_without_a_finite_place_or_with_odd_sectors_is_harmless() -> None:
    seen = ObstacleMap()
    seen.integrate_scan(scan({0: 4.0}), Position((math.nan, 0.0, -8.0), ZERO), 0.0)
    seen.integrate_scan(scan({0: 4.0}, yaw_rad=math.nan), HERE, 0.0)
    assert len(seen) == 0
    seen.integrate_scan(ObstacleScan(0, (), 0.0, STEP_RAD, 0.2, 8.0), HERE, 0.1)
    seen.integrate_scan(ObstacleScan(0, (3.0, math.inf), 0.0, 0.0, 0.2, 8.0), HERE, 0.2)
    assert points(seen) == [(3.0, 0.0)]
