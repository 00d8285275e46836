"""A GNSS that fails: what the estimator goes by then, and what a velocity from outside changes."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot.estimates.gnss_faults import RECKONS_S, FaultyGnss
from tests.unit.world.autopilot.px4.px4_kit import Flight

STEP_S = 0.05


def flying() -> FaultyGnss:
    """Hovers where it believes to hover."""
    body = PointMass((0.0, 0.0, -5.0), 0.0, ground_down_m=0.0)
    body.set_armed(True)
    gnss = FaultyGnss(body, seed=3, vehicle_id=1)
    gnss.command((0.0, 0.0, 0.0), 0.0)
    return gnss


def run(gnss: FaultyGnss, lasts_s: float, *, told: bool, every: int = 2) -> None:
    """`told`: the true velocity, with every second step."""
    for k in range(round(lasts_s / STEP_S)):
        gnss.command((0.0, 0.0, 0.0), 0.0)
        gnss.step(STEP_S)
        if told and k % every == 0:
            vel = gnss._airframe.state.vel_ned_mps
            gnss.receive_velocity((vel[0], vel[1]))


def drift_mps(gnss: FaultyGnss) -> float:
    return math.hypot(*gnss._airframe.state.vel_ned_mps[:2])


def test_by_inertial_sensors_alone_the_position_is_given_up_after_five_seconds() -> None:
    gnss = flying()
    gnss.set_fix(False)
    run(gnss, RECKONS_S - 0.1, told=False)
    assert gnss.has_position
    run(gnss, 0.2, told=False)
    assert not gnss.has_position


def test_a_velocity_from_outside_keeps_the_position_and_holds_the_drift() -> None:
    alone, told = flying(), flying()
    for gnss in (alone, told):
        gnss.set_fix(False)
    run(alone, 4.5, told=False)
    run(told, 4.5, told=True)
    assert drift_mps(told) < 0.5 * drift_mps(alone)
    run(told, 30.0, told=True)
    assert told.has_position
    assert drift_mps(told) < 0.5
    run(told, RECKONS_S + 0.1, told=False)
    assert not told.has_position


def test_with_a_fix_it_is_of_no_account() -> None:
    gnss = flying()
    run(gnss, 1.0, told=True)
    gnss.receive_velocity((5.0, 5.0))
    run(gnss, 0.1, told=False)
    assert gnss.state.vel_ned_mps[:2] == pytest.approx(gnss._airframe.state.vel_ned_mps[:2])


def odometry(vx: float, child_frame: int) -> Any:
    """ODOMETRY with a velocity alone."""
    unknown = (math.nan,) * 21
    place = (math.nan, math.nan, math.nan)
    return mav.MAVLink_odometry_message(
        0, mav.MAV_FRAME_LOCAL_NED, child_frame, *place, (math.nan,) * 4, vx, 0.0, 0.0, *place, unknown, unknown
    )


@pytest.mark.parametrize(
    ("parameters", "told", "keeps"),
    [
        ({}, (0.0, mav.MAV_FRAME_LOCAL_NED), True),  # EKF2_EV_CTRL 15: PX4's default
        ({"EKF2_EV_CTRL": 4}, (0.0, mav.MAV_FRAME_LOCAL_NED), True),
        ({"EKF2_EV_CTRL": 11}, (0.0, mav.MAV_FRAME_LOCAL_NED), False),
        ({}, (math.nan, mav.MAV_FRAME_LOCAL_NED), False),
        ({}, (0.0, mav.MAV_FRAME_BODY_FRD), False),
    ],
)
def test_px4_flies_on_by_odometry_where_it_is_set_to_and_can_read_it(
    parameters: dict[str, float], told: tuple[float, int], keeps: bool
) -> None:
    flight = Flight(parameters, gnss_fails=True).airborne()
    assert isinstance(flight.body, FaultyGnss)
    flight.body.set_fix(False)
    flight.run(RECKONS_S + 1.0, odometry(*told))
    assert flight.body.has_position is keeps
    assert ("position lost" in flight.texts()) is not keeps
