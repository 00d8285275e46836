"""What PX4 tells: parameters, streams, texts. Figures: recorded flights of PX4 1.16."""

from __future__ import annotations

import math
import struct

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from sim_bridge.world.autopilot import (
    PROFILES,
    BatterySpec,
    Link,
    ParameterError,
    Px4Autopilot,
    StreamProfile,
)
from tests.unit.world.autopilot.autopilot_kit import ORIGIN, STEP_S, long
from tests.unit.world.autopilot.px4.px4_kit import (
    ARM,
    REQUEST,
    SET_INTERVAL,
    SET_MODE,
    Body,
    Flight,
    setpoint,
    velocity,
)

# Parameters


def text(name: str) -> bytes:
    return name.encode()


def test_the_whole_list_comes() -> None:
    flight = Flight()
    flight.send(mav.MAVLink_param_request_list_message(1, 1))
    flight.run(1.0)
    values = [m for m in flight.heard[Link.ONBOARD] if m.get_type() == "PARAM_VALUE"]
    assert [m.param_index for m in values] == list(range(values[0].param_count))
    assert {m.param_id for m in values} >= {"COM_OF_LOSS_T", "GF_ACTION", "MAV_SYS_ID"}
    assert not any(m.get_type() == "PARAM_VALUE" for m in flight.heard[Link.GROUND])


def test_a_parameter_is_read_by_name_and_by_index() -> None:
    flight = Flight()
    (named,) = flight.ask(mav.MAVLink_param_request_read_message(1, 1, text("COM_OBL_RC_ACT"), -1))
    (indexed,) = flight.ask(mav.MAVLink_param_request_read_message(1, 1, b"", named.param_index))
    assert named.param_id == indexed.param_id == "COM_OBL_RC_ACT"
    assert named.param_type == 6


@pytest.mark.parametrize(("name", "index"), [("NO_SUCH_PARAM", -1), ("", 5000), ("", -1)])
def test_silence_about_an_unknown_parameter(name: str, index: int) -> None:
    assert Flight().ask(mav.MAVLink_param_request_read_message(1, 1, text(name), index)) == []


def test_a_parameter_is_set_and_told_on_every_link() -> None:
    flight = Flight()
    flight.listen(Link.GROUND)
    wire = struct.unpack("<f", struct.pack("<i", 5))[0]
    (told,) = flight.ask(mav.MAVLink_param_set_message(1, 1, text("COM_OBL_RC_ACT"), wire, 6))
    assert struct.pack("<f", told.param_value) == struct.pack("<i", 5)
    assert [m.get_type() for m in flight.listen(Link.GROUND)] == ["PARAM_VALUE"]
    assert flight.autopilot.parameters["COM_OBL_RC_ACT"] == 5


def test_a_parameter_of_the_wrong_type_keeps_its_value_and_tells_it() -> None:
    flight = Flight()
    (told,) = flight.ask(mav.MAVLink_param_set_message(1, 1, text("COM_OBL_RC_ACT"), 5.0, 9))
    assert told.param_value == 0.0


def test_setting_an_unknown_parameter_is_met_with_silence() -> None:
    assert Flight().ask(mav.MAVLink_param_set_message(1, 1, text("NOPE"), 1.0, 9)) == []


def test_presets_apply_and_unknown_ones_are_refused() -> None:
    assert Flight({"COM_OF_LOSS_T": 0.5}).autopilot.parameters["COM_OF_LOSS_T"] == 0.5
    with pytest.raises(ParameterError, match="COM_OFF_LOSS_T: no such parameter"):
        Flight({"COM_OFF_LOSS_T": 0.5})


def test_absurd_parameters_do_not_break_the_flight() -> None:
    flight = Flight().offboard()
    for name in flight.autopilot.parameters.names:
        if name.startswith(("MPC_", "RTL_", "NAV_ACC", "NAV_MC")) and name != "RTL_TYPE":
            for value in (0.0, -1.0, 3e38):
                flight.autopilot.parameters.set(name, value)
                for mode in ((6.0, 0.0), (4.0, 3.0), (4.0, 5.0), (4.0, 6.0)):
                    flight.run(0.1, velocity(1.0))
                    flight.command(SET_MODE, 1.0, *mode)
                    flight.run(0.1, setpoint(0xDC0, pos=(3e38, -3e38, 3e38)))
                    flight.body.pos = (20.0, -10.0, -5.0)


# Telemetry


def test_minimal_streams_three_states_at_1_hz_and_the_origin_once() -> None:
    flight = Flight()
    flight.run(10.0)
    kinds = [m.get_type() for m in flight.heard[Link.ONBOARD]]
    assert {k: kinds.count(k) for k in set(kinds)} == {
        "HEARTBEAT": 9,
        "SYS_STATUS": 11,
        "EXTENDED_SYS_STATE": 11,
        "GPS_GLOBAL_ORIGIN": 1,
    }


def test_a_20_hz_position_comes_with_every_step_as_the_last_message() -> None:
    flight = Flight()
    flight.command(SET_INTERVAL, 32.0, 50000.0)
    for _ in range(200):
        flight.run(STEP_S)
        last = flight.heard[Link.ONBOARD][-1]
        assert last.get_type() == "LOCAL_POSITION_NED"
        assert last.time_boot_ms == round(flight.now_s * 1000)


@pytest.mark.parametrize(
    ("link", "rates"),
    [
        (
            Link.ONBOARD,
            {
                "ATTITUDE": 98,
                "ATTITUDE_QUATERNION": 49,
                "HIGHRES_IMU": 49,
                "GLOBAL_POSITION_INT": 49,
                "LOCAL_POSITION_NED": 29,
                "ODOMETRY": 29,
                "ALTITUDE": 10,
                "VFR_HUD": 10,
                "ATTITUDE_TARGET": 10,
                "POSITION_TARGET_LOCAL_NED": 10,
                "SERVO_OUTPUT_RAW": 10,
                "TIMESYNC": 10,
                "GPS_RAW_INT": 8,
                "SYS_STATUS": 5,
                "EXTENDED_SYS_STATE": 5,
                "HEARTBEAT": 1,
                "HOME_POSITION": 0.5,
                "BATTERY_STATUS": 0.5,
            },
        ),
        (
            Link.GROUND,
            {
                "ATTITUDE": 49,
                "LOCAL_POSITION_NED": 49,
                "GLOBAL_POSITION_INT": 49,
                "ATTITUDE_TARGET": 49,
                "POSITION_TARGET_LOCAL_NED": 49,
                "SERVO_OUTPUT_RAW": 49,
                "SYS_STATUS": 1,
                "EXTENDED_SYS_STATE": 1,
                "HEARTBEAT": 1,
            },
        ),
    ],
)
def test_default_rates_are_px4s(link: Link, rates: dict[str, float]) -> None:
    autopilot = Px4Autopilot(1, Body(), LocalFrame(ORIGIN), links=PROFILES)
    counts: dict[str, int] = {}
    reader = mav.MAVLink(None)
    for tick in range(0, 14_000, 4):
        now_s = tick / 1000.0
        autopilot.update(now_s)
        datagrams = autopilot.transmit(link, now_s)
        if tick < 4_000:
            continue
        for message in reader.parse_buffer(b"".join(datagrams)) or []:
            counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    assert {kind: counts[kind] for kind in rates} == pytest.approx(
        {kind: rate * 10 for kind, rate in rates.items()}, abs=1
    )


@pytest.mark.parametrize("profile", [StreamProfile.ONBOARD, StreamProfile.GROUND])
def test_every_message_packs_in_the_air(profile: StreamProfile) -> None:
    flight = Flight(links={Link.ONBOARD: profile, Link.GROUND: StreamProfile.GROUND}).airborne()
    kinds = {m.get_type() for m in flight.heard[Link.ONBOARD]}
    assert {"HOME_POSITION", "ODOMETRY" if profile is StreamProfile.ONBOARD else "ALTITUDE"} <= kinds


def test_positions_agree_with_each_other_and_with_the_truth() -> None:
    flight = Flight().airborne(6.0)
    local, place, home, origin, hud, height = (
        flight.ask(long(REQUEST, float(number)))[0] for number in (32, 33, 242, 49, 74, 141)
    )
    assert (local.x, local.y, local.z) == pytest.approx((0.0, 0.0, flight.body.pos[2]), abs=1e-5)
    truth = flight.frame.to_wgs84(flight.body.pos)
    assert (place.lat, place.lon) == (round(truth.lat_deg * 1e7), round(truth.lon_deg * 1e7))
    assert place.alt == pytest.approx(truth.alt_m * 1000.0, abs=1.0)
    assert place.relative_alt == pytest.approx(-flight.body.pos[2] * 1000.0, abs=1.0)
    assert (home.latitude, home.longitude, home.altitude) == (place.lat, place.lon, 488_000)
    assert (home.x, home.y, home.z) == (0.0, 0.0, 0.0)
    assert (origin.latitude, origin.longitude, origin.altitude) == (place.lat, place.lon, 488_000)
    assert hud.alt == pytest.approx(truth.alt_m, abs=1e-3)
    assert height.altitude_relative == pytest.approx(-flight.body.pos[2], abs=1e-3)


def test_attitude_and_its_quaternion_agree() -> None:
    flight = Flight()
    flight.body.yaw = 1.0
    attitude = flight.ask(long(REQUEST, 30.0))[0]
    quaternion = flight.ask(long(REQUEST, 31.0))[0]
    assert attitude.yaw == pytest.approx(1.0)
    assert 2.0 * math.atan2(quaternion.q4, quaternion.q1) == pytest.approx(1.0)


def test_an_imu_at_rest_feels_gravity_upwards() -> None:
    imu = Flight().ask(long(REQUEST, 105.0))[0]
    assert (imu.xacc, imu.yacc, imu.zacc) == pytest.approx((0.0, 0.0, -9.80665), abs=1e-3)
    assert imu.abs_pressure == pytest.approx(956.0, abs=1.0)  # hPa at 488 m, standard atmosphere


def test_home_is_set_again_at_arming() -> None:
    flight = Flight().ready()
    flight.body.pos = (30.0, -10.0, 0.0)
    flight.run(0.1)
    flight.command(ARM, 1.0)
    home = flight.ask(long(REQUEST, 242.0))[0]
    assert (home.x, home.y) == pytest.approx((10.0, 0.0))


def test_the_battery_drains_with_the_throttle() -> None:
    flight = Flight(battery=BatterySpec(capacity_mah=100.0, remaining=0.9)).ready()
    idle = flight.autopilot.snapshot.battery_remaining
    assert idle == pytest.approx(0.9, abs=0.01)
    flight.command(ARM, 1.0)
    flight.run(5.0)
    assert flight.autopilot.snapshot.battery_remaining == pytest.approx(0.7, abs=0.05)
    status = flight.ask(long(REQUEST, 147.0))[0]
    assert status.battery_remaining == round(flight.autopilot.snapshot.battery_remaining * 100.0)
    assert 14_400 < status.voltages[0] < 16_200


def test_bat1_presets_win_over_what_is_fitted() -> None:
    flight = Flight({"BAT1_CAPACITY": 100.0}, battery=BatterySpec(capacity_mah=5000.0))
    assert flight.autopilot.parameters["BAT1_CAPACITY"] == 100.0
    with pytest.raises(ValueError, match="capacity_mah must be > 0"):
        Flight({"BAT1_CAPACITY": -1.0})


def test_ping_is_answered_once() -> None:
    flight = Flight()
    (pong,) = flight.ask(mav.MAVLink_ping_message(77, 5, 0, 0))
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (77, 5, 1, 191)
    assert flight.ask(mav.MAVLink_ping_message(77, 5, 1, 1)) == []


def test_timesync_requests_are_answered_and_answers_are_not() -> None:
    flight = Flight()
    flight.run(2.0)
    (answer,) = flight.ask(mav.MAVLink_timesync_message(0, 123))
    assert (answer.tc1, answer.ts1) == (2_000_000_000, 123)
    assert flight.ask(mav.MAVLink_timesync_message(456, 123)) == []


def test_a_timesync_request_can_be_made() -> None:
    flight = Flight()
    (request,) = mav.MAVLink(None).parse_buffer(flight.autopilot.timesync_request(1.25))
    assert (request.tc1, request.ts1) == (0, 1_250_000_000)
    assert (request.get_srcSystem(), request.get_srcComponent()) == (1, 1)


def test_long_texts_come_in_chunks_of_50_characters() -> None:
    flight = Flight({"NAV_DLL_ACT": 2}).ready()
    flight.command(ARM, 1.0)
    chunks = [m for m in flight.listen(Link.GROUND) if m.get_type() == "STATUSTEXT"]
    assert [len(m.text) for m in chunks] == [50, 1]
    assert [m.chunk_seq for m in chunks] == [0, 1]
    assert chunks[0].id == chunks[1].id != 0
    assert "".join(m.text for m in chunks) == "Arming denied: no connection to the ground station\t"


def test_ids_of_sequence_run_per_link() -> None:
    flight = Flight()
    flight.run(5.0)
    for link in Link:
        sequence = [m.get_seq() for m in flight.heard[link]]
        assert sequence == list(range(len(sequence)))
