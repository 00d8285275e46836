"""ArduCopter's behaviour, row by row, as a client on the wire sees it. Figures: its recorded flights."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest
from autopilot_kit import NAN, ORIGIN, STEP_S, Wire, long

from companion.mavlink import dialect as mav
from mission.frames import LocalFrame, Vec3
from mission.model import Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import (
    ArduCopterAutopilot,
    BatterySpec,
    Failsafe,
    LandedState,
    Link,
    ParameterError,
    StreamProfile,
    make_autopilot,
)

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION, SET_INTERVAL, REQUEST = 400, 176, 22, 21, 20, 192, 511, 512
STABILIZE, GUIDED, LOITER, RTL_MODE, LAND_MODE, BRAKE = 0, 4, 5, 6, 9, 17
FORCE = 21196.0


class Flight(Wire):
    """An autopilot on a point mass, and a client on each link."""

    def __init__(self, parameters: Mapping[str, float] | None = None, battery: BatterySpec | None = None) -> None:
        super().__init__(onboard_system=245)
        self.body = PointMass((20.0, -10.0, 0.0), 0.0)
        self.frame = LocalFrame(ORIGIN)
        self.autopilot = make_autopilot(
            Personality.ARDUPILOT, 1, self.body, self.frame, parameters=parameters, battery=battery
        )
        self.heard: dict[Link, list[tuple[float, Any]]] = {Link.ONBOARD: [], Link.GROUND: []}

    def listen(self, link: Link = Link.ONBOARD) -> list[Any]:
        messages = super().listen(link)
        self.heard[link] += [(self.now_s, message) for message in messages]
        return messages

    def run(self, seconds: float, *repeated: Any) -> Flight:
        """Fly on, sending `repeated` before every step."""
        for _ in range(round(seconds / STEP_S)):
            self.step(*repeated)
            for link in Link:
                self.listen(link)
        return self

    def all(self, kind: str, link: Link = Link.ONBOARD) -> list[tuple[float, Any]]:
        return [(at_s, m) for at_s, m in self.heard[link] if m.get_type() == kind]

    def last(self, kind: str) -> Any:
        return self.all(kind)[-1][1]

    def texts(self, link: Link = Link.ONBOARD) -> list[str]:
        return [m.text for _, m in self.all("STATUSTEXT", link)]

    def landed_states(self) -> list[int]:
        return changes([m.landed_state for _, m in self.all("EXTENDED_SYS_STATE")])

    @property
    def armed(self) -> bool:
        return self.autopilot.snapshot.armed

    @property
    def height_m(self) -> float:
        return -self.body.state.pos_ned_m[2]

    # Flights to start from

    def ready(self) -> Flight:
        """GUIDED, with a position."""
        self.run(42.0)
        assert self.command(SET_MODE, 1.0, GUIDED) == ACCEPTED
        assert self.command(SET_INTERVAL, 245.0, 100_000.0) == ACCEPTED
        return self

    def airborne(self, height_m: float = 5.0) -> Flight:
        self.ready()
        assert self.command(ARM, 1.0) == ACCEPTED
        self.run(1.2)
        assert self.command(TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == ACCEPTED
        return self.run(8.0 + height_m / 2.0)


def velocity(north: float = 0.0, east: float = 0.0, down: float = 0.0, mask: int = 0x5C7) -> Any:
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, mask, 0, 0, 0, north, east, down, 0, 0, 0, 0, 0
    )


def heartbeat(kind: int = 6) -> Any:
    return mav.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)


def changes(values: list[Any]) -> list[Any]:
    return [value for before, value in zip([None, *values], values, strict=False) if value != before]


def speed(velocity_ned_mps: Vec3) -> float:
    return math.hypot(*velocity_ned_mps)


# Boot


def test_first_heartbeat_at_1_0_s_booting_and_then_every_second() -> None:
    beats = Flight().run(6.1).all("HEARTBEAT")
    assert [at_s for at_s, _ in beats] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], abs=0.1)
    first = beats[0][1]
    assert (first.type, first.autopilot, first.base_mode, first.custom_mode, first.system_status) == (2, 3, 89, 0, 1)
    third = beats[2][1]
    assert (third.base_mode, third.custom_mode, third.system_status) == (81, 0, mav.MAV_STATE_STANDBY)


def test_it_streams_only_heartbeats_until_asked() -> None:
    flight = Flight().run(60.0)
    kinds = {m.get_type() for _, m in flight.heard[Link.ONBOARD]}
    assert kinds == {"HEARTBEAT", "STATUSTEXT", "TIMESYNC", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}


def test_home_and_origin_are_pushed_once_at_20_s() -> None:
    flight = Flight().run(42.0)
    for kind in ("HOME_POSITION", "GPS_GLOBAL_ORIGIN"):
        ((at_s, message),) = flight.all(kind)
        assert at_s == pytest.approx(20.0, abs=0.2)
        assert message.latitude == round(flight.frame.to_wgs84((20.0, -10.0, 0.0)).lat_deg * 1e7)
    assert all(math.isnan(value) for value in flight.last("HOME_POSITION").q)


def test_home_asked_for_before_there_is_one_is_accepted_and_empty() -> None:
    flight = Flight().run(9.0)
    assert [m.get_type() for m in flight.ask(long(REQUEST, 242.0))] == ["COMMAND_ACK"]
    flight.run(12.0)
    assert [m.get_type() for m in flight.ask(long(REQUEST, 242.0))] == ["COMMAND_ACK", "HOME_POSITION"]


def test_the_prearm_bit_comes_at_23_6_s_and_is_not_enough() -> None:
    flight = Flight()
    flight.command(SET_INTERVAL, 1.0, 100_000.0)
    flight.run(42.0)
    healthy = [at_s for at_s, m in flight.all("SYS_STATUS") if m.onboard_control_sensors_health & 0x10000000]
    assert healthy[0] == pytest.approx(23.6, abs=0.3)


def test_in_guided_the_prearm_bit_waits_for_a_position() -> None:
    flight = Flight().run(3.0)
    flight.command(SET_MODE, 1.0, GUIDED)
    flight.command(SET_INTERVAL, 1.0, 100_000.0)
    flight.run(40.0)
    healthy = [at_s for at_s, m in flight.all("SYS_STATUS") if m.onboard_control_sensors_health & 0x10000000]
    assert healthy[0] == pytest.approx(41.5, abs=0.3)


def test_ekf_flags_over_time() -> None:
    flight = Flight()
    flight.command(SET_INTERVAL, 193.0, 100_000.0)
    flight.run(45.0)
    flags = [(at_s, m.flags) for at_s, m in flight.all("EKF_STATUS_REPORT")]
    assert changes([value for _, value in flags]) == [1024, 0, 167, 831]
    assert next(at_s for at_s, value in flags if value & 0x10) == pytest.approx(41.4, abs=0.2)


def test_local_position_comes_only_with_the_position_then_at_the_rate_asked_for() -> None:
    flight = Flight()
    flight.command(SET_INTERVAL, 32.0, 100_000.0)
    flight.run(51.4)
    times = [at_s for at_s, _ in flight.all("LOCAL_POSITION_NED")]
    assert times[0] == pytest.approx(41.45, abs=0.15)
    assert len(times) == pytest.approx(100, abs=2)


def test_guided_asked_for_before_2_7_s_is_taken_back_and_each_change_is_told_at_once() -> None:
    flight = Flight().run(2.5)
    assert flight.command(SET_MODE, 1.0, GUIDED) == ACCEPTED
    assert flight.mode == "GUIDED"
    flight.run(1.0)
    assert flight.mode == "STABILIZE"
    beats = [m.custom_mode for _, m in flight.all("HEARTBEAT")]
    assert beats == [0, 0, GUIDED, STABILIZE, STABILIZE]
    assert flight.command(SET_MODE, 1.0, GUIDED) == ACCEPTED
    flight.run(5.0)
    assert flight.mode == "GUIDED"


@pytest.mark.parametrize(
    ("at_s", "reasons"),
    [
        (1.1, ["System not initialised"]),
        (
            2.55,
            ["Need Alt Estimate", "Accels inconsistent", "EKF attitude is bad", "AHRS: waiting for home"],
        ),
        (6.55, ["Accels inconsistent", "AHRS: waiting for home"]),
        (12.6, ["Gyros inconsistent", "AHRS: waiting for home"]),
        (20.6, ["Gyros inconsistent", "Need Position Estimate"]),
        (30.0, ["Need Position Estimate"]),
    ],
)
def test_armed_too_early_fails_and_says_why(at_s: float, reasons: list[str]) -> None:
    flight = Flight().run(at_s)
    flight.command(SET_MODE, 1.0, GUIDED)
    flight.listen()
    kinds = [m for m in flight.ask(long(ARM, 1.0)) if m.get_type() in ("COMMAND_ACK", "STATUSTEXT")]
    assert kinds[0].result == FAILED
    assert [m.text for m in kinds[1:]] == [f"Arm: {why}" for why in reasons]
    assert {m.severity for m in kinds[1:]} == {2}
    assert not flight.armed


# Arming and taking off


def test_arms_with_a_position_and_pushes_home() -> None:
    flight = Flight().ready()
    answers = [m.get_type() for m in flight.ask(long(ARM, 1.0))]
    assert answers[0] == "COMMAND_ACK"
    assert {"HOME_POSITION", "GPS_GLOBAL_ORIGIN", "STATUSTEXT"} <= set(answers)
    assert flight.texts()[-1] == "Arming motors"
    flight.run(1.0)
    beat = flight.last("HEARTBEAT")
    assert (beat.base_mode, beat.custom_mode, beat.system_status) == (217, GUIDED, mav.MAV_STATE_STANDBY)


def test_takeoff_fails_when_not_guided_or_not_armed() -> None:
    flight = Flight().run(42.0)
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0) == FAILED
    flight.command(SET_MODE, 1.0, GUIDED)
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0) == FAILED
    flight.command(SET_MODE, 1.0, LOITER)
    assert flight.command(ARM, 1.0) == ACCEPTED
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0) == FAILED


def test_takeoff_is_relative_climbs_as_recorded_and_stays_guided() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    flight.run(1.2)
    assert flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0) == ACCEPTED
    begin_s = flight.now_s
    while flight.height_m < 4.7:
        flight.run(STEP_S)
        assert flight.now_s - begin_s < 10.0
    assert flight.now_s - begin_s == pytest.approx(6.2, abs=0.5)
    flight.run(5.0)
    assert flight.height_m == pytest.approx(5.0, abs=0.1)
    assert flight.mode == "GUIDED"
    assert flight.landed_states() == [LandedState.ON_GROUND, LandedState.TAKEOFF, LandedState.IN_AIR]
    assert flight.last("HEARTBEAT").system_status == mav.MAV_STATE_ACTIVE


def test_a_takeoff_asked_for_again_is_not_put_off() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    for _ in range(8):
        flight.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0)
        flight.run(1.0)
    assert flight.height_m > 3.0


def test_idle_on_the_ground_disarms_after_10_s() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    flight.run(9.8)
    assert flight.armed
    flight.run(0.4)
    assert not flight.armed
    assert flight.texts()[-1] == "Disarming motors"


def test_disarm_in_the_air_fails_unless_forced() -> None:
    flight = Flight().airborne()
    assert flight.command(ARM, 0.0) == FAILED
    assert flight.armed
    assert flight.command(ARM, 0.0, FORCE) == ACCEPTED
    flight.run(3.0)
    assert flight.height_m == 0.0
    assert flight.landed_states()[-1] == LandedState.ON_GROUND


@pytest.mark.parametrize("mode", [RTL_MODE, LAND_MODE, BRAKE])
def test_some_modes_do_not_arm(mode: int) -> None:
    flight = Flight().ready()
    flight.command(SET_MODE, 1.0, mode)
    assert flight.command(ARM, 1.0) == FAILED
    assert flight.texts()[-1] == "Arm: Mode not armable"


# Landing


def test_land_stays_land_and_disarms_at_once() -> None:
    flight = Flight().airborne()
    assert flight.command(LAND) == ACCEPTED
    assert flight.last("HEARTBEAT").custom_mode == LAND_MODE
    flight.run(3.0)
    assert flight.body.state.vel_ned_mps[2] == pytest.approx(0.5, abs=0.05)
    flight.run(15.0)
    assert not flight.armed
    assert flight.mode == "LAND"
    assert flight.landed_states() == [1, 3, 2, 4, 1]
    landed_s = next(at_s for at_s, m in reversed(flight.all("EXTENDED_SYS_STATE")) if m.landed_state == 4)
    disarmed_s = next(at_s for at_s, m in flight.all("STATUSTEXT") if m.text == "Disarming motors")
    assert disarmed_s - landed_s < 0.4


def test_rtl_climbs_within_the_cone_comes_home_waits_and_lands() -> None:
    flight = Flight().airborne()
    flight.run(6.0, velocity(1.0, 0.0, 0.0))
    flight.run(4.0, velocity())
    distance_m = math.dist(flight.body.state.pos_ned_m[:2], (20.0, -10.0))
    assert flight.command(RTL) == ACCEPTED
    heights = []
    for _ in range(600):
        flight.run(0.1)
        heights.append(flight.height_m)
    assert max(heights) == pytest.approx(min(3.0 * distance_m, 15.0), abs=0.3)  # RTL_CONE_SLOPE
    assert not flight.armed
    assert flight.body.state.pos_ned_m[:2] == pytest.approx((20.0, -10.0), abs=0.3)
    assert flight.mode == "RTL"


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
