"""What callers of an airframe may rely on: places, refusals, determinism; and the point mass."""

from __future__ import annotations

import math
import sys

import pytest

from mission.common.frames import LocalFrame, Vec3, Wgs84
from sim_bridge.world.airframe import bench
from sim_bridge.world.airframe.base import Airframe, AirframeError
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.point_mass import PointMass
from tests.unit.world.airframe_kit import FRAME, GUSTY, SAMPLE_S, STILL, gusty_flight, hovering, record

# Place and time


@pytest.mark.parametrize(
    "origin", [Wgs84(-35.363, 149.165, 584.0), Wgs84(0.0, 179.9999, 0.0), Wgs84(68.0, -120.0, 2500.0)]
)
@pytest.mark.parametrize("pos_ned_m", [STILL, (250.0, -300.0, -12.5), (-80.0, 120.0, 0.0)])
def test_vehicle_appears_where_it_is_put(origin: Wgs84, pos_ned_m: Vec3) -> None:
    quad = JsbsimQuad(LocalFrame(origin), pos_ned_m, -2.0)
    assert math.dist(quad.state.pos_ned_m, pos_ned_m) < 1e-4
    assert quad.state.attitude_rad == pytest.approx((0.0, 0.0, -2.0), abs=1e-6)
    assert quad.state.vel_ned_mps == pytest.approx(STILL, abs=1e-9)
    assert quad.state.on_ground == (pos_ned_m[2] == 0.0)


def test_positions_are_the_integral_of_velocities_far_from_the_origin() -> None:
    quad = JsbsimQuad(FRAME, (300.0, 300.0, -20.0), 0.0)
    quad.set_armed(True)
    quad.command((3.0, 0.0, 0.0), 0.0)
    quad.step(5.0)
    before = quad.state.pos_ned_m
    velocities = [state.vel_ned_mps for state in record(quad, 10.0)]
    for axis in range(3):
        moved_m = quad.state.pos_ned_m[axis] - before[axis]
        assert moved_m == pytest.approx(sum(v[axis] for v in velocities) * SAMPLE_S, abs=0.01)


@pytest.mark.parametrize("dt_s", [0.0, -0.05, 0.004, 0.0125, 0.001])
def test_step_refuses_a_fraction_of_a_physics_step(dt_s: float) -> None:
    quad = JsbsimQuad(FRAME, STILL, 0.0)
    with pytest.raises(ValueError, match=rf"dt_s = {dt_s}: .* 0\.005 s"):
        quad.step(dt_s)


@pytest.mark.parametrize("rate_hz", [100, 250, 1000])
def test_physics_rate_must_be_one_that_was_proven(rate_hz: int) -> None:
    with pytest.raises(ValueError, match=f"rate_hz = {rate_hz}"):
        JsbsimQuad(FRAME, STILL, 0.0, rate_hz=rate_hz)


@pytest.mark.parametrize("pos_ned_m", [(0.0, 0.0, 0.5), (math.nan, 0.0, 0.0)])
def test_place_under_the_ground_or_nowhere_is_refused(pos_ned_m: Vec3) -> None:
    with pytest.raises(ValueError, match="pos_ned_m"):
        JsbsimQuad(FRAME, pos_ned_m, 0.0)


@pytest.mark.parametrize(("vel_ned_mps", "yaw_rad"), [((math.nan, 0.0, 0.0), 0.0), (STILL, math.inf)])
def test_command_that_is_not_finite_is_refused(vel_ned_mps: Vec3, yaw_rad: float) -> None:
    airframes: list[Airframe] = [JsbsimQuad(FRAME, STILL, 0.0), PointMass(STILL, 0.0)]
    for airframe in airframes:
        with pytest.raises(ValueError, match="must be finite"):
            airframe.command(vel_ned_mps, yaw_rad)


# Determinism


def test_same_seed_gives_the_same_flight_whatever_flies_beside_it() -> None:
    alone = gusty_flight(7)
    other = JsbsimQuad(FRAME, (0.0, 0.0, -20.0), 0.0, wind=GUSTY, seed=1)
    quad = JsbsimQuad(FRAME, (1.0, 2.0, 0.0), 0.5, wind=GUSTY, seed=7)
    quad.set_armed(True)
    quad.command((1.0, -1.0, -1.0), 2.0)
    beside = []
    for _ in alone:
        other.step(0.05)
        quad.step(SAMPLE_S)
        beside.append(quad.state)
    assert beside == alone


def test_each_seed_has_its_own_gusts() -> None:
    flights = [gusty_flight(seed) for seed in (-1, 0, 1, 2**40)]
    assert all(a != b for i, a in enumerate(flights) for b in flights[:i])


def test_long_step_is_the_same_as_its_parts() -> None:
    whole = hovering(wind=GUSTY)
    parts = hovering(wind=GUSTY)
    whole.step(0.1)
    for _ in range(20):
        parts.step(0.005)
    assert whole.state == parts.state


# JSBSim itself


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    quad = hovering(height_m=1.0)
    quad.command((0.0, 0.0, 1.0), 0.0)
    quad.step(3.0)
    del quad
    assert capfd.readouterr() == ("", "")


def test_missing_jsbsim_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    with pytest.raises(AirframeError, match=r"pip install -e '\.\[sim\]'"):
        JsbsimQuad(FRAME, STILL, 0.0)


def test_benchmark_measures_what_it_prints(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(bench, "TICKS", 10)
    monkeypatch.setattr(bench, "REPETITIONS", 5)
    monkeypatch.setattr(bench, "FLEET", 2)
    assert bench.main(["--json"]) == 0
    assert '"ratio_median"' in capsys.readouterr().out
    assert bench.main([]) == 0
    assert "ratio" in capsys.readouterr().out


# PointMass


def test_point_mass_follows_with_its_lag() -> None:
    body = PointMass((0.0, 0.0, -5.0), 0.0, lag_s=0.5, accel_max_mps2=100.0)
    body.set_armed(True)
    body.command((1.0, 0.0, 0.0), 0.0)
    body.step(0.5)
    assert body.state.vel_ned_mps[0] == pytest.approx(1 - math.exp(-1))


def test_point_mass_accelerates_within_its_limit_along_the_step() -> None:
    body = PointMass((0.0, 0.0, -50.0), 0.0)
    body.set_armed(True)
    body.command((3.0, 4.0, 0.0), 0.0)
    body.step(0.1)
    assert body.state.vel_ned_mps == pytest.approx((0.18, 0.24, 0.0))
    assert record(body, 5.0)[-1].vel_ned_mps == pytest.approx((3.0, 4.0, 0.0), abs=1e-3)


def test_point_mass_takes_off_lands_and_stands() -> None:
    body = PointMass((1.0, 2.0, 0.0), 0.0)
    body.set_armed(True)
    body.command((1.0, 0.0, 0.0), 0.0)
    body.step(1.0)
    assert body.state.pos_ned_m == (1.0, 2.0, 0.0)
    body.command((0.0, 0.0, -1.0), 0.0)
    assert not record(body, 3.0)[-1].on_ground
    body.command((0.0, 0.0, 0.7), 0.0)
    landed = record(body, 6.0)[-1]
    assert landed.on_ground
    assert landed.pos_ned_m == pytest.approx((1.0, 2.0, 0.0))
    assert landed.vel_ned_mps == STILL


def test_point_mass_falls_when_disarmed() -> None:
    body = PointMass((0.0, 0.0, -10.0), 0.0)
    record(body, 1.0)
    assert body.state.vel_ned_mps[2] == pytest.approx(9.80665)
    assert record(body, 1.0)[-1].on_ground


def test_point_mass_turns_the_short_way_at_its_limit() -> None:
    body = PointMass((0.0, 0.0, -10.0), 3.0)
    body.set_armed(True)
    body.command(STILL, -3.0)
    body.step(0.1)
    assert body.state.attitude_rad[2] == pytest.approx(3.1)
    body.step(0.3)
    assert body.state.attitude_rad[2] == pytest.approx(-3.0)


def test_point_mass_refuses_nonsense() -> None:
    with pytest.raises(ValueError, match="down"):
        PointMass((0.0, 0.0, 1.0), 0.0)
    with pytest.raises(ValueError, match="lag_s = 0"):
        PointMass(STILL, 0.0, lag_s=0.0)
    with pytest.raises(ValueError, match="dt_s = 0"):
        PointMass(STILL, 0.0).step(0.0)
