"""What is made of the messages in which simulators tell the truth."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as standard

from companion.core.model.states import LandedState
from companion.mavlink import dialect as mav
from mission.common.frames import Vec3, Wgs84
from mission.stand.stand import Stand
from sim_bridge.drive.external.autopilots import Telemetry
from sim_bridge.drive.external.truth import Truth, told_by
from sim_bridge.world.contacts import Contacts, Touched

ZEROS3 = (0.0, 0.0, 0.0)
RATES = (0.25, -0.5, 1.0)
HERE = Wgs84(47.397742, 8.545594, 488.5)
LAT, LON = 473_977_420, 85_455_940


def hil(quaternion: list[float], lat: int = LAT) -> Any:
    return standard.MAVLink_hil_state_quaternion_message(
        0, quaternion, *RATES, lat, LON, 488_500, 100, -200, 50, 0, 0, 0, 0, 0
    )


def sim_state(lat_int: int = LAT, lon_int: int = LON, yaw: float = 1.5) -> Any:
    attitude, place, vel = (0.1, -0.2, yaw), (47.3977, 8.5456, 488.5), (1.0, -2.0, 0.5)
    return standard.MAVLink_sim_state_message(
        1.0, *ZEROS3, *attitude, *ZEROS3, *RATES, *place, 0.0, 0.0, *vel, lat_int=lat_int, lon_int=lon_int
    )


def simstate() -> Any:
    return standard.MAVLink_simstate_message(0.1, -0.2, 1.5, *ZEROS3, *RATES, LAT, LON)


def estimate() -> Any:
    return standard.MAVLink_global_position_int_message(0, LAT + 50, LON, 490_000, 0, 30, 40, 50, 0)


def heard(*messages: Any) -> Telemetry:
    """After these, packed by the standard dialect and read by ours."""
    telemetry, sender, reader = Telemetry(), standard.MAVLink(None), mav.MAVLink(None)
    for m in messages:
        for read in reader.parse_buffer(bytearray(m.pack(sender))) or []:
            telemetry.receive_message(read, 7.0)
    return telemetry


def test_hil_state_quaternion_is_the_truth_in_si_units() -> None:
    half = math.sqrt(0.5)
    telemetry = heard(hil([half, 0.0, 0.0, half]))
    assert telemetry.truth is not None
    assert (telemetry.truth.position, telemetry.truth.vel_ned_mps) == (HERE, (1.0, -2.0, 0.5))
    assert telemetry.truth.attitude_rad == pytest.approx((0.0, 0.0, math.pi / 2.0))
    assert telemetry.truth.has_height
    assert telemetry.truth_s == 7.0
    assert telemetry.position is None  # no estimate


@pytest.mark.parametrize(("axis", "at"), [(0, 1), (1, 2), (2, 3)])
def test_quaternion_turns_about_each_axis(axis: int, at: int) -> None:
    quaternion = [math.cos(0.15), 0.0, 0.0, 0.0]
    quaternion[at] = math.sin(0.15)
    truth = heard(hil(quaternion)).truth
    wanted = [0.0, 0.0, 0.0]
    wanted[axis] = 0.3
    assert truth is not None
    assert truth.attitude_rad == pytest.approx(wanted, abs=1e-6)


def test_sim_state_is_the_truth_by_its_whole_degrees() -> None:
    truth = heard(sim_state()).truth
    assert truth is not None
    assert (truth.position, truth.vel_ned_mps) == (HERE, (1.0, -2.0, 0.5))
    assert truth.attitude_rad == pytest.approx((0.1, -0.2, 1.5))


def test_simstate_has_its_height_and_velocity_from_the_estimate() -> None:
    assert heard(simstate()).truth is None
    truth = heard(estimate(), simstate()).truth
    assert truth is not None
    assert truth.position == Wgs84(HERE.lat_deg, HERE.lon_deg, 490.0)
    assert truth.vel_ned_mps == (0.3, 0.4, 0.5)
    assert truth.attitude_rad == pytest.approx((0.1, -0.2, 1.5))
    assert not truth.has_height


@pytest.mark.parametrize("told", [hil([1.0, 0.0, 0.0, 0.0]), sim_state(), simstate()])
def test_rates_are_told_with_the_truth_and_by_the_autopilot(told: Any) -> None:
    attitude = standard.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, *RATES)
    telemetry = heard(estimate(), attitude, told)
    assert telemetry.truth is not None
    assert telemetry.truth.rates_radps == telemetry.rates_radps == RATES
    no_rates = standard.MAVLink_attitude_message(0, 0.1, 0.0, 0.0, math.nan, 0.0, 0.0)
    assert (heard(no_rates).attitude_rad[0], heard(no_rates).rates_radps) == (pytest.approx(0.1), ZEROS3)


def test_simstate_is_not_taken_beside_sim_state() -> None:
    truth = heard(estimate(), simstate(), sim_state(), simstate()).truth
    assert truth is not None
    assert truth.has_height


@pytest.mark.parametrize(
    "message",
    [
        hil([0.0, 0.0, 0.0, 0.0]),
        hil([math.nan, 0.0, 0.0, 0.0]),
        hil([1.0, 0.0, 0.0, 0.0], lat=2**31 - 1),
        sim_state(lat_int=0, lon_int=0),
        sim_state(yaw=math.nan),
    ],
)
def test_what_makes_no_sense_is_no_truth(message: Any) -> None:
    telemetry = heard(message)
    assert (telemetry.truth, telemetry.truth_s) == (None, -math.inf)


@pytest.mark.parametrize("told", [True, False])
def test_a_hard_fall_is_seen_when_the_truth_tells_it_long_before_the_autopilot_has_landed(told: bool) -> None:
    """From 10 m, looked at 20 times a second; the land detector needs 1 s."""
    telemetry, contacts, found = Telemetry(), Contacts(Stand()), []
    down_mps, up_m = 0.0, 10.0

    def tell(up_m: float, down_mps: float, landed: LandedState) -> None:
        place, vel = (LAT, LON, round(1e3 * (488.0 + up_m))), (0, 0, round(100.0 * down_mps))
        messages = [
            standard.MAVLink_extended_sys_state_message(0, landed),
            standard.MAVLink_global_position_int_message(0, *place, 0, *vel, 0),
        ]
        if told:
            quaternion = [1.0, 0.0, 0.0, 0.0]
            messages.append(
                standard.MAVLink_hil_state_quaternion_message(0, quaternion, *RATES, *place, *vel, *[0] * 5)
            )
        for m in messages:
            telemetry.receive_message(m, 7.0)

    tell(0.0, 0.0, LandedState.ON_GROUND)
    since = 0
    for _ in range(60):
        if up_m > 0.0:
            down_mps += 9.81 * 0.05
            up_m = max(0.0, up_m - down_mps * 0.05)
        since += up_m == 0.0
        speed_mps = down_mps if up_m else 0.0
        tell(up_m, speed_mps, LandedState.ON_GROUND if since > 20 else LandedState.IN_AIR)
        place: Vec3 = (0.0, 0.0, -up_m)
        found.append(contacts.find_contact(1, place, (0.0, 0.0, speed_mps), on_ground=telemetry.is_down))
    assert found.count(Touched.GROUND) == told
    assert telemetry.on_ground


def test_verdict_words_name_what_rests_on_estimates() -> None:
    full, level = Truth(HERE, ZEROS3, ZEROS3), Truth(HERE, ZEROS3, ZEROS3, has_height=False)
    assert told_by((1, 2), {1: full, 2: full}) == ""
    assert told_by((1, 2), {}) == "by estimates"
    assert told_by((1, 2), {1: level, 2: level}) == "heights by estimates"
    assert told_by((1, 2, 3), {1: full, 2: level}) == "by estimates of 3, heights by estimates of 2"
