"""Whole flights of the PX4 autopilot on a point mass, as a companion on the wire flies them.

Compare with the recorded flights of PX4 1.16 in software-in-the-loop that each test names.
"""

from __future__ import annotations

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from tests.unit.world.autopilot.px4.px4_pilot import (
    ACCEPTED,
    ARM,
    HOLD,
    LAND,
    NAN,
    OFFBOARD,
    ORIGIN,
    REJECTED,
    REPOSITION,
    RTL,
    SET_MODE,
    STEP_S,
    TAKEOFF,
    Pilot,
)


def test_the_flight_of_px4_pymavlink_a() -> None:
    pilot = Pilot()
    pilot.fly(1.5)
    assert pilot.command(ARM, 1.0) == REJECTED  # too early
    pilot.fly(3.0)
    assert pilot.command(SET_MODE, *OFFBOARD) == ACCEPTED  # disarmed, no setpoints: does not show
    pilot.fly(0.5)
    assert pilot.command(TAKEOFF, *[NAN] * 7) == ACCEPTED  # disarmed
    pilot.fly(2.0)
    assert pilot.command(ARM, 1.0) == ACCEPTED
    pilot.fly(1.5)
    assert pilot.command(TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + 4.7) == ACCEPTED
    pilot.fly(9.0)
    assert pilot.height_m == pytest.approx(4.7, abs=0.1)
    pilot.go_offboard()
    pilot.fly(5.0, (0.4, 0.4, -0.4))
    assert pilot.speed_ned_mps == pytest.approx((0.4, 0.4, -0.4), abs=0.01)
    pilot.fly(4.0, (3.0, 0.0, 0.0))
    assert pilot.speed_ned_mps == pytest.approx((3.0, 0.0, 0.0), abs=0.01)
    pilot.fly(3.0, (0.0, 0.0, 0.0))
    assert pilot.command(LAND, 0, 0, 0, NAN, NAN, NAN, NAN) == ACCEPTED
    pilot.fly_until_disarmed(30.0)
    pilot.fly(1.1)
    assert pilot.landed_states == [1, 3, 2, 4, 1]
    assert pilot.modes == [
        (0x3040000, 0),
        (0x3040000, 3),
        (0x2040000, 3),
        (0x2040000, 4),
        (0x3040000, 4),
        (0x60000, 4),
        (0x6040000, 4),
        (0x60000, 0),  # back to the mode before, which without setpoints is not ready
    ]


def test_takeoff_climbs_at_1_2_to_1_3_m_s_as_recorded_and_stays_where_it_stood() -> None:
    pilot = Pilot()
    pilot.fly(5.0)
    pilot.command(TAKEOFF, *[NAN] * 6, ORIGIN.alt_m + 10.0)
    pilot.command(ARM, 1.0)
    fastest_mps = 0.0
    for _ in range(400):
        pilot.fly(STEP_S)
        fastest_mps = max(fastest_mps, -pilot.speed_ned_mps[2])
    assert 1.2 < fastest_mps < 1.3
    assert pilot.body.state.pos_ned_m == pytest.approx((12.0, -7.0, -10.0), abs=0.1)


def test_default_takeoff_height_is_mis_takeoff_alt() -> None:
    pilot = Pilot({"MIS_TAKEOFF_ALT": 4.0})
    pilot.fly(5.0)
    pilot.command(TAKEOFF, *[NAN] * 7)
    pilot.command(ARM, 1.0)
    pilot.fly(12.0)
    assert pilot.height_m == pytest.approx(4.0, abs=0.05)


def test_arming_in_offboard_and_climbing_works_as_in_px4_offboard_takeoff() -> None:
    pilot = Pilot()
    pilot.fly(5.0)
    pilot.fly(1.0, (0.0, 0.0, -0.7))
    assert pilot.command(SET_MODE, *OFFBOARD) == ACCEPTED
    pilot.fly(1.0, (0.0, 0.0, -0.7))
    assert pilot.command(ARM, 1.0) == ACCEPTED
    pilot.fly(10.0, (0.0, 0.0, -0.7))
    assert pilot.speed_ned_mps == pytest.approx((0.0, 0.0, -0.7), abs=0.01)
    assert 2.5 < pilot.height_m < 4.5  # recorded: 3.0 m
    assert pilot.command(ARM, 0.0) == REJECTED
    assert pilot.landed_states == [1, 2]  # never 3: that is the TAKEOFF mode's


def test_landing_slows_down_twice_crawls_to_the_ground_and_disarms_after_com_disarm_land() -> None:
    pilot = Pilot().take_off(15.0)
    pilot.command(LAND)
    pilot.fly(3.0)
    assert 1.2 < pilot.speed_ned_mps[2] < 1.3  # high above the ground
    while pilot.height_m > 2.0:
        pilot.fly(STEP_S)
    assert 0.5 < pilot.speed_ned_mps[2] < 0.7
    while pilot.height_m > 0.2:
        pilot.fly(STEP_S)
    assert pilot.speed_ned_mps[2] == pytest.approx(0.3, abs=0.02)
    while not pilot.body.state.on_ground:
        pilot.fly(STEP_S)
    assert 4.0 <= pilot.fly_until_disarmed(6.0) <= 5.0  # called landed, then disarmed
    assert pilot.mode == "HOLD"  # the one before


def test_hold_stops_and_stays() -> None:
    pilot = Pilot().take_off().go_offboard((3.0, 0.0, 0.0))
    assert pilot.command(SET_MODE, *HOLD) == ACCEPTED
    before = pilot.body.state.pos_ned_m
    pilot.fly(15.0)
    after = pilot.body.state.pos_ned_m
    assert 0.5 < after[0] - before[0] < 3.0
    assert pilot.speed_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_reposition_flies_there_and_holds() -> None:
    pilot = Pilot().take_off()
    target = LocalFrame(ORIGIN).to_wgs84((30.0, 10.0, -8.0))
    message = mav.MAVLink_command_int_message(
        3, 1, 0, REPOSITION, 0, 0, -1.0, 1.0, 0.0, NAN, round(target.lat_deg * 1e7),
        round(target.lon_deg * 1e7), target.alt_m,
    )  # fmt: skip
    pilot.send(message)
    pilot.fly(20.0)
    assert pilot.acks[-1] == (REPOSITION, ACCEPTED)
    assert pilot.body.state.pos_ned_m == pytest.approx((30.0, 10.0, -8.0), abs=0.1)
    assert pilot.mode == "HOLD"


def test_return_climbs_flies_home_and_lands() -> None:
    pilot = Pilot({"RTL_RETURN_ALT": 12.0}).take_off().go_offboard((6.0, 0.0, 0.0))
    assert pilot.command(RTL) == ACCEPTED
    highest_m = 0.0
    while pilot.armed:
        assert pilot.now_s < 120.0
        pilot.fly(STEP_S)
        highest_m = max(highest_m, pilot.height_m)
    assert highest_m == pytest.approx(12.0, abs=0.5)
    assert pilot.body.state.pos_ned_m == pytest.approx((12.0, -7.0, 0.0), abs=0.5)
    assert pilot.landed_states == [1, 3, 2, 4, 1]
