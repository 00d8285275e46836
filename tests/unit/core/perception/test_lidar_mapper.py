"""Raw scans in the obstacle map: each ray by the pose at its own time, what is at the vehicle's height, and no more."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.core.model.events import LidarScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.lidar_mapper import BAND_M, SENSORS_MAX, TRUNK_FROM_M, LidarMapper
from companion.core.perception.obstacle_map import MEMORY_S, ObstacleMap
from companion.core.perception.vehicles.hovering_hulls import HoveringHulls
from mission.common.frames import Vec3
from mission.schema.kinds import RAW_LIDARS, SensorClass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.raw_scan import RayPattern, cast
from tests.unit.sensors.lidar_kit import scan

HERE = Position((100.0, -50.0, -4.0), ZERO)
INF = math.inf


def mapped(*scans: LidarScan, own: Position = HERE, ignore: tuple[Vec3, ...] = ()) -> ObstacleMap:
    seen = ObstacleMap()
    mapper = LidarMapper(seen, HoveringHulls())
    for k, one in enumerate(scans):
        mapper.integrate_rays(one, own, 10.0 + 0.1 * k, ignore)
    return seen


def points(seen: ObstacleMap, own: Position = HERE) -> list[tuple[float, float]]:
    return [(round(n, 2), round(e, 2)) for n, e in zip(*seen.find_near(own.pos_ned_m, 100.0), strict=True)]


def one_ray(bearing_deg: float, range_m: float, **changes: object) -> LidarScan:
    """The others of the turn saw nothing."""
    return scan(tuple(range_m if k == round(bearing_deg) else INF for k in range(360)), **changes)


def test_a_hit_is_where_its_ray_looked() -> None:
    assert points(mapped(one_ray(90.0, 5.0))) == [(0.0, 5.0)]
    assert points(mapped(one_ray(0.0, 5.0, first_attitude_rad=(0.0, 0.0, math.pi / 2)))) == [(0.0, 5.0)]
    leaning = one_ray(0.0, 5.0, first_attitude_rad=(0.0, -0.1, 0.0))
    assert points(mapped(leaning)) == [(round(5.0 * math.cos(0.1), 2), 0.0)]


def test_points_stand_where_trunks_are_though_the_vehicle_moves_and_turns_while_the_lidar_does() -> None:
    """The simulator's own distortion, undone: trunks all round, passed at 3 m/s while yawing at 60 degrees/s."""
    lidar = RAW_LIDARS[SensorClass.SCAN_1DEG]
    pattern = RayPattern(lidar, 0.1)
    vel, yaw_radps = (3.0, 1.0, 0.0), math.radians(60.0)
    state = AirframeState((0.0, 0.0, -4.0), vel, (0.0, 0.1, 0.4), (0.0, 0.0, yaw_radps), False, 0.4)
    trunks = [(6.0 * math.cos(0.7 * k), 6.0 * math.sin(0.7 * k)) for k in range(9)]
    standing = np.array([[n, e, 0.15, -50.0, 50.0, 0.0, 0.0] for n, e in trunks])
    ranges_m = cast(pattern.rays(state, 0.0), standing, [], (0.0, 0.0, 0.0), max_m=12.0, beam_deg=0.0)[0].tolist()

    def attitude_at(age_s: float) -> Vec3:
        return (0.0, 0.1, 0.4 - yaw_radps * age_s)

    seen = ObstacleMap()
    mapper = LidarMapper(seen, HoveringHulls())
    for k in range(4):
        age_s = 0.1 - 0.025 * k - 0.1 / 360
        piece = scan(
            tuple(ranges_m[90 * k : 90 * (k + 1)]),
            start_rad=math.radians(90.0 * k),
            step_rad=math.radians(1.0),
            age_s=age_s,
            ray_time_s=0.1 / 360,
            first_attitude_rad=attitude_at(age_s),
            last_attitude_rad=attitude_at(age_s - 89 * 0.1 / 360),
        )
        mapper.integrate_rays(piece, Position((0.0, 0.0, -4.0), vel), 10.0)
    placed = list(zip(*seen.find_near((0.0, 0.0, -4.0), 20.0), strict=True))
    off_m = [min(abs(math.dist(point, trunk) - 0.15) for trunk in trunks) for point in placed]
    assert {min(range(9), key=lambda k: math.dist(trunks[k], point)) for point in placed} == set(range(9))
    assert max(off_m) < 0.06  # a scan that is placed as one is 0.3 m off ahead, and 6 degrees at its begin


def test_what_is_above_or_below_the_band_is_in_no_map() -> None:
    low = Position((0.0, 0.0, -TRUNK_FROM_M - 1.0), ZERO)
    for elevation_deg, is_kept in ((0.0, True), (10.0, True), (13.0, False), (-10.0, True), (-13.0, False)):
        ray = one_ray(0.0, 5.0, elevation_rad=math.radians(elevation_deg))
        assert (abs(5.0 * math.sin(ray.elevation_rad)) <= BAND_M) is is_kept
        assert bool(points(mapped(ray, own=low), low)) is is_kept, elevation_deg


def test_what_is_hit_low_but_above_all_undergrowth_is_a_trunk() -> None:
    """One that leans ahead by 15 degrees sees nothing else of what it flies at (search, seeds 32030, 32048)."""
    for own_up_m, is_kept in ((TRUNK_FROM_M + 1.2, True), (TRUNK_FROM_M + 1.4, True), (TRUNK_FROM_M + 1.0, False)):
        own = Position((0.0, 0.0, -own_up_m), ZERO)
        ray = one_ray(0.0, 5.0, elevation_rad=math.radians(-13.0))  # 1.12 m lower
        assert bool(points(mapped(ray, own=own), own)) is is_kept


def test_what_may_be_the_ground_is_in_no_map() -> None:
    low = Position((0.0, 0.0, -1.5), ZERO)
    ray = one_ray(0.0, 5.0, elevation_rad=math.radians(-7.0))
    assert points(mapped(ray, own=low), low) == []
    assert points(mapped(ray)) != []


def test_a_hit_where_a_neighbour_is_reported_is_in_no_map_wherever_the_vehicle_was_when_it_was_measured() -> None:
    own = Position(HERE.pos_ned_m, (3.0, 0.0, 0.0))
    ray = one_ray(0.0, 6.4, age_s=0.2)  # from 0.6 m behind: 5.8 m ahead of where it is now
    ((ahead_m, _),) = points(mapped(ray, own=own), own)
    assert ahead_m == pytest.approx(5.8, abs=0.01)
    assert points(mapped(ray, own=own, ignore=((7.2, 0.0, 0.0),)), own) == []
    assert points(mapped(ray, own=own, ignore=((7.4, 0.0, 0.0),)), own) != []


def test_a_point_that_two_turns_see_through_is_gone_and_one_that_is_hit_stays() -> None:
    hit, free = one_ray(45.0, 5.0, turn=1), [one_ray(45.0, INF, turn=k) for k in range(2, 6)]
    assert len(mapped(hit, *free[:2])) == 1  # the second of them is not whole yet
    assert len(mapped(hit, *free[:3])) == 0
    assert len(mapped(hit, *[one_ray(45.0, 5.0, turn=k) for k in range(2, 6)])) == 1


@pytest.mark.parametrize("told_m", [math.nan, 3.0], ids=["not measured", "hidden"])
def test_a_point_that_is_not_seen_through_stays(told_m: float) -> None:
    turns = [one_ray(45.0, 5.0, turn=1)]
    for k in range(2, 8):
        ranges_m = [told_m if abs(at - 45) < 8 else INF for at in range(360)]
        turns.append(scan(tuple(ranges_m), turn=k))
    seen = mapped(*turns)
    assert any(math.hypot(n, e) == pytest.approx(5.0, abs=0.02) for n, e in points(seen))


def test_a_ray_that_leaves_the_band_before_a_point_has_not_seen_through_it() -> None:
    hit = one_ray(45.0, 8.0, turn=1)
    over = [scan((INF,) * 360, turn=k, elevation_rad=math.radians(10.0)) for k in range(2, 8)]
    assert len(mapped(hit, *over)) == 1


def test_a_layer_that_goes_on_above_a_low_thing_does_not_clear_what_another_layer_hits() -> None:
    pieces = []
    for turn in range(1, 8):
        pieces += [
            one_ray(45.0, 5.0, turn=turn, elevation_rad=math.radians(-7.0)),
            scan((INF,) * 360, turn=turn),
        ]
    assert len(mapped(*pieces)) == 1


def test_bearings_that_no_ray_measures_are_blind() -> None:
    half = scan(tuple(INF if k < 180 else math.nan for k in range(360)))
    blind = mapped(half).find_blind(10.0, fresh_s=0.3)
    assert not any(blind[:36])
    assert all(blind[38:71])
    assert all(mapped(half).find_blind(10.5, fresh_s=0.3))


def test_a_steep_layer_makes_no_bearing_seen() -> None:
    for deg, is_seen in ((29.0, True), (31.0, False), (-52.0, False)):
        blind = mapped(scan((INF,) * 360, elevation_rad=math.radians(deg))).find_blind(10.0, fresh_s=0.3)
        assert any(blind) is not is_seen, deg

    hit = one_ray(0.0, 1.0, elevation_rad=math.radians(40.0))
    assert all(mapped(hit).find_blind(10.0, fresh_s=0.3))
    assert len(mapped(hit)) == 1


def test_a_point_that_was_hit_in_a_turn_is_not_cleared_by_it() -> None:
    """Seen from the turn's middle it is in another bearing than from where it was hit, which is free."""
    fast = Position(HERE.pos_ned_m, (0.0, 6.0, 0.0))
    turns = [one_ray(359.0, 1.0 if turn == 1 else INF, turn=turn) for turn in range(1, 5)]
    assert len(mapped(*turns[:3], own=fast)) == 1  # one whole turn has passed it
    assert len(mapped(*turns, own=fast)) == 0


def test_a_point_beside_which_rays_are_stopped_is_not_cleared() -> None:
    beside = tuple(3.0 if k in (43, 47) else INF for k in range(360))
    seen = mapped(one_ray(45.0, 5.0, turn=1), *[scan(beside, turn=turn) for turn in range(2, 8)])
    assert max(math.hypot(n, e) for n, e in points(seen)) == pytest.approx(5.0, abs=0.02)


def test_a_point_behind_what_one_layer_hits_is_not_cleared_by_another_that_goes_on() -> None:
    pieces = [one_ray(45.0, 8.0, turn=1)]
    for turn in range(2, 8):
        low = one_ray(45.0, 5.0, turn=turn, elevation_rad=math.radians(-7.0))
        pieces += [low, scan((INF,) * 360, turn=turn)]
    assert len(mapped(*pieces)) == 2


def test_of_the_layers_in_a_bearing_the_flattest_says_how_rays_fall() -> None:
    seen = ObstacleMap()
    mapper = LidarMapper(seen, HoveringHulls())
    for deg in (9.0, 1.0, -7.0):
        mapper.integrate_rays(scan((INF,) * 360, elevation_rad=math.radians(deg)), HERE, 10.0)
    assert seen.ray_fall(0.5) == pytest.approx(-math.tan(math.radians(1.0)))
    leaning = [
        scan((INF,) * 360, turn=turn, first_attitude_rad=(0.0, pitch, 0.0)) for turn, pitch in ((1, 0.0), (2, -0.2))
    ]
    assert mapped(*leaning).ray_fall(0.0) == pytest.approx(math.tan(0.2), abs=1e-3)  # of the last turn


LEAN_RAD = math.radians(17.0)


def leaning_turn(turn: int, elevations_deg: tuple[float, ...], stem_m: float) -> list[LidarScan]:
    """One turn of a vehicle that leans forward by 17 degrees, 4 m up, with a trunk straight ahead."""
    lean, pieces = (0.0, -LEAN_RAD, 0.0), []
    for elevation_deg in elevations_deg:
        up_rad = math.radians(elevation_deg)
        range_m = stem_m / math.cos(up_rad - LEAN_RAD)
        piece = one_ray(0.0, range_m, turn=turn, elevation_rad=up_rad, first_attitude_rad=lean, last_attitude_rad=lean)
        pieces.append(piece)
    return pieces


@pytest.mark.parametrize(
    ("elevations_deg", "ahead_m"), [((0.0, 8.0, 17.0), 8.0), ((17.0, 0.0, 8.0), 8.0), ((0.0,), None)]
)
def test_the_level_scan_of_one_that_leans_has_the_flattest_ray_of_each_bearing(
    elevations_deg: tuple[float, ...], ahead_m: float | None
) -> None:
    """The layer that is level in the vehicle meets the trunk 2.4 m lower, where undergrowth is: not seen by it."""
    mapper, scans = LidarMapper(ObstacleMap(), HoveringHulls()), []
    for turn in range(1, 5):
        for piece in leaning_turn(turn, elevations_deg, 8.0):
            level = mapper.integrate_rays(piece, HERE, 10.0 + 0.1 * turn)
            if level is not None:
                scans.append(level)
    assert len(scans) >= 3
    for level in scans[1:]:
        assert level.is_whole
        assert len(level.ranges_m) == 360
        (ahead,) = [r for b, r in zip(level.bearings_rad, level.ranges_m, strict=True) if abs(b) < 1e-6]
        assert math.isnan(ahead) if ahead_m is None else ahead == pytest.approx(ahead_m, abs=0.01)


def test_bearings_that_no_layer_measured_are_none_of_the_level_scan() -> None:
    some = tuple(5.0 if k == 90 else math.nan if 100 <= k < 200 else INF for k in range(360))
    mapper, scans = LidarMapper(ObstacleMap(), HoveringHulls()), []
    for turn in range(1, 4):
        for deg in (0.0, 8.0):
            piece = scan(some, turn=turn, elevation_rad=math.radians(deg))
            level = mapper.integrate_rays(piece, HERE, 10.0 + 0.1 * turn)
            scans += [] if level is None else [level]
    last = scans[-1]
    assert last.is_whole
    assert [k for k, r in enumerate(last.ranges_m) if r != r] == list(range(100, 200))
    around = [math.remainder(b - a, math.tau) for a, b in zip(last.bearings_rad, last.bearings_rad[1:], strict=False)]
    assert around == pytest.approx([math.radians(1.0)] * 359, abs=1e-6)
    north_m, east_m, _ = HERE.pos_ned_m
    assert not last.sees_beyond(north_m, east_m + 6.0, 0.5)  # behind what is hit in the east
    assert last.sees_beyond(north_m + 6.0, east_m, 0.5)


@pytest.mark.parametrize(("missed_deg", "ahead_m"), [(0.0, math.nan), (8.0, INF)])
def test_where_the_flattest_ray_was_missed_no_steeper_one_says_that_the_way_is_free(
    missed_deg: float, ahead_m: float
) -> None:
    """It went over a hull, which one missed ray cut in two."""
    mapper, scans = LidarMapper(ObstacleMap(), HoveringHulls()), []
    for turn in range(1, 5):
        for deg in (0.0, 8.0):
            piece = one_ray(0.0, math.nan if deg == missed_deg else INF, turn=turn, elevation_rad=math.radians(deg))
            level = mapper.integrate_rays(piece, HERE, 10.0 + 0.1 * turn)
            scans += [] if level is None else [level]
    (ahead,) = [r for b, r in zip(scans[-1].bearings_rad, scans[-1].ranges_m, strict=True) if abs(b) < 1e-6]
    assert ahead == pytest.approx(ahead_m, nan_ok=True)


def test_points_are_forgotten_and_sensors_are_bounded() -> None:
    seen = ObstacleMap()
    mapper = LidarMapper(seen, HoveringHulls())
    mapper.integrate_rays(one_ray(0.0, 5.0), HERE, 10.0)
    mapper.integrate_rays(scan((math.nan,) * 359 + (INF,), turn=2), HERE, 10.1 + MEMORY_S)
    assert len(seen) == 0
    for sensor in range(2, 200):
        mapper.integrate_rays(scan((5.0,), sensor=sensor, turn=1), HERE, 20.0)
    assert len(mapper._turns) == SENSORS_MAX


def test_numbers_that_are_none_change_nothing() -> None:
    for spoilt in (
        one_ray(0.0, 5.0, first_attitude_rad=(math.nan, 0.0, 0.0)),
        one_ray(0.0, 5.0, start_rad=INF),
        one_ray(0.0, 5.0, age_s=math.nan),
    ):
        assert len(mapped(spoilt)) == 0
    assert len(mapped(one_ray(0.0, 5.0), own=Position((math.nan, 0.0, 0.0), ZERO))) == 0
