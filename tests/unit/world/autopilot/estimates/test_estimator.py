"""What an autopilot believes: wrong as [sim] says, and the truth left alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import frames
from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.document.load import load_mission
from mission.document.model import Estimates, Mission, Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import Link, StreamProfile, make_autopilot
from sim_bridge.world.autopilot.estimates.errors import EXACT, RECORDED_2026_11, Errors, Form, errors_of
from sim_bridge.world.autopilot.estimates.estimator import estimated
from sim_bridge.world.world import DEFAULT_ORIGIN, World

LINKS = {Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL}

EXAMPLES = Path(__file__).parents[5] / "mission" / "examples"
DT_S = 0.05
SLOW_S = 0.2  # steps for statistics over an hour
FRAME = LocalFrame(Wgs84(47.4, 8.5, 488.0))
STILL: Vec3 = (0.0, 0.0, 0.0)


class Flown:
    """A point mass in the air, and what is believed of it."""

    def __init__(self, errors: Errors, *, seed: int = 1, vehicle_id: int = 1, height_m: float = 20.0) -> None:
        self.truth = PointMass((0.0, 0.0, -height_m), 0.0)
        self.believed = estimated(self.truth, errors, seed, vehicle_id)
        self.believed.set_armed(True)

    def fly(self, vel_ned_mps: Vec3, seconds: float, dt_s: float = DT_S) -> list[tuple[AirframeState, AirframeState]]:
        """The truth and the belief after each step."""
        seen = []
        for _ in range(round(seconds / dt_s)):
            self.believed.command(vel_ned_mps, 0.0)
            self.believed.step(dt_s)
            seen.append((self.truth.state, self.believed.state))
        return seen


def correlation(values: list[float], lag: int) -> float:
    return float(np.corrcoef(values[:-lag], values[lag:])[0, 1])


def test_without_errors_the_autopilot_has_the_airframe_itself() -> None:
    truth = PointMass(STILL, 0.0)
    assert estimated(truth, EXACT, 1, 1) is truth


def test_a_biased_vehicle_told_to_hover_drifts_at_the_bias_and_says_that_it_stands() -> None:
    flown = Flown(Errors(velocity_bias_mps=0.4))
    for truth, belief in flown.fly(STILL, 20.0)[100:]:
        assert math.hypot(*truth.vel_ned_mps[:2]) == pytest.approx(0.4, abs=1e-6)
        assert belief.vel_ned_mps == pytest.approx(STILL, abs=1e-6)
        assert belief.pos_ned_m == truth.pos_ned_m
    assert math.hypot(*flown.truth.state.pos_ned_m[:2]) == pytest.approx(8.0, abs=0.3)


def test_a_bias_of_climb_is_vertical() -> None:
    flown = Flown(Errors(climb_bias_mps=0.1))
    truth, belief = flown.fly(STILL, 10.0)[-1]
    assert (truth.vel_ned_mps[0], truth.vel_ned_mps[1], abs(truth.vel_ned_mps[2])) == pytest.approx((0.0, 0.0, 0.1))
    assert belief.vel_ned_mps == pytest.approx(STILL, abs=1e-6)


def test_biases_of_a_swarm_point_all_ways() -> None:
    angles = []
    for vehicle_id in range(1, 41):
        truth, _ = Flown(Errors(velocity_bias_mps=0.4), vehicle_id=vehicle_id).fly(STILL, 5.0)[-1]
        angles.append(math.atan2(truth.vel_ned_mps[1], truth.vel_ned_mps[0]))
    assert {math.floor(angle / (math.pi / 2.0)) for angle in angles} == {-2, -1, 0, 1}


def test_on_the_ground_a_vehicle_knows_that_it_stands() -> None:
    flown = Flown(Errors(velocity_bias_mps=0.4, climb_bias_mps=0.2, velocity_noise_mps=0.5), height_m=0.0)
    for truth, belief in flown.fly((0.0, 0.0, 0.3), 5.0):
        assert truth.on_ground
        assert truth.pos_ned_m == belief.vel_ned_mps == STILL


def test_velocity_noise_has_its_size_and_memory_and_is_flown() -> None:
    seen = Flown(Errors(velocity_noise_mps=0.2, climb_noise_mps=0.1), height_m=1000.0).fly(STILL, 4000.0, SLOW_S)
    for axis, sd in ((0, 0.2), (1, 0.2), (2, 0.1)):
        wrong = [b.vel_ned_mps[axis] - t.vel_ned_mps[axis] for t, b in seen]
        assert float(np.std(wrong)) == pytest.approx(sd, rel=0.1)
        assert float(np.mean(wrong)) == pytest.approx(0.0, abs=0.04)
        assert correlation(wrong, round(4.0 / SLOW_S)) == pytest.approx(math.exp(-1.0), abs=0.12)
        assert np.std([t.vel_ned_mps[axis] for t, _ in seen]) > 0.8 * sd  # what it flies
    assert np.std([b.vel_ned_mps[0] for _, b in seen]) < 0.1  # what it tells: the airframe lags


def test_position_noise_has_its_size_and_memory_and_leaves_the_truth_alone() -> None:
    seen = Flown(Errors(position_noise_m=0.3, height_noise_m=0.15)).fly(STILL, 4000.0, SLOW_S)
    assert all(truth.pos_ned_m == (0.0, 0.0, -20.0) for truth, _ in seen)
    for axis, sd in ((0, 0.3), (1, 0.3), (2, 0.15)):
        wrong = [b.pos_ned_m[axis] - t.pos_ned_m[axis] for t, b in seen]
        assert float(np.std(wrong)) == pytest.approx(sd, rel=0.15)
        assert correlation(wrong, round(10.0 / SLOW_S)) == pytest.approx(math.exp(-1.0), abs=0.15)


@pytest.mark.parametrize("delay_s", [0.05, 0.12, 0.3])
def test_positions_and_velocities_are_told_late(delay_s: float) -> None:
    seen = Flown(Errors(delay_s=delay_s)).fly((2.0, 0.0, 0.0), 5.0)
    truth, belief = seen[-1]
    assert truth.pos_ned_m[0] - belief.pos_ned_m[0] == pytest.approx(2.0 * delay_s, abs=1e-3)
    for at_s in (0.5, 1.0):
        late, past_s = seen[round(at_s / DT_S) - 1][1], at_s - delay_s
        steps, share = divmod(past_s / DT_S + 1e-9, 1.0)
        before, after = seen[int(steps) - 1][0].vel_ned_mps[0], seen[int(steps)][0].vel_ned_mps[0]
        assert late.vel_ned_mps[0] == pytest.approx(before + share * (after - before), abs=1e-6)


def test_a_seed_and_an_id_give_the_same_errors_to_the_bit_and_others_give_others() -> None:
    errors = Errors(velocity_bias_mps=0.2, velocity_noise_mps=0.2, position_noise_m=0.3, delay_s=0.1)

    def beliefs(seed: int, vehicle_id: int) -> list[AirframeState]:
        return [belief for _, belief in Flown(errors, seed=seed, vehicle_id=vehicle_id).fly((1.0, 0.0, 0.0), 2.0)]

    assert beliefs(1, 1) == beliefs(1, 1)
    assert beliefs(1, 1) != beliefs(1, 2) != beliefs(2, 1)


def test_a_heading_is_held_as_told_and_stands_wrong_in_truth() -> None:
    flown = Flown(Errors(yaw_bias_rad=0.07, form=Form.SWINGING))
    truth, belief = flown.fly((1.0, 0.0, 0.0), 10.0)[-1]
    assert belief.attitude_rad[2] == pytest.approx(0.0, abs=1e-6)
    assert truth.attitude_rad[2] == pytest.approx(-0.07, abs=1e-6)


def test_a_wrong_yaw_turns_the_push_of_a_velocity_and_not_where_it_ends() -> None:
    seen = Flown(Errors(yaw_bias_rad=math.radians(4.0), form=Form.SWINGING)).fly((3.0, 0.0, 0.0), 10.0)
    first = seen[0][0].vel_ned_mps
    assert math.degrees(math.atan2(first[1], first[0])) == pytest.approx(-4.0, abs=0.1)  # told too far to the right
    strayed = [truth.vel_ned_mps[1] for truth, _ in seen]
    assert -0.1 < min(strayed) < -0.03
    assert seen[-1][0].vel_ned_mps == pytest.approx((3.0, 0.0, 0.0), abs=1e-3)


def test_yaw_is_told_within_half_a_turn_either_way() -> None:
    flown = Flown(Errors(yaw_bias_rad=0.1, form=Form.SWINGING))
    for heading_rad in (3.1, -3.1):
        for _ in range(200):
            flown.believed.command(STILL, heading_rad)
            flown.believed.step(DT_S)
        told = flown.believed.state.attitude_rad[2]
        assert abs(told) <= math.pi
        assert math.remainder(told - heading_rad, math.tau) == pytest.approx(0.0, abs=1e-3)


def mission(**sim: object) -> Mission:
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (60.0, 0.0, 8.0), "vel_leader_mps": 1.0},
            "swarm": {"size": 2},
            "sim": {"personalities": {2: "ardupilot"}, **sim},
        }
    )


def test_estimates_of_2026_11_are_the_makes_and_keys_go_before_them() -> None:
    assert errors_of(mission().sim, 1) == EXACT
    former = mission(estimates="2026-11").sim
    assert [errors_of(former, k) for k in (1, 2)] == [RECORDED_2026_11[make] for make in Personality]
    mixed = errors_of(mission(estimates="2026-11", velocity_noise_mps=0.0, estimate_delay_s=0.3).sim, 1)
    px4 = RECORDED_2026_11[Personality.PX4]
    assert mixed == Errors(position_noise_m=px4.position_noise_m, height_noise_m=px4.height_noise_m, delay_s=0.3)


def test_keys_go_before_recorded_estimates_and_are_halved_vertically() -> None:
    drawn = errors_of(mission(estimates="recorded").sim, 1)
    mixed = errors_of(mission(estimates="recorded", velocity_noise_mps=0.0, position_noise_m=1.0).sim, 1)
    assert (mixed.velocity_noise_mps, mixed.climb_noise_mps) == (0.0, 0.0)
    assert (mixed.position_noise_m, mixed.height_noise_m) == (1.0, 0.5)
    assert (mixed.yaw_bias_rad, mixed.yaw_noise_rad) == (drawn.yaw_bias_rad, drawn.yaw_noise_rad)


def test_with_a_range_finder_only_heights_and_vertical_velocities_are_better() -> None:
    without = errors_of(mission(estimates="recorded").sim, 1)
    with_one = errors_of(mission(estimates="recorded", range_finder=True, climb_bias_mps=0.1).sim, 1)
    assert (with_one.climb_bias_mps, with_one.climb_noise_mps, with_one.height_noise_m) == (0.0, 0.05, 0.1)
    kept = replace(with_one, climb_noise_mps=without.climb_noise_mps, height_noise_m=without.height_noise_m)
    assert kept == replace(without, over_ground=True)
    better = errors_of(mission(estimates="2026-11", range_finder=True).sim, 1)
    assert better.height_noise_m == RECORDED_2026_11[Personality.PX4].height_noise_m


def test_a_range_finder_takes_rising_ground_for_a_vehicle_that_descends() -> None:
    flown = Flown(Errors(over_ground=True), height_m=4.0)
    flown.believed.set_ground(-1.5)
    (truth, belief) = flown.fly(STILL, 1.0)[-1]
    assert -truth.pos_ned_m[2] == pytest.approx(4.0)
    assert -belief.pos_ned_m[2] == pytest.approx(2.5)


def test_a_world_keeps_the_truth_and_its_autopilots_the_belief() -> None:
    flown = mission(position_noise_m=2.0).with_origin(DEFAULT_ORIGIN)
    world = World(flown, lambda _frame, place, _seed: PointMass(place, 0.0), links=LINKS)
    exact = World(
        mission().with_origin(DEFAULT_ORIGIN), lambda _frame, place, _seed: PointMass(place, 0.0), links=LINKS
    )
    for _ in range(40):
        world.step(DT_S)
        exact.step(DT_S)
    assert world.positions() == exact.positions()
    vehicle = world.vehicles[1]
    belief = vehicle.believed.state.pos_ned_m
    vehicle.autopilot.transmit(Link.ONBOARD, world.now_s)
    told: Any = ask(vehicle.autopilot.receive, vehicle.autopilot.transmit, world.now_s, "GLOBAL_POSITION_INT")
    here = world.frame.to_ned(Wgs84(told.lat / 1e7, told.lon / 1e7, told.alt / 1000.0))
    assert here == pytest.approx(belief, abs=0.02)
    assert math.dist(belief, vehicle.airframe.state.pos_ned_m) > 0.1


def test_scans_are_cast_as_the_airframe_stands_and_turned_by_the_yaw_that_is_told() -> None:
    stand = load_mission(EXAMPLES / "natural_stand.toml").with_origin(DEFAULT_ORIGIN).with_size(3)
    worlds = [
        World(stand.with_estimates(estimates), lambda _frame, place, _seed: PointMass(place, 0.0), links=LINKS)
        for estimates in Estimates
    ]
    heard = 0
    for _ in range(40):
        scans = [[[data for _, data in world.sense(k)] for k in world.vehicles] for world in worlds]
        assert scans[0] == scans[1] == scans[2]
        heard += sum(map(len, scans[0]))
        for world in worlds:
            world.step(DT_S)
    assert heard >= 30
    for k in worlds[0].vehicles:
        exact, recorded, former = (world.vehicles[k].believed.state.attitude_rad[2] for world in worlds)
        assert exact == former == worlds[1].vehicles[k].airframe.state.attitude_rad[2]
        assert 0.001 < abs(recorded - exact) < math.radians(4.3 + 4.0 * 3.1)


@pytest.mark.parametrize(("form", "yaw_rad"), [(Form.WANDERING, 0.0), (Form.SWINGING, 0.07)])
@pytest.mark.parametrize("personality", list(Personality))
def test_messages_of_one_time_tell_the_same_wrong_place_and_velocity(
    personality: Personality, form: Form, yaw_rad: float
) -> None:
    truth = PointMass(STILL, 0.0)
    errors = Errors(velocity_bias_mps=0.4, velocity_noise_mps=0.2, position_noise_m=1.0, delay_s=0.3, form=form)
    body = estimated(truth, replace(errors, yaw_bias_rad=yaw_rad), 1, 1)
    autopilot = make_autopilot(personality, 1, body, FRAME, links={Link.ONBOARD: StreamProfile.MINIMAL})
    truth.set_armed(True)
    for k in range(1000):  # past the boot of either
        autopilot.update(k * DT_S)
        body.command((1.0, -1.0, -0.5), 0.0)
        body.step(DT_S)
    now_s = 1000 * DT_S
    autopilot.transmit(Link.ONBOARD, now_s)

    def told(name: str) -> Any:
        return ask(autopilot.receive, autopilot.transmit, now_s, name)

    local, globally, origin = told("LOCAL_POSITION_NED"), told("GLOBAL_POSITION_INT"), told("GPS_GLOBAL_ORIGIN")
    belief = body.state
    assert math.dist(belief.pos_ned_m, truth.state.pos_ned_m) > 0.3
    assert belief.attitude_rad[2] - truth.state.attitude_rad[2] == pytest.approx(yaw_rad, abs=1e-9)
    assert told("ATTITUDE").yaw == pytest.approx(belief.attitude_rad[2], abs=1e-6)
    assert globally.hdg / 100.0 % 360.0 == pytest.approx(math.degrees(belief.attitude_rad[2]) % 360.0, abs=0.01)
    assert (local.vx, local.vy, local.vz) == pytest.approx(belief.vel_ned_mps, abs=1e-5)
    assert (globally.vx, globally.vy, globally.vz) == pytest.approx([100.0 * v for v in belief.vel_ned_mps], abs=0.6)
    here = FRAME.to_ned(Wgs84(globally.lat / 1e7, globally.lon / 1e7, globally.alt / 1000.0))
    start = FRAME.to_ned(Wgs84(origin.latitude / 1e7, origin.longitude / 1e7, origin.altitude / 1000.0))
    assert here == pytest.approx(belief.pos_ned_m, abs=0.02)
    assert [h - s for h, s in zip(here, start, strict=True)] == pytest.approx((local.x, local.y, local.z), abs=0.03)
    if personality is Personality.PX4:  # ArduCopter has neither of these
        odometry, altitude = told("ODOMETRY"), told("ALTITUDE")
        assert (odometry.vx, odometry.vy, odometry.vz) == (local.vx, local.vy, local.vz)
        assert (odometry.x, odometry.y, odometry.z) == (local.x, local.y, local.z)
        assert altitude.altitude_amsl == pytest.approx(globally.alt / 1000.0, abs=0.01)
        assert altitude.altitude_local == pytest.approx(-local.z, abs=1e-4)


def ask(
    receive: Callable[[Link, bytes, float], None],
    transmit: Callable[[Link, float], list[bytes]],
    now_s: float,
    name: str,
) -> mav.MAVLink_message:
    """The answer to MAV_CMD_REQUEST_MESSAGE."""
    message_id = getattr(mav, f"MAVLINK_MSG_ID_{name}")
    command = mav.MAVLink_command_long_message(1, 1, 512, 0, message_id, 0, 0, 0, 0, 0, 0)
    receive(Link.ONBOARD, command.pack(mav.MAVLink(None, srcSystem=1, srcComponent=191)), now_s)
    data = b"".join(transmit(Link.ONBOARD, now_s))
    (found,) = [data[start:end] for start, end, found_id in frames(data) if found_id == message_id]
    (message,) = mav.MAVLink(None).parse_buffer(bytearray(found))
    return message
