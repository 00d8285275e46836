"""One stand surveyed by lanes, by one vehicle and by several: `python -m tests.bench survey-lanes --help`.

Each row: so many vehicles over the same polygon, in the same forests ([forest.shapes], 300 trees/ha): area over the
time from the start of the first lane to the end of the last, and what share of the polygon's trees of 10 cm or more has
been measured. On two sides: of these trees, those that came within survey.reach_m from all around, so that no half of
the horizon is without a vehicle.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.common.frames import enu_to_ned
from mission.common.plane import area_m2, clearance_m
from mission.document.model import Mission
from mission.lanes.spread import PASS_M
from mission.schema.check import validated
from mission.schema.forest import M2_PER_HA
from mission.schema.trees import StandTree
from mission.stand.stand import stand_of
from sim_bridge.judge import run_folder
from sim_bridge.judge.metrics.stems import DBH_LEAST_M, match_stems
from sim_bridge.judge.recording import Recording
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.options import as_density, number
from tests.bench.survey import CLASSES
from tests.bench.table import spread
from tests.kept_records import records_in

BEYOND_M = 45.0  # from the polygon to the fence
SAMPLED = 5  # ticks
COLUMNS = (
    "vehicles",
    "lanes",
    "ha/min: on lanes",
    "in the air",
    "in the air, min",
    "found",
    "on two sides",
    "width, m, 5 % / median",
    "DBH RMSE, cm",
    "contacts",
)


@dataclass(frozen=True, slots=True)
class Survey:
    """Figures of one flight."""

    lanes: int
    ha_per_min: float
    air_min: float  # from take-off to the last landing
    air_ha_per_min: float  # the polygon over that
    spent_s: dict[str, float]  # of that, on what
    trees: int
    found: int
    two_sided: int
    width_m: tuple[float, float]  # of the swarm, across the lanes, on them: 5 %, median
    rmse_cm: float
    contacts: int
    verdict: str


def mission_of(
    vehicles: int,
    seed: int,
    *,
    sensor: str,
    sides_m: tuple[float, float],
    soft_m: float,
    lane_m: float | None = None,
    per_ha: float,
    speed_mps: float,
) -> Mission:
    """The flight: d1 and d2 beside the stand."""
    east_m, north_m = sides_m
    low_m, high_m = -BEYOND_M, BEYOND_M
    tables: dict[str, Any] = {
        "schema": 1,
        "name": "survey by lanes",
        "route": {
            "d1_enu_m": [-25.0, 0.0, 4.0],
            "d2_enu_m": [-25.0, 20.0, 4.0],
            "vel_leader_mps": speed_mps,
            "at_end": "land",
        },
        "swarm": {"size": vehicles},
        "separation": {"soft_m": soft_m},
        "coverage": {"duration_s": 0.0},
        "fence": {
            "altitude_min_m": 2.0,
            "altitude_max_m": 6.0,
            "polygon_enu_m": [
                [low_m - 20.0, low_m],
                [east_m + high_m, low_m],
                [east_m + high_m, north_m + high_m],
                [low_m - 20.0, north_m + high_m],
            ],
        },
        "sensing": {"range_m": CLASSES[sensor], "sensor": sensor, "upside_down": sensor == "multi-layer"},
        "survey": {"area_enu_m": [[0.0, 0.0], [east_m, 0.0], [east_m, north_m], [0.0, north_m]]},
        "forest": {
            "shapes": {},
            "stand": {
                "density_per_ha": per_ha,
                "margin_m": 20.0,
                "crown_base_share": 0.7,
                "dbh_mean_m": 0.22,
                "species": ["spruce", "broadleaf", "pine"],
            },
        },
        "sim": {"seed": seed, "range_finder": True, "estimates": "recorded", "battery_mah": {"1": 20_000.0}},
    }
    if lane_m is not None:
        tables["survey"]["lane_m"] = lane_m
    return validated(Mission, tables, "survey-lanes").with_origin(DEFAULT_ORIGIN)


def fly(mission: Mission, *, on_jsbsim: bool) -> Survey:
    """One flight, judged."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        outcome = fly_stack(mission, folder, on_jsbsim=on_jsbsim)
        held = {k: records_in(folder, k) for k in range(1, mission.swarm.size + 1)}
        recording = run_folder.load(folder)
    area = mission.surveyed_enu_m
    assert area is not None
    stand = stand_of(mission)
    trees = [
        tree
        for tree in stand.trees
        if 2.0 * tree.radius_m >= DBH_LEAST_M and clearance_m((tree.east_m, tree.north_m), area) > 0.0
    ]
    stems, _ = match_stems(held, recording, mission, stand)
    found = {(stem.tree.east_m, stem.tree.north_m) for stem in stems if stem.tree is not None}
    off_m = [s.observation.dbh_m - 2.0 * s.tree.radius_m for s in stems if s.tree in trees]
    passed_s = passes_s(recording, mission)
    up_s = recording.time_s[~recording.on_ground.all(axis=1)]
    reach_m = mission.survey.reach_m if mission.survey is not None else 0.0
    return Survey(
        lanes=len(mission.lanes),
        ha_per_min=area_m2(area) / M2_PER_HA / (passed_s[-1] - passed_s[0]) * 60.0,
        air_min=float(up_s[-1] - up_s[0]) / 60.0,
        air_ha_per_min=area_m2(area) / M2_PER_HA / float(up_s[-1] - up_s[0]) * 60.0,
        spent_s=spent_s(recording, passed_s, float(up_s[0]), float(up_s[-1])),
        trees=len(trees),
        found=sum((tree.east_m, tree.north_m) in found for tree in trees),
        two_sided=sum(is_passed_around(tree, recording, reach_m) for tree in trees),
        width_m=width_on_lanes(recording, mission),
        rmse_cm=100.0 * float(np.sqrt(np.mean(np.square(off_m)))) if off_m else float("nan"),
        contacts=outcome.metrics.contacts,
        verdict=str(outcome.summary["verdict"]),
    )


def passes_s(recording: Recording, mission: Mission) -> list[float]:
    """When an acting leader first came to each end of a lane, one after the other; and was last at the last."""
    acting = recording.acting & recording.agent_alive
    found, since = [], 0
    for end in (visit.pos_enu_m for visit in mission.visits if visit.is_passed):
        away_m = np.linalg.norm(recording.pos_ned_m[since:] - np.array(enu_to_ned(end)), axis=2)
        near = np.flatnonzero((acting[since:] & (away_m <= 3.0 * PASS_M)).any(axis=1))
        if not len(near):
            raise RuntimeError("the lanes were not flown to their end")
        last = since + int(near[-1])
        since += int(near[0])
        found.append(float(recording.time_s[since]))
    return [*found[:-1], float(recording.time_s[last])]


def spent_s(recording: Recording, passed_s: Sequence[float], up_s: float, down_s: float) -> dict[str, float]:
    """Where the time in the air goes."""
    transit = (recording.acting & (recording.phase == SwarmPhase.TRANSIT)).any(axis=1)
    departed_s = float(recording.time_s[np.flatnonzero(transit)[0]])
    legs_s = np.diff(passed_s)
    return {
        "gathering": departed_s - up_s,
        "to lane 1": passed_s[0] - departed_s,
        "on lanes": float(legs_s[::2].sum()),
        "between lanes": float(legs_s[1::2].sum()),
        "to d2 and down": down_s - passed_s[-1],
    }


def width_on_lanes(recording: Recording, mission: Mission) -> tuple[float, float]:
    """Of those in the air, across, while an acting leader is on a lane: 5 % and median over ticks; m."""
    ne_m, widths_m = recording.pos_ned_m[::SAMPLED, :, :2], []
    flying = ~recording.on_ground[::SAMPLED]
    leads = recording.acting[::SAMPLED] & flying
    for lane in mission.lanes:
        a, b = np.array(lane.start[::-1]), np.array(lane.end[::-1])
        length_m = float(np.linalg.norm(b - a))
        u = (b - a) / length_m
        along_m = (ne_m - a) @ u
        across_m = (ne_m - a) @ np.array([-u[1], u[0]])
        on = leads & (np.abs(across_m) <= 2.0 * PASS_M) & (along_m >= 0.0) & (along_m <= length_m)
        for k in np.flatnonzero(on.any(axis=1)):
            widths_m.append(float(np.ptp(across_m[k][flying[k]])))
    low_m, middle_m = np.percentile(widths_m, [5.0, 50.0])
    return float(low_m), float(middle_m)


def is_passed_around(tree: StandTree, recording: Recording, reach_m: float) -> bool:
    """Vehicles in the air saw it from within reach, from so many sides that no half of the horizon is without one."""
    flying = ~recording.on_ground[::SAMPLED]
    off_m = recording.pos_ned_m[::SAMPLED, :, :2] - np.array([tree.north_m, tree.east_m])
    near = flying & (np.hypot(off_m[..., 0], off_m[..., 1]) <= reach_m)
    bearings = np.sort(np.arctan2(off_m[near][:, 1], off_m[near][:, 0]))
    if len(bearings) < 2:
        return False
    gaps = np.diff(np.append(bearings, bearings[0] + 2.0 * np.pi))
    return bool(gaps.max() < np.pi)


def main(argv: Sequence[str]) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench survey-lanes", description=__doc__)
    parser.add_argument("--vehicles", nargs="+", type=positive, default=[1, 8])
    parser.add_argument("--seeds", nargs="+", type=as_seed, default=[31, 32])
    parser.add_argument("--sensor", default="multi-layer", choices=list(CLASSES))
    parser.add_argument(
        "--sides", nargs=2, type=number(1.0, 1000.0), default=[80.0, 56.0], metavar=("EAST", "NORTH"), help="m"
    )
    parser.add_argument("--soft", type=number(1.0, 100.0), default=10.0, help="separation.soft_m")
    parser.add_argument("--lane", type=number(1.0, 100.0), help="survey.lane_m")
    parser.add_argument("--per-ha", type=as_density, default=300.0)
    parser.add_argument("--speed", type=number(0.1, 10.0), default=1.5, help="m/s")
    parser.add_argument("--jsbsim", action="store_true", help="on JSBSim quadrotors, not point masses")
    options = parser.parse_args(argv)
    print(" | ".join(COLUMNS), flush=True)
    for vehicles in options.vehicles:
        flown = []
        for seed in options.seeds:
            mission = mission_of(
                vehicles,
                seed,
                sensor=options.sensor,
                sides_m=tuple(options.sides),
                soft_m=options.soft,
                lane_m=options.lane,
                per_ha=options.per_ha,
                speed_mps=options.speed,
            )
            flown.append(fly(mission, on_jsbsim=options.jsbsim))
            print(f"  {vehicles}, seed {seed}: {flown[-1]}", flush=True)
        print(row_of(vehicles, flown), flush=True)
    return 0


def row_of(vehicles: int, flown: Sequence[Survey]) -> str:
    """All flights of so many vehicles."""
    trees = sum(one.trees for one in flown)
    low_m, middle_m = min(one.width_m[0] for one in flown), np.mean([one.width_m[1] for one in flown])
    cells = (
        f"{vehicles}",
        f"{flown[0].lanes}",
        ", ".join(f"{one.ha_per_min:.3f}" for one in flown),
        ", ".join(f"{one.air_ha_per_min:.3f}" for one in flown),
        spread([one.air_min for one in flown], ""),
        f"{sum(one.found for one in flown) / trees:.1%} of {trees}",
        f"{sum(one.two_sided for one in flown) / trees:.1%}",
        f"{low_m:.1f} / {middle_m:.1f}",
        spread([one.rmse_cm for one in flown], ""),
        f"{sum(one.contacts for one in flown)}",
    )
    return " | ".join(cells)
