"""PX4's OFFBOARD and its setpoints. Figures: recorded flights of PX4 1.16."""

from __future__ import annotations

import math

import pytest

from tests.unit.world.autopilot.autopilot_kit import NAN
from tests.unit.world.autopilot.px4.px4_kit import (
    ACCEPTED,
    ARM,
    OFFBOARD,
    REJECTED,
    SET_MODE,
    Flight,
    setpoint,
    velocity,
)


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
