"""Vehicles that hover, told by a lidar of several layers from what stands: rays go on close above and below them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from companion.core.model.events import LidarScan, Position
from companion.core.model.neighbour import Neighbour
from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.perception.obstacle_perception import SensingPerception
from companion.core.perception.vehicles.vehicle_tracks import SeenVehicle
from mission.schema.kinds import RAW_LIDARS, SensorClass
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.raw_scan import RayPattern, cast
from tests.unit.core.core_kit import mission, neighbour

Cylinder = tuple[float, float, float, float, float]  # north, east, radius, from height, to height
UP_M = 4.0
PERIOD_S = 0.1
TRUNKS: list[Cylinder] = [(4.0, 6.0, 0.2, 0.0, 20.0), (-5.0, 4.0, 0.25, 0.0, 20.0), (-4.0, -5.0, 0.2, 0.0, 20.0)]
HULL: Cylinder = (5.0, -1.0, 0.35, UP_M - 0.25, UP_M + 0.25)
THICK: Cylinder = (5.0, -1.0, 0.35, 0.0, 20.0)


def watch(
    standing: Sequence[Cylinder], *, lasts_s: float = 2.0, speed_mps: float = 0.0, missed: float = 0.0
) -> tuple[SensingPerception, Position]:
    """A vehicle that flies north past what stands there; `missed`: share of its rays that are not measured."""
    flown = mission(sensing={"sensor": "multi-layer", "range_m": 12.0}, swarm={"size": 3})
    assert flown.sensing is not None
    perception, rng = SensingPerception(flown, flown.sensing), np.random.default_rng(5)
    pattern = RayPattern(RAW_LIDARS[SensorClass.MULTI_LAYER], PERIOD_S)
    rows = np.array([[*one, 0.0, 0.0] for one in standing])
    vel, lean, own = (speed_mps, 0.0, 0.0), (0.0, -0.05, 0.0), Position((0.0, 0.0, -UP_M), (speed_mps, 0.0, 0.0))
    for turn in range(1, round(lasts_s / PERIOD_S) + 1):
        now_s, at = PERIOD_S * turn, (speed_mps * PERIOD_S * turn, 0.0, -UP_M)
        own, state = Position(at, vel), AirframeState(at, vel, lean, (0.0, 0.0, 0.0), False, 0.4)
        perception.correct_odometry(own, now_s)
        ranges_m = cast(pattern.rays(state, 0.0), rows, [], (0.0, 0.0, 0.0), max_m=12.0, beam_deg=0.0)
        ranges_m[rng.random(ranges_m.shape) < missed] = math.nan
        for first in range(0, ranges_m.shape[1], 90):
            for layer, elevation_deg in enumerate(pattern.elevations_deg):
                piece = LidarScan(
                    1,
                    turn,
                    tuple(ranges_m[layer, first : first + 90].tolist()),
                    math.radians(elevation_deg),
                    math.radians(pattern.bearings_deg[first]),
                    math.radians(pattern.step_deg),
                    0.1,
                    12.0,
                    float(pattern.ages_s[first]),
                    pattern.ray_time_s,
                    lean,
                    lean,
                )
                perception.integrate_scan(piece, own, now_s, ())
    return perception, own


def seen_by(
    standing: Sequence[Cylinder], *, lasts_s: float = 2.0, speed_mps: float = 0.0, missed: float = 0.0
) -> Sequence[SeenVehicle]:
    perception, own = watch(standing, lasts_s=lasts_s, speed_mps=speed_mps, missed=missed)
    return perception.find_vehicles(own.pos_ned_m, (), lasts_s)


@pytest.mark.parametrize("away_m", [3.5, 5.0, 7.0])
@pytest.mark.parametrize("missed", [0.0, 0.05])
def test_a_hull_that_hovers_is_a_vehicle_though_it_never_moved(away_m: float, missed: float) -> None:
    (seen,) = seen_by([*TRUNKS, (away_m, *HULL[1:])], missed=missed)
    assert math.dist(seen.rel_ned_m[:2], (away_m, HULL[1])) < 0.15
    assert seen.rests


def test_it_is_known_while_one_flies_at_it() -> None:
    (seen,) = seen_by([*TRUNKS, (10.0, -0.5, *HULL[2:])], speed_mps=3.0)
    assert seen.rests
    assert seen.rel_ned_m[0] == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize(
    "standing",
    [
        [THICK],
        [(*THICK[:4], UP_M + 0.3)],
        [(*THICK[:3], UP_M - 0.3, 20.0)],
        [HULL, (5.0, -0.75, 0.1, UP_M + 0.2, 20.0)],
        [(5.0, -1.0, 0.12, UP_M - 0.25, UP_M + 0.25)],
        [(7.0, -1.0, 0.35, UP_M - 0.7, UP_M + 0.8)],
    ],
    ids=[
        "a trunk",
        "a stump",
        "a crown",
        "what hangs from something",
        "a branch",
        "what is higher than a hull",
    ],
)
def test_what_stands_or_hangs_or_is_thin_is_no_vehicle(standing: list[Cylinder]) -> None:
    assert seen_by([*TRUNKS, *standing]) == []
    assert seen_by([*TRUNKS, *standing], speed_mps=1.0) == []


@pytest.mark.parametrize("hides", [(4.0, -0.6, 0.5, 0.0, UP_M - 0.35), (4.0, -0.6, 0.5, UP_M + 0.2, 20.0)])
def test_a_hull_of_which_something_nearer_hides_what_is_below_or_above_is_unsure(hides: Cylinder) -> None:
    hull = (7.0, *HULL[1:])
    assert seen_by([*TRUNKS, hull, hides]) == []
    assert len(seen_by([*TRUNKS, hull])) == 1


def test_one_that_is_heard_there_and_stands_is_that_neighbour_and_no_report_alone_hides_it() -> None:
    perception, own = watch([*TRUNKS, HULL])
    at = (HULL[0], HULL[1], 0.0)

    def is_heard(heard: Neighbour) -> bool:
        (seen,) = perception.find_vehicles(own.pos_ned_m, (heard,), 2.0)
        return seen.heard and not seen.rests

    assert is_heard(neighbour(2, rel_ned_m=at))
    assert not is_heard(neighbour(2, rel_ned_m=(5.0, 2.0, 0.0)))
    assert not is_heard(neighbour(2, rel_ned_m=at, vel_ned_mps=(0.0, 3.0, 0.0)))


def test_it_is_an_obstacle_that_is_kept_from_as_a_vehicle_is_and_no_landmark() -> None:
    perception, own = watch([*TRUNKS, HULL], lasts_s=4.0)
    seen = perception.find_vehicles(own.pos_ned_m, (), 4.0)
    cloud = perception.observe_obstacles(own.pos_ned_m, own.pos_ned_m, {}, 4.0, seen)
    (obstacle,) = cloud.hovering
    assert obstacle.kind is ObstacleKind.SILENT
    assert math.dist(obstacle.rel_ned_m[:2], HULL[:2]) < 0.15
    trunks = [trunk for trunk in perception.motion.odometry.trunks if trunk.seen_s > 3.5]
    assert len(trunks) >= 2
    assert min([math.dist((trunk.north_m, trunk.east_m), HULL[:2]) for trunk in trunks]) > 1.0
