"""SWARM_LIDAR_SCAN as drivers send it -> LidarScan: units, ages, how the vehicle stood, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.model.events import LidarScan
from companion.core.vehicle.obstacle_sensor_monitor import SENSORS_MAX
from companion.mavlink.lidar_scan import decode_lidar_scan
from companion.sensors.lidar_pieces import WAITING_MAX, LidarPieces
from companion.sensors.scans import ATTITUDE_FRESH_S
from tests.unit.sensors.lidar_kit import attitude, message

LASTS_S = 89 * 0.1 / 360
SENSOR = 196


def pieces_of(*told: tuple[Any, float], joined_s: float | None = None) -> tuple[list[LidarScan], LidarPieces]:
    """Messages with their arrivals; level attitudes 20 times a second meanwhile."""
    pieces = LidarPieces()
    ended_s = told[-1][1] if joined_s is None else joined_s
    for k in range(20):
        pieces.attitude(attitude(), ended_s + 0.05 * (k - 19))
    for m, at_s in told:
        pieces.piece(m, SENSOR, at_s)
    return pieces.join(ended_s), pieces


def test_a_piece_is_told_in_the_bodys_frame() -> None:
    ((found,), _) = pieces_of(
        (message(first_bearing_deg=270.0, bearing_step_deg=-0.5, elevation_deg=52.0, turn=7), 10.0)
    )
    assert (found.sensor, found.turn, found.min_m, found.max_m) == (SENSOR, 7, 0.2, 12.0)
    assert found.start_rad == pytest.approx(-math.pi / 2)
    assert found.step_rad == pytest.approx(-math.radians(0.5))
    assert found.elevation_rad == pytest.approx(math.radians(52.0))
    assert found.ranges_m == (3.0,) * 90


def test_what_was_not_measured_and_what_is_not_there_are_told_apart() -> None:
    told = message(ranges_mm=[0, 65535, 12_001, 12_000, 150, 200, 0, 0])
    ((found,), _) = pieces_of((told, 10.0))
    assert repr(found.ranges_m) == repr((math.nan, math.inf, math.inf, 12.0, 0.2, 0.2, math.nan, math.nan))


def test_zeros_at_the_end_are_no_rays_of_a_driver_that_does_not_mark_its_last_one() -> None:
    told = message(ranges_mm=[3000, 0, 3000, 0, 0])
    told.ranges_mm = [3000, 0, 3000, *[0] * 109]
    ((found,), _) = pieces_of((told, 10.0))
    assert repr(found.ranges_m) == repr((3.0, math.nan, 3.0))


def test_pieces_of_a_turn_that_come_together_are_as_old_as_they_were_measured_one_after_the_other() -> None:
    told = [
        (message(time_us=round((9.9 + 0.025 * k) * 1e6), first_bearing_deg=90.0 * k, turn=turn), 10.0 + 0.1 * turn)
        for turn in range(2)
        for k in range(4)
    ]
    for m, _ in told[4:]:
        m.time_usec += 100_000
    found, _ = pieces_of(*told)
    second = found[4:]
    ages_s = [one.age_s for one in second]  # the last ray of the last piece is the quickest: it has no age
    assert ages_s == pytest.approx([LASTS_S + 0.025 * k for k in (3, 2, 1, 0)], abs=1e-3)


def test_short_pieces_make_long_ones_no_older() -> None:
    short = message(time_us=9_990_000, ranges_mm=[3000] * 10)
    long = message(time_us=10_000_000)
    (_, found), _ = pieces_of((short, 9.99 + 9 * 0.1 / 360), (long, 10.0 + LASTS_S))
    assert found.age_s == pytest.approx(LASTS_S, abs=1e-3)


def test_a_backlog_shows_as_age_and_the_wait_for_the_tick_counts() -> None:
    told = [(message(time_us=9_000_000), 9.025), (message(time_us=9_100_000), 9.325)]
    (_, late), _ = pieces_of(*told, joined_s=9.35)
    assert late.age_s == pytest.approx(0.2 + LASTS_S + 0.025, abs=1e-3)


def test_a_piece_has_the_attitude_of_its_own_first_and_last_ray() -> None:
    pieces = LidarPieces()
    for k in range(10):
        pieces.attitude(attitude(0.1 * k, -0.05 * k, math.remainder(3.0 + 0.2 * k, math.tau)), 9.55 + 0.05 * k)
    pieces.piece(message(), SENSOR, 9.975)
    (found,) = pieces.join(10.0)
    began = (9.975 - LASTS_S - 9.55) / 0.05
    ended = (9.975 - 9.55) / 0.05
    for attitude_rad, at in ((found.first_attitude_rad, began), (found.last_attitude_rad, ended)):
        assert attitude_rad[0] == pytest.approx(0.1 * at, abs=1e-6)
        assert attitude_rad[1] == pytest.approx(-0.05 * at, abs=1e-6)
        assert math.remainder(attitude_rad[2] - 3.0 - 0.2 * at, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_without_a_fresh_attitude_pieces_are_dropped_and_counted() -> None:
    pieces = LidarPieces()
    pieces.attitude(attitude(), 10.0 - ATTITUDE_FRESH_S - LASTS_S - 0.01)
    pieces.piece(message(), SENSOR, 10.0)
    assert pieces.join(10.0) == []
    assert pieces.without_attitude == 1
    pieces.piece(message(), SENSOR, 10.0)
    pieces.attitude(attitude(), 10.05)  # comes after it, in the tick
    assert len(pieces.join(10.05)) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"ray_time_s": -0.001},
        {"ray_time_s": 0.11},
        {"ray_time_s": math.nan},
        {"first_bearing_deg": 361.0},
        {"bearing_step_deg": 0.0},
        {"bearing_step_deg": 31.0},
        {"bearing_step_deg": math.inf},
        {"elevation_deg": 91.0},
        {"elevation_deg": math.nan},
        {"max_m": 0.0},
        {"min_m": 13.0},
        {"ranges_mm": [0] * 90},
        {"bearing_step_deg": 4.1},  # 90 of them are more than a turn
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, Any]) -> None:
    assert decode_lidar_scan(message(**changes)) is None
    found, pieces = pieces_of((message(**changes), 10.0))
    assert (found, pieces.refused) == ([], 1)


def test_an_attitude_that_makes_no_sense_is_refused() -> None:
    pieces = LidarPieces()
    pieces.attitude(attitude(math.nan), 10.0)
    pieces.piece(message(), SENSOR, 10.0)
    assert pieces.join(10.0) == []
    assert (pieces.refused, pieces.without_attitude) == (1, 1)


def test_what_is_kept_is_bounded() -> None:
    pieces = LidarPieces()
    pieces.attitude(attitude(), 10.0)
    for k in range(WAITING_MAX + 100):
        pieces.piece(message(), k % (2 * SENSORS_MAX), 10.0)
    found = pieces.join(10.0)
    assert len(found) <= WAITING_MAX
    assert len({one.sensor for one in found}) == SENSORS_MAX
