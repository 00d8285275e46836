"""Encounters of two vehicles that do not hear each other: `python -m tests.bench encounters`.

Each flies straight at what the safety filter leaves of its desired velocity (no planner turns it aside), sees the other
by its own simulated lidar alone, and leans as it speeds up and brakes. The stand is thinned along both courses.
"""

from __future__ import annotations

import argparse
import math
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from companion.core.model.events import Position
from companion.core.perception.obstacle_perception import SensingPerception
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from mission.schema.trees import StandTree
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.metrics import CONTACT_M
from sim_bridge.lab.plot_style import ALARM, FAINT, RC, colours
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import Lidar
from sim_bridge.world.sensors.raw_lidar import RawLidar
from sim_bridge.world.sensors.scene import Scene
from tests.bench.options import as_density, number
from tests.bench.own_motion import LATE_S, TICK_S, mission_of, scan_events
from tests.bench.table import spread

GRAVITY_MPS2 = 9.81
LAG_S, DEAD_TICKS = 0.3, 2
LASTS_S = 9.0
MEET_S = 4.5  # until both would be in one place
COURSES_DEG = {
    "head-on": 180.0,
    "crossing": 90.0,
    "overtaking": 0.0,
    "hovering": 180.0,
    "round trunks": 90.0,
    "in a gap": 180.0,
}
SHARES = {"overtaking": 0.33, "hovering": 0.0}  # of the speed, that the other flies at; who hovers is not steered
ASIDE_M = 1.0  # by so much at most they would miss each other
WAY_M = 1.2  # of the courses, free of trunks to either side
TRUNK_M = 0.2  # radius of those that are put there
HEDGE_M = (2.0, 12.0, 0.5)  # round trunks: from where they would meet outwards between both; one each
GAP_M = 1.6  # in a gap: from its middle to either trunk


@dataclass(frozen=True, slots=True)
class Met:
    """One encounter: how near they came, and from how far one first knew of the other."""

    least_m: float
    known_m: float


class Vehicle:
    """One of the two: perception and safety filter as they fly, on a point mass with a lag that leans."""

    def __init__(self, mission: Mission, scene: Scene, start: tuple[float, float], vel: tuple[float, float], seed: int):
        assert mission.sensing is not None
        self.desired: Vec3 = (vel[0], vel[1], 0.0)
        self.sensor = mission.sensing.sensor
        self.perception = SensingPerception(mission, mission.sensing)
        self.filter = SafetyFilter.of(mission)
        self.limit_mps2 = mission.limits.acceleration_max_mps2
        self.pos, self.vel, self.yaw = np.array(start), np.array(vel), math.atan2(vel[1], vel[0])
        self.accel = np.zeros(2)
        self.setpoint: Vec3 = self.desired
        self.under_way: deque[Vec3] = deque([self.desired] * DEAD_TICKS)
        is_sectors = self.sensor is SensorClass.SECTORS
        self.sectors = Lidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1) if is_sectors else None
        self.rays = None if is_sectors else RawLidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1)
        self.mission = mission
        self.known_m = math.inf

    @property
    def state(self) -> AirframeState:
        """As the lidar has it: it leans with its acceleration, and against a little drag."""
        push = self.accel + 0.15 * self.vel
        ahead, right = (
            np.array([math.cos(self.yaw), math.sin(self.yaw)]),
            np.array([-math.sin(self.yaw), math.cos(self.yaw)]),
        )
        attitude = (float(push @ right) / GRAVITY_MPS2, -float(push @ ahead) / GRAVITY_MPS2, self.yaw)
        vel = (float(self.vel[0]), float(self.vel[1]), 0.0)
        return AirframeState((float(self.pos[0]), float(self.pos[1]), -4.0), vel, attitude, (0.0, 0.0, 0.0), False, 0.4)

    def sense(self, other: Vehicle, now_s: float) -> None:
        """A turn of the lidar, where one is due."""
        state, there = self.state, other.state
        if self.sectors is not None:
            told = self.sectors.scan(state, [there.pos_ned_m], now_s)
        else:
            assert self.rays is not None
            told = self.rays.scan(state, [(there.pos_ned_m, (there.vel_ned_mps[0], there.vel_ned_mps[1]))], now_s)
        if told is not None:
            own = Position(state.pos_ned_m, state.vel_ned_mps)
            for scan in scan_events(told.ranges_m, self.sensor, self.mission, state, 0.0):
                self.perception.integrate_scan(scan, own, now_s + LATE_S, ())

    def command(self, other: Vehicle, now_s: float) -> None:
        """A tick of the companion."""
        state = self.state
        own = self.perception.correct_odometry(Position(state.pos_ned_m, state.vel_ned_mps), now_s)
        seen = self.perception.find_vehicles(own.pos_ned_m, (), now_s)
        if seen and self.known_m == math.inf:
            self.known_m = math.dist(state.pos_ned_m, other.state.pos_ned_m)
        cloud = self.perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, now_s, seen)
        around = Surroundings(own, (), {}, cloud, seen=seen, commanded_ned_mps=self.setpoint)
        self.setpoint = self.filter.apply(self.desired, around, dt_s=TICK_S).vel_ned_mps
        self.under_way.append(self.setpoint)

    def move(self) -> None:
        """A tick of the airframe."""
        asked = np.array(self.under_way.popleft()[:2])
        accel = (asked - self.vel) / LAG_S
        size = float(np.linalg.norm(accel))
        self.accel = accel if size <= self.limit_mps2 else accel * self.limit_mps2 / size
        self.pos = self.pos + self.vel * TICK_S + 0.5 * self.accel * TICK_S**2
        self.vel = self.vel + self.accel * TICK_S


def meet(seed: int, *, kind: str, sensor: SensorClass, density_per_ha: float, speed_mps: float) -> Met:
    """One encounter."""
    rng = np.random.default_rng(seed)
    mission = mission_of(density_per_ha, sensor, seed)
    bearing = float(rng.uniform(0.0, math.tau))
    aside_m = float(rng.uniform(-ASIDE_M, ASIDE_M))
    one = np.array([math.cos(bearing), math.sin(bearing)])
    turned = bearing + math.radians(COURSES_DEG[kind] + float(rng.uniform(-20.0, 20.0)))
    other = np.array([math.cos(turned), math.sin(turned)])
    middle = np.array([0.0, 80.0])
    across = np.array([-one[1], one[0]]) * aside_m
    vels = (speed_mps * one, SHARES.get(kind, 1.0) * speed_mps * other)
    starts = (middle - MEET_S * vels[0], middle - MEET_S * vels[1] + across)
    ways = np.concatenate(
        [start + vel * np.linspace(-1.0, LASTS_S, 60)[:, None] for start, vel in zip(starts, vels, strict=True)]
    )
    stand = _with_trunks(_thinned(stand_of(mission), ways), kind, middle, one, other)
    scene = Scene(stand, mission.sensing.range_m if mission.sensing else 8.0)
    pair = [
        Vehicle(mission, scene, (float(start[0]), float(start[1])), (float(vel[0]), float(vel[1])), seed + k)
        for k, (start, vel) in enumerate(zip(starts, vels, strict=True))
    ]
    steered = (0,) if kind == "hovering" else (0, 1)
    least_m, now_s = math.inf, 10.0
    for _ in range(round(LASTS_S / TICK_S)):
        now_s += TICK_S
        for k in steered:
            pair[k].sense(pair[1 - k], now_s)
        for k in steered:
            pair[k].command(pair[1 - k], now_s)
        for k in steered:
            pair[k].move()
        least_m = min(least_m, float(np.linalg.norm(pair[0].pos - pair[1].pos)))
    return Met(least_m, min(vehicle.known_m for vehicle in pair))


def _thinned(stand: Stand, ways: np.ndarray) -> Stand:
    trees = [
        tree
        for tree in stand.trees
        if float(np.min(np.hypot(ways[:, 0] - tree.north_m, ways[:, 1] - tree.east_m))) > tree.radius_m + WAY_M
    ]
    return Stand(trees, (), stand.grade)


def _with_trunks(stand: Stand, kind: str, middle: np.ndarray, one: np.ndarray, other: np.ndarray) -> Stand:
    """With those that hide the two from one another until they are near, or that leave them one way."""
    places: list[np.ndarray] = []
    if kind == "round trunks":
        between = -(one + other) / np.linalg.norm(one + other)
        places = [middle + between * away_m for away_m in np.arange(*HEDGE_M)]
    elif kind == "in a gap":
        across = np.array([-one[1], one[0]])
        places = [middle + across * side_m for side_m in (-GAP_M, GAP_M)]
    trees = [StandTree(float(place[1]), float(place[0]), TRUNK_M, 20.0, 15.0, 2.0) for place in places]
    return Stand((*stand.trees, *trees), (), stand.grade)


def main(argv: Sequence[str]) -> int:
    """Prints a row for each kind of encounter and class of sensor."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench encounters", description=__doc__)
    parser.add_argument("--runs", type=positive, default=50, metavar="N", help="of each kind and class (50)")
    parser.add_argument("--first-seed", type=as_seed, default=3000, metavar="S", help="(3000)")
    parser.add_argument("--density", type=as_density, default=200.0, metavar="TREES", help="per ha (200)")
    parser.add_argument(
        "--speed", type=number(0.1, 10.0), default=3.0, metavar="MPS", help="of each; one overtaken: a third (3)"
    )
    classes = [sensor.value for sensor in SensorClass]
    parser.add_argument("--sensor", action="append", choices=classes, help="sensing.sensor (sectors, scan-1deg)")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="nearest against known from, of each encounter")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="at once (2)")
    args = parser.parse_args(argv)
    all_met: dict[tuple[SensorClass, str], list[Met]] = {}
    print(
        "| sensor | encounter | runs | contacts | nearest, m | below 2 m | vehicle known from, m |",
        "|---|---|---|---|---|---|---|",
        sep="\n",
    )
    for sensor in [SensorClass(name) for name in args.sensor or ("sectors", "scan-1deg")]:
        for kind in COURSES_DEG:
            one = partial(meet, kind=kind, sensor=sensor, density_per_ha=args.density, speed_mps=args.speed)
            with ProcessPoolExecutor(args.jobs) as pool:
                met = list(pool.map(one, range(args.first_seed, args.first_seed + args.runs), chunksize=5))
            all_met[sensor, kind] = met
            least_m = [one.least_m for one in met]
            known_m = [one.known_m for one in met if one.known_m < math.inf]
            contacts, near = (sum(m < limit_m for m in least_m) for limit_m in (CONTACT_M, 2.0))
            known = f"{spread(known_m, '')}, {len(known_m)} of {len(met)}" if known_m else "never"
            print(
                f"| {sensor.value} | {kind} | {len(met)} | {contacts} | {spread(least_m, '')} | {near} | {known} |",
                flush=True,
            )
    if args.plot:
        draw(all_met, args.plot, args.speed)
    return 0


def draw(met: Mapping[tuple[SensorClass, str], Sequence[Met]], file: Path, speed_mps: float) -> None:
    """How near they came, over the distance from which one first knew of the other: a panel for each class."""
    sensors = list(dict.fromkeys(sensor for sensor, _ in met))
    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(3.4 * len(sensors), 3.6), dpi=110, layout="constrained")
        panels = figure.subplots(1, len(sensors), sharex=True, sharey=True, squeeze=False)[0]
        for axes, sensor in zip(panels, sensors, strict=True):
            for kind, colour in zip(COURSES_DEG, colours(len(COURSES_DEG)), strict=True):
                known = [one for one in met[sensor, kind] if one.known_m < math.inf]
                places = [[one.known_m for one in known], [one.least_m for one in known]]
                axes.plot(*places, "o", markersize=2.5, alpha=0.6, color=colour, label=kind)
            axes.axhline(CONTACT_M, color=ALARM, linewidth=0.8)
            axes.plot([0.0, 11.0], [0.0, 11.0], color=FAINT, linewidth=0.8)
            axes.set_title(sensor.value)
            axes.set_xlabel("vehicle known from, m")
        panels[0].set_ylabel(f"nearest, m, at {speed_mps:g} m/s each")
        panels[0].legend(loc="upper left")
        figure.savefig(file, metadata={"Software": None})
