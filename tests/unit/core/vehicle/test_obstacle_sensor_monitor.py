"""How long a vehicle flies by what its obstacle sensors told last."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import ObstacleScan
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.autopilot_state import Vehicle
from companion.core.vehicle.failsafe import Cause, Readings, Response, Source
from companion.core.vehicle.obstacle_sensor_monitor import (
    ESTABLISHED_SCANS,
    NO_SCAN,
    SENSORS_MAX,
    ObstacleSensorMonitor,
)
from tests.unit.sensors import lidar_kit

BLIND_LAND_S = 60.0
STALE_S = 0.3
FRONT, REAR = 196, 197


def scan(sensor: int = FRONT, age_s: float = 0.0) -> ObstacleScan:
    return ObstacleScan(sensor, (5.0,), 0.0, 0.1, 0.2, 8.0, age_s=age_s)


def causes(monitor: ObstacleSensorMonitor, now_s: float, *, airborne: bool = True) -> list[Cause]:
    monitor.update(now_s)
    readings = Readings(no_scan=monitor.no_scan, no_scan_s=monitor.no_scan_s, airborne=airborne)
    return [found.cause for found in failsafe_engine.detect(Source.AUTOPILOT, readings)]


def establish(monitor: ObstacleSensorMonitor, *sensors: int, until_s: float) -> None:
    """Their scans ten times a second, the last at `until_s`."""
    for k in reversed(range(ESTABLISHED_SCANS)):
        for sensor in sensors:
            monitor.record_scan(scan(sensor), until_s - 0.1 * k)


@pytest.mark.parametrize("count", [1, ESTABLISHED_SCANS])
def test_sight_is_as_old_as_the_sensor_that_was_heard_longest_ago(count: int) -> None:
    monitor = ObstacleSensorMonitor()
    assert monitor.age_s(1.0) == math.inf
    for _ in range(count):
        monitor.record_scan(scan(FRONT, age_s=0.1), 10.0)
        monitor.record_scan(scan(REAR), 10.2)
    monitor.record_scan(scan(REAR), 11.0)
    assert monitor.age_s(11.0) == pytest.approx(1.1)


def test_pieces_of_one_turn_are_one_scan_and_a_lidar_counts_by_its_turns() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    establish(monitor, FRONT, until_s=10.0)
    for turn in range(ESTABLISHED_SCANS - 1):
        for _ in range(8):
            monitor.record_scan(lidar_kit.scan((5.0,), sensor=REAR, turn=turn, age_s=0.0), 9.6 + 0.1 * turn)
    monitor.record_scan(scan(FRONT), 11.0)
    assert monitor.age_s(11.0) == 0.0  # the lidar is not missed
    for turn in range(ESTABLISHED_SCANS):
        monitor.record_scan(lidar_kit.scan((5.0,), sensor=REAR, turn=turn, age_s=0.0), 11.0 + 0.1 * turn)
    monitor.record_scan(scan(FRONT), 12.0)
    assert monitor.age_s(12.0) == pytest.approx(0.6)


@pytest.mark.parametrize("before", [False, True])
def test_a_component_that_sends_a_few_scans_is_no_sensor_that_is_missed(before: bool) -> None:
    """As when another program tries a message out: the vehicle would come to rest, and land a minute later."""
    monitor = ObstacleSensorMonitor(STALE_S)
    for _ in range(ESTABLISHED_SCANS - 1):
        monitor.record_scan(scan(REAR), 9.0 if before else 10.0)
    establish(monitor, FRONT, until_s=10.0)
    monitor.record_scan(scan(FRONT), 10.5)
    assert causes(monitor, 10.6) == []
    for minute in range(ESTABLISHED_SCANS):
        monitor.record_scan(scan(REAR), 20.0 + 60.0 * minute)
    monitor.record_scan(scan(FRONT), 300.0)
    assert causes(monitor, 300.1) == []


def test_an_established_sensor_is_missed() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    establish(monitor, FRONT, REAR, until_s=10.0)
    monitor.record_scan(scan(FRONT), 10.5)
    assert causes(monitor, 10.6) == [Cause.OBSTACLES_STALE]


def test_sensors_are_bounded_and_strays_take_no_ones_place() -> None:
    monitor = ObstacleSensorMonitor()
    for sensor in range(250):
        monitor.record_scan(scan(sensor), 10.0)
    establish(monitor, *range(100, 100 + 2 * SENSORS_MAX), until_s=100.0)
    assert monitor.age_s(100.0) == 0.0
    establish(monitor, *range(100, 100 + SENSORS_MAX), until_s=500.0)
    assert monitor.age_s(500.0) == 0.0  # those beyond do not count


def test_stale_scan_is_found_and_ends_with_the_next() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    monitor.record_scan(scan(), 10.0)
    assert causes(monitor, 10.29) == []
    assert causes(monitor, 10.35) == [Cause.OBSTACLES_STALE]
    monitor.record_scan(scan(), 10.4)
    assert causes(monitor, 10.4) == []


def test_scan_that_comes_old_is_stale_though_scans_come_as_often_as_ever() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    monitor.record_scan(scan(age_s=0.5), 10.0)
    assert causes(monitor, 10.0) == [Cause.OBSTACLES_STALE]


def test_vehicle_that_stays_blind_lands_but_not_on_the_ground() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    assert causes(monitor, 5.0) == [Cause.OBSTACLES_STALE]
    assert causes(monitor, 5.0 + BLIND_LAND_S - 0.1) == [Cause.OBSTACLES_STALE]
    assert Cause.OBSTACLES_LOST in causes(monitor, 5.0 + BLIND_LAND_S)
    assert Cause.OBSTACLES_LOST not in causes(monitor, 5.0 + BLIND_LAND_S, airborne=False)


def test_each_blindness_counts_by_itself() -> None:
    monitor = ObstacleSensorMonitor(STALE_S)
    for k in range(10):
        monitor.record_scan(scan(), 20.0 * k)
        for tenth in range(200):
            assert Cause.OBSTACLES_LOST not in causes(monitor, 20.0 * k + tenth / 10.0)


def test_vehicle_that_does_not_fly_by_sight_misses_nothing() -> None:
    monitor = ObstacleSensorMonitor()
    assert causes(monitor, 1e6) == []
    assert monitor.missing(1e6) == ""


def test_blind_vehicle_is_not_armed_and_rests_and_does_not_lead() -> None:
    vehicle = Vehicle(ObstacleSensorMonitor(STALE_S))
    found = vehicle.findings(10.0)
    assert Cause.OBSTACLES_STALE in [one.cause for one in found]
    row = failsafe_engine.row(Cause.OBSTACLES_STALE)
    assert row.response is Response.REST
    assert row.resigns
    assert vehicle.sensors.missing(10.0) == NO_SCAN
