"""Whole flights of the PX4 autopilot on a point mass, as a companion on the wire flies them.

Compare with the recorded flights of PX4 1.16 in software-in-the-loop that each test names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.frames import LocalFrame, Wgs84
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import BatterySpec, Failsafe, Link, Px4Autopilot, StreamProfile

ORIGIN = Wgs84(47.3977, 8.5456, 488.0)
STEP_S = 0.05
NAN = math.nan
ARM, SET_MODE, TAKEOFF, LAND, RTL, REPOSITION = 400, 176, 22, 21, 20, 192
OFFBOARD = (1.0, 6.0)
HOLD = (1.0, 4.0, 3.0)
ACCEPTED, REJECTED = 0, 1


class Pilot:
    """A companion that flies one vehicle and keeps a log of what it hears."""

    def __init__(self, parameters: Mapping[str, float] | None = None, battery: BatterySpec | None = None) -> None:
        self.body = PointMass((12.0, -7.0, 0.0), 0.5)
        links = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}
        self.autopilot = Px4Autopilot(
            3, self.body, LocalFrame(ORIGIN), parameters=parameters, links=links, battery=battery
        )
        self.codec = mav.MAVLink(None, srcSystem=3, srcComponent=191)
        self.steps = 0
        self.landed_states: list[int] = []
        self.modes: list[tuple[int, int]] = []  # custom_mode, system_status of HEARTBEAT
        self.acks: list[tuple[int, int]] = []
        self.texts: list[str] = []
        self.log = b""
        self.command(511, 245.0, 50_000.0)

    @property
    def now_s(self) -> float:
        return self.steps * STEP_S

    @property
    def height_m(self) -> float:
        return -self.body.state.pos_ned_m[2]

    @property
    def speed_ned_mps(self) -> tuple[float, float, float]:
        return self.body.state.vel_ned_mps

    @property
    def mode(self) -> str:
        return self.autopilot.snapshot.mode

    @property
    def armed(self) -> bool:
        return self.autopilot.snapshot.armed

    def send(self, message: Any) -> None:
        self.autopilot.receive(Link.ONBOARD, message.pack(self.codec), self.now_s)

    def command(self, number: int, *params: float) -> int:
        """The result in the acknowledgement."""
        self.send(mav.MAVLink_command_long_message(3, 1, number, 0, *params, *[0.0] * (7 - len(params))))
        self._listen()
        assert self.acks[-1][0] == number
        return self.acks[-1][1]

    def fly(self, seconds: float, velocity: tuple[float, float, float] | None = None) -> None:
        """With a velocity setpoint at 20 Hz, or without."""
        for _ in range(round(seconds / STEP_S)):
            if velocity is not None:
                self.send(
                    mav.MAVLink_set_position_target_local_ned_message(
                        0, 3, 1, 1, 0x5C7, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
                    )
                )
            self.autopilot.update(self.now_s)
            self.body.step(STEP_S)
            self.steps += 1
            self._listen()

    def fly_until_disarmed(self, at_most_s: float) -> float:
        """Seconds it took."""
        begin_s = self.now_s
        while self.armed:
            assert self.now_s - begin_s < at_most_s
            self.fly(STEP_S)
        return self.now_s - begin_s

    def _listen(self) -> None:
        for link in Link:
            for datagram in self.autopilot.transmit(link, self.now_s):
                self.log += datagram
                for message in mav.MAVLink(None).parse_buffer(datagram) or []:
                    self._note(link, message)

    def _note(self, link: Link, message: Any) -> None:
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.texts.append(message.text.rstrip("\t"))
        if link is Link.GROUND:
            return
        if kind == "COMMAND_ACK":
            self.acks.append((message.command, message.result))
        elif kind == "EXTENDED_SYS_STATE" and self.landed_states[-1:] != [message.landed_state]:
            self.landed_states.append(message.landed_state)
        elif kind == "HEARTBEAT":
            shown = (message.custom_mode, message.system_status)
            if self.modes[-1:] != [shown]:
                self.modes.append(shown)

    def take_off(self, height_m: float = 5.0) -> Pilot:
        self.fly(5.0)
        assert self.command(ARM, 1.0) == ACCEPTED
        assert self.command(TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, ORIGIN.alt_m + height_m) == ACCEPTED
        self.fly(6.0 + height_m)
        assert self.mode == "HOLD"
        return self

    def go_offboard(self, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pilot:
        self.fly(0.2, (0.0, 0.0, 0.0))
        assert self.command(SET_MODE, *OFFBOARD) == ACCEPTED
        self.fly(3.0, velocity)
        return self


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
