"""A companion's third link: from which sensors it takes scans, by which ways, and what it asks for to place them."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega, common

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.streams import STREAMS_RETRY_S
from companion.sensors.table import sensors_of
from tests.unit.core.core_kit import mission

ME, OTHER = 3, 4
AUTOPILOT, AVOIDANCE, COMPUTER = 1, 196, 191
ATTITUDE = dialect.MAVLINK_MSG_ID_ATTITUDE


def endpoint(*, sensing: bool = True, **changes: Any) -> Endpoint:
    flown = mission(sensing={}) if sensing else mission()
    return Endpoint(flown, ME, sensors=sensors_of(flown), **changes)


def from_driver(system: int = ME, component: int = AVOIDANCE, cm: int = 300) -> bytes:
    """As a driver that knows nothing of this project sends it: pymavlink's common dialect, MAVLink 2."""
    driver = common.MAVLink(None, srcSystem=system, srcComponent=component)
    frame: bytes = driver.obstacle_distance_encode(
        time_usec=0,
        sensor_type=common.MAV_DISTANCE_SENSOR_LASER,
        distances=[cm] * 72,
        increment=5,
        min_distance=20,
        max_distance=800,
        increment_f=0.0,
        angle_offset=-180.0,
        frame=common.MAV_FRAME_BODY_FRD,
    ).pack(driver)
    return frame


def attitude(yaw: float = 0.0) -> bytes:
    autopilot = ardupilotmega.MAVLink(None, srcSystem=ME, srcComponent=AUTOPILOT)
    frame: bytes = autopilot.attitude_encode(1000, 0.0, 0.0, yaw, 0.0, 0.0, 0.0).pack(autopilot)
    return frame


def age_s(one: Endpoint, now_s: float) -> float:
    one.from_autopilot(attitude(), now_s)
    one.tick(now_s)
    return one.agent.sensors.age_s(now_s)


def test_scan_of_the_sensors_link_reaches_the_agent() -> None:
    one = endpoint()
    one.from_sensor(from_driver(), 10.0)
    assert age_s(one, 10.0) == 0.0
    assert age_s(one, 10.5) == 0.5


def test_scan_may_come_by_way_of_the_autopilot_or_from_the_autopilot_itself() -> None:
    for component in (AVOIDANCE, AUTOPILOT):
        one = endpoint()
        one.from_autopilot(from_driver(component=component), 10.0)
        assert age_s(one, 10.0) == 0.0


def test_scan_that_comes_by_both_ways_counts_once_by_its_own_link() -> None:
    """What an autopilot passes on, or puts together, is late; it may be an older scan than the last."""
    one = endpoint()
    one.from_sensor(from_driver(), 10.0)
    for component in (AVOIDANCE, AUTOPILOT):
        one.from_autopilot(from_driver(component=component), 10.3)
    assert age_s(one, 10.3) == pytest.approx(0.3)
    other = endpoint()
    other.from_sensor(from_driver(OTHER), 10.0)  # not this vehicle's: its own may come by way of the autopilot
    other.from_autopilot(from_driver(), 10.3)
    assert age_s(other, 10.3) == 0.0


def test_any_component_of_this_vehicle_may_be_its_sensor_but_the_autopilot() -> None:
    for component in (2, 93, 158, COMPUTER, 195, AVOIDANCE, 197, 240):
        one = endpoint()
        one.from_sensor(from_driver(component=component), 10.0)
        assert age_s(one, 10.0) == 0.0
    one = endpoint()
    one.from_sensor(from_driver(component=AUTOPILOT), 10.0)
    assert age_s(one, 10.0) == math.inf


def test_another_vehicles_scan_is_refused_and_its_system_named() -> None:
    one = endpoint()
    one.from_sensor(from_driver(OTHER), 10.0)
    one.from_autopilot(from_driver(7), 10.0)
    assert age_s(one, 10.0) == math.inf
    assert one.sensors.foreign("obstacles") == {OTHER, 7}


def test_systems_that_are_remembered_to_be_named_are_bounded() -> None:
    one = endpoint()
    for system in range(10, 250):
        one.from_sensor(from_driver(system), 10.0)
    assert len(one.sensors.foreign("obstacles")) == 16


def test_serial_sensors_frames_may_break_anywhere() -> None:
    one = endpoint(sensor_streams={"obstacles": True})
    data = from_driver()
    for at in range(0, len(data), 7):
        one.from_sensor(data[at : at + 7], 10.0, "obstacles")
    assert age_s(one, 10.0) == 0.0


def test_attitude_is_asked_for_only_where_the_mission_has_sensing() -> None:
    for sensing in (True, False):
        asked = ardupilotmega.MAVLink(None).parse_buffer(endpoint(sensing=sensing).tick(10.0).autopilot)
        rates_us = {m.param1: m.param2 for m in asked if m.get_type() == "COMMAND_LONG" and m.command == 511}
        assert rates_us.get(ATTITUDE) == (50_000.0 if sensing else None)


def test_attitude_that_has_stopped_is_asked_for_again() -> None:
    one = endpoint()
    one.tick(10.0)
    one.from_autopilot(attitude(), 10.1)
    again = ardupilotmega.MAVLink(None).parse_buffer(one.tick(10.2 + STREAMS_RETRY_S).autopilot)
    assert ATTITUDE in {m.param1 for m in again if m.get_type() == "COMMAND_LONG" and m.command == 511}


def test_without_sensing_nothing_of_a_sensor_is_heard() -> None:
    one = endpoint(sensing=False)
    one.from_sensor(from_driver(), 10.0)
    one.from_autopilot(from_driver() + attitude(), 10.0)
    one.tick(10.0)
    assert one.agent.sensors.age_s(10.0) == math.inf
    assert not one.sensors.sources
