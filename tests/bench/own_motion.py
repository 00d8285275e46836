"""Errors of the own motion by scans, open loop, beside what the autopilot reports: `python -m tests.bench own-motion`.

One vehicle flies a drawn, winding course at 3 m/s through drawn stands, leaning and turning as it goes; its autopilot's
errors are those of `sim.estimates = "recorded"`. Trees that the course would touch are left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.core.model.events import LidarScan, ObstacleScan, Position
from companion.core.perception.obstacle_perception import SensingPerception
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import (
    LIDAR_SCAN_ID,
    NOT_MEASURED_MM,
    NOTHING_MM,
    LidarPiece,
    decode_lidar_scan,
    encode_lidar_scan,
)
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.stand.stand import Stand, stand_of
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.autopilot.estimates.errors import errors_of
from sim_bridge.world.autopilot.estimates.noise import Swinging
from sim_bridge.world.sensors.lidar import Lidar
from sim_bridge.world.sensors.raw_lidar import PIECE_RAYS, RawLidar
from sim_bridge.world.sensors.scan import STEP_RAD
from sim_bridge.world.sensors.scene import Scene
from tests.bench.options import as_density, number

TICK_S = 0.05
LENGTH_S = 60.0
SPEED_MPS = 3.0
WIDE_M = 0.9  # from the course to a bark: as near as vehicles pass
LATE_S = 0.05  # of a scan: a tick
SETTLED_S = 5.0  # from when on errors count
FOUND_S = 20.0  # from when on drifts do
MEAN_TICKS = 20  # of which headings are averaged: a turn of the sensor is noisy
SENSORS = {
    SensorClass.SECTORS: 8.0,
    SensorClass.SCAN_1DEG: 12.0,
    SensorClass.SCAN_HALF_DEG: 20.0,
    SensorClass.MULTI_LAYER: 12.0,
}


@dataclass(frozen=True, slots=True)
class Flown:
    """Errors of one run: reported and corrected velocity, m/s rms an axis; place, m; heading, degrees."""

    reported_mps: float
    corrected_mps: float
    p999_mps: float  # level, of the corrected velocity
    strayed_m: float  # of the corrected place against the truth, at the end of 100 m, level
    heading_deg: float  # of the corrected heading, rms
    reported_heading_deg: float
    corrected_share: float  # of the time in which trunks corrected the pose
    # From FOUND_S on, when flying has shown how the trunks' frame is turned: for each 100 m of way
    drift_m: float
    drift_deg: float


def mission_of(density_per_ha: float, sensor: SensorClass, seed: int) -> Mission:
    """A stand, and a sensor."""
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (160.0, 0.0, 4.0), "vel_leader_mps": SPEED_MPS},
            "sensing": {"sensor": sensor.value, "range_m": SENSORS[sensor]},
            "forest": {"stand": {"density_per_ha": density_per_ha, "margin_m": 40.0, "seed": seed}},
            "sim": {"seed": seed, "estimates": "recorded", "range_finder": True},
        }
    )


def course(rng: np.random.Generator, lean_rad: float = 0.0, winding: float = 1.0) -> Iterator[AirframeState]:
    """True states, a tick each: a winding way east, heading along it with some lag. `lean_rad`: more, forward.

    `winding`: so many times as far to the sides.
    """
    periods = rng.uniform(4.0, 15.0, 3)
    phases, sizes = rng.uniform(0.0, math.tau, 3), rng.uniform(0.3, 1.0, 3)
    pos, yaw, speed = np.zeros(2), math.pi / 2.0, 0.0
    for k in range(round(LENGTH_S / TICK_S)):
        t = k * TICK_S
        bearing = math.pi / 2.0 + winding * float(0.35 * np.sum(sizes * np.sin(math.tau * t / periods + phases)))
        asked = SPEED_MPS * (0.75 + 0.25 * math.sin(math.tau * t / 11.0))
        speed += max(-2.0, min(2.0, asked - speed)) * TICK_S
        vel = (speed * math.cos(bearing), speed * math.sin(bearing))
        rate = max(-0.7, min(0.7, math.remainder(bearing - yaw, math.tau)))
        yaw += rate * TICK_S
        pos = pos + np.array(vel) * TICK_S
        lean = (0.08 * math.sin(t), -0.06 - lean_rad + 0.06 * math.cos(0.7 * t), yaw)
        yield AirframeState((pos[0], pos[1], -4.0), (*vel, 0.0), lean, (0.0, 0.0, rate), False, 0.4)


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of a run, after its scans were taken in."""

    now_s: float
    since_s: float  # of the run
    state: AirframeState  # true
    own: Position  # as reported
    wrong_ned_mps: Vec3  # reported velocity less the true one
    bias_ned_mps: Vec3  # as trunks correct it
    yaw_off_rad: float  # of the reported yaw
    perception: SensingPerception
    stand: Stand


def fly(density_per_ha: float, sensor: SensorClass, seed: int, lean_rad: float = 0.0, winding: float = 1.0) -> Flown:
    """One run."""
    reported: list[Vec3] = []
    corrected: list[Vec3] = []
    headings: list[tuple[float, float]] = []
    strayed: list[tuple[float, float]] = []
    fixed = 0
    for tick in fly_ticks(density_per_ha, sensor, seed, lean_rad, winding):
        if tick.since_s <= SETTLED_S:
            continue
        wrong, bias, at = tick.wrong_ned_mps, tick.bias_ned_mps, tick.state.pos_ned_m
        reported.append((wrong[0], wrong[1], 0.0))
        corrected.append((wrong[0] + bias[0], wrong[1] + bias[1], 0.0))
        motion = tick.perception.motion
        headings.append((tick.yaw_off_rad, tick.yaw_off_rad + motion.turn_rad))
        placed = motion.correct_place(tick.own.pos_ned_m)
        strayed.append((placed[0] - at[0], placed[1] - at[1]))
        fixed += motion.odometry.is_corrected(tick.now_s)
    told_v, seen_v = np.array(reported)[:, :2], np.array(corrected)[:, :2]
    angles, drift = np.degrees(np.array(headings)), np.array(strayed)
    flown_m = SPEED_MPS * 0.75 * LENGTH_S
    found = round((FOUND_S - SETTLED_S) / TICK_S)
    since_m = flown_m * (1.0 - FOUND_S / LENGTH_S)
    turned_deg = float(np.mean(angles[-MEAN_TICKS:, 1]) - np.mean(angles[found : found + MEAN_TICKS, 1]))
    return Flown(
        float(np.sqrt(np.mean(told_v**2))),
        float(np.sqrt(np.mean(seen_v**2))),
        float(np.quantile(np.hypot(*seen_v.T), 0.999)),
        float(np.hypot(*(drift[-1] - drift[0])) * 100.0 / flown_m),
        float(np.sqrt(np.mean(angles[:, 1] ** 2))),
        float(np.sqrt(np.mean(angles[:, 0] ** 2))),
        fixed / len(reported),
        float(np.hypot(*(drift[-1] - drift[found])) * 100.0 / since_m),
        abs(turned_deg) * 100.0 / since_m,
    )


def fly_ticks(
    density_per_ha: float, sensor: SensorClass, seed: int, lean_rad: float = 0.0, winding: float = 1.0
) -> Iterator[Tick]:
    """The ticks of one run. `winding`: as `course`."""
    mission = mission_of(density_per_ha, sensor, seed)
    assert mission.sensing is not None
    rng = np.random.default_rng(seed)
    states = list(course(rng, lean_rad, winding))
    stand = _thinned(stand_of(mission), states)
    scene = Scene(stand, mission.sensing.range_m)
    sizes = errors_of(mission.sim, 1)
    noise = Swinging(
        velocity_sd_mps=sizes.velocity_noise_mps,
        climb_sd_mps=sizes.climb_noise_mps,
        position_sd_m=sizes.position_noise_m,
        height_sd_m=sizes.height_noise_m,
        yaw_sd_rad=sizes.yaw_noise_rad,
        rng=rng,
    )
    raw = (
        None
        if sensor is SensorClass.SECTORS
        else RawLidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1)
    )
    sectors = Lidar(scene, mission.sensing, LidarErrors(), seed=seed, vehicle_id=1)
    perception = SensingPerception(mission, mission.sensing)
    scans: list[tuple[float, list[ObstacleScan | LidarScan]]] = []
    for k, state in enumerate(states):
        now_s = 10.0 + k * TICK_S
        noise.step(TICK_S)
        off, at, vel = noise.pos_ned_m, state.pos_ned_m, state.vel_ned_mps
        wrong = noise.velocity_ned_mps
        own = Position(
            (at[0] + off[0], at[1] + off[1], at[2] + off[2]), (vel[0] + wrong[0], vel[1] + wrong[1], 0.0), now_s
        )
        yaw_off = sizes.yaw_bias_rad + noise.yaw_rad
        perception.correct_odometry(own, now_s)
        bias = perception.velocity_bias((0.0, 0.0, 0.0))
        true_vel = Position(own.pos_ned_m, (own.vel_ned_mps[0] + bias[0], own.vel_ned_mps[1] + bias[1], 0.0))
        while scans and scans[0][0] <= now_s - LATE_S + 1e-9:
            for scan in scans.pop(0)[1]:
                perception.integrate_scan(scan, true_vel, now_s, ())
        told = raw.scan(state, (), now_s) if raw is not None else sectors.scan(state, (), now_s)
        if told is not None:
            scans.append((now_s, list(scan_events(told.ranges_m, sensor, mission, state, yaw_off))))
        yield Tick(now_s, k * TICK_S, state, own, wrong, bias, yaw_off, perception, stand)


def _thinned(stand: Stand, states: Sequence[AirframeState]) -> Stand:
    ways = np.array([state.pos_ned_m[:2] for state in states])
    trees = [
        tree
        for tree in stand.trees
        if float(np.min(np.hypot(ways[:, 0] - tree.north_m, ways[:, 1] - tree.east_m))) > tree.radius_m + WIDE_M
    ]
    return Stand(trees, stand.bushes, stand.grade, stand.boxes)


def scan_events(
    ranges_m: object, sensor: SensorClass, mission: Mission, state: AirframeState, yaw_off: float
) -> Iterator[ObstacleScan | LidarScan]:
    """A turn that ends now, as the companion has it a tick later: of a lidar what its messages tell of it."""
    assert mission.sensing is not None
    roll, pitch, yaw = state.attitude_rad
    max_m = mission.sensing.range_m
    if sensor is SensorClass.SECTORS:
        told = tuple(float(r) for r in ranges_m)  # type: ignore[attr-defined]
        yield ObstacleScan(196, told, 0.0, STEP_RAD, 0.2, max_m, roll, pitch, yaw + yaw_off, LATE_S)
        return
    lidar = RAW_LIDARS[sensor]
    for elevation_deg, row in zip(lidar.elevations_deg, np.asarray(ranges_m), strict=True):
        ray_s = 1.0 / mission.sensing.rate_hz / len(row)
        for first in range(0, len(row), PIECE_RAYS):
            part = row[first : first + PIECE_RAYS]
            before = (len(row) - 1 - first) * ray_s
            after = before - (len(part) - 1) * ray_s
            turns = [(roll, pitch, yaw + yaw_off - state.rates_radps[2] * age_s) for age_s in (before, after)]
            piece = _sent(
                time_us=0,
                ray_time_s=ray_s,
                first_bearing_deg=lidar.step_deg * first,
                bearing_step_deg=lidar.step_deg,
                elevation_deg=elevation_deg,
                min_m=0.2,
                max_m=max_m,
                turn=_turn(state),
                ranges_mm=[_mm(float(range_m)) for range_m in part],
            )
            if piece is not None:
                yield LidarScan(
                    196,
                    piece.turn,
                    piece.ranges_m,
                    math.radians(piece.elevation_deg),
                    math.radians(piece.first_bearing_deg),
                    math.radians(piece.bearing_step_deg),
                    piece.min_m,
                    piece.max_m,
                    LATE_S + before,
                    piece.ray_time_s,
                    turns[0],
                    turns[1],
                )


def _sent(**fields: Any) -> LidarPiece | None:
    """A piece as its receiver has it."""
    frame = wire.frame(LIDAR_SCAN_ID, encode_lidar_scan(**fields), seq=0, system=1, component=196)
    return decode_lidar_scan(wire.fields(frame))


def _mm(range_m: float) -> int:
    if math.isnan(range_m):
        return NOT_MEASURED_MM
    return NOTHING_MM if math.isinf(range_m) else round(1000.0 * range_m)


def _turn(state: AirframeState) -> int:
    return hash(state.pos_ned_m) % 256


def main(argv: Sequence[str]) -> int:
    """Prints a row for each density and class."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench own-motion", description=__doc__)
    parser.add_argument("--runs", type=positive, default=10, metavar="N", help="of each density and class (10)")
    parser.add_argument("--first-seed", type=as_seed, default=2000, metavar="S", help="(2000)")
    parser.add_argument("--density", type=as_density, action="append", metavar="TREES", help="per ha (100, 200, 400)")
    parser.add_argument("--sensor", type=SensorClass, action="append", metavar="CLASS", help="(all)")
    parser.add_argument(
        "--lean-deg", type=number(-45.0, 45.0), default=0.0, metavar="DEG", help="so much further forward (0)"
    )
    parser.add_argument(
        "--winding", type=number(0.0, 5.0), default=1.0, metavar="TIMES", help="as far to the sides (1)"
    )
    parser.add_argument("--clearances", action="store_true", help="to trunks, as believed: see tests.bench.clearances")
    args = parser.parse_args(argv)
    if args.clearances:
        print_clearances(args)
        return 0
    lean_rad = math.radians(args.lean_deg)
    print(
        "| sensor | trees/ha | velocity, m/s an axis: reported | corrected | 99.9 % of its error are less "
        "| place, m per 100 m | heading, deg: reported | corrected | trunks correct it for "
        f"| from {FOUND_S:g} s on: place, m per 100 m | heading, deg per 100 m |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for sensor in args.sensor or SENSORS:
        for density in args.density or (100.0, 200.0, 400.0):
            seeds = range(args.first_seed, args.first_seed + args.runs)
            runs = [fly(density, sensor, seed, lean_rad, args.winding) for seed in seeds]
            names = ("reported_mps", "corrected_mps", "p999_mps", "strayed_m", "reported_heading_deg", "heading_deg")
            cells = [_cell([getattr(run, name) for run in runs]) for name in names]
            share = np.mean([run.corrected_share for run in runs])
            what = f"{sensor.value}, {SENSORS[sensor]:g} m"
            drifts = [_cell([getattr(run, name) for run in runs]) for name in ("drift_m", "drift_deg")]
            told = " | ".join([what, f"{density:g}", *cells, f"{100.0 * share:.0f} %", *drifts])
            print(f"| {told} |", flush=True)
    return 0


def print_clearances(args: argparse.Namespace) -> None:
    """Rows for each density and class."""
    from tests.bench import clearances

    print(clearances.HEAD)
    by_sd = []
    for sensor in args.sensor or SENSORS:
        ticks = []
        for density in args.density or (100.0, 200.0, 400.0):
            seeds = range(args.first_seed, args.first_seed + args.runs)
            told = clearances.tell(sensor, density, seeds, args.winding)
            print(*clearances.rows(sensor, density, told), sep="\n", flush=True)
            ticks += told.ticks
        by_sd += list(clearances.sd_rows(sensor, np.array(ticks)))
    print("", *by_sd, sep="\n")


def _cell(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f} ({max(values):.2f})"
