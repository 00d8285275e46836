"""PX4's behaviour, row by row, as a client on the wire sees it. Figures: recorded flights of PX4 1.16."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Mapping
from typing import Any

import pytest
from autopilot_kit import NAN, ORIGIN, STEP_S, Wire, long

from companion.mavlink import dialect as mav
from mission.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import (
    PROFILES,
    BatterySpec,
    LandedState,
    Link,
    ParameterError,
    Px4Autopilot,
    Px4Mode,
    StreamProfile,
)

MINIMAL = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION, SET_INTERVAL, REQUEST = 400, 176, 22, 21, 20, 192, 511, 512
OFFBOARD = (1.0, 6.0)
HOLD = (1.0, 4.0, 3.0)


class Body:
    """An airframe that takes every velocity at once; the ground is at down = 0."""

    def __init__(self, pos_ned_m: Vec3 = (20.0, -10.0, 0.0)) -> None:
        self.pos = pos_ned_m
        self.vel: Vec3 = (0.0, 0.0, 0.0)
        self.yaw = 0.0
        self.armed = False

    @property
    def state(self) -> AirframeState:
        throttle = 0.5 if self.armed else 0.0
        return AirframeState(self.pos, self.vel, (0.0, 0.0, self.yaw), (0.0, 0.0, 0.0), self.pos[2] >= 0.0, throttle)

    def set_armed(self, armed: bool) -> None:
        self.armed = armed

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        assert all(map(math.isfinite, (*vel_ned_mps, yaw_rad)))
        self.vel, self.yaw = vel_ned_mps, yaw_rad

    def step(self, dt_s: float) -> None:
        if not self.armed:
            self.vel = (0.0, 0.0, 5.0)
        if self.pos[2] >= 0.0 and self.vel[2] >= 0.0:
            self.vel = (0.0, 0.0, 0.0)
        north, east, down = (p + v * dt_s for p, v in zip(self.pos, self.vel, strict=True))
        self.pos = (north, east, min(down, 0.0))


class Flight(Wire):
    """An autopilot, its body, and a client on each link."""

    def __init__(
        self,
        parameters: Mapping[str, float] | None = None,
        links: Mapping[Link, StreamProfile] = MINIMAL,
        battery: BatterySpec | None = None,
    ) -> None:
        super().__init__(onboard_system=1)
        self.body: Body = Body()
        self.frame = LocalFrame(ORIGIN)
        self.autopilot = Px4Autopilot(1, self.body, self.frame, parameters=parameters, links=links, battery=battery)
        self.heard: dict[Link, list[Any]] = {Link.ONBOARD: [], Link.GROUND: []}

    def run(self, seconds: float, *repeated: Any) -> None:
        """Fly on, sending `repeated` before every step."""
        for _ in range(round(seconds / STEP_S)):
            self.step(*repeated)
            for link in self.heard:
                if link in self.autopilot._channels:
                    self.heard[link] += self.listen(link)

    def last(self, kind: str, link: Link = Link.ONBOARD) -> Any:
        return next(m for m in reversed(self.heard[link]) if m.get_type() == kind)

    def texts(self) -> str:
        return "|".join(m.text for m in self.heard[Link.GROUND] if m.get_type() == "STATUSTEXT")

    # Flights to start from

    def ready(self) -> Flight:
        self.run(5.0)
        return self

    def airborne(self, height_m: float = 5.0) -> Flight:
        """In HOLD at about `height_m`."""
        self.ready()
        assert self.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + height_m) == ACCEPTED
        assert self.command(ARM, 1.0) == ACCEPTED
        self.run(8.0 + height_m)
        assert self.mode == "HOLD"
        return self

    def offboard(self) -> Flight:
        """In OFFBOARD, standing still in the air."""
        self.airborne()
        self.run(0.2, velocity())
        assert self.command(SET_MODE, *OFFBOARD) == ACCEPTED
        self.run(0.2, velocity())
        assert self.mode == "OFFBOARD"
        return self


def setpoint(
    mask: int, pos: Vec3 = (0.0, 0.0, 0.0), vel: Vec3 = (0.0, 0.0, 0.0), yaw: float = 0.0, rate: float = 0.0
) -> Any:
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, mask, *pos, *vel, 0.0, 0.0, 0.0, yaw, rate
    )


def velocity(north: float = 0.0, east: float = 0.0, down: float = 0.0, mask: int = 0x9C7) -> Any:
    return setpoint(mask, vel=(north, east, down))


# Boot and arming


def test_first_heartbeat_at_1_2_s_and_then_strictly_every_second() -> None:
    flight = Flight()
    at_s = []
    for _ in range(200):
        flight.run(STEP_S)
        if any(m.get_type() == "HEARTBEAT" for m in flight.heard[Link.ONBOARD]):
            at_s.append(flight.now_s)
        flight.heard[Link.ONBOARD].clear()
    assert at_s == pytest.approx([1.2 + second for second in range(9)])


def test_heartbeat_is_a_px4_quadrotors() -> None:
    flight = Flight()
    flight.run(2.0)
    beat = flight.last("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.get_srcSystem(), beat.get_srcComponent()) == (2, 12, 1, 1)
    assert (beat.base_mode, beat.custom_mode, beat.system_status) == (29, 0x3040000, 0)


def test_ready_at_4_5_s_with_the_prearm_bit_and_standby() -> None:
    flight = Flight()
    flight.run(4.1)
    assert not flight.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000
    flight.run(1.0)
    assert flight.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000
    assert flight.last("HEARTBEAT").system_status == mav.MAV_STATE_STANDBY


def test_armed_too_early_is_temporarily_rejected_and_told_to_the_ground_only() -> None:
    flight = Flight()
    flight.run(1.0)
    assert flight.command(ARM, 1.0) == REJECTED
    flight.run(0.1)
    assert "Arming denied: system not ready\t" in flight.texts()
    assert not any(m.get_type() == "STATUSTEXT" for m in flight.heard[Link.ONBOARD])


def test_arms_when_ready_and_starts_the_rotors() -> None:
    flight = Flight().ready()
    assert flight.command(ARM, 1.0) == ACCEPTED
    flight.run(1.0)
    assert flight.body.armed
    assert flight.last("HEARTBEAT").base_mode == 157
    assert flight.last("HEARTBEAT").system_status == mav.MAV_STATE_ACTIVE


@pytest.mark.parametrize("mode", [(1.0, 4.0, 6.0), (1.0, 4.0, 5.0), (1.0, 3.0), (1.0, 1.0)])
def test_land_return_and_stick_modes_do_not_allow_arming(mode: tuple[float, ...]) -> None:
    flight = Flight().ready()
    assert flight.command(SET_MODE, *mode) == ACCEPTED
    assert flight.command(ARM, 1.0) == REJECTED


@pytest.mark.parametrize("value", [2.0, -1.0, NAN, math.inf])
def test_arm_disarm_takes_only_0_and_1(value: float) -> None:
    assert Flight().ready().command(ARM, value) == UNSUPPORTED


def test_mavsdks_nan_parameters_arm() -> None:
    assert Flight().ready().command(ARM, 1.0, NAN, NAN, NAN, NAN, NAN, NAN) == ACCEPTED


def test_disarm_in_the_air_is_refused_unless_forced() -> None:
    flight = Flight().airborne()
    assert flight.command(ARM, 0.0) == REJECTED
    assert flight.body.armed
    assert flight.command(ARM, 0.0, 21196.0) == ACCEPTED
    assert not flight.body.armed
    flight.run(3.0)
    assert flight.autopilot.snapshot.landed is LandedState.ON_GROUND


def test_idle_on_the_ground_disarms_after_10_s() -> None:
    flight = Flight().ready()
    flight.command(ARM, 1.0)
    flight.run(9.9)
    assert flight.body.armed
    flight.run(0.2)
    assert not flight.body.armed


def test_arming_needs_a_ground_station_when_nav_dll_act_says_so_even_forced() -> None:
    flight = Flight({"NAV_DLL_ACT": 2}).ready()
    flight.send(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))  # a companion is none
    assert flight.command(ARM, 1.0, 21196.0) == REJECTED
    flight.send(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), Link.GROUND)
    assert flight.command(ARM, 1.0) == ACCEPTED


# Commands


def test_an_unknown_command_is_unsupported() -> None:
    assert Flight().command(31999) == UNSUPPORTED


def test_a_command_to_another_system_is_not_acknowledged() -> None:
    assert Flight().ask(long(ARM, 1.0, system=2)) == []


def test_a_command_to_another_component_is_not_acknowledged() -> None:
    assert Flight().ask(long(ARM, 1.0, component=191)) == []


@pytest.mark.parametrize("link", list(Link))
def test_the_ack_goes_to_the_asker_on_his_link(link: Link) -> None:
    flight = Flight()
    other = Link.GROUND if link is Link.ONBOARD else Link.ONBOARD
    flight.listen(other)
    (ack,) = flight.ask(long(31999), link)
    codec = flight.codecs[link]
    assert (ack.target_system, ack.target_component) == (codec.srcSystem, codec.srcComponent)
    assert flight.listen(other) == []


@pytest.mark.parametrize(
    ("number", "params", "result"),
    [
        (SET_INTERVAL, (32.0, 20000.0), ACCEPTED),  # these as recorded
        (SET_INTERVAL, (31.0, -1.0), ACCEPTED),
        (SET_INTERVAL, (290.0, -1.0), ACCEPTED),
        (SET_INTERVAL, (65.0, 500000.0), ACCEPTED),
        (SET_INTERVAL, (9999.0, 100000.0), FAILED),
        (SET_INTERVAL, (340.0, -1.0), FAILED),
        (510, (32.0,), ACCEPTED),
        (REQUEST, (242.0,), ACCEPTED),
        (REQUEST, (148.0, NAN, NAN, NAN, NAN, NAN, NAN), ACCEPTED),
        (LAND, (NAN, NAN, NAN, NAN, NAN, NAN, NAN), ACCEPTED),
        (TAKEOFF, (NAN, NAN, NAN, NAN, NAN, NAN, NAN), ACCEPTED),
        (SET_MODE, (129.0, 6.0, 0.0, NAN, NAN, NAN, NAN), ACCEPTED),
        (SET_INTERVAL, (NAN, 1.0), FAILED),
        (SET_INTERVAL, (32.0, math.inf), FAILED),
        (510, (math.inf,), FAILED),
        (510, (-5.0,), FAILED),
        (REQUEST, (9999.0,), DENIED),
        (REQUEST, (math.inf,), DENIED),
        (SET_MODE, (0.0, 6.0), REJECTED),
        (SET_MODE, (1.0, 77.0), REJECTED),
        (SET_MODE, (1.0, NAN), REJECTED),
        (SET_MODE, (1.0, 4.0, 4.0), REJECTED),  # there is no mission
        (SET_MODE, (1.0, -1e9, 1e30), REJECTED),
        (178, (1.0, 3.0, -1.0), ACCEPTED),
        (178, (1.0, math.inf), DENIED),
        (179, (0.0, 0.0, 0.0, 0.0, 47.4, 8.5, 490.0), ACCEPTED),
        (179, (0.0, 0.0, 0.0, 0.0, 200.0, 8.5, 490.0), DENIED),
        (179, (0.0, 0.0, 0.0, 0.0, 47.4, 8.5, 1e30), DENIED),
        (179, (0.0, 0.0, 0.0, 0.0, NAN, 8.5, 490.0), DENIED),
        (179, (1.0,), ACCEPTED),
        (185, (0.0,), ACCEPTED),
        (REPOSITION, (-1.0, 1.0, 0.0, NAN, NAN, NAN, NAN), ACCEPTED),
        (REPOSITION, (-1.0, 1.0, 0.0, NAN, 91.0, 0.0, 500.0), DENIED),
        (401, (), ACCEPTED),
        (410, (), ACCEPTED),
        (519, (1.0,), ACCEPTED),
        (520, (1.0,), ACCEPTED),
    ],
)
def test_results_on_the_ground(number: int, params: tuple[float, ...], result: int) -> None:
    assert Flight().ready().command(number, *params) == result


def test_message_interval_is_told() -> None:
    flight = Flight()
    flight.command(SET_INTERVAL, 32.0, 20000.0)
    told, ack = flight.ask(long(510, 32.0))
    assert (told.message_id, told.interval_us) == (32, 20000)
    assert ack.get_type() == "COMMAND_ACK"


def test_a_requested_message_comes_before_its_ack() -> None:
    kinds = [m.get_type() for m in Flight().ready().ask(long(REQUEST, 242.0))]
    assert kinds == ["HOME_POSITION", "COMMAND_ACK"]


def test_home_requested_before_there_is_one_is_accepted_and_empty() -> None:
    kinds = [m.get_type() for m in Flight().ask(long(REQUEST, 242.0))]
    assert kinds == ["COMMAND_ACK"]


def test_autopilot_version_is_px4_1_16_and_tells_vehicles_apart() -> None:
    version = Flight().ask(long(520, 1.0))[0]
    assert (version.capabilities, version.flight_sw_version) == (59647 - 32, 17826047)
    other = Px4Autopilot(2, Body(), LocalFrame(ORIGIN))
    codec = mav.MAVLink(None, srcSystem=255)
    other.receive(Link.ONBOARD, long(520, 1.0, system=2).pack(codec), 0.0)
    messages = mav.MAVLink(None).parse_buffer(b"".join(other.transmit(Link.ONBOARD, 0.0)))
    second = next(m for m in messages if m.get_type() == "AUTOPILOT_VERSION")
    assert second.uid2 != version.uid2
    assert second.uid != version.uid


def test_command_int_does_the_same() -> None:
    flight = Flight().ready()
    message = mav.MAVLink_command_int_message(1, 1, 0, ARM, 0, 0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    (ack,) = flight.ask(message)
    assert (ack.command, ack.result) == (ARM, ACCEPTED)


# Modes


@pytest.mark.parametrize(
    ("main_sub", "custom", "base"),
    [
        ((4.0, 3.0), 0x3040000, 29),
        ((4.0, 2.0), 0x2040000, 29),
        ((4.0, 5.0), 0x5040000, 29),
        ((4.0, 6.0), 0x6040000, 29),
        ((3.0, 0.0), 0x30000, 81),
    ],
)
def test_modes_show_as_px4s(main_sub: tuple[float, float], custom: int, base: int) -> None:
    flight = Flight().ready()
    assert flight.command(SET_MODE, 1.0, *main_sub) == ACCEPTED
    flight.run(1.1)
    beat = flight.last("HEARTBEAT")
    assert (beat.custom_mode, beat.base_mode) == (custom, base)


def test_the_older_set_mode_message_works() -> None:
    flight = Flight().airborne()
    flight.send(mav.MAVLink_set_mode_message(1, 1, int(Px4Mode.LAND)))
    assert flight.mode == "LAND"


def test_offboard_disarmed_without_setpoints_is_accepted_and_does_not_show() -> None:
    flight = Flight().ready()
    assert flight.command(SET_MODE, *OFFBOARD) == ACCEPTED
    flight.run(1.1)
    assert flight.mode == "HOLD"
    # Recorded: the prearm bit goes, as this mode could not run.
    assert not flight.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000
    assert flight.command(ARM, 1.0) == REJECTED


def test_offboard_asked_for_before_the_stream_comes_with_the_stream() -> None:
    flight = Flight().ready()
    flight.command(SET_MODE, *OFFBOARD)
    flight.run(0.2, velocity())
    assert flight.mode == "OFFBOARD"


def test_offboard_in_the_air_without_setpoints_is_rejected() -> None:
    flight = Flight().airborne()
    assert flight.command(SET_MODE, *OFFBOARD) == REJECTED
    assert flight.mode == "HOLD"


def test_two_setpoints_are_enough_and_one_is_not() -> None:
    flight = Flight().airborne()
    flight.send(velocity())
    assert flight.command(SET_MODE, *OFFBOARD) == REJECTED
    flight.run(0.1)
    flight.send(velocity())
    assert flight.command(SET_MODE, *OFFBOARD) == ACCEPTED


def test_setpoints_from_long_ago_are_not_a_stream() -> None:
    flight = Flight().airborne()
    flight.run(0.5, velocity())
    flight.run(0.6)
    assert flight.command(SET_MODE, *OFFBOARD) == REJECTED


@pytest.mark.parametrize(("every_s", "holds"), [(0.25, True), (0.5, True), (0.8, True), (1.1, False)])
def test_4_2_and_1_25_hz_hold_offboard_and_0_9_hz_does_not(every_s: float, holds: bool) -> None:
    flight = Flight().offboard()
    for _ in range(4):
        flight.run(every_s)
        flight.send(velocity())
    assert (flight.mode == "OFFBOARD") is holds


def test_a_pilot_takes_the_vehicle_with_position_mode_and_it_holds() -> None:
    flight = Flight().offboard()
    assert flight.command(SET_MODE, 1.0, 3.0) == ACCEPTED
    before = flight.body.pos
    flight.run(3.0, velocity(2.0))
    assert flight.mode == "POSCTL"
    assert flight.body.pos == pytest.approx(before, abs=0.1)


# Setpoints


@pytest.mark.parametrize("mask", [0x9C7, 0xDC7, 0x5C7])
def test_velocity_masks_are_followed(mask: int) -> None:
    flight = Flight().offboard()
    flight.run(1.0, velocity(0.7, -0.4, -0.3, mask))
    assert flight.body.vel == pytest.approx((0.7, -0.4, -0.3), abs=1e-6)


def test_a_position_is_of_the_local_frame_whose_origin_is_where_the_vehicle_booted() -> None:
    flight = Flight().offboard()
    flight.run(20.0, setpoint(0xDF8, pos=(3.0, 4.0, -6.0)))
    assert flight.body.pos == pytest.approx((23.0, -6.0, -6.0), abs=0.01)


def test_yaw_is_followed_and_kept_when_ignored() -> None:
    flight = Flight().offboard()
    flight.run(0.2, setpoint(0x9C7, yaw=1.0))
    assert flight.body.yaw == pytest.approx(1.0)
    flight.run(0.2, setpoint(0xDC7, yaw=2.0))
    assert flight.body.yaw == pytest.approx(1.0)


def test_a_yaw_rate_turns() -> None:
    flight = Flight().offboard()
    flight.run(2.0, setpoint(0x5C7, rate=0.5))
    assert flight.body.yaw == pytest.approx(1.0, abs=0.05)


def test_velocity_is_limited_by_the_parameters() -> None:
    flight = Flight({"MPC_XY_VEL_MAX": 2.0}).offboard()
    flight.run(0.2, velocity(30.0, 40.0, -50.0))
    assert flight.body.vel == pytest.approx((1.2, 1.6, -3.0), abs=1e-6)


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf])
def test_what_is_not_finite_is_rejected_counted_and_brakes(bad: float) -> None:
    flight = Flight().offboard()
    flight.run(0.5, velocity(1.0))
    flight.run(2.0, velocity(0.7, 0.0, bad))
    assert flight.body.vel == (0.0, 0.0, 0.0)
    assert flight.mode == "OFFBOARD"  # as recorded: the stream is alive
    assert flight.autopilot.snapshot.setpoints_rejected == 40


def test_nan_in_an_ignored_field_does_no_harm() -> None:
    flight = Flight().offboard()
    flight.run(0.2, setpoint(0x9C7, pos=(NAN, NAN, NAN), vel=(1.0, 0.0, 0.0), rate=NAN))
    assert flight.body.vel == pytest.approx((1.0, 0.0, 0.0))


def test_setpoints_outside_offboard_are_ignored_in_silence() -> None:
    flight = Flight().airborne()
    before = flight.body.pos
    assert flight.ask(velocity(3.0)) == []
    flight.run(2.0, velocity(3.0))
    assert flight.body.pos == pytest.approx(before, abs=0.2)


@pytest.mark.parametrize("mask", [0xFFF, 0xE3F, 0xDFF])
def test_a_setpoint_without_position_and_velocity_is_no_stream(mask: int) -> None:
    flight = Flight().airborne()
    flight.run(0.5, setpoint(mask))
    assert flight.command(SET_MODE, *OFFBOARD) == REJECTED


def test_other_frames_are_rejected() -> None:
    flight = Flight().airborne()
    message = velocity(1.0)
    message.coordinate_frame = 9
    flight.run(0.5, message)
    assert flight.autopilot.snapshot.setpoints_rejected == 10
    assert flight.command(SET_MODE, *OFFBOARD) == REJECTED


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
    for tick in range(0, 14_000, 4):
        now_s = tick / 1000.0
        autopilot.update(now_s)
        datagrams = autopilot.transmit(link, now_s)
        if tick < 4_000:
            continue
        for message in mav.MAVLink(None).parse_buffer(b"".join(datagrams)) or []:
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


# Missions: none, but nobody waits in vain


def test_the_mission_is_empty() -> None:
    (count,) = Flight().ask(mav.MAVLink_mission_request_list_message(1, 1, 1))
    assert (count.count, count.mission_type, count.target_system, count.target_component) == (0, 1, 1, 191)


@pytest.mark.parametrize(("count", "result"), [(3, 3), (0, 0)])
def test_an_upload_is_refused_unless_empty(count: int, result: int) -> None:
    (ack,) = Flight().ask(mav.MAVLink_mission_count_message(1, 1, count, 0))
    assert ack.type == result


def test_clearing_the_mission_works() -> None:
    (ack,) = Flight().ask(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    assert ack.type == mav.MAV_MISSION_ACCEPTED


def test_request_data_stream_is_ignored() -> None:
    assert Flight().ask(mav.MAVLink_request_data_stream_message(1, 1, 0, 10, 1)) == []


# Forwarding


def forwarded(flight: Flight, message: Any, link: Link) -> list[bytes]:
    """What a frame sent on `link` makes come out of the other, if it is that frame."""
    other = Link.GROUND if link is Link.ONBOARD else Link.ONBOARD
    flight.listen(other)
    frame = flight.send(message, link)
    sent = flight.autopilot.transmit(other, flight.now_s)
    return [datagram for datagram in sent if datagram == frame]


@pytest.mark.parametrize(
    ("message", "goes"),
    [
        (mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), True),
        (long(42001, component=191), True),
        (long(42001, component=0), True),
        (long(42001, component=1), False),
        (long(42001, system=2, component=191), False),
        (mav.MAVLink_param_request_list_message(1, 191), True),
    ],
)
def test_ground_to_companion(message: Any, goes: bool) -> None:
    assert bool(forwarded(Flight(), message, Link.GROUND)) is goes


@pytest.mark.parametrize(
    ("message", "goes"),
    [
        (mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), True),
        (mav.MAVLink_statustext_message(6, b"leader", 0, 0), True),
        (mav.MAVLink_command_ack_message(42001, 0, 0, 0, 255, 190), True),
        (long(400, 1.0, system=255, component=190), True),
        (velocity(1.0), False),
        (mav.MAVLink_timesync_message(0, 5), False),
        (long(400, 1.0), False),
    ],
)
def test_companion_to_ground(message: Any, goes: bool) -> None:
    assert bool(forwarded(Flight(), message, Link.ONBOARD)) is goes


def test_a_broadcast_command_is_forwarded_and_answered() -> None:
    flight = Flight()
    message = long(42001, component=0)
    (ack,) = flight.ask(message, Link.GROUND)
    assert ack.result == UNSUPPORTED


def test_a_vehicle_with_one_link_forwards_nowhere() -> None:
    flight = Flight(links={Link.ONBOARD: StreamProfile.MINIMAL})
    flight.send(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    assert flight.listen() != []


def test_its_own_messages_that_come_back_are_ignored() -> None:
    flight = Flight().ready()
    flight.codecs[Link.GROUND] = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    assert flight.ask(long(ARM, 1.0), Link.GROUND) == []
    assert flight.listen(Link.ONBOARD) == []


# Hostile bytes


def test_damaged_datagrams_never_raise() -> None:
    rng = random.Random(7)
    flight = Flight().offboard()
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    for _ in range(3000):
        kind = rng.choice(list(mav.mavlink_map.values()))
        frame = bytearray(rng.randbytes(kind.unpacker.size) if rng.random() < 0.5 else bytes(8))
        message = kind(*decoded(kind, bytes(frame)))
        data = bytearray(message.pack(codec))
        if rng.random() < 0.5:
            data[rng.randrange(len(data))] ^= rng.randrange(256)
        flight.autopilot.receive(rng.choice(list(Link)), bytes(data), flight.now_s)
        flight.run(STEP_S)


def decoded(kind: Any, payload: bytes) -> list[Any]:
    """Fields of a message in constructor order, from any bytes, addressed to the autopilot."""
    values = kind.unpacker.unpack(payload.ljust(kind.unpacker.size, b"\0")[: kind.unpacker.size])
    fields: dict[str, Any] = {}
    at = 0
    for name, length in zip(kind.ordered_fieldnames, lengths(kind), strict=True):
        if isinstance(values[at], bytes):
            fields[name] = values[at]
            at += 1
        else:
            fields[name] = values[at] if length <= 1 else list(values[at : at + length])
            at += max(length, 1)
    if "target_system" in fields:
        fields["target_system"] = 1
    if "target_component" in fields:
        fields["target_component"] = 1
    return [fields[name] for name in kind.fieldnames]


def lengths(kind: Any) -> list[int]:
    return list(kind.lengths)


@pytest.mark.parametrize("sysid", [0, 256])
def test_a_sysid_out_of_range_is_refused(sysid: int) -> None:
    with pytest.raises(ValueError, match=r"must be 1\.\.255"):
        Px4Autopilot(sysid, Body(), LocalFrame(ORIGIN))


def test_targets_are_silent_from_offboard_until_the_first_setpoint() -> None:
    """As in px4_pymavlink_A and _B; later, with stale setpoints, they go on."""
    flight = Flight(links=PROFILES).ready()
    assert flight.command(SET_MODE, *OFFBOARD) == ACCEPTED
    flight.heard[Link.ONBOARD].clear()
    flight.run(1.0)
    targets = {"SERVO_OUTPUT_RAW", "ATTITUDE_TARGET", "POSITION_TARGET_LOCAL_NED"}
    assert not targets & {m.get_type() for m in flight.heard[Link.ONBOARD]}
    flight.send(mav.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x5C7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    flight.run(3.0)
    flight.heard[Link.ONBOARD].clear()
    flight.run(1.0)
    assert targets <= {m.get_type() for m in flight.heard[Link.ONBOARD]}
