"""How long a vehicle flies by what its obstacle sensors told last."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import ObstacleScan
from companion.core.vehicle import failsafe
from companion.core.vehicle.autopilot_state import Vehicle
from companion.core.vehicle.failsafe import BLIND_LAND_S, Cause
from companion.core.vehicle.obstacle_sensor_monitor import NO_SCAN, SENSORS_MAX, Sight

STALE_S = 0.3
FRONT, REAR = 196, 197


def scan(sensor: int = FRONT, age_s: float = 0.0) -> ObstacleScan:
    return ObstacleScan(sensor, (5.0,), 0.0, 0.1, 0.2, 8.0, age_s=age_s)


def causes(sight: Sight, now_s: float, *, airborne: bool = True) -> list[Cause]:
    return [found.cause for found in sight.findings(now_s, airborne=airborne)]


def test_sight_is_as_old_as_the_sensor_that_was_heard_longest_ago() -> None:
    sight = Sight()
    assert sight.age_s(1.0) == math.inf
    sight.see(scan(FRONT, age_s=0.1), 10.0)
    sight.see(scan(REAR), 10.2)
    sight.see(scan(REAR), 11.0)
    assert sight.age_s(11.0) == pytest.approx(1.1)


def test_sensors_are_bounded() -> None:
    sight = Sight()
    for sensor in range(250):
        sight.see(scan(sensor), 10.0 + sensor)
    assert sight.age_s(10.0 + SENSORS_MAX) == SENSORS_MAX  # the first of them; those beyond do not count
    for sensor in range(SENSORS_MAX):
        sight.see(scan(sensor), 500.0)
    assert sight.age_s(500.0) == 0.0


def test_stale_scan_is_found_and_ends_with_the_next() -> None:
    sight = Sight(STALE_S)
    sight.see(scan(), 10.0)
    assert causes(sight, 10.29) == []
    assert causes(sight, 10.35) == [Cause.OBSTACLES_STALE]
    sight.see(scan(), 10.4)
    assert causes(sight, 10.4) == []


def test_scan_that_comes_old_is_stale_though_scans_come_as_often_as_ever() -> None:
    sight = Sight(STALE_S)
    sight.see(scan(age_s=0.5), 10.0)
    assert causes(sight, 10.0) == [Cause.OBSTACLES_STALE]


def test_vehicle_that_stays_blind_lands_but_not_on_the_ground() -> None:
    sight = Sight(STALE_S)
    assert causes(sight, 5.0) == [Cause.OBSTACLES_STALE]
    assert causes(sight, 5.0 + BLIND_LAND_S - 0.1) == [Cause.OBSTACLES_STALE]
    assert Cause.OBSTACLES_LOST in causes(sight, 5.0 + BLIND_LAND_S)
    assert Cause.OBSTACLES_LOST not in causes(sight, 5.0 + BLIND_LAND_S, airborne=False)


def test_each_blindness_counts_by_itself() -> None:
    sight = Sight(STALE_S)
    for k in range(10):
        sight.see(scan(), 20.0 * k)
        for tenth in range(200):
            assert Cause.OBSTACLES_LOST not in causes(sight, 20.0 * k + tenth / 10.0)


def test_vehicle_that_does_not_fly_by_sight_misses_nothing() -> None:
    sight = Sight()
    assert causes(sight, 1e6) == []
    assert sight.missing(1e6) == ""


def test_blind_vehicle_is_not_armed_and_rests_and_does_not_lead() -> None:
    vehicle = Vehicle(Sight(STALE_S))
    found = vehicle.findings(10.0)
    assert Cause.OBSTACLES_STALE in [one.cause for one in found]
    row = failsafe.row(Cause.OBSTACLES_STALE)
    assert row.response is failsafe.Response.REST
    assert row.resigns
    assert vehicle.sight.missing(10.0) == NO_SCAN
