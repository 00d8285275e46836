"""RPLIDAR's standard scan: samples, answers, the start, and finding back into step."""

from __future__ import annotations

import pytest

from companion.lidar import rplidar
from companion.lidar.rplidar import LOCK_SAMPLES, RpLidar
from tests.unit.lidar.lidar_kit import (
    RPLIDAR_FAILED,
    RPLIDAR_HEALTHY,
    RPLIDAR_INFO,
    RPLIDAR_SCANNING,
    everywhere,
    post,
    rplidar_revolution,
    rplidar_sample,
)


def test_samples_are_clockwise_azimuth_range_and_the_start_of_a_revolution() -> None:
    data = rplidar_sample(0.0, 2.5, starts=True) + rplidar_sample(90.5, 0.0) + rplidar_sample(359.0, 11.25)
    assert list(RpLidar().decode(RPLIDAR_SCANNING + data)) == [
        (0, 2.5, 0.0, True),
        (9050, 0.0, 0.0, False),
        (35900, 11.25, 0.0, False),
    ]


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64])
def test_bytes_may_break_anywhere(size: int) -> None:
    data = RPLIDAR_INFO + RPLIDAR_HEALTHY + RPLIDAR_SCANNING + rplidar_revolution(post(90.0, 3.0, 8.0))
    whole, pieces = RpLidar(), RpLidar()
    expected = list(whole.decode(data))
    found = [one for at in range(0, len(data), size) for one in pieces.decode(data[at : at + size])]
    assert (found, pieces.notes, pieces.bad) == (expected, whole.notes, 0)
    assert len(found) == 360


def test_it_says_what_it_is_and_how_it_is() -> None:
    lidar = RpLidar()
    assert not list(lidar.decode(RPLIDAR_INFO + RPLIDAR_HEALTHY))
    assert lidar.notes == [
        f"RPLIDAR model 1.8, firmware 1.29, hardware 7, serial number {bytes(range(16)).hex()}",
        "RPLIDAR health: good, error code 0",
    ]


def test_a_lost_byte_costs_a_few_samples_and_the_one_that_it_was_in() -> None:
    data = rplidar_revolution(everywhere(4.0))
    lidar = RpLidar()
    found = list(lidar.decode(RPLIDAR_SCANNING + data[:502] + data[503:] + data))
    assert 0 < lidar.bad < 10
    assert {range_m for _, range_m, _, _ in found[:100]} == {4.0}
    assert len(found) >= 720 - 2
    assert sum(range_m != 4.0 for _, range_m, _, _ in found) <= 1


def test_a_scan_that_runs_already_is_joined_in_the_middle_of_a_sample() -> None:
    data = rplidar_revolution(everywhere(4.0))
    found = list(RpLidar().decode(data[3:]))
    assert len(found) == 359
    assert all(range_m == 4.0 for _, range_m, _, _ in found)


def test_fewer_samples_in_a_row_than_chance_makes_are_not_believed() -> None:
    sample = rplidar_sample(10.0, 1.0)
    assert not list(RpLidar().decode(sample * (LOCK_SAMPLES - 1) + b"\0" * 60))
    assert len(list(RpLidar().decode(sample * LOCK_SAMPLES))) == LOCK_SAMPLES


@pytest.mark.parametrize(
    ("at", "wrong"),
    [(0, 0x3C), (0, 0x3F), (1, 0x00), (2, 0xFF)],  # no start flag, both, no check bit, an angle beyond a turn
)
def test_a_sample_that_contradicts_itself_is_none(at: int, wrong: int) -> None:
    good = rplidar_sample(10.0, 1.0)
    bad = good[:at] + bytes([wrong]) + good[at + 1 :]
    lidar = RpLidar()
    assert list(lidar.decode(RPLIDAR_SCANNING + good + bad)) == [(1000, 1.0, 0.0, False)]
    assert list(lidar.decode(RPLIDAR_SCANNING + good * LOCK_SAMPLES)) == [(1000, 1.0, 0.0, False)] * LOCK_SAMPLES
    assert lidar.bad == len(bad)


def test_bytes_of_garbage_are_counted() -> None:
    lidar = RpLidar()
    assert not list(lidar.decode(b"\x00" * 500))
    assert lidar.bad + len(lidar._buffer) == 500
    assert len(lidar._buffer) < 40


def test_it_is_started_and_left_alone_while_it_measures() -> None:
    lidar = RpLidar()
    times = [k * 0.01 for k in range(100)]
    sent = [request for now_s in times if (request := lidar.poll(now_s))]
    assert sent == [rplidar.STOP, rplidar.GET_INFO, rplidar.GET_HEALTH, rplidar.SET_PWM, rplidar.SCAN]
    list(lidar.decode(RPLIDAR_SCANNING + rplidar_sample(1.0, 1.0)))
    assert lidar.poll(4.0) == b""
    assert lidar.poll(4.0 + rplidar.SILENT_S - 0.1) == b""
    assert lidar.poll(4.0 + rplidar.SILENT_S) == rplidar.STOP  # silent since: again from the beginning


def test_a_failed_one_is_reset_before_it_is_started_again() -> None:
    lidar = RpLidar()
    assert lidar.poll(0.0) == rplidar.STOP
    list(lidar.decode(RPLIDAR_FAILED))
    assert lidar.notes == ["RPLIDAR health: failed, error code 4660"]
    assert lidar.poll(0.1) == rplidar.RESET
    assert lidar.poll(0.1 + rplidar.RESET_S - 0.1) == b""
    assert lidar.poll(0.1 + rplidar.RESET_S) == rplidar.STOP


def test_requests_are_the_protocols() -> None:
    assert rplidar.SET_PWM.hex() == "a5f0029402c1"  # 660, and the XOR of all before
    assert RpLidar().shutdown().hex() == "a525a5f002000057"
