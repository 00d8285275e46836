"""PX4's failsafes on a point mass, in flight: lost setpoints, battery, fence, ground station."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot import BatterySpec, Failsafe, Link
from tests.unit.world.autopilot.px4.px4_pilot import (
    ACCEPTED,
    ARM,
    HOLD,
    LAND,
    NAN,
    OFFBOARD,
    ORIGIN,
    REJECTED,
    SET_MODE,
    STEP_S,
    TAKEOFF,
    Pilot,
)

# What happens when setpoints stop at 0.7 m/s: the recorded px4_loss_* flights


def lose_stream(parameters: Mapping[str, float], silent_s: float = 2.0) -> Pilot:
    pilot = Pilot(parameters).take_off(8.0).go_offboard((0.4, 0.4, -0.4))
    pilot.fly(silent_s)
    return pilot


def test_the_failsafe_waits_for_com_of_loss_t() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 5}, silent_s=0.9)
    assert pilot.mode == "OFFBOARD"
    pilot.fly(0.2)
    assert pilot.mode == "HOLD"
    quick = lose_stream({"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 0.5}, silent_s=0.6)
    assert quick.mode == "HOLD"


def test_loss_by_default_is_an_emergency_descent_that_drifts_lands_and_disarms() -> None:
    pilot = lose_stream({}, silent_s=3.0)
    assert pilot.modes[-1] == (0x30000, mav.MAV_STATE_CRITICAL)
    assert pilot.speed_ned_mps[2] == pytest.approx(0.65, abs=0.02)
    assert math.hypot(*pilot.speed_ned_mps[:2]) > 0.2
    pilot.fly_until_disarmed(25.0)
    pilot.fly(1.1)
    assert pilot.modes[-1] == (0x60000, mav.MAV_STATE_UNINIT)
    assert pilot.landed_states == [1, 3, 2, 1]  # never 4: it is no landing


def test_loss_with_act_5_holds() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 5}, silent_s=10.0)
    assert pilot.modes[-1] == (0x3040000, mav.MAV_STATE_CRITICAL)
    assert pilot.speed_ned_mps == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_loss_with_act_4_lands() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 4})
    assert pilot.modes[-1] == (0x6040000, mav.MAV_STATE_CRITICAL)
    assert pilot.landed_states[-1] == 4
    pilot.fly_until_disarmed(30.0)


def test_loss_with_act_3_near_home_lands_there() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 3})
    assert pilot.modes[-1] == (0x5040000, mav.MAV_STATE_CRITICAL)
    pilot.fly_until_disarmed(60.0)
    assert pilot.body.state.pos_ned_m == pytest.approx((12.0, -7.0, 0.0), abs=0.6)


@pytest.mark.parametrize("action", [0, 3, 4, 5])
def test_when_setpoints_resume_it_goes_back_to_offboard_by_itself(action: int) -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": action})
    assert pilot.mode != "OFFBOARD"
    pilot.fly(2.0, (0.0, 0.0, -0.5))
    assert pilot.mode == "OFFBOARD"
    assert pilot.autopilot.snapshot.failsafe is None
    assert pilot.speed_ned_mps == pytest.approx((0.0, 0.0, -0.5), abs=0.05)


def test_it_does_not_go_back_after_the_user_chose_a_mode() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 5})
    assert pilot.command(LAND) == ACCEPTED
    pilot.fly(1.1, (0.0, 0.0, -0.5))
    assert pilot.mode == "LAND"
    assert pilot.modes[-1] == (0x6040000, mav.MAV_STATE_ACTIVE)


def test_loss_with_act_7_disarms_in_the_air() -> None:
    pilot = lose_stream({"COM_OBL_RC_ACT": 7})
    assert not pilot.armed
    assert pilot.autopilot.snapshot.failsafe is Failsafe.TERMINATED


def test_termination_is_for_good() -> None:
    pilot = Pilot().take_off()
    assert pilot.command(185, 1.0) == ACCEPTED
    pilot.fly(5.0)
    assert pilot.height_m == 0.0
    assert pilot.command(ARM, 1.0, 21196.0) == REJECTED
    assert pilot.command(SET_MODE, *HOLD) == REJECTED
    assert pilot.command(TAKEOFF, *[NAN] * 7) == REJECTED
    pilot.fly(1.1)
    assert pilot.modes[-1][1] == mav.MAV_STATE_FLIGHT_TERMINATION


# The other failsafes


def test_a_critical_battery_lands_when_com_low_bat_act_is_2() -> None:
    battery = BatterySpec(capacity_mah=400.0, remaining=0.45)
    pilot = Pilot({"COM_LOW_BAT_ACT": 2}, battery).take_off()
    while pilot.autopilot.snapshot.battery_remaining >= 0.07:
        pilot.fly(STEP_S)
    pilot.fly(0.1)
    assert pilot.mode == "LAND"
    assert pilot.autopilot.snapshot.failsafe is Failsafe.BATTERY
    assert "Low battery" in pilot.texts


def test_a_critical_battery_only_warns_by_default() -> None:
    pilot = Pilot(battery=BatterySpec(capacity_mah=400.0, remaining=0.4)).take_off()
    pilot.fly(60.0)
    assert pilot.mode == "HOLD"
    assert [text for text in pilot.texts if "attery" in text] == [
        "Low battery",
        "Critical battery",
        "Dangerous battery level",
    ]


def test_the_fence_stops_the_vehicle_and_offboard_may_be_asked_for_again() -> None:
    pilot = Pilot({"GF_MAX_HOR_DIST": 5.0}).take_off().go_offboard()
    pilot.fly(6.0, (1.5, 0.0, 0.0))
    assert pilot.mode == "HOLD"
    assert pilot.autopilot.snapshot.failsafe is Failsafe.GEOFENCE
    assert pilot.command(SET_MODE, *OFFBOARD) == ACCEPTED
    pilot.fly(6.0, (-1.5, 0.0, 0.0))
    assert pilot.mode == "OFFBOARD"
    pilot.fly(8.0, (1.5, 0.0, 0.0))
    assert pilot.mode == "HOLD"


def test_a_lost_ground_station_holds_when_nav_dll_act_is_1() -> None:
    pilot = Pilot({"NAV_DLL_ACT": 1})
    ground = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    pilot.autopilot.receive(Link.GROUND, beat.pack(ground), pilot.now_s)
    pilot.take_off(3.0)
    pilot.autopilot.receive(Link.GROUND, beat.pack(ground), pilot.now_s)
    pilot.go_offboard()
    pilot.fly(6.0, (0.0, 0.0, 0.0))
    assert pilot.mode == "OFFBOARD"
    pilot.fly(2.0, (0.0, 0.0, 0.0))
    assert pilot.mode == "HOLD"
    assert pilot.autopilot.snapshot.failsafe is Failsafe.GCS_LOSS


def test_the_same_flight_gives_the_same_bytes() -> None:
    def flight() -> bytes:
        pilot = lose_stream({"COM_OBL_RC_ACT": 4})
        pilot.fly_until_disarmed(60.0)
        return pilot.log

    assert flight() == flight()


def test_a_takeoff_lower_than_its_acceptance_still_leaves_the_ground() -> None:
    pilot = Pilot()
    pilot.fly(5.0)
    pilot.command(TAKEOFF, *[NAN] * 6, ORIGIN.alt_m + 0.6)
    pilot.command(ARM, 1.0)
    pilot.fly(15.0)
    assert pilot.height_m == pytest.approx(0.6, abs=0.05)
    assert pilot.mode == "HOLD"


def test_a_takeoff_called_off_on_the_ground_disarms() -> None:
    pilot = Pilot()
    pilot.fly(5.0)
    pilot.fly(0.5, (0.0, 0.0, -0.7))
    pilot.command(SET_MODE, *OFFBOARD)
    pilot.command(ARM, 1.0)
    pilot.fly(2.2, (0.0, 0.0, -0.7))  # spool-up, and the ramp's first second
    pilot.fly(5.5, (0.0, 0.0, 0.0))
    assert not pilot.armed
    assert pilot.height_m == 0.0


def test_setpoints_at_0_9_hz_trip_and_end_the_failsafe_again_and_again() -> None:
    """As in px4_pymavlink_kdv0.2: after a loss one setpoint is enough."""
    pilot = Pilot().take_off().go_offboard()
    seen = []
    for _ in range(4):
        pilot.fly(STEP_S, (0.3, 0.0, 0.0))
        seen.append(pilot.mode)
        pilot.fly(1.1 - STEP_S)
        seen.append(pilot.mode)
    assert seen == ["OFFBOARD", "POSCTL"] * 4
