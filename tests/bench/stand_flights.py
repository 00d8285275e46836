"""The fused stem map of drawn flights against the trees that stood there: `python -m tests.bench stand-flights --help`.

A swarm crosses 90 m of forest whose trunks lean, taper and fork and comes back, on JSBSim with recorded estimates; wind
and loss are drawn. What reaches its base station is fused as `sim-bridge fly` does it. With `--gnss leader` the others
fly by ranges and odometry. Trees of 10 cm or more count that a vehicle truly passed within 85 % of its reach, and stems
of 10 cm or more that the map counts.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from mission.document.model import Mission
from mission.schema.check import validated
from mission.stand.stand import stand_of
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.stand_files import write_stand
from sim_bridge.judge.metrics.stems import DBH_LEAST_M, PASSED_SHARE
from sim_bridge.judge.run_folder import STAND_FOLDER
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.options import as_density
from tests.bench.stand_map import DIAMETER, Compared, compare, read_stems
from tests.bench.table import spread

Floats = npt.NDArray[np.float64]
SALT = 0x57A4
TICKS = 10  # between two places of a way: 0.75 m
STARTS_M = (
    (-4, -4),
    (4, -4),
    (4, 4),
    (-4, 4),
    (-11, 0),
    (11, 0),
    (0, -11),
    (0, 11),
    (-11, 9),
    (11, 9),
    (-11, -9),
    (11, -9),
)
BESIDE_M = 15.0  # stems so near share the error of their place


@dataclass(frozen=True, slots=True)
class Case:
    """What is flown, beside what its seed draws."""

    per_ha: float
    vehicles: int
    gnss: str
    seed: int


@dataclass(frozen=True, slots=True)
class Result:
    """Of one flight."""

    case: Case
    drawn: str
    grade: str
    passed: int
    found: int
    compared: Compared


def mission_of(case: Case) -> tuple[Mission, str]:
    """The mission of a case, and what its seed drew, in words."""
    rng = np.random.default_rng([SALT, case.seed])
    loss, wind_mps = round(float(rng.uniform(0.0, 0.3)), 2), round(float(rng.uniform(0.0, 4.0)), 1)
    bearing = float(rng.uniform(0.0, 2.0 * math.pi))
    tables: dict[str, Any] = {
        "schema": 1,
        "name": "stand flights",
        "route": {
            "d1_enu_m": [0.0, 0.0, 4.0],
            "d2_enu_m": [90.0, 0.0, 4.0],
            "vel_leader_mps": 1.5,
            "at_end": "return",
        },
        "swarm": {"size": case.vehicles},
        "coverage": {"radius_m": 12.0, "duration_s": 20.0},
        "fence": {"altitude_min_m": 2.0, "altitude_max_m": 6.0},
        "sensing": {"range_m": 12.0, "sensor": "multi-layer", "upside_down": True},
        "survey": {},
        "forest": {
            "shapes": {},
            "stand": {
                "density_per_ha": case.per_ha,
                "margin_m": 45.0,
                "spacing_min_m": 1.5,
                "crown_base_share": 0.7,
                "dbh_min_m": 0.1,
                "dbh_mean_m": 0.24,
                "species": ["spruce", "broadleaf", "pine"],
            },
        },
        "sim": {
            "seed": case.seed,
            "range_finder": True,
            "estimates": "recorded",
            "radio_loss": loss,
            "wind_mps": [wind_mps * math.sin(bearing), wind_mps * math.cos(bearing), 0.0],
        },
    }
    if case.gnss == "leader":
        tables["swarm"] |= {"gnss": "leader", "leader_priority": list(range(1, case.vehicles + 1))}
        tables["ranging"] = {"start_enu_m": [[float(e), float(n), 0.0] for e, n in STARTS_M[: case.vehicles]]}
    return validated(Mission, tables, "stand-flights"), f"loss {loss:.0%}, wind {wind_mps} m/s"


def fly_one(case: Case) -> Result:
    """Flies it, and compares the map that its base station's records make."""
    mission, drawn = mission_of(case)
    assert mission.survey is not None
    ways_m: list[Floats] = []
    ticks = 0

    def look(flight: Flight) -> None:
        nonlocal ticks
        ticks += 1
        if ticks % TICKS == 0:
            ways_m.append(np.array([p for p in flight.last.pos_ned_m if -p[2] >= mission.fence.altitude_min_m]))

    stand = stand_of(mission)
    trees = np.array([(tree.east_m, tree.north_m, 2.0 * tree.radius_m) for tree in stand.trees])
    with tempfile.TemporaryDirectory() as folder:
        outcome = fly_stack(mission, Path(folder), on_jsbsim=True, watch=look)
        write_stand(mission, Path(folder))
        told = read_stems(Path(folder) / STAND_FOLDER / "stems.csv")
    flown_m = np.concatenate([way for way in ways_m if len(way)])[:, [1, 0]]
    away_m, _ = cKDTree(flown_m).query(trees[:, :2])
    is_passed = (trees[:, DIAMETER] >= DBH_LEAST_M) & (away_m <= PASSED_SHARE * mission.survey.reach_m)
    compared = compare(told[told[:, DIAMETER] >= DBH_LEAST_M], trees)
    every = compare(told, trees)  # one of 10 cm that is told as one of 9.9 is found
    return Result(
        case,
        drawn,
        str(outcome.summary["grade"]),
        int(is_passed.sum()),
        len(set(np.flatnonzero(is_passed)) & {int(tree) for tree in every.tree}),
        compared,
    )


def relative_m(compared: Compared) -> Floats:
    """Errors of place once the median error of the stems within BESIDE_M is taken off; (n, 2)."""
    near = cKDTree(compared.place_m).query_ball_point(compared.place_m, BESIDE_M)
    return compared.off_m - np.array([np.median(compared.off_m[beside], axis=0) for beside in near]).reshape(-1, 2)


def row_of(results: Sequence[Result]) -> str:
    """For the table: of all flights of one kind."""
    passed, found = sum(r.passed for r in results), sum(r.found for r in results)
    stems = sum(r.compared.stems for r in results)
    false = sum(r.compared.stems - r.compared.trees for r in results)
    off_cm = 100.0 * np.concatenate([r.compared.dbh_off_m for r in results])
    sd_cm = 100.0 * np.concatenate([r.compared.dbh_sd_m for r in results])
    absolute = [_rms_m(r.compared.off_m) for r in results]
    relative = [_rms_m(relative_m(r.compared)) for r in results]
    return (
        f"{len(results)} | {found / passed:.1%} of {passed} | {false} of {stems} | {np.sqrt(np.mean(off_cm**2)):.2f}, "
        f"bias {off_cm.mean():+.2f} | {np.mean(np.abs(off_cm) <= 2.0 * sd_cm):.0%} | {spread(relative, '')} | "
        f"{spread(absolute, '')}"
    )


def _rms_m(off_m: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(off_m**2, axis=1))))


def main(argv: Sequence[str]) -> int:
    """Prints a line for each flight, and a row for each kind."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench stand-flights", description=__doc__)
    parser.add_argument("--per-ha", nargs="+", type=as_density, default=[200.0, 400.0], help="trees/ha (200 400)")
    parser.add_argument("--vehicles", nargs="+", type=positive, default=[4, 8], help="(4 8)")
    parser.add_argument("--gnss", nargs="+", choices=("all", "leader"), default=["all", "leader"], help="(all leader)")
    parser.add_argument("--seeds", nargs="+", type=as_seed, default=[61, 62, 63, 64], help="of each kind (61 to 64)")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    options = parser.parse_args(argv)
    kinds = list(product(options.per_ha, options.vehicles, options.gnss))
    cases = [Case(*kind, seed) for kind in kinds for seed in options.seeds]
    rows: dict[tuple[float, int, str], list[Result]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        for done in pool.map(fly_one, cases):
            case, of = done.case, done.compared
            print(
                f"seed {case.seed}, {case.per_ha:g}/ha, {case.vehicles} vehicles, GNSS {case.gnss}, {done.drawn}: "
                f"{done.grade}, {done.found} of {done.passed} found, {of.stems - of.trees} false, place "
                f"{_rms_m(of.off_m):.2f} m",
                flush=True,
            )
            rows.setdefault((case.per_ha, case.vehicles, case.gnss), []).append(done)
    print(
        "\ntrees/ha, vehicles, GNSS | flights | found | false | DBH RMSE, cm | within 2 sd "
        "| place RMSE, m: relative | absolute"
    )
    for (per_ha, vehicles, gnss), results in rows.items():
        print(f"{per_ha:g}, {vehicles}, {gnss} | {row_of(results)}")
    return 0
