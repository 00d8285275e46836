"""The airframes in flight: steps, winds, take-off and landing."""

from __future__ import annotations

import math
import random
import subprocess
import sys

import pytest

from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.document.model import Drag
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.airframe.wind import CALM, Wind
from tests.unit.world import airframe_kit
from tests.unit.world.airframe_kit import FRAME, GUSTY, SAMPLE_S, STILL, gusty_flight, hovering, record


def tilt_deg(state: AirframeState) -> float:
    return math.degrees(math.hypot(state.attitude_rad[0], state.attitude_rad[1]))


def progress(states: list[AirframeState], start_mps: Vec3, end_mps: Vec3) -> list[float]:
    """How much of the step of velocity is done, 0..1, along it."""
    step = [end - start for start, end in zip(start_mps, end_mps, strict=True)]
    length = math.hypot(*step)
    return [
        sum((v - v0) * d for v, v0, d in zip(state.vel_ned_mps, start_mps, step, strict=True)) / length**2
        for state in states
    ]


def time_to_s(done: list[float], share: float) -> float:
    return next(i for i, value in enumerate(done, start=1) if value >= share) * SAMPLE_S


# With the drag of PX4's SIH: of a step to 3 m/s PX4 reached 2.16 m/s after 2.5 s, 0.86-0.88 after 6 s, 2.9 after 15 s.


@pytest.mark.parametrize("make", [JsbsimQuad, PointMass])
def test_with_the_drag_of_sih_a_step_is_followed_as_slowly_as_by_px4(make: type[JsbsimQuad | PointMass]) -> None:
    at = {"pos_ned_m": (0.0, 0.0, -40.0), "yaw_rad": 0.0, "drag": Drag.SIH}
    body: Airframe = JsbsimQuad(FRAME, **at) if make is JsbsimQuad else PointMass(**at)
    body.set_armed(True)
    record(body, 8.0)
    body.command((3.0, 0.0, 0.0), 0.0)
    north_mps = [state.vel_ned_mps[0] for state in record(body, 15.0)]
    assert north_mps[round(2.5 / SAMPLE_S) - 1] == pytest.approx(2.16, abs=0.06)
    assert north_mps[round(6.0 / SAMPLE_S) - 1] == pytest.approx(0.87 * 3.0, abs=0.06)
    assert north_mps[-1] == pytest.approx(2.9, abs=0.03)
    assert max(north_mps) < 3.0
    assert body.state.pos_ned_m[2] == pytest.approx(-40.0, abs=0.1)


def test_with_the_drag_of_sih_a_point_mass_lands_lifts_off_and_does_not_depend_on_its_step() -> None:
    ends = []
    for dt_s in (0.01, 0.1):
        body = PointMass((0.0, 0.0, -2.0), 0.0, drag=Drag.SIH)
        body.set_armed(True)
        for down_mps, seconds in ((0.5, 10.0), (-1.0, 8.0)):
            body.command((1.0, 0.0, down_mps), 0.0)
            for _ in range(round(seconds / dt_s)):
                body.step(dt_s)
            if down_mps > 0.0:
                assert body.state.on_ground
                assert body.state.vel_ned_mps == STILL
        ends.append(body.state)
    assert ends[0].vel_ned_mps == pytest.approx(ends[1].vel_ned_mps, abs=0.01)
    assert ends[0].pos_ned_m[2] == pytest.approx(ends[1].pos_ned_m[2], abs=0.1)
    assert ends[0].pos_ned_m[2] == pytest.approx(-7.0, abs=0.5)


# Velocity steps: between the two autopilots of the reference, whose t10, t63, t90 these brackets enclose.


@pytest.mark.parametrize("rate_hz", [200, 400])
@pytest.mark.parametrize(
    ("vel_ned_mps", "t10_s", "t63_s", "t90_s"),
    [
        ((3.0, 0.0, 0.0), (0.25, 0.5), (0.6, 1.12), (1.0, 1.7)),
        ((0.0, -3.0, 0.0), (0.25, 0.5), (0.6, 1.12), (1.0, 1.7)),
        ((-2.1, 2.1, 0.0), (0.25, 0.5), (0.6, 1.12), (1.0, 1.7)),
        ((0.5, 0.0, -0.5), (0.19, 0.3), (0.45, 0.75), (0.85, 1.35)),
    ],
)
def test_velocity_step_and_stop_settle_without_overshoot(
    vel_ned_mps: Vec3,
    t10_s: tuple[float, float],
    t63_s: tuple[float, float],
    t90_s: tuple[float, float],
    rate_hz: int,
) -> None:
    quad = hovering(rate_hz=rate_hz)
    for start_mps, end_mps in ((STILL, vel_ned_mps), (vel_ned_mps, STILL)):
        quad.command(end_mps, 0.0)
        states = record(quad, 6.0)
        done = progress(states, start_mps, end_mps)
        assert t10_s[0] <= time_to_s(done, 0.1) <= t10_s[1]
        assert t63_s[0] <= time_to_s(done, 0.63) <= t63_s[1]
        assert t90_s[0] <= time_to_s(done, 0.9) <= t90_s[1]
        assert max(done) < 1.05
        assert math.dist(states[-1].vel_ned_mps, end_mps) < 0.01 * math.hypot(*vel_ned_mps)
        if vel_ned_mps[2] == 0.0:
            assert max(state.pos_ned_m[2] for state in states) - states[0].pos_ned_m[2] < 0.1


@pytest.mark.parametrize("vel_ned_mps", [(5.0, 0.0, 0.0), (0.0, 0.0, -3.0), (0.0, 0.0, 2.0), (3.0, 4.0, -3.0)])
def test_fastest_speeds_are_reached_and_held(vel_ned_mps: Vec3) -> None:
    quad = hovering()
    quad.command(vel_ned_mps, 0.0)
    assert math.dist(record(quad, 6.0)[-1].vel_ned_mps, vel_ned_mps) < 0.05


def test_reversal_at_full_speed_keeps_height_and_tilt() -> None:
    quad = hovering()
    quad.command((5.0, 0.0, 0.0), 0.0)
    quad.step(5.0)
    quad.command((-5.0, 0.0, 0.0), 0.0)
    states = record(quad, 8.0)
    assert max(tilt_deg(state) for state in states) < 30.0
    assert max(state.pos_ned_m[2] for state in states) - states[0].pos_ned_m[2] < 0.3
    assert states[-1].vel_ned_mps[0] == pytest.approx(-5.0, abs=0.05)


def test_hover_in_calm_does_not_drift() -> None:
    quad = hovering()
    before = quad.state.pos_ned_m
    quad.step(30.0)
    assert math.dist(quad.state.pos_ned_m, before) < 0.02
    assert tilt_deg(quad.state) < 0.01


def test_commands_that_change_at_20_hz_are_followed() -> None:
    rng = random.Random(1)
    quad = hovering()
    for _ in range(200):
        quad.command((rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(-1, 1)), rng.uniform(-4, 4))
        quad.step(0.05)
        assert tilt_deg(quad.state) < 35.0
        assert math.hypot(*quad.state.vel_ned_mps) < 4.0
    quad.command((1.0, 1.0, 0.0), 0.0)
    quad.step(5.0)
    assert math.dist(quad.state.vel_ned_mps, (1.0, 1.0, 0.0)) < 0.05


@pytest.mark.parametrize("vel_ned_mps", [STILL, (3.0, 0.0, 0.0), (2.0, -2.0, -1.0)])
def test_half_a_turn_does_not_disturb_the_velocity(vel_ned_mps: Vec3) -> None:
    quad = hovering()
    quad.command(vel_ned_mps, 0.0)
    quad.step(6.0)
    quad.command(vel_ned_mps, math.pi)
    states = record(quad, 6.0)
    assert max(math.dist(state.vel_ned_mps, vel_ned_mps) for state in states) < 0.1
    assert abs(states[-1].attitude_rad[2]) == pytest.approx(math.pi, abs=0.01)


def test_turn_takes_the_short_way_across_south() -> None:
    quad = JsbsimQuad(FRAME, (0.0, 0.0, -10.0), 3.0)
    quad.set_armed(True)
    quad.command(STILL, -3.0)
    states = record(quad, 3.0)
    assert min(abs(state.attitude_rad[2]) for state in states) > 2.9
    assert states[-1].attitude_rad[2] == pytest.approx(-3.0, abs=0.02)


# Wind


def test_steady_wind_is_held_against_by_leaning_into_it() -> None:
    quad = hovering(wind=Wind((5.0, 0.0, 0.0)))
    assert math.hypot(*quad.state.vel_ned_mps) < 0.02
    into_the_wind_deg = math.degrees(quad.state.attitude_rad[1])
    assert into_the_wind_deg == pytest.approx(8.7, abs=0.3)  # atan(0.3 /s x 5 m/s / g), nose up


def test_gusts_of_a_5_mps_wind_move_the_hover_by_centimetres_per_second() -> None:
    quad = hovering(wind=Wind((5.0, 0.0, 0.0), turbulence_mps=5.0), seed=3, height_m=5.0)
    states = record(quad, 40.0)
    rms_mps = math.sqrt(sum(math.hypot(*state.vel_ned_mps) ** 2 for state in states) / len(states))
    assert 0.02 < rms_mps < 0.15


def test_storm_beyond_the_tilt_limit_costs_ground_but_not_height_and_is_recovered_from() -> None:
    quad = hovering(wind=Wind((20.0, 0.0, 0.0)))
    assert quad.state.vel_ned_mps[0] > 1.0
    assert quad.state.vel_ned_mps[2] == pytest.approx(0.0, abs=0.05)
    assert tilt_deg(quad.state) < 30.0
    quad.command((5.0, 0.0, 0.0), 0.0)
    assert record(quad, 6.0)[-1].vel_ned_mps == pytest.approx((5.0, 0.0, 0.0), abs=0.2)


def test_wind_carries_a_falling_vehicle_along() -> None:
    quad = JsbsimQuad(FRAME, (0.0, 0.0, -100.0), 0.0, wind=Wind((0.0, -5.0, 0.0)))
    quad.step(3.0)
    north, east, _ = quad.state.vel_ned_mps
    assert abs(north) < 0.01
    assert east == pytest.approx(-5.0 * (1 - math.exp(-0.3 * 3.0)), abs=0.1)


def test_gusts_do_not_depend_on_the_altitude_of_the_mission() -> None:
    flights = []
    for altitude_m in (0.0, 1500.0):
        quad = JsbsimQuad(LocalFrame(Wgs84(45.0, 9.0, altitude_m)), (0.0, 0.0, -5.0), 0.0, wind=GUSTY, seed=1)
        quad.set_armed(True)
        flights.append([state.vel_ned_mps for state in record(quad, 5.0)])
    assert flights[0] == flights[1]


@pytest.mark.parametrize("mean_ned_mps", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_wind_refuses_what_is_not_finite(mean_ned_mps: Vec3) -> None:
    with pytest.raises(ValueError, match="mean_ned_mps"):
        Wind(mean_ned_mps)


def test_wind_refuses_negative_turbulence() -> None:
    with pytest.raises(ValueError, match=r"turbulence_mps = -1\.0"):
        Wind(turbulence_mps=-1.0)


# Ground


@pytest.mark.parametrize("wind", [CALM, GUSTY])
def test_takeoff_landing_and_disarming_end_upright_and_still(wind: Wind) -> None:
    quad = JsbsimQuad(FRAME, (3.0, -4.0, 0.0), 1.0, wind=wind)
    quad.set_armed(True)
    quad.step(2.0)
    assert quad.state.on_ground
    assert quad.state.pos_ned_m == pytest.approx((3.0, -4.0, 0.0), abs=1e-3)
    assert quad.state.throttle == pytest.approx(0.1)

    quad.command((0.0, 0.0, -1.2), 1.0)
    climb = record(quad, 3.0)
    assert max(tilt_deg(state) for state in climb) < (0.1 if wind == CALM else 15.0)
    assert not climb[-1].on_ground
    assert climb[-1].vel_ned_mps[2] == pytest.approx(-1.2, abs=0.1)

    quad.command((0.0, 0.0, 0.7), 1.0)
    descent = record(quad, 8.0)
    touch = next(i for i, state in enumerate(descent) if state.on_ground)
    assert max(-state.pos_ned_m[2] for state in descent[touch:]) < 0.05
    landed = descent[-1]
    assert landed.on_ground
    assert tilt_deg(landed) < 0.1

    quad.set_armed(False)
    quad.step(3.0)
    assert quad.state.on_ground
    assert quad.state.throttle == 0.0
    assert math.dist(quad.state.pos_ned_m, landed.pos_ned_m) < 1e-3


@pytest.mark.parametrize("drag", list(Drag))
def test_vehicle_that_leans_against_the_wind_touches_down_as_slowly_as_it_came(drag: Drag) -> None:
    quad = JsbsimQuad(FRAME, (0.0, 0.0, -6.0), 0.0, wind=Wind((0.0, 4.0, 0.0)), drag=drag)
    quad.set_armed(True)
    quad.step(15.0)
    quad.command((0.0, 0.0, 0.5), 0.0)
    state = quad.state
    while not quad.state.on_ground:
        state = quad.state
        quad.step(SAMPLE_S)
    assert math.hypot(*state.vel_ned_mps[:2]) < 0.3


def test_armed_vehicle_stays_on_the_ground_until_told_to_climb() -> None:
    quad = JsbsimQuad(FRAME, STILL, 0.0)
    quad.set_armed(True)
    quad.command((2.0, 0.0, 0.0), 1.5)
    quad.step(3.0)
    assert quad.state.on_ground
    assert quad.state.pos_ned_m == pytest.approx(STILL, abs=1e-3)
    assert quad.state.attitude_rad[2] == pytest.approx(0.0, abs=1e-3)


def test_disarmed_vehicle_ignores_commands() -> None:
    quad = JsbsimQuad(FRAME, STILL, 0.0)
    quad.command((0.0, 0.0, -2.0), 0.0)
    quad.step(2.0)
    assert quad.state.on_ground
    assert quad.state.throttle == 0.0


def test_vehicle_disarmed_in_the_air_falls_and_comes_to_rest() -> None:
    quad = hovering(height_m=10.0)
    quad.command((3.0, 0.0, 0.0), 0.0)
    quad.step(1.0)
    quad.set_armed(False)
    quad.step(1.0)
    assert quad.state.vel_ned_mps[2] > 7.0
    quad.step(8.0)
    assert quad.state.on_ground
    assert math.hypot(*quad.state.vel_ned_mps) < 0.01
    assert -0.01 < quad.state.pos_ned_m[2] < 0.15


def test_vehicle_armed_again_while_falling_catches_itself() -> None:
    quad = hovering(height_m=60.0)
    quad.set_armed(False)
    quad.step(1.0)
    quad.set_armed(True)
    states = record(quad, 8.0)
    assert math.hypot(*states[-1].vel_ned_mps) < 0.1
    assert min(state.vel_ned_mps[2] for state in states) > -0.5
    assert not states[-1].on_ground


def test_same_seed_gives_the_same_flight_in_another_process() -> None:
    output = subprocess.run([sys.executable, airframe_kit.__file__], capture_output=True, text=True, check=True).stdout
    assert output == f"{gusty_flight(7)!r}\n"
