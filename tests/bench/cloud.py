"""How far a run's point cloud lies from the bark of the bridge's true trunks: `python -m tests.bench cloud RUN`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from mission.stems import utm
from sim_bridge.judge.run_folder import STAND_FOLDER
from sim_bridge.world.sensors.stems.shapes import EAST, LEAN_E, LEAN_N, NORTH, REF, radius_m, shapes_of
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.stand_map import compare, read_stems

Floats = NDArray[np.float64]
CLOUD_LAZ = "cloud.laz"
STEM = 5  # class of points on stems
NEAR_M = 1.5  # from a trunk's place: beyond, a point is of no trunk
LEAST_POINTS = 20  # of a stem that is moved to its trunk
BARK_M = 0.05  # scale of points' distances, beyond which they count less


class Read(NamedTuple):
    """A cloud as laspy reads it, in the mission's frame."""

    east_m: Floats
    north_m: Floats
    up_m: Floats
    above_ground_m: Floats
    of_stem: NDArray[np.bool_]
    tree: NDArray[np.int64]
    vehicle: NDArray[np.int64]


def read_cloud(file: Path, origin: Wgs84) -> Read:
    """Back from UTM, by a fit of third degree to places all around: exact to a millimetre within a stand."""
    import laspy  # which the other benches need not have

    las, zone, frame = laspy.read(file), utm.zone_at(origin.lat_deg, origin.lon_deg), LocalFrame(origin)
    places = np.array([(e, n) for e in np.linspace(-150.0, 250.0, 7) for n in np.linspace(-150.0, 150.0, 7)])
    there = [frame.to_wgs84(enu_to_ned((float(e), float(n), 0.0))) for e, n in places]
    grid = np.array([utm.from_wgs84(at.lat_deg, at.lon_deg, zone) for at in there])
    middle = grid.mean(axis=0)
    fit = np.linalg.lstsq(_terms(grid - middle), places, rcond=None)[0]
    east_m, north_m = (_terms(np.column_stack((las.x, las.y)) - middle) @ fit).T
    return Read(
        east_m,
        north_m,
        np.asarray(las.z) - origin.alt_m,
        np.asarray(las["above_ground_m"], dtype=np.float64),
        np.asarray(las.classification) == STEM,
        np.asarray(las["treeID"]).astype(np.int64),
        np.asarray(las.point_source_id).astype(np.int64),
    )


def bark_off_m(cloud: Read, mission: Mission, stand: Stand) -> Floats:
    """Level distance of each point from the nearest true bark, outwards positive; inf: no trunk is near.

    At the point's height above the ground as its rays saw that: a vehicle's own height is a barometer's.
    """
    shapes = shapes_of(mission, stand)
    off_m = np.full(len(cloud.east_m), np.inf)
    if shapes is None:
        trunks = [(t.north_m, t.east_m, t.radius_m) for t in stand.trees]
        for north_m, east_m, radius in trunks:
            away_m = np.hypot(cloud.north_m - north_m, cloud.east_m - east_m) - radius
            off_m = np.where(np.abs(away_m) < np.abs(off_m), away_m, off_m)
        return off_m
    for row in shapes.trunks:
        near = np.flatnonzero(np.hypot(cloud.north_m - row[NORTH], cloud.east_m - row[EAST]) < NEAR_M)
        up_m = np.where(np.isnan(cloud.above_ground_m), cloud.up_m, cloud.above_ground_m)[near]
        up_m = up_m + stand.ground_up_m(float(row[EAST]), float(row[NORTH])) * ~np.isnan(cloud.above_ground_m[near])
        to_n = cloud.north_m[near] - row[NORTH] - row[LEAN_N] * (up_m - row[REF])
        to_e = cloud.east_m[near] - row[EAST] - row[LEAN_E] * (up_m - row[REF])
        rows = np.tile(row, (len(near), 1))
        away_m = np.hypot(to_n, to_e) - radius_m(rows, up_m, np.arctan2(to_e, to_n))
        closer = np.abs(away_m) < np.abs(off_m[near])
        off_m[near[closer]] = away_m[closer]
    return off_m


def _terms(at: Floats) -> Floats:
    at = at / 100.0
    squares = (at[:, :1] * at[:, 1:], at**2)
    return np.hstack((np.ones((len(at), 1)), at, *squares, at**3))


def shifted(cloud: Read, stand: Stand) -> tuple[Read, float]:
    """The cloud with each stem's points moved level to the nearest true trunk, and the median length of the move.

    What is left is the shape: noise of the lidar, and of the poses within a pass and between passes.
    """
    east_m, north_m, moves = cloud.east_m.copy(), cloud.north_m.copy(), []
    for tree in np.unique(cloud.tree[cloud.tree > 0]):
        own = (cloud.tree == tree) & cloud.of_stem
        if own.sum() < LEAST_POINTS:
            continue
        e, n = cloud.east_m[own], cloud.north_m[own]
        nearest = min(stand.trees, key=lambda t: (t.east_m - e.mean()) ** 2 + (t.north_m - n.mean()) ** 2)
        best = _best_move(e, n, nearest.east_m, nearest.north_m, nearest.radius_m)
        moves.append(float(np.hypot(*best)))
        east_m[cloud.tree == tree] += best[0]
        north_m[cloud.tree == tree] += best[1]
    return cloud._replace(east_m=east_m, north_m=north_m), float(np.median(moves)) if moves else 0.0


def _best_move(e: Floats, n: Floats, east_m: float, north_m: float, radius: float) -> Floats:
    """Least squares of points to a circle that is known, by Gauss and Newton."""
    move = np.zeros(2)
    for _ in range(20):
        to = np.column_stack((e + move[0] - east_m, n + move[1] - north_m))
        away = np.maximum(np.hypot(to[:, 0], to[:, 1]), 1e-6)
        off = away - radius
        weight = 1.0 / (1.0 + (off / BARK_M) ** 2)
        slope = to / away[:, None]
        normal = slope.T @ (slope * weight[:, None]) + 1e-9 * np.eye(2)
        move -= np.linalg.solve(normal, slope.T @ (off * weight))
    return move


def main(argv: list[str]) -> int:
    """Prints the figures of a run folder."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench cloud", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a flight that surveyed")
    parser.add_argument("--dendromatics", action="store_true", help="what that library makes of it, where installed")
    arguments = parser.parse_args(argv)
    run: Path = arguments.run
    mission = load_mission(run / "mission.toml")
    placed = mission if mission.origin is not None else mission.with_origin(DEFAULT_ORIGIN)
    assert placed.origin is not None
    stand = stand_of(placed, run)
    cloud = read_cloud(run / STAND_FOLDER / CLOUD_LAZ, placed.origin.wgs84)
    moved, move_m = shifted(cloud, stand)
    print(f"{len(cloud.east_m)} points, {cloud.of_stem.mean():.1%} of stems, {len(set(cloud.tree) - {0})} stems")
    for name, one in (("as written", cloud), (f"each stem moved to its trunk, {move_m:.3f} m in the median", moved)):
        off_m = bark_off_m(one, placed, stand)[one.of_stem]
        near = np.abs(off_m[np.isfinite(off_m)])
        shares = ", ".join(
            f"{share:.0%} within {100.0 * np.quantile(near, share):.1f} cm" for share in (0.5, 0.9, 0.95)
        )
        print(f"{name}: {shares}; rms of those within 30 cm {100.0 * np.sqrt(np.mean(near[near < 0.3] ** 2)):.1f} cm")
    if arguments.dendromatics:
        _referee(cloud, run, stand)
    return 0


def _referee(cloud: Read, run: Path, stand: Stand) -> None:
    """Ours and dendromatics' stems against the trees that stood there, and against those that both have."""
    from tests.bench.cloud_referee import measured

    trees = np.array([(t.east_m, t.north_m, 2.0 * t.radius_m) for t in stand.trees])
    points_m = np.column_stack((cloud.east_m, cloud.north_m, cloud.above_ground_m))
    theirs = measured(points_m[np.isfinite(points_m).all(axis=1)])
    ours = read_stems(run / STAND_FOLDER / "stems.csv")
    for name, told in (("ours", ours), ("dendromatics", np.column_stack((theirs, np.full(len(theirs), np.nan))))):
        print(f"{name}: {compare(told, trees).said()}".replace("\n", "; "))
