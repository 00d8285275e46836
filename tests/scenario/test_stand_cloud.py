"""Returns of two vehicles that surveyed a few trees: one LAZ, read back by laspy, that lies on the trees' bark."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.drive import fly as lockstep
from sim_bridge.drive.stand_files import write_stand
from sim_bridge.judge.progress import Progress
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.cloud import bark_off_m, read_cloud
from tests.scenario.test_survey import HANGING, TREES

laspy = pytest.importorskip("laspy")
BARK_M = 0.06  # three standard deviations of the lidar's ranges: 99 % of 9,556 were so near, half within 1.6 cm


def surveyed_by(n: int) -> Mission:
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {
                "d1_enu_m": [0.0, 0.0, 4.0],
                "d2_enu_m": [32.0, 0.0, 4.0],
                "vel_leader_mps": 1.5,
                "at_end": "return",
            },
            "swarm": {"size": n},
            "coverage": {"duration_s": 0.0},
            "sensing": HANGING,
            "survey": {},
            "forest": {
                "trees": [{"base_enu_m": [e, n], "trunk_radius_m": r, "height_m": 20.0} for e, n, r in TREES],
                "shapes": {"stubs_per_tree": 1.0},
            },
            "sim": {"seed": 2},
        }
    ).with_origin(DEFAULT_ORIGIN)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Mission, Path]:
    mission, folder = surveyed_by(2), tmp_path_factory.mktemp("cloud")

    def body(_frame: Any, pos_ned_m: Any, _seed: int) -> PointMass:
        return PointMass(pos_ned_m, 0.0, drag=mission.sim.drag, ground_down_m=pos_ned_m[2])

    with Progress(io.StringIO()) as progress:
        assert lockstep.fly(mission, folder, progress, in_process=True, airframes=body).succeeded
    lines = write_stand(mission, folder).lines
    assert any(line.startswith("stand: cloud: ") for line in lines), lines
    return mission, folder


def test_points_on_stems_lie_on_the_bark_of_true_trunks(flight: tuple[Mission, Path]) -> None:
    mission, folder = flight
    assert mission.origin is not None
    cloud = read_cloud(folder / "stand" / "cloud.laz", mission.origin.wgs84)
    off_m = bark_off_m(cloud, mission, stand_of(mission))[cloud.of_stem]
    assert len(off_m) > 3000
    assert np.mean(np.abs(off_m) < BARK_M) > 0.95
    assert abs(np.median(off_m)) < 0.02
    assert set(cloud.vehicle.tolist()) == {1, 2}
    above_m = cloud.above_ground_m[cloud.of_stem]
    assert 0.3 < np.nanmin(above_m) < 0.8
    assert 1.8 < np.nanmax(above_m) < 2.4


def test_points_are_of_the_stems_that_the_map_numbers(flight: tuple[Mission, Path]) -> None:
    mission, folder = flight
    assert mission.origin is not None
    cloud = read_cloud(folder / "stand" / "cloud.laz", mission.origin.wgs84)
    lines = (folder / "stand" / "stems.csv").read_text().splitlines()[1:]
    for tree, line in enumerate(lines, start=1):
        east_m, north_m = map(float, line.split(",")[:2])
        own = (cloud.tree == tree) & cloud.of_stem
        assert own.sum() > 100
        assert np.hypot(cloud.east_m[own] - east_m, cloud.north_m[own] - north_m).max() < 0.5


def test_other_software_reads_what_it_is_and_where_on_earth(flight: tuple[Mission, Path]) -> None:
    _, folder = flight
    las = laspy.read(folder / "stand" / "cloud.laz")
    assert (str(las.header.version), las.header.point_format.id) == ("1.4", 6)
    (wkt,) = [vlr for vlr in las.header.vlrs if vlr.record_id == 2112]
    assert 'AUTHORITY["EPSG","326' in wkt.record_data_bytes().decode()
    assert set(np.unique(las.classification)) <= {1, 5}
    assert len(np.unique(las["ring"])) > 1
    assert np.all(np.diff(np.unique(las.gps_time)) > 0.0)


def test_the_same_files_give_the_same_cloud(flight: tuple[Mission, Path]) -> None:
    mission, folder = flight
    before = (folder / "stand" / "cloud.laz").read_bytes()
    write_stand(mission, folder)
    assert (folder / "stand" / "cloud.laz").read_bytes() == before
