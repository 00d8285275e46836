"""OBSTACLE_DISTANCE as drivers send it -> ObstacleScan: angles, units, what is unknown, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.model.events import ObstacleScan
from companion.mavlink import dialect
from companion.sensors.scans import ATTITUDE_FRESH_S, SENSORS_MAX, WAITING_MAX, Scans

UNKNOWN, FRD, GLOBAL, LOCAL_NED = 0xFFFF, 12, 0, 1
SENSOR = 196
NAN, INF = math.nan, math.inf


def attitude(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Any:
    return dialect.MAVLink_attitude_message(0, roll, pitch, yaw, 0.0, 0.0, 0.0)


def message(distances_cm: tuple[int, ...] = (500,), **changes: Any) -> Any:
    """A driver's, whose other sectors are unknown."""
    fields: dict[str, Any] = {
        "time_usec": 0,
        "sensor_type": 0,
        "distances": [*distances_cm, *[UNKNOWN] * (72 - len(distances_cm))],
        "increment": 5,
        "min_distance": 20,
        "max_distance": 800,
        "increment_f": 0.0,
        "angle_offset": 0.0,
        "frame": FRD,
    }
    return dialect.MAVLink_obstacle_distance_message(**fields | changes)


def scan_of(m: Any, *, told: Any = None) -> ObstacleScan | None:
    scans = Scans()
    scans.attitude(told or attitude(), 10.0)
    scans.scan(m, SENSOR, 10.0)
    found = scans.join(10.0)
    assert len(found) + scans.refused == 1
    return found[0] if found else None


def good(m: Any, *, told: Any = None) -> ObstacleScan:
    scan = scan_of(m, told=told)
    assert scan is not None
    return scan


def directions_deg(scan: ObstacleScan) -> list[float]:
    """In which each sector looks, where the vehicle stands level: from its nose, clockwise, 0..360."""
    return [round(math.degrees(scan.start_rad + k * scan.step_rad) % 360.0, 3) for k in range(len(scan.ranges_m))]


# --- distances ---


def test_distances_are_metres_within_the_sensors_limits() -> None:
    scan = good(message((20, 123, 800)))
    assert scan.ranges_m[:3] == (0.2, 1.23, 8.0)
    assert (scan.sensor, scan.min_m, scan.max_m) == (SENSOR, 0.2, 8.0)


def test_more_than_the_greatest_distance_is_nothing_there() -> None:
    assert good(message((801, 802, 65534))).ranges_m[:3] == (INF, INF, INF)


def test_what_is_too_near_to_be_measured_is_an_obstacle_at_the_least_distance() -> None:
    assert good(message((0, 1, 19))).ranges_m[:3] == (0.2, 0.2, 0.2)


def test_unknown_sectors_are_neither_free_nor_taken() -> None:
    scan = good(message((500, UNKNOWN, 500)))
    assert math.isnan(scan.ranges_m[1])
    assert all(math.isnan(range_m) for range_m in scan.ranges_m[3:])


def test_unknown_is_unknown_also_to_a_sensor_of_the_greatest_range() -> None:
    assert math.isnan(good(message((500, UNKNOWN), max_distance=65535)).ranges_m[1])


def test_scan_that_measured_nothing_is_none() -> None:
    assert scan_of(message(())) is None


# --- angles ---


def test_sectors_go_clockwise_from_ahead() -> None:
    scan = good(message((500,) * 72))
    assert directions_deg(scan) == [5.0 * k for k in range(72)]


def test_offset_turns_the_first_sector() -> None:
    assert directions_deg(good(message((500,) * 72, angle_offset=-180.0)))[:3] == [180.0, 185.0, 190.0]


def test_fine_increment_counts_before_the_whole_degrees() -> None:
    assert directions_deg(good(message((500,) * 72, increment=3, increment_f=2.5)))[:3] == [0.0, 2.5, 5.0]


def test_increment_of_zero_is_made_up_for_by_the_fine_one() -> None:
    assert directions_deg(good(message((500,) * 72, increment=0, increment_f=4.0)))[1] == 4.0


def test_counter_clockwise_sectors_are_turned_round() -> None:
    scan = good(message((100, 200, 300, 400), increment_f=-90.0))
    found = dict(zip(directions_deg(scan), scan.ranges_m, strict=True))
    assert found == {0.0: 1.0, 270.0: 2.0, 180.0: 3.0, 90.0: 4.0}
    assert scan.step_rad > 0.0


def test_sectors_beyond_a_full_turn_are_padding() -> None:
    scan = good(message((500,) * 36 + (0,) * 36, increment=10))
    assert scan.ranges_m == (5.0,) * 36


# --- frames ---


@pytest.mark.parametrize("frame", [GLOBAL, LOCAL_NED])
def test_sectors_from_north_are_turned_to_the_vehicles_nose(frame: int) -> None:
    """North-aligned is what a message without the extension is, too."""
    scan = good(message((500,) * 72, frame=frame), told=attitude(yaw=math.radians(90.0)))
    assert directions_deg(scan)[0] == 270.0  # it looks east; north is to its left
    assert scan.yaw_rad + scan.start_rad == pytest.approx(0.0)


def test_scan_has_the_attitude_that_was_told_last() -> None:
    scan = good(message(), told=attitude(0.1, -0.2, 3.0))
    assert (scan.roll_rad, scan.pitch_rad, scan.yaw_rad) == (0.1, -0.2, 3.0)


def test_scan_waits_for_the_attitude_of_its_tick() -> None:
    """A sensor's link is read before the autopilot's."""
    scans = Scans()
    scans.scan(message(), SENSOR, 10.0)
    scans.attitude(attitude(yaw=1.0), 10.0)
    (scan,) = scans.join(10.0)
    assert scan.yaw_rad == 1.0


@pytest.mark.parametrize("frame", [FRD, GLOBAL])
def test_scan_without_a_fresh_attitude_is_dropped(frame: int) -> None:
    scans = Scans()
    scans.attitude(attitude(), 10.0)
    scans.scan(message(frame=frame), SENSOR, 10.0 + ATTITUDE_FRESH_S + 0.01)
    assert scans.join(10.0 + ATTITUDE_FRESH_S + 0.01) == []
    assert (scans.without_attitude, scans.refused) == (1, 0)


# --- what makes no sense ---

HOSTILE = [
    {"increment": 0},
    {"increment_f": NAN},
    {"increment_f": INF},
    {"increment_f": 1e-30},
    {"increment_f": -361.0},
    {"angle_offset": NAN},
    {"angle_offset": -INF},
    {"angle_offset": 1e9},
    {"min_distance": 801},
    {"min_distance": 0, "max_distance": 0},
    {"frame": 3},
    {"frame": 255},
]


@pytest.mark.parametrize("changes", HOSTILE, ids=str)
def test_senseless_message_is_refused_and_counted(changes: dict[str, Any]) -> None:
    assert scan_of(message(**changes)) is None


@pytest.mark.parametrize("bad", [NAN, INF, 1e30])
def test_senseless_attitude_is_refused_and_the_last_one_kept(bad: float) -> None:
    for told in (attitude(roll=bad), attitude(pitch=bad), attitude(yaw=bad)):
        scans = Scans()
        scans.attitude(attitude(yaw=1.0), 10.0)
        scans.attitude(told, 10.0)
        scans.scan(message(), SENSOR, 10.0)
        assert [scan.yaw_rad for scan in scans.join(10.0)] == [1.0]
        assert scans.refused == 1


def test_sensors_and_scans_that_are_kept_are_bounded() -> None:
    scans = Scans()
    for k in range(1000):
        scans.scan(message(), k % 250 + 2, 10.0)
    scans.attitude(attitude(), 10.0)
    found = scans.join(10.0)
    assert len(found) == WAITING_MAX
    assert len({scan.sensor for scan in found}) == SENSORS_MAX


# --- age ---


def ages(times_us: list[int], arrivals_s: list[float]) -> list[float]:
    scans = Scans()
    found = []
    for time_us, now_s in zip(times_us, arrivals_s, strict=True):
        scans.attitude(attitude(), now_s)
        scans.scan(message(time_usec=time_us, increment_f=60.0), SENSOR, now_s)  # few sectors: quickly read
        (scan,) = scans.join(now_s)
        found.append(round(scan.age_s, 2))
    return found


EPOCH_US = 1_790_000_000_000_000


def test_backlog_on_its_way_makes_scans_old() -> None:
    at = [0.0, 0.1, 0.2, 0.3]
    assert ages([EPOCH_US + round(t * 1e6) for t in at], [5.0, 5.1, 5.7, 5.8]) == [0.0, 0.0, 0.5, 0.5]


def test_scan_that_is_sent_again_and_again_grows_old() -> None:
    assert ages([EPOCH_US] * 3, [5.0, 5.5, 6.0]) == [0.0, 0.5, 1.0]


def test_sensor_without_a_clock_has_scans_of_no_age() -> None:
    assert ages([0, 0, 0], [5.0, 5.5, 6.0]) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("jump_s", [-3600.0, -1.0, 0.5, 3600.0])
def test_sensors_clock_that_is_set_does_nothing(jump_s: float) -> None:
    at = [0.0, 0.1, 0.2 + jump_s, 0.3 + jump_s, 0.4 + jump_s]
    assert ages([EPOCH_US + round(t * 1e6) for t in at], [5.0, 5.1, 5.2, 5.3, 5.4]) == [0.0] * 5


def test_clocks_that_drift_apart_do_not_make_scans_old() -> None:
    at = [0.1 * k for k in range(20_000)]
    found = ages([EPOCH_US + round(t * 1e6 * (1 - 2e-4)) for t in at], at)
    assert max(found) <= 0.01
