"""One cloud a tick: what is in it with an obstacle sensor and without."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.events import LidarScan, ObstacleScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.motion_margin import find_wider_m
from companion.core.perception.obstacle_cloud import LocalObstacleCloud, ObstacleKind
from companion.core.perception.obstacle_perception import build_perception
from companion.core.safety.safety_filter import SafetyFilter
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import applied
from tests.unit.core.perception import scan_kit

HERE, PLACED = (10.0, 20.0, -8.0), (12.0, 20.0, -8.0)
HOVERING = {
    2: PeerReport(2, (3.0, 4.0, 0.0), 20.0, silent=True, elsewhere=((-7.0, 4.0, 0.0),)),
    3: PeerReport(3, (0.0, 9.0, 0.0), 0.2, silent=False),
}
DT_S, LAG_S = 0.05, 0.3
STEMS = [(4.0, 1.0, 0.2), (-3.0, 3.0, 0.2), (1.0, -5.0, 0.2)]
SCAN = ObstacleScan(0, (4.0, *[math.inf] * 71), 0.0, math.tau / 72, 0.2, 8.0)


@pytest.mark.parametrize("sensing", [None, {}], ids=["open sky", "sensor"])
def test_trunks_and_hovering_vehicles_are_in_every_cloud(sensing: dict[str, float] | None) -> None:
    flown = mission() if sensing is None else mission(sensing=sensing)
    cloud = build_perception(flown, 1).observe_obstacles(HERE, PLACED, HOVERING, 0.0)
    (trunk,) = cloud.trunks
    assert trunk.rel_ned_m == pytest.approx((-12.0, 110.0, 0.0))  # d2 from the place in the mission's frame
    assert [(o.kind, o.rel_ned_m, o.keep_out_m) for o in cloud.hovering] == [
        (ObstacleKind.SILENT, (3.0, 4.0, 0.0), flown.separation.hard_m),
        (ObstacleKind.SILENT, (-7.0, 4.0, 0.0), flown.separation.hard_m),
        (ObstacleKind.HOVERING, (0.0, 9.0, 0.0), flown.separation.hard_m),
    ]


def test_scans_are_in_the_cloud_of_a_vehicle_with_a_sensor_and_nothing_is_blind_to_one_without() -> None:
    clouds = {}
    for name, flown in {"sensor": mission(sensing={}), "open sky": mission()}.items():
        perception = build_perception(flown, 1)
        perception.integrate_scan(SCAN, Position(HERE, ZERO), 0.0, ())
        clouds[name] = perception.observe_obstacles(HERE, HERE, {}, 0.0)
    seen = clouds["sensor"]
    assert list(zip(seen.norths, seen.easts, strict=True)) == [pytest.approx((4.0, 0.0), abs=1e-9)]
    assert (seen.sensor_m, len(seen.blind)) == (8.0, 72)
    assert clouds["open sky"].norths == []
    assert clouds["open sky"].is_seen(1e6, 0.0)


def test_cloud_that_is_widened_leaves_the_one_it_came_from_as_it_was() -> None:
    cloud = LocalObstacleCloud(7.0, [False])
    cloud.add_points([2.0], [0.0], 0.65)
    wide = cloud.widened(1.0)
    past = (0.0, 1.0, 4.0, 1.0)  # a metre beside the point
    assert cloud.is_way_clear(*past)
    assert not wide.is_way_clear(*past)


def sectors(trunk_m: float) -> ObstacleScan:
    return ObstacleScan(0, (trunk_m if trunk_m < 8.0 else math.inf, *[math.inf] * 71), 0.0, math.tau / 72, 0.2, 8.0)


def rays(trunk_m: float) -> LidarScan:
    level = (0.0, 0.0, 0.0)
    return LidarScan(0, 0, (trunk_m,) * 3, 0.0, -0.01, 0.01, 0.2, 12.0, 0.0, 0.0, level, level)


@pytest.mark.parametrize("scan", [sectors, rays])
@pytest.mark.parametrize("speed_mps", [1.0, 2.0, 3.0])
def test_trunk_at_which_a_neighbour_says_that_it_is_is_not_run_into(
    scan: Callable[[float], ObstacleScan | LidarScan], speed_mps: float
) -> None:
    """Nor a hovering vehicle: whatever a member reports, what is as near as no neighbour comes is seen."""
    flown = mission(sensing={})
    perception, safety_filter = build_perception(flown, 1), SafetyFilter.of(flown)
    trunk_m, north_m, vel_mps, told, least_m = 30.0, 0.0, 0.0, ZERO, math.inf
    for tick in range(round(40.0 / speed_mps / DT_S)):
        own = Position((north_m, 0.0, -8.0), (vel_mps, 0.0, 0.0))
        to_trunk_m = trunk_m - north_m
        if tick % 2 == 0:
            perception.integrate_scan(scan(to_trunk_m), own, tick * DT_S, [(to_trunk_m, 0.0, 0.0)])
        cloud = perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, tick * DT_S)
        seen = LocalObstacleCloud(cloud.reach_m, (False,))
        seen.add_points(cloud.norths, cloud.easts, 0.65)
        told = applied(safety_filter, (speed_mps, 0.0, 0.0), told, own, dt_s=DT_S, points=seen)
        vel_mps += (told[0] - vel_mps) * -math.expm1(-DT_S / LAG_S)
        north_m += vel_mps * DT_S
        least_m = min(least_m, trunk_m - north_m)
    assert 0.6 < least_m < 1.5  # it came that far, and stopped


def test_more_is_kept_from_what_is_seen_while_nothing_tells_the_own_motion() -> None:
    perception = build_perception(mission(sensing={}), 1)
    own = Position((0.0, 0.0, -8.0), ZERO)
    clears_m = []
    for k in range(1, 141):
        now_s = 0.1 * k
        perception.correct_odometry(own, now_s)
        stems = STEMS if k <= 30 else STEMS[:1]  # one alone tells no motion
        perception.integrate_scan(scan_kit.sectors(stems, (0.0, 0.0), 0.0), own, now_s, ())
        perception.correct_odometry(own, now_s + 0.01)
        clears_m.append(perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, now_s).clears_m[0])
    assert clears_m[0] == pytest.approx(0.65 + find_wider_m(scan_kit.SECTORS, math.inf, 0.3))
    assert clears_m[29] == pytest.approx(0.65)
    assert 0.70 < clears_m[45] < 0.76  # 1.6 s after the last correction
    assert clears_m[-1] == pytest.approx(clears_m[0])
    assert max(clears_m[k + 1] - clears_m[k] for k in range(29, 139)) < 0.03  # no step
