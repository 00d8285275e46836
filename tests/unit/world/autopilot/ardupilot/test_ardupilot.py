"""ArduCopter's readiness, arming and flight, as a client on the wire sees them. Figures: its recorded flights."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.mavlink import dialect as mav
from mission.document.model import Personality
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import (
    LandedState,
    Link,
    make_autopilot,
)
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from tests.unit.world.autopilot.ardupilot.ardupilot_kit import (
    ACCEPTED,
    ARM,
    BRAKE,
    FAILED,
    FORCE,
    GUIDED,
    LAND,
    LAND_MODE,
    LOITER,
    REQUEST,
    RTL,
    RTL_MODE,
    SET_INTERVAL,
    SET_MODE,
    STABILIZE,
    TAKEOFF,
    Flight,
    changes,
    velocity,
)
from tests.unit.world.autopilot.autopilot_kit import STEP_S, long

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


class Receiver(FaultyGnss):
    """One whose position comes back 6 m from where it had been reckoned."""

    OFF_M = 6.0

    @property
    def state(self) -> AirframeState:
        state = self._airframe.state
        north, east, down = state.pos_ned_m
        return replace(state, pos_ned_m=(north if self.has_fix else north + self.OFF_M, east, down))


@pytest.mark.parametrize("lands_first", [False, True])
def test_a_landing_without_a_position_seeks_none_when_it_is_back(lands_first: bool) -> None:
    """As ArduCopter: it flew there at 3.8 m/s, and met the ground so (search, seed 10009)."""
    flight = Flight()
    receiver = Receiver(flight.body, seed=1, vehicle_id=1)
    flight.autopilot = make_autopilot(Personality.ARDUPILOT, 1, receiver, flight.frame)
    flight.airborne()
    if lands_first:
        flight.command(LAND)
    receiver.set_fix(False)
    receiver._without_fix_s = math.inf
    flight.run(1.0)
    assert flight.mode == "LAND"
    assert "EKF Failsafe: changed to LAND Mode" in flight.texts()
    receiver.set_fix(True)
    sideways = []
    for _ in range(20):
        flight.run(0.1)
        sideways.append(math.hypot(*flight.body.state.vel_ned_mps[:2]))
    assert max(sideways) < 0.3
    assert flight.body.state.vel_ned_mps[2] > 0.4
