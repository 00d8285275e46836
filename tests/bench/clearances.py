"""Clearances to trunks as believed, against the truth, open loop: `python -m tests.bench own-motion --clearances`.

The flights are those of `own_motion`. Of every trunk whose bark is within NEAR_M in a tick: how far it is by the points
that the safety filter gets, where it looks from, and by the tracked trunk that is a good one there, a circle. What
counts is a clearance believed too large, as a vehicle is led that much nearer; ACTS_S ahead what the own velocity is
wrong, against what is seen, comes to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.core.model.velocity_bias import VelocityBias
from companion.core.perception.level_scan import ScanClass
from companion.core.perception.motion_margin import ACTS_S, velocity_error_mps
from mission.common.frames import Vec3
from mission.schema.kinds import SensorClass
from mission.schema.trees import StandTree
from tests.bench.own_motion import SENSORS, SETTLED_S, TICK_S, Tick, fly_ticks

NEAR_M = 3.0
OF_TRUNK_M = 0.7  # a point so near to a bark is that trunk's, a circle whose axis is so near to the trunk's axis
TURNS_MPS2 = 1.0  # to the side; in between a way is neither straight nor a turn
STRAIGHT_MPS2 = 0.3
HULL_M = 0.35  # sensing.vehicle_radius_m, by default
STRIDE_TICKS = 2  # a turn of the sensor


@dataclass(slots=True)
class Told:
    """What was believed in the ticks of some runs. Of trunks and ticks each a row; metres, m/s, rad."""

    # True distance of the bark; believed too large by points, by circles (nan: none there); side acceleration; what a
    # velocity that is wrong adds until a setpoint acts; what is kept beyond the hull; sd of the track from here
    trunks: list[tuple[float, ...]]
    # Velocity's error, level, as reported and corrected; side acceleration; told; since trunks corrected last, s;
    # heading's error, its sd; the shift's sd; the corrected velocity's error as of _find_wrong, level and aside; speed
    ticks: list[tuple[float, ...]]


def observe(told: Told, ticks: Iterator[Tick]) -> None:
    """Takes in a run."""
    side_mps2, before = 0.0, None
    reported = VelocityBias()  # what a companion knows of its velocity without trunks
    for k, tick in enumerate(ticks):
        vel = tick.state.vel_ned_mps
        if before is not None:
            turned = math.remainder(math.atan2(vel[1], vel[0]) - math.atan2(before[1], before[0]), math.tau)
            side_mps2 = abs(turned) / TICK_S * math.hypot(vel[0], vel[1])
        before = vel
        reported.update(tick.own.pos_ned_m, tick.own.vel_ned_mps, tick.now_s)
        if tick.since_s <= SETTLED_S or k % STRIDE_TICKS:
            continue
        _observe_tick(told, tick, tick.perception.velocity_bias(reported.ned_mps), side_mps2)


def _observe_tick(told: Told, tick: Tick, bias: Vec3, side_mps2: float) -> None:
    perception, own = tick.perception, tick.own
    odometry = perception.motion.odometry
    wrong, at = tick.wrong_ned_mps, tick.state.pos_ned_m
    off, true, turned_rad = _find_wrong(tick, bias)
    turn_sd_rad = math.sqrt(odometry._heading_rad2())
    shift_sd_m = odometry.shift_sd_m(tick.now_s)
    told.ticks.append(
        (
            math.hypot(wrong[0], wrong[1]),
            math.hypot(wrong[0] + bias[0], wrong[1] + bias[1]),
            side_mps2,
            float(perception.sees_motion),
            tick.now_s - odometry.corrected_s,
            abs(tick.yaw_off_rad + perception.motion.turn_rad),
            turn_sd_rad,
            shift_sd_m,
            math.hypot(*off),
            abs(off[0] * true[1] - off[1] * true[0]) / max(1e-6, math.hypot(*true)),
            math.hypot(*tick.state.vel_ned_mps[:2]),
        )
    )
    cloud = perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, tick.now_s)
    points = np.column_stack([cloud.norths, cloud.easts]) if cloud.norths else np.zeros((0, 2))
    kept_m = cloud.clears_m[0] - HULL_M if cloud.norths else math.nan
    here = odometry.correct_place(own.pos_ned_m)
    tracks = [trunk for trunk in odometry.trunks if trunk.is_good]
    for tree in tick.stand.near(at[1], at[0], NEAR_M):
        north, east = tree.north_m - at[0], tree.east_m - at[1]
        axis_m = math.hypot(north, east)
        true_m = axis_m - tree.radius_m
        by_points = _nearest_m(points, tree, north, east)
        by_circles = track_sd_m = math.nan
        for trunk in tracks:
            n, e = trunk.north_m - here[0], trunk.east_m - here[1]
            if math.hypot(n - north, e - east) < OF_TRUNK_M:
                away_m = math.hypot(n, e)
                un, ue = n / away_m, e / away_m
                variance = trunk.nn_m2 * un * un + 2.0 * trunk.ne_m2 * un * ue + trunk.ee_m2 * ue * ue
                by_circles, track_sd_m = away_m - trunk.radius_m, math.sqrt(variance + shift_sd_m * shift_sd_m)
                break
        bearing_rad = math.atan2(east, north) + turned_rad  # as it is seen
        strays_m = -ACTS_S * (off[0] * math.cos(bearing_rad) + off[1] * math.sin(bearing_rad))
        told.trunks.append((true_m, by_points - true_m, by_circles - true_m, side_mps2, strays_m, kept_m, track_sd_m))


def _find_wrong(tick: Tick, bias: Vec3) -> tuple[tuple[float, float], tuple[float, float], float]:
    """What the corrected velocity is wrong, and the true one, in the frame of what is seen; how that is turned.

    What is seen is placed by a heading that is wrong, so a vehicle goes past it by a velocity that is turned as much.
    """
    vel, wrong = tick.state.vel_ned_mps, tick.wrong_ned_mps
    turned_rad = tick.yaw_off_rad + tick.perception.motion.turn_rad
    cos, sin = math.cos(turned_rad), math.sin(turned_rad)
    true = cos * vel[0] - sin * vel[1], sin * vel[0] + cos * vel[1]
    off = vel[0] + wrong[0] + bias[0] - true[0], vel[1] + wrong[1] + bias[1] - true[1]
    return off, true, turned_rad


def _nearest_m(points: npt.NDArray[np.float64], tree: StandTree, north_m: float, east_m: float) -> float:
    """Of a tree's points the distance of the nearest; nan: none."""
    of_tree = np.abs(np.hypot(points[:, 0] - north_m, points[:, 1] - east_m) - tree.radius_m) < OF_TRUNK_M
    return float(np.hypot(*points[of_tree].T).min()) if of_tree.any() else math.nan


def tell(sensor: SensorClass, density_per_ha: float, seeds: Sequence[int], winding: float = 1.0) -> Told:
    """Some runs."""
    told = Told([], [])
    for seed in seeds:
        observe(told, fly_ticks(density_per_ha, sensor, seed, winding=winding))
    return told


HEAD = (
    "| sensor | trees/ha | way | in the map | points, m: mean | 99 % | 99.9 % | points, 0.65 s ahead: 99 % | 99.9 % "
    "| a good track | circles, m: mean | 99 % | 99.9 % | 0.65 s ahead: 99.9 % "
    "| kept beyond the hull, m | left of it at 99.9 % | velocity against what is seen wrong, m/s: 99 % | 99.9 % |\n"
    + "|---" * 18
    + "|"
)


def rows(sensor: SensorClass, density_per_ha: float, told: Told) -> Iterator[str]:
    """Of straight ways, of turns, and of all."""
    trunks, ticks = np.array(told.trunks), np.array(told.ticks)
    for way, least_mps2, most_mps2 in (
        ("straight", 0.0, STRAIGHT_MPS2),
        ("turns", TURNS_MPS2, math.inf),
        ("all", 0.0, math.inf),
    ):
        some = trunks[(trunks[:, 3] >= least_mps2) & (trunks[:, 3] <= most_mps2)]
        vel = ticks[(ticks[:, 2] >= least_mps2) & (ticks[:, 2] <= most_mps2)][:, 8]
        mapped, tracked = ~np.isnan(some[:, 1]), ~np.isnan(some[:, 2])
        ahead = some[mapped, 1] + some[mapped, 4]
        cells = [f"{100.0 * np.mean(mapped):.1f} %", *_spread(some[mapped, 1]), *_spread(ahead)[1:]]
        cells += [f"{100.0 * np.mean(tracked):.0f} %", *_spread(some[tracked, 2])]
        cells += [_spread(some[tracked, 2] + some[tracked, 4])[2], _spread(some[mapped, 5])[0]]
        cells += [f"{-float(_spread(ahead - some[mapped, 5])[2] or 'nan'):.2f}", *_spread(vel)[1:]]
        yield f"| {sensor.value}, {SENSORS[sensor]:g} m | {density_per_ha:g} | {way} | {' | '.join(cells)} |"


SD_M = (0.0, 0.03, 0.04, 0.05, 0.07, 0.1, 0.16, 0.2, math.inf)


def sd_rows(sensor: SensorClass, ticks: npt.NDArray[np.float64]) -> Iterator[str]:
    """How wrong the velocity is, level, by how sure the scan odometry is of the position; the same of the heading."""
    yield "| sensor | position's sd, m | ticks | velocity wrong, m/s: rms | 99 % | 99.9 % | reckoned with |"
    yield "|---" * 7 + "|"
    for k in range(len(SD_M) - 1):
        some = ticks[(ticks[:, 7] >= SD_M[k]) & (ticks[:, 7] < SD_M[k + 1])]
        if not len(some):
            continue
        cells = [f"{math.sqrt(np.mean(some[:, 8] ** 2)):.2f}", *_spread(some[:, 8])[1:]]
        cells.append(f"{velocity_error_mps(ScanClass(sensor), float(np.mean(some[:, 7]))):.2f}")
        yield f"| {sensor.value} | {SD_M[k]:g} to {SD_M[k + 1]:g} | {len(some)} | {' | '.join(cells)} |"
    sigmas = _spread(ticks[:, 5] / np.maximum(ticks[:, 6], 1e-6))
    told = f"the heading's error in its standard deviations: mean {sigmas[0]}, 99.9 % {sigmas[2]}"
    yield f"{sensor.value}: {told}; reported velocity wrong, m/s: 99.9 % {_spread(ticks[:, 0])[2]}"


def _spread(values: npt.NDArray[np.float64]) -> list[str]:
    """Mean, 99 % and 99.9 %."""
    if not values.size:
        return ["", "", ""]
    return [f"{v:.2f}" for v in (np.mean(values), np.quantile(values, 0.99), np.quantile(values, 0.999))]
