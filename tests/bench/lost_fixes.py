"""Vehicles that lose their GNSS fix among trees, told of their own motion or not: `python -m tests.bench lost-fixes`.

mission/examples/natural_stand.toml on JSBSim by recorded estimates; who loses it, when and for how long, how many fly,
the stand's density, the sensor and the wind are drawn. Each flight is flown twice: its autopilots are sent ODOMETRY
(sensing.sends_odometry), and are not.
"""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mission
from mission.schema.kinds import RAW_LIDARS, SensorClass
from sim_bridge import fly
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.table import spread

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
SALT = 0x10F1
RANGES_M = {SensorClass.SECTORS: 8.0, SensorClass.MULTI_LAYER: 20.0}


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight."""

    seed: int
    drawn: str
    sends: bool
    grade: str
    verdict: str
    separation_m: float
    bark_m: float


def draw_tables(seed: int) -> tuple[dict[str, Any], str]:
    """The mission of a seed, and what was drawn, in words."""
    rng = np.random.default_rng([SALT, seed])
    n, density_per_ha = int(rng.integers(4, 9)), round(float(rng.uniform(100.0, 450.0)))
    sensor = SensorClass(str(rng.choice([kind.value for kind in SensorClass])))
    struck = int(rng.integers(1, n + 1))
    at_s, for_s = round(float(rng.uniform(2.0, 30.0)), 1), round(float(rng.uniform(6.0, 40.0)), 1)
    bearing, wind_mps = float(rng.uniform(0.0, 2.0 * np.pi)), round(float(rng.uniform(0.0, 3.0)), 1)
    tables: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
    tables["swarm"]["size"] = n
    tables["forest"]["stand"]["density_per_ha"] = density_per_ha
    range_m = RANGES_M.get(sensor) or RAW_LIDARS[sensor].range_max_m
    tables["sensing"] |= {"sensor": sensor.value, "range_m": range_m}
    tables["sim"] |= {
        "seed": seed,
        "estimates": "recorded",
        "wind_mps": [wind_mps * float(np.sin(bearing)), wind_mps * float(np.cos(bearing)), 0.0],
        "faults": [{"kind": "gnss-outage", "vehicles": [struck], "phase": "transit", "at_s": at_s, "for_s": for_s}],
    }
    words = f"{n} vehicles, {density_per_ha}/ha, {sensor.value}, {wind_mps} m/s, {struck} from {at_s} s for {for_s} s"
    return tables, words


def fly_one(job: tuple[int, bool]) -> Flown:
    """Flies one, with ODOMETRY or without."""
    seed, sends = job
    tables, words = draw_tables(seed)
    tables["sensing"]["sends_odometry"] = sends
    result = fly(tables)
    metrics = result.metrics
    return Flown(
        seed,
        words,
        sends,
        str(result.summary["grade"]),
        str(result.summary["verdict"]),
        metrics.min_separation_m or 0.0,
        metrics.trunk_clearance_min_m or 0.0,
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then one for each way."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench lost-fixes", description=__doc__)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="of each way (20)")
    parser.add_argument("--first-seed", type=as_seed, default=4000, metavar="S", help="(4000)")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.flights)
    flown: list[Flown] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(fly_one, [(seed, sends) for seed in seeds for sends in (True, False)]):
            print(row, flush=True)
            flown.append(row)
    print("\n| ODOMETRY | flights | grades | separation, m | bark, m |\n|---|---|---|---|---|")
    for sends in (True, False):
        rows = [row for row in flown if row.sends is sends]
        grades = ", ".join(f"{count} {grade}" for grade, count in sorted(Counter(row.grade for row in rows).items()))
        cells = [spread([row.separation_m for row in rows], ""), spread([row.bark_m for row in rows], "")]
        print(f"| {'sent' if sends else 'none'} | {len(rows)} | {grades} | {' | '.join(cells)} |")
    return 0
