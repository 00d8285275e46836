"""An autopilot without GNSS: its odometer drifts as [sim.odometry] says, and knows nothing of the true place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import frames
from mission.common.frames import LocalFrame, Vec3
from mission.document.model import Mission, OdometryErrors, Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot import Link, StreamProfile, make_autopilot
from sim_bridge.world.autopilot.estimates.odometry import Odometer
from sim_bridge.world.sensors.ranging import RangeRadios
from sim_bridge.world.world import World
from tests.unit.core.ranging_kit import ranging_mission

DT_S = 0.05
NONE = OdometryErrors(velocity_noise_mps=0.0, velocity_bias_mps=0.0, yaw_deg=0.0)
LINKS = {Link.ONBOARD: StreamProfile.ONBOARD, Link.GROUND: StreamProfile.MINIMAL}
ABSOLUTE = {
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    mav.MAVLINK_MSG_ID_HOME_POSITION,
}


def flown(errors: OdometryErrors, vel: Vec3, seconds: float, *, seed: int = 1) -> tuple[PointMass, Odometer]:
    body = PointMass((300.0, -200.0, -20.0), 0.3)
    told = Odometer(body, errors, seed=seed, vehicle_id=1)
    told.set_armed(True)
    for _ in range(round(seconds / DT_S)):
        told.command(vel, 0.3)
        told.step(DT_S)
    return body, told


def test_without_errors_the_odometer_counts_the_way_from_where_it_was_switched_on() -> None:
    body, told = flown(NONE, (2.0, -1.0, 0.0), 10.0)
    way = [a - b for a, b in zip(body.state.pos_ned_m, (300.0, -200.0, -20.0), strict=True)]
    assert told.state.pos_ned_m[:2] == pytest.approx(way[:2], abs=0.1)  # a tick of rounding by the integration
    assert told.state.vel_ned_mps == pytest.approx(body.state.vel_ned_mps)


def test_compass_error_turns_what_is_told_and_what_is_flown() -> None:
    errors = NONE.model_copy(update={"yaw_deg": 10.0})
    body, told = flown(errors, (3.0, 0.0, 0.0), 10.0, seed=4)
    off = body.state.attitude_rad[2] - told.state.attitude_rad[2]
    assert abs(math.degrees(off)) > 2.0
    # Told north is flown along its own north, which lies `off` east of the map's.
    true = body.state.vel_ned_mps
    assert math.atan2(true[1], true[0]) == pytest.approx(off, abs=0.01)
    assert told.state.vel_ned_mps[1] == pytest.approx(0.0, abs=0.02)


def test_noise_and_bias_are_as_large_as_the_mission_says() -> None:
    finals = []
    for seed in range(40):
        body, told = flown(OdometryErrors(yaw_deg=0.0), (0.0, 0.0, 0.0), 60.0, seed=seed)
        truth = (body.state.pos_ned_m[0] - 300.0, body.state.pos_ned_m[1] + 200.0)
        finals += [told.state.pos_ned_m[0] - truth[0], told.state.pos_ned_m[1] - truth[1]]
    # bias: 0.05 sqrt(2 * 20 * (60 - 20 (1 - e^-3))) = 2.0 m; noise: 0.1 sqrt(0.1 * 60) = 0.24 m
    assert np.std(finals) == pytest.approx(2.0, rel=0.25)


def test_on_the_ground_it_knows_that_it_stands() -> None:
    told = Odometer(PointMass((5.0, 6.0, 0.0), 0.0), OdometryErrors(), seed=1, vehicle_id=1)
    for _ in range(200):
        told.step(DT_S)
    assert told.state.pos_ned_m == (0.0, 0.0, 0.0)
    assert told.state.vel_ned_mps == (0.0, 0.0, 0.0)


class Elsewhere:
    """The same flight in another place of the world, which is turned as well: (n, e) -> (-e, n), then shifted."""

    def __init__(self, pos_ned_m: Vec3) -> None:
        self.inner = PointMass(pos_ned_m, 0.0, ground_down_m=pos_ned_m[2])

    @property
    def state(self) -> AirframeState:
        state = self.inner.state
        (n, e, d), (vn, ve, vd), (roll, pitch, yaw) = state.pos_ned_m, state.vel_ned_mps, state.attitude_rad
        turned = math.remainder(yaw + math.pi / 2.0, math.tau)
        return replace(
            state,
            pos_ned_m=(-e + 1000.0, n - 700.0, d),
            vel_ned_mps=(-ve, vn, vd),
            attitude_rad=(roll, pitch, turned),
        )

    def set_armed(self, armed: bool) -> None:
        self.inner.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        self.inner.command((vel_ned_mps[1], -vel_ned_mps[0], vel_ned_mps[2]), yaw_rad - math.pi / 2.0)

    def set_ground(self, down_m: float) -> None:
        self.inner.set_ground(down_m)

    def step(self, dt_s: float) -> None:
        self.inner.step(dt_s)


def told_by(mission: Mission, *, elsewhere: bool, personality: Personality) -> tuple[dict[int, bytes], dict[int, int]]:
    """All that vehicles 2 to 4 hear of their autopilots and range radios in a climb and a short flight; message counts.

    `elsewhere`: the world is in another place and turned by a quarter, with all compasses in it.
    """
    frame = LocalFrame(mission.origin.wgs84) if mission.origin else None
    assert frame is not None
    world = World(mission, lambda _f, place, _s: PointMass(place, 0.0, ground_down_m=place[2]), links=LINKS)
    heard: dict[int, bytes] = dict.fromkeys((2, 3, 4), b"")
    counts: dict[int, int] = {}
    autopilots, bodies = {}, {}
    for k in (2, 3, 4):
        place = world.vehicles[k].airframe.state.pos_ned_m
        bodies[k] = Elsewhere(place) if elsewhere else PointMass(place, 0.0, ground_down_m=place[2])
        turn_rad = math.pi / 2.0 if elsewhere else 0.0
        odometer = Odometer(bodies[k], mission.sim.odometry, seed=1, vehicle_id=k, turn_rad=turn_rad)
        autopilots[k] = make_autopilot(personality, k, odometer, frame, links=LINKS, satellites=False)
        bodies[k].set_armed(True)
        odometer.set_armed(True)
        bodies[k] = odometer  # type: ignore[assignment]
    (radios,) = (sensor for sensor in world.sensors if isinstance(sensor, RangeRadios))
    for tick in range(1000):
        now_s = tick * DT_S
        places: Mapping[int, Vec3] = {k: bodies[k]._airframe.state.pos_ned_m for k in bodies}  # type: ignore[union-attr]
        told = radios.measure(places, now_s)
        for k, autopilot in autopilots.items():
            data = b"".join(autopilot.transmit(Link.ONBOARD, now_s)) + told.get(k, b"")
            heard[k] += data
            for _, _, message_id in frames(data):
                counts[message_id] = counts.get(message_id, 0) + 1
            autopilot.update(now_s)
            bodies[k].command((0.5 * k, 1.0, -1.0 if tick < 160 else 0.0), 0.2)
            bodies[k].step(DT_S)
    return heard, counts


@pytest.mark.parametrize("personality", list(Personality))
def test_not_a_byte_tells_a_follower_where_in_the_world_it_is_or_how_that_is_turned(personality: Personality) -> None:
    mission = ranging_mission()
    here, counts = told_by(mission, elsewhere=False, personality=personality)
    there, _ = told_by(mission, elsewhere=True, personality=personality)
    assert here == there
    assert not ABSOLUTE & counts.keys()
    assert counts[mav.MAVLINK_MSG_ID_SWARM_RANGES] > 1000


def test_one_with_satellites_is_told_of_by_the_same_bytes() -> None:
    """So the test above would notice: with the truth instead of an odometer the bytes differ."""
    mission = ranging_mission()
    assert mission.origin is not None
    frame = LocalFrame(mission.origin.wgs84)
    told = []
    for place in ((0.0, 0.0, 0.0), (1000.0, -700.0, 0.0)):
        autopilot = make_autopilot(Personality.PX4, 2, PointMass(place, 0.0), frame, links=LINKS)
        data = b""
        for tick in range(100):
            data += b"".join(autopilot.transmit(Link.ONBOARD, tick * DT_S))
            autopilot.update(tick * DT_S)
        told.append(data)
    assert told[0] != told[1]
