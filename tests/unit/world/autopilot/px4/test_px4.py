"""PX4's readiness, commands and modes, as a client on the wire sees them. Figures: recorded flights of PX4 1.16."""

from __future__ import annotations

import math

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from sim_bridge.world.autopilot import (
    LandedState,
    Link,
    Px4Autopilot,
    Px4Mode,
)
from tests.unit.world.autopilot.autopilot_kit import NAN, ORIGIN, STEP_S, long
from tests.unit.world.autopilot.px4.px4_kit import (
    ACCEPTED,
    ARM,
    DENIED,
    FAILED,
    LAND,
    REJECTED,
    REPOSITION,
    REQUEST,
    SET_INTERVAL,
    SET_MODE,
    TAKEOFF,
    UNSUPPORTED,
    Body,
    Flight,
)

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
