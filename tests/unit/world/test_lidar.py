"""The simulated lidar: what it tells, when, how wrong, and as which message."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from companion.mavlink import dialect
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Sensing
from mission.stand.stand import Stand, StandTree
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import MOUNTED_UP_M, Lidar, Scan, obstacle_distance
from sim_bridge.world.sensors.scan import SECTORS
from sim_bridge.world.sensors.scene import Scene

EXACT = LidarErrors(noise_m=0.0, dropout=0.0)
AHEAD, RIGHT, BEHIND, LEFT = 0, 18, 36, 54


def state(
    north_m: float = 0.0,
    east_m: float = 0.0,
    up_m: float = 3.0,
    *,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
    yaw_rad: float = 0.0,
) -> AirframeState:
    return AirframeState(
        (north_m, east_m, -up_m), (0.0, 0.0, 0.0), (roll_rad, pitch_rad, yaw_rad), (0.0, 0.0, 0.0), False, 0.4
    )


def trunk(north_m: float, east_m: float, radius_m: float = 0.2, height_m: float = 20.0) -> StandTree:
    return StandTree(east_m, north_m, radius_m, height_m, height_m, radius_m)


def lidar(
    stand: Stand, *, errors: LidarErrors = EXACT, seed: int = 1, vehicle_id: int = 1, sensing: Sensing | None = None
) -> Lidar:
    sensing = sensing or Sensing()
    return Lidar(Scene(stand, sensing.range_m), sensing, errors, seed=seed, vehicle_id=vehicle_id)


def one_scan(
    stand: Stand,
    at: AirframeState | None = None,
    others: tuple[Vec3, ...] = (),
    *,
    errors: LidarErrors = EXACT,
    seed: int = 1,
    sensing: Sensing | None = None,
) -> Scan:
    scan = lidar(stand, errors=errors, seed=seed, sensing=sensing).scan(at or state(), others, 1.0)
    assert scan is not None
    return scan


def seen(scan: Scan) -> dict[int, float]:
    return {k: round(range_m, 3) for k, range_m in enumerate(scan.ranges_m) if math.isfinite(range_m)}


def test_a_trunk_is_seen_in_the_direction_where_it_stands_whatever_the_heading() -> None:
    stand = Stand([trunk(0.0, 5.0, 0.4)])  # east
    ahead = {71: 4.674, 0: 4.601, 1: 4.674}  # 9.2 degrees wide: rays 0.25 and 2.75 degrees off its axis
    assert seen(one_scan(stand)) == {(k + RIGHT) % SECTORS: range_m for k, range_m in ahead.items()}
    assert seen(one_scan(stand, state(yaw_rad=math.pi / 2))) == ahead
    assert min(seen(one_scan(stand, state(yaw_rad=math.pi))).items(), key=lambda item: item[1])[0] == LEFT


def test_nothing_is_seen_beyond_the_range() -> None:
    assert seen(one_scan(Stand([trunk(8.3, 0.0)]))) == {}
    assert one_scan(Stand([trunk(8.3, 0.0)])).ranges_m == (math.inf,) * SECTORS
    assert seen(one_scan(Stand([trunk(8.19, 0.0)]))) == {0: 7.993}


def test_no_trunk_of_ten_centimetres_is_missed_at_the_end_of_the_range() -> None:
    for k in range(400):
        turn = math.tau * k / 400
        assert seen(one_scan(Stand([trunk(8.0 * math.cos(turn), 8.0 * math.sin(turn), 0.05)])))


def test_what_stands_behind_a_trunk_is_hidden() -> None:
    near, far, beside = trunk(3.0, 0.0, 0.3), trunk(6.0, 0.0, 0.3), trunk(6.0, 0.9, 0.3)
    alone = seen(one_scan(Stand([near])))
    assert set(alone) == {71, 0, 1}
    assert seen(one_scan(Stand([near, far]))) == alone
    assert seen(one_scan(Stand([near, beside]))) == {**alone, 2: seen(one_scan(Stand([beside])))[2]}


def test_a_pitched_lidar_sees_the_ground_ahead_and_looks_over_what_is_behind() -> None:
    tilt = math.radians(30.0)
    at = state(pitch_rad=-tilt)
    height_m = 3.0 + MOUNTED_UP_M
    ranges_m = one_scan(Stand(), at).ranges_m
    assert ranges_m[AHEAD] == pytest.approx(height_m / math.sin(tilt), abs=0.01)
    assert math.isinf(ranges_m[BEHIND])
    assert math.isinf(ranges_m[RIGHT])
    low = Stand([trunk(5.0, 0.0, 0.2, height_m=1.2), trunk(-5.0, 0.0, 0.2, height_m=1.2)])
    assert AHEAD in seen(one_scan(low, at))
    assert BEHIND not in seen(one_scan(low, at))
    assert seen(one_scan(low)) == {}  # level, it looks over both


def test_uphill_a_level_lidar_sees_the_slope() -> None:
    height_m = 0.5 + MOUNTED_UP_M
    ranges_m = one_scan(Stand(grade=(0.0, 0.2)), state(up_m=0.5)).ranges_m
    assert ranges_m[AHEAD] == pytest.approx(height_m / 0.2, abs=0.02)
    assert math.isinf(ranges_m[BEHIND])


def test_a_bush_is_seen_from_below_its_top_alone() -> None:
    bush = StandTree(5.0, 0.0, 0.4, 1.0, 1.0, 0.4)
    stand = Stand(bushes=[bush])
    assert RIGHT in seen(one_scan(stand, state(up_m=0.5)))
    assert seen(one_scan(stand, state(up_m=2.0))) == {}


def test_a_crown_is_seen_at_its_height_and_the_trunk_below_it() -> None:
    tree = StandTree(0.0, 5.0, 0.2, 20.0, 8.0, 2.0)
    assert one_scan(Stand([tree]), state(up_m=3.0)).ranges_m[AHEAD] == pytest.approx(4.8, abs=0.01)
    assert one_scan(Stand([tree]), state(up_m=9.0)).ranges_m[AHEAD] == pytest.approx(3.0, abs=0.01)


def test_on_a_slope_a_crown_begins_above_the_ground_at_its_trunk() -> None:
    stand = Stand([StandTree(6.0, 0.0, 0.2, 20.0, 4.0, 2.0)], grade=(0.1, 0.0))  # from 4.6 m up, 0.6 of it ground
    assert min(seen(one_scan(stand, state(up_m=4.3 - MOUNTED_UP_M))).values()) == pytest.approx(5.8, abs=0.01)
    assert min(seen(one_scan(stand, state(up_m=4.9 - MOUNTED_UP_M))).values()) == pytest.approx(4.0, abs=0.01)


def test_a_crown_is_seen_whose_trunk_stands_beyond_the_range() -> None:
    stand = Stand([StandTree(0.0, -11.0, 0.2, 20.0, 3.0, 3.5)])  # south
    assert min(seen(one_scan(stand, state(up_m=5.0))).values()) == pytest.approx(7.5, abs=0.01)


def test_a_trunk_right_behind_is_seen_in_every_sector_that_it_is_in() -> None:
    for off in map(math.radians, (-4.0, -1.0, 0.0, 1.0, 4.0)):
        north_m, east_m = 5.0 * math.cos(off), 5.0 * math.sin(off)
        ahead, behind = (seen(one_scan(Stand([trunk(sign * north_m, sign * east_m, 0.4)]))) for sign in (1.0, -1.0))
        assert behind == {(sector + BEHIND) % SECTORS: range_m for sector, range_m in ahead.items()}


def test_other_vehicles_are_seen_as_bodies_at_their_height() -> None:
    level, above = (6.0, 0.0, -3.0), (0.0, 6.0, -5.0)
    assert set(seen(one_scan(Stand(), others=(level, above)))) == {71, 0, 1}
    assert seen(one_scan(Stand(), others=(level,)))[0] == pytest.approx(6.0 - 0.35, abs=0.01)


def test_a_lidar_that_has_fallen_on_its_side_measures_nothing() -> None:
    assert all(map(math.isnan, one_scan(Stand([trunk(3.0, 0.0)]), state(roll_rad=1.5)).ranges_m))


def test_outside_the_field_of_view_nothing_is_measured() -> None:
    ranges_m = one_scan(Stand(), sensing=Sensing(field_of_view_deg=90.0)).ranges_m
    assert [k for k, range_m in enumerate(ranges_m) if not math.isnan(range_m)] == [*range(10), *range(63, 72)]


def test_noise_and_dropouts_have_the_statistics_of_the_mission() -> None:
    ring = Stand([trunk(4.0 * math.cos(math.tau * k / 72), 4.0 * math.sin(math.tau * k / 72)) for k in range(72)])
    sensor = lidar(ring, errors=LidarErrors(noise_m=0.05, dropout=0.02))
    scans = [scan for k in range(300) if (scan := sensor.scan(state(), (), 0.1 * k)) is not None]
    told = np.array([scan.ranges_m for scan in scans])
    assert np.isnan(told).mean() == pytest.approx(0.02, abs=0.004)
    assert np.nanstd(told - 3.8) == pytest.approx(0.05, abs=0.002)
    assert np.nanmean(told) == pytest.approx(3.8, abs=0.005)


def test_the_same_seed_tells_the_same_and_every_vehicle_something_else() -> None:
    stand = Stand([trunk(3.0, 0.0), trunk(0.0, 4.0)])
    errors = LidarErrors()

    def flown(seed: int, vehicle_id: int) -> list[Scan | None]:
        sensor = lidar(stand, errors=errors, seed=seed, vehicle_id=vehicle_id)
        return [sensor.scan(state(), (), 0.05 * k) for k in range(40)]

    assert repr(flown(1, 1)) == repr(flown(1, 1))
    assert repr(flown(1, 1)) != repr(flown(2, 1))
    assert repr(flown(1, 1)) != repr(flown(1, 2))


def test_what_a_lidar_draws_does_not_depend_on_what_it_sees() -> None:
    trees = [trunk(3.0, 0.0), trunk(0.0, 4.0)]
    errors = LidarErrors(dropout=0.1)
    alone, among = (
        lidar(stand, errors=errors) for stand in (Stand(trees[:1]), Stand([*trees, trunk(-3.0, 0.0), trunk(0.0, -2.0)]))
    )
    for k in range(50):
        one, other = alone.scan(state(), (), 0.1 * k), among.scan(state(), (), 0.1 * k)
        if one is not None and other is not None:
            assert repr(one.ranges_m[AHEAD]) == repr(other.ranges_m[AHEAD])


def test_it_turns_ten_times_a_second_and_starts_at_a_time_of_its_own() -> None:
    first_s = set()
    for vehicle_id in range(1, 9):
        sensor = lidar(Stand(), vehicle_id=vehicle_id)
        told_s = [0.05 * k for k in range(200) if sensor.scan(state(), (), 0.05 * k) is not None]
        assert len(told_s) in (99, 100)
        assert all(0.05 < b - a < 0.15 for a, b in pairwise(told_s))
        first_s.add(told_s[0])
    assert len(first_s) > 1


def test_a_late_scan_is_told_late_and_says_when_it_was_taken() -> None:
    sensor = lidar(Stand(), errors=LidarErrors(noise_m=0.0, dropout=0.0, delay_s=0.2))
    told = [(0.05 * k, scan) for k in range(60) if (scan := sensor.scan(state(), (), 0.05 * k)) is not None]
    assert told
    assert all(at_s - scan.taken_s == pytest.approx(0.2) for at_s, scan in told)


def test_the_message_is_what_drivers_send() -> None:
    ranges_m = (0.4, math.inf, math.nan, *([8.0] * 69))
    message = obstacle_distance(Scan(12.3456, ranges_m, 0.2, 8.0), 12.3456)
    assert message.distances[:4] == [40, 801, 65535, 800]
    assert (message.min_distance, message.max_distance) == (20, 800)
    assert (message.increment, message.increment_f, message.angle_offset) == (5, pytest.approx(5.0), 0.0)
    assert message.frame == dialect.MAV_FRAME_BODY_FRD
    assert message.sensor_type == dialect.MAV_DISTANCE_SENSOR_LASER
    assert message.time_usec == 12_345_600
