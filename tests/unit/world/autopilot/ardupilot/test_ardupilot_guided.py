"""ArduCopter's GUIDED, failsafes, commands and parameters. Figures: its recorded flights."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import (
    ArduCopterAutopilot,
    Failsafe,
    LandedState,
    Link,
    ParameterError,
    StreamProfile,
)
from tests.unit.world.autopilot.ardupilot.ardupilot_kit import (
    ACCEPTED,
    ARM,
    BRAKE,
    DENIED,
    FAILED,
    FORCE,
    REPOSITION,
    REQUEST,
    SET_INTERVAL,
    SET_MODE,
    TAKEOFF,
    UNSUPPORTED,
    Flight,
    velocity,
)
from tests.unit.world.autopilot.autopilot_kit import NAN, ORIGIN, long


def heartbeat(kind: int = 6) -> Any:
    return mav.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)


def speed(velocity_ned_mps: Vec3) -> float:
    return math.hypot(*velocity_ned_mps)


# Setpoints


@pytest.mark.parametrize("mask", [0x5C7, 0xDC7, 0x9C7])
def test_velocity_masks_work_in_guided(mask: int) -> None:
    flight = Flight().airborne()
    flight.run(5.0, velocity(0.4, 0.4, -0.4, mask))
    assert flight.body.state.vel_ned_mps == pytest.approx((0.4, 0.4, -0.4), abs=0.02)


def test_mavproxys_velocity_is_along_the_heading() -> None:
    """Its `velocity` sends MAV_FRAME_BODY_NED."""
    flight = Flight().airborne()
    turned = velocity(mask=0x9C7)
    turned.yaw = math.radians(90.0)
    flight.run(4.0, turned)
    ahead = velocity(1.0, 0.0, 0.0, mask=4039)
    ahead.coordinate_frame = 8
    flight.run(4.0, ahead)
    assert flight.body.state.vel_ned_mps == pytest.approx((0.0, 1.0, 0.0), abs=0.05)


def test_setpoints_outside_guided_are_ignored() -> None:
    flight = Flight().airborne()
    flight.command(SET_MODE, 1.0, BRAKE)
    flight.run(3.0, velocity(2.0))
    assert speed(flight.body.state.vel_ned_mps) < 0.05


def test_a_setpoint_on_the_ground_does_not_lift_it() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    flight.run(5.0, velocity(0.0, 0.0, -1.0))
    assert flight.height_m == 0.0


def test_a_setpoint_ends_a_takeoff() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 20.0)
    flight.run(6.0)
    assert flight.height_m > 0.5
    flight.run(5.0, velocity())
    assert flight.height_m < 15.0
    assert flight.autopilot.snapshot.landed is LandedState.IN_AIR


def test_without_setpoints_it_flies_on_for_3_s_stops_and_hovers_in_guided() -> None:
    flight = Flight().airborne()
    flight.run(5.0, velocity(0.7))
    flight.run(2.8)
    assert flight.body.state.vel_ned_mps[0] == pytest.approx(0.7, abs=0.02)
    flight.run(1.5)
    assert speed(flight.body.state.vel_ned_mps) < 0.1
    assert flight.mode == "GUIDED"
    assert flight.autopilot.snapshot.failsafe is None
    flight.run(3.0, velocity(0.7))
    assert flight.body.state.vel_ned_mps[0] == pytest.approx(0.7, abs=0.02)


def test_guid_timeout_is_a_parameter() -> None:
    flight = Flight({"GUID_TIMEOUT": 0.5}).airborne()
    flight.run(5.0, velocity(0.7))
    flight.run(2.0)
    assert speed(flight.body.state.vel_ned_mps) < 0.1


def test_once_stopped_without_setpoints_it_holds_its_place() -> None:
    """As ArduCopter with GUID_OPTIONS 0: a velocity held at 0, and known to 0.03 m/s, drifts (search, seed 9900)."""
    flight = Flight({"GUID_TIMEOUT": 0.5}).airborne()
    flight.run(5.0, velocity(0.7))
    flight.run(3.0)
    north, east, down = flight.body.state.pos_ned_m
    moved = AirframeState((north + 1.0, east - 1.0, down), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, False, 0.4)
    flight.body._state = moved
    flight.run(8.0)
    assert flight.body.state.pos_ned_m == pytest.approx((north, east, down), abs=0.1)
    flight.run(3.0, velocity(0.7))
    assert flight.body.state.vel_ned_mps[0] == pytest.approx(0.7, abs=0.02)


@pytest.mark.parametrize("value", [NAN, math.inf])
def test_setpoints_that_are_not_finite_are_dropped(value: float) -> None:
    flight = Flight().airborne()
    flight.run(1.0, velocity(value))
    assert speed(flight.body.state.vel_ned_mps) < 0.1
    assert flight.autopilot.snapshot.setpoints_rejected == 20


# The ground station's failsafe


def test_a_silent_ground_station_means_rtl_and_its_return_does_not_end_it() -> None:
    flight = Flight({"FS_GCS_ENABLE": 1}).airborne()
    flight.send(heartbeat(), Link.GROUND)
    flight.run(4.8)
    assert flight.mode == "GUIDED"
    flight.run(0.4)
    assert flight.mode == "RTL"
    assert flight.texts()[-1] == "GCS Failsafe"
    assert flight.last("HEARTBEAT").system_status == mav.MAV_STATE_CRITICAL
    assert flight.autopilot.snapshot.failsafe is Failsafe.GCS_LOSS
    flight.send(heartbeat(), Link.GROUND)
    flight.run(1.1)
    assert flight.texts()[-1] == "GCS Failsafe Cleared"
    assert flight.mode == "RTL"
    assert flight.last("HEARTBEAT").system_status == mav.MAV_STATE_ACTIVE


def test_only_mav_gcs_sysid_counts_as_ground_station() -> None:
    flight = Flight({"FS_GCS_ENABLE": 1}).airborne()
    flight.send(heartbeat(), Link.ONBOARD)  # 245
    flight.run(10.0)
    assert flight.mode == "GUIDED"


def test_without_fs_gcs_enable_nothing_happens() -> None:
    flight = Flight().airborne()
    flight.send(heartbeat(), Link.GROUND)
    flight.run(10.0)
    assert flight.mode == "GUIDED"


# Batteries


def test_an_empty_battery_lands_where_it_is_told_to() -> None:
    flight = Flight({"BATT_FS_CRT_ACT": 1, "BATT_CRT_MAH": 3290.0}).ready()
    flight.command(ARM, 1.0, FORCE)
    flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0)
    flight.run(40.0)
    assert flight.mode == "LAND"
    assert any(text.startswith("Battery 1 is critical") for text in flight.texts())


# Commands


@pytest.mark.parametrize(
    ("number", "params", "result"),
    [
        (31999, (), UNSUPPORTED),  # these as recorded
        (SET_MODE, (1.0, 99.0), FAILED),
        (SET_MODE, (129.0, 4.0), ACCEPTED),
        (SET_INTERVAL, (32.0, 20000.0), ACCEPTED),
        (SET_INTERVAL, (62.0, 500000.0), ACCEPTED),
        (SET_INTERVAL, (65.0, 1000000.0), ACCEPTED),
        (SET_INTERVAL, (111.0, -1.0), DENIED),
        (SET_INTERVAL, (9999.0, 100000.0), DENIED),
        (510, (32.0,), ACCEPTED),
        (REQUEST, (148.0,), ACCEPTED),
        (REQUEST, (9999.0,), FAILED),
        (SET_MODE, (0.0, 4.0), DENIED),
        (SET_MODE, (1.0, NAN), DENIED),
        (ARM, (2.0,), UNSUPPORTED),
        (ARM, (NAN,), UNSUPPORTED),
        (TAKEOFF, (0, 0, 0, 0, 0, 0, NAN), FAILED),
        (REPOSITION, (-1.0, 1.0, 0.0, NAN, NAN, NAN, NAN), DENIED),
        (178, (1.0, 3.0), ACCEPTED),
        (178, (1.0, math.inf), FAILED),
        (179, (1.0,), ACCEPTED),
        (179, (0.0, 0.0, 0.0, 0.0, 200.0, 8.5, 490.0), DENIED),
        (410, (), ACCEPTED),
        (401, (), ACCEPTED),
        (520, (1.0,), ACCEPTED),
        (SET_INTERVAL, (math.inf, 1.0), FAILED),
    ],
)
def test_results_on_the_ground(number: int, params: tuple[float, ...], result: int) -> None:
    assert Flight().ready().command(number, *params) == result


def test_what_is_refused_is_said() -> None:
    flight = Flight().ready()
    flight.command(SET_MODE, 1.0, 99.0)
    assert flight.texts()[-1] == "No such mode 99"
    flight.command(SET_INTERVAL, 111.0, -1.0)
    assert flight.texts()[-1] == "No ap_message for mavlink id (111)"


def test_a_command_to_another_system_is_not_acknowledged() -> None:
    assert Flight().ask(long(ARM, 1.0, system=2)) == []


def test_the_acknowledgement_comes_before_a_message_asked_for() -> None:
    kinds = [m.get_type() for m in Flight().ready().ask(long(REQUEST, 148.0))]
    assert kinds == ["COMMAND_ACK", "AUTOPILOT_VERSION"]


def test_autopilot_version_is_arducopters() -> None:
    version = Flight().ready().ask(long(REQUEST, 148.0))[1]
    assert (version.capabilities, version.flight_sw_version) == (64495 - 32, 67567616)


def test_texts_reach_both_links() -> None:
    flight = Flight().run(3.0)
    assert "ArduPilot Ready" in flight.texts(Link.ONBOARD)
    assert "ArduPilot Ready" in flight.texts(Link.GROUND)


def test_mavproxys_data_streams() -> None:
    flight = Flight().run(42.0)
    flight.send(mav.MAVLink_request_data_stream_message(1, 1, 0, 4, 1), Link.GROUND)
    flight.heard[Link.GROUND].clear()
    flight.run(5.0)
    kinds = {m.get_type() for _, m in flight.heard[Link.GROUND]}
    assert {"ATTITUDE", "GLOBAL_POSITION_INT", "SYS_STATUS", "VFR_HUD", "EKF_STATUS_REPORT"} <= kinds
    assert len(flight.all("ATTITUDE", Link.GROUND)) == pytest.approx(20, abs=1)
    flight.send(mav.MAVLink_request_data_stream_message(1, 1, 0, 4, 0), Link.GROUND)
    flight.heard[Link.GROUND].clear()
    flight.run(5.0)
    assert {m.get_type() for _, m in flight.heard[Link.GROUND]} <= {"HEARTBEAT", "TIMESYNC", "STATUSTEXT"}


# Parameters


def test_parameters_travel_by_value() -> None:
    flight = Flight()
    (asked,) = flight.ask(mav.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))
    assert (asked.param_value, asked.param_type, asked.param_index) == (1500.0, 6, 65535)
    (told,) = flight.ask(mav.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 5.0, 9))
    assert (told.param_value, told.param_type) == (5.0, 2)
    (refused,) = flight.ask(mav.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1000.0, 9))
    assert refused.param_value == 5.0


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("ARMING_CHECK", 1.0, 6),  # as recorded
        ("FS_GCS_ENABLE", 0.0, 2),
        ("FS_GCS_TIMEOUT", 5.0, 9),
        ("FS_THR_ENABLE", 1.0, 2),
        ("FS_OPTIONS", 16.0, 6),
        ("GUID_TIMEOUT", 3.0, 9),
        ("GUID_OPTIONS", 0.0, 6),
        ("MAV_SYSID", 1.0, 4),
        ("MAV_GCS_SYSID", 255.0, 4),
        ("MAV_OPTIONS", 0.0, 4),
        ("DISARM_DELAY", 10.0, 2),
        ("WPNAV_SPEED", 1000.0, 9),
        ("WPNAV_ACCEL", 250.0, 9),
        ("WPNAV_SPEED_UP", 250.0, 9),
        ("WPNAV_JERK", 1.0, 9),
        ("PSC_JERK_XY", 5.0, 9),
        ("LOIT_SPEED", 1250.0, 9),
        ("LAND_SPEED", 50.0, 4),
        ("PILOT_TKOFF_ALT", 0.0, 9),
        ("RTL_ALT", 1500.0, 6),
        ("FRAME_CLASS", 1.0, 2),
        ("SCHED_LOOP_RATE", 400.0, 4),
    ],
)
def test_defaults_and_types_as_recorded(name: str, value: float, kind: int) -> None:
    (told,) = Flight().ask(mav.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    assert (told.param_value, told.param_type) == (value, kind)


def test_the_whole_list_comes_once_each_with_its_place() -> None:
    flight = Flight()
    flight.send(mav.MAVLink_param_request_list_message(1, 1))
    flight.run(2.0)
    told = [m for _, m in flight.all("PARAM_VALUE")]
    assert [m.param_index for m in told] == list(range(told[0].param_count))
    assert len({m.param_id for m in told}) == len(told)


def test_presets_that_it_does_not_have_are_refused_by_name() -> None:
    with pytest.raises(ParameterError, match="COM_OF_LOSS_T: no such parameter"):
        Flight({"COM_OF_LOSS_T": 0.5})


@pytest.mark.parametrize("sysid", [0, 256])
def test_a_sysid_outside_1_to_255_is_refused(sysid: int) -> None:
    with pytest.raises(ValueError, match="sysid"):
        ArduCopterAutopilot(sysid, PointMass((0.0, 0.0, 0.0), 0.0), LocalFrame(ORIGIN))


def test_a_minimal_link_has_heartbeats_only() -> None:
    body = PointMass((0.0, 0.0, 0.0), 0.0)
    links = {Link.ONBOARD: StreamProfile.MINIMAL}
    autopilot = ArduCopterAutopilot(1, body, LocalFrame(ORIGIN), links=links)
    kinds = set()
    for step in range(200):
        autopilot.update(step * 0.05)
        for datagram in autopilot.transmit(Link.ONBOARD, step * 0.05):
            kinds |= {m.get_type() for m in mav.MAVLink(None).parse_buffer(datagram) or []}
    assert kinds == {"HEARTBEAT", "STATUSTEXT"}
