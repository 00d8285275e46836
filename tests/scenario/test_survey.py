"""One vehicle crosses a few trees: its records have those trees, and without [survey] there are none."""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path
from typing import Any

import pytest

from companion.survey.observation import STEM_KIND, Grade, StemObservation, decode
from companion.survey.track import TRACK_KIND, decode_track
from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.drive import fly as lockstep
from sim_bridge.judge.metrics.stems import match_stems
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.run_folder import load
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.kept_records import records_in

TREES = [(8.0, 3.0, 0.12), (13.0, -2.5, 0.2), (18.0, 3.5, 0.09), (22.0, -4.0, 0.15), (15.0, 5.5, 0.25)]


def mission_with(sensing: dict[str, Any], *, surveys: bool = True, shapes: bool = False) -> Mission:
    forest: dict[str, Any] = {
        "trees": [{"base_enu_m": [e, n], "trunk_radius_m": r, "height_m": 20.0} for e, n, r in TREES]
    }
    if shapes:
        forest["shapes"] = {"stubs_per_tree": 1.0}
    tables: dict[str, Any] = {
        "schema": 1,
        "route": {
            "d1_enu_m": [0.0, 0.0, 4.0],
            "d2_enu_m": [32.0, 0.0, 4.0],
            "vel_leader_mps": 1.5,
            "at_end": "land",
        },
        "swarm": {"size": 1},
        "coverage": {"duration_s": 0.0},
        "sensing": sensing,
        "forest": forest,
        "sim": {"estimates": "recorded", "range_finder": True},
    }
    return Mission.model_validate(tables | ({"survey": {}} if surveys else {})).with_origin(DEFAULT_ORIGIN)


def records_of(mission: Mission, folder: Path) -> tuple[list[tuple[int, bytes]], dict[str, Any]]:
    """Records of the one vehicle, and the flight's figures."""

    def body(_frame: Any, pos_ned_m: Any, _seed: int) -> PointMass:
        return PointMass(pos_ned_m, 0.0, drag=mission.sim.drag, ground_down_m=pos_ned_m[2])

    with Progress(io.StringIO()) as progress:
        outcome = lockstep.fly(mission, folder, progress, in_process=True, airframes=body)
    assert outcome.succeeded
    return records_in(folder, 1) if mission.survey is not None else [], outcome.summary


HANGING = {"sensor": "multi-layer", "upside_down": True, "range_m": 12.0}


@pytest.mark.parametrize("shapes", [False, True], ids=["cylinders", "shapes"])
def test_a_hanging_lidar_measures_the_stems_at_breast_height(shapes: bool, tmp_path: Path) -> None:
    mission = mission_with(HANGING, shapes=shapes)
    held, summary = records_of(mission, tmp_path)
    found, passed = match_stems({1: held}, load(tmp_path), mission, stand_of(mission))
    assert len({stem.tree for stem in found}) == len(passed) == len(TREES)
    assert all(stem.tree is not None for stem in found)
    assert all(stem.observation.is_dbh_measured for stem in found)
    assert summary["stems_found_share"] == 1.0
    assert summary["stems_false_share"] == 0.0
    assert summary["stems_dbh_rmse_m"] < 0.02
    assert summary["stems_relative_rmse_m"] < 0.2


def test_a_level_lidar_says_that_it_went_by_taper(tmp_path: Path) -> None:
    held, summary = records_of(mission_with({"sensor": "scan-0.5deg", "range_m": 10.0}), tmp_path)
    stems: list[StemObservation | None] = [decode(body, 1) for kind, body in held if kind == STEM_KIND]
    assert len(stems) >= len(TREES) - 1
    for stem in stems:
        assert stem is not None
        assert not stem.is_dbh_measured
        assert stem.cut_up_m > 3.0
        assert stem.grade is not Grade.GOOD
        assert stem.dbh_m == pytest.approx(stem.diameter_m + 0.01 * (stem.cut_up_m - 1.3), abs=1e-5)
        assert stem.dbh_sd_m > 0.01
    assert summary["stems_breast_share"] == 0.0


def test_the_way_is_recorded_every_two_seconds(tmp_path: Path) -> None:
    held, _ = records_of(mission_with(HANGING), tmp_path)
    points = [decode_track(body, 1) for kind, body in held if kind == TRACK_KIND]
    assert len(points) > 8
    for before, after in itertools.pairwise(points):
        assert before is not None
        assert after is not None
        assert after.at_s - before.at_s == pytest.approx(2.0, abs=0.11)
        assert after.range_m == 7.0
        assert math.hypot(after.north_m - before.north_m, after.east_m - before.east_m) < 5.0


def test_without_survey_nothing_is_recorded(tmp_path: Path) -> None:
    held, summary = records_of(mission_with(HANGING, surveys=False), tmp_path)
    assert held == []
    assert "stems_found" not in summary


def test_a_vehicle_whose_companion_is_dead_is_recorded_as_no_stem(tmp_path: Path) -> None:
    """It hovers in the way of the two others, at the height of their level lidars."""
    trees = [(8.0, 6.0, 0.12), (14.0, -6.5, 0.2), (20.0, 6.5, 0.15), (27.0, -6.0, 0.15), (24.0, 0.6, 0.2)]
    tables = mission_with({"sensor": "scan-0.5deg", "range_m": 12.0}).model_dump(mode="json", by_alias=True)
    tables["forest"]["trees"] = [{"base_enu_m": [e, n], "trunk_radius_m": r, "height_m": 20.0} for e, n, r in trees]
    tables["swarm"]["size"] = 3
    tables["sim"]["seed"] = 1
    tables["sim"]["faults"] = [{"kind": "kill", "vehicles": [1], "phase": "transit", "at_s": 8.0}]
    records_of(Mission.model_validate(tables), tmp_path)
    told = [decode(body, k) for k in (2, 3) for kind, body in records_in(tmp_path, k) if kind == STEM_KIND]
    stems = [stem for stem in told if stem is not None]
    assert len(stems) >= 3
    for stem in stems:
        assert min([math.hypot(stem.east_m - e, stem.north_m - n) for e, n, _ in trees]) < 1.2
