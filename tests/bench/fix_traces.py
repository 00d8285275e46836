"""Open-loop runs of a vehicle among trees whose GNSS is led astray, or not: where trunks have it, and where fixes do.

The course, stands, sensors and errors are those of `own_motion`, with HOVERS_S at the end in which it moves little, as
around d2. Cheap: what detects spoofing is tuned, and its false alarms are counted, on many of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.core.model.events import LidarScan, ObstacleScan, Position
from companion.core.perception.obstacle_perception import SensingPerception
from mission.document.model import Lidar as LidarErrors
from mission.schema.kinds import SensorClass
from mission.stand.stand import stand_of
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.estimates.errors import errors_of
from sim_bridge.world.autopilot.estimates.noise import Swinging
from sim_bridge.world.sensors.lidar import Lidar
from sim_bridge.world.sensors.raw_lidar import RawLidar
from sim_bridge.world.sensors.scene import Scene
from tests.bench.own_motion import LATE_S, TICK_S, _thinned, course, mission_of, scan_events

HOVERS_S = 40.0
CIRCLE_M = 0.5  # of what a hovering vehicle moves


@dataclass(frozen=True, slots=True)
class Led:
    """A receiver led astray from `at_s` on, north and east, m/s."""

    at_s: float
    drift_ne_mps: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Moment:
    """What a companion has after a tick."""

    now_s: float
    reported: Position
    perception: SensingPerception
    off_m: float  # of the fix, by the spoofer alone


def whole_course(rng: np.random.Generator) -> list[AirframeState]:
    """The winding way, then a slow circle where it ends."""
    states = list(course(rng))
    last = states[-1]
    north, east, down = last.pos_ned_m
    for k in range(round(HOVERS_S / TICK_S)):
        turn = 0.4 * k * TICK_S
        pos = (north + CIRCLE_M * math.sin(turn), east + CIRCLE_M * (1.0 - math.cos(turn)), down)
        vel = (0.4 * CIRCLE_M * math.cos(turn), 0.4 * CIRCLE_M * math.sin(turn), 0.0)
        states.append(AirframeState(pos, vel, (0.0, 0.0, last.attitude_rad[2]), (0.0, 0.0, 0.0), False, 0.4))
    return states


def trace(density_per_ha: float, sensor: SensorClass, seed: int, led: Led | None) -> Iterator[Moment]:
    """One run, a tick each."""
    mission = mission_of(density_per_ha, sensor, seed)
    assert mission.sensing is not None
    rng = np.random.default_rng(seed)
    states = whole_course(rng)
    scene = Scene(_thinned(stand_of(mission), states), mission.sensing.range_m)
    sizes = errors_of(mission.sim, 1)
    noise = Swinging(
        velocity_sd_mps=sizes.velocity_noise_mps,
        climb_sd_mps=sizes.climb_noise_mps,
        position_sd_m=sizes.position_noise_m,
        height_sd_m=sizes.height_noise_m,
        yaw_sd_rad=sizes.yaw_noise_rad,
        rng=rng,
    )
    if sensor is SensorClass.SECTORS:
        lidar: Lidar | RawLidar = Lidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1)
    else:
        lidar = RawLidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1)
    perception = SensingPerception(mission, mission.sensing)
    scans: list[tuple[float, list[ObstacleScan | LidarScan]]] = []
    astray = (0.0, 0.0)
    for k, state in enumerate(states):
        now_s = 10.0 + k * TICK_S
        noise.step(TICK_S)
        off, at, vel, wrong = noise.pos_ned_m, state.pos_ned_m, state.vel_ned_mps, noise.velocity_ned_mps
        drift = led.drift_ne_mps if led is not None and k * TICK_S >= led.at_s else (0.0, 0.0)
        astray = (astray[0] + drift[0] * TICK_S, astray[1] + drift[1] * TICK_S)
        own = Position(
            (at[0] + off[0] + astray[0], at[1] + off[1] + astray[1], at[2] + off[2]),
            (vel[0] + wrong[0] + drift[0], vel[1] + wrong[1] + drift[1], 0.0),
            now_s,
        )
        flown = perception.correct_odometry(own, now_s)
        bias = perception.velocity_bias((0.0, 0.0, 0.0))
        true_vel = Position(flown.pos_ned_m, (own.vel_ned_mps[0] + bias[0], own.vel_ned_mps[1] + bias[1], 0.0))
        while scans and scans[0][0] <= now_s - LATE_S + 1e-9:
            for scan in scans.pop(0)[1]:
                perception.integrate_scan(scan, true_vel, now_s, ())
        told = lidar.scan(state, (), now_s)
        if told is not None:
            yaw_off = sizes.yaw_bias_rad + noise.yaw_rad
            scans.append((now_s, list(scan_events(told.ranges_m, sensor, mission, state, yaw_off))))
        yield Moment(now_s, own, perception, math.hypot(*astray))
