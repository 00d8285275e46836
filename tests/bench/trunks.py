"""Contacts with trunks by estimates as recorded, by class of sensor: `python -m tests.bench trunks`.

mission/examples/natural_stand.toml (n = 8, JSBSim), heights by range finders; wind and a killed leader where asked for.
"""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import mission
from mission.schema.kinds import RAW_LIDARS, SensorClass
from sim_bridge import fly
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.options import ESTIMATES, SENSORS, as_density, number
from tests.bench.table import spread

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
RANGES_M = {SensorClass.SECTORS: 8.0, SensorClass.MULTI_LAYER: 20.0}
KILLED_AT_S = (5.0, 30.0)  # in transit


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight. `touched`: vehicles, by what they touched."""

    seed: int
    grade: str
    touched: dict[str, int]
    bark_m: float
    separation_m: float
    overhead: float | None


def fly_one(
    seed: int, *, sensor: SensorClass, density_per_ha: float, estimates: str, wind_mps: float, kills: bool
) -> Flown:
    """Flies one."""
    drawn = np.random.default_rng(seed)
    flown: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
    flown["forest"]["stand"]["density_per_ha"] = density_per_ha
    range_m = RANGES_M.get(sensor) or RAW_LIDARS[sensor].range_max_m
    flown["sensing"] |= {"sensor": sensor.value, "range_m": range_m}
    flown["sim"] |= {"seed": seed, "estimates": estimates, "range_finder": True}
    if wind_mps > 0.0:
        bearing = float(drawn.uniform(0.0, 2.0 * np.pi))
        flown["sim"] |= {
            "wind_mps": [wind_mps * float(np.sin(bearing)), wind_mps * float(np.cos(bearing)), 0.0],
            "turbulence_mps": wind_mps,
        }
    if kills:
        at_s = round(float(drawn.uniform(*KILLED_AT_S)), 1)
        flown["sim"]["faults"] = [{"kind": "kill", "phase": "transit", "at_s": at_s}]
    result = fly(flown)
    metrics = result.metrics
    at_last = [TOUCHED[number] for number in result.recording.touched[-1].tolist()]
    return Flown(
        seed,
        str(result.summary["grade"]),
        dict(Counter(word for word in at_last if word)),
        metrics.trunk_clearance_min_m or 0.0,
        metrics.min_separation_m or 0.0,
        metrics.overhead_leader,
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then one for each class."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench trunks", description=__doc__)
    parser.add_argument("--flights", type=positive, default=8, metavar="N", help="of each class (8)")
    parser.add_argument("--first-seed", type=as_seed, default=2000, metavar="S", help="(2000)")
    parser.add_argument("--density", type=as_density, default=400.0, metavar="TREES", help="per ha (400)")
    parser.add_argument(
        "--estimates", choices=ESTIMATES, default="recorded", metavar="KIND", help="sim.estimates (recorded)"
    )
    parser.add_argument(
        "--wind", type=number(0.0, 12.0), default=0.0, metavar="MPS", help="as turbulent; direction drawn (0)"
    )
    parser.add_argument("--kill", action="store_true", help="the leader, at a drawn time in transit")
    parser.add_argument(
        "--sensor", action="append", choices=SENSORS, metavar="CLASS", help="sensing.sensor (sectors, scan-1deg)"
    )
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    sums = []
    for sensor in [SensorClass(name) for name in args.sensor or ("sectors", "scan-1deg")]:
        one = partial(
            fly_one,
            sensor=sensor,
            density_per_ha=args.density,
            estimates=args.estimates,
            wind_mps=args.wind,
            kills=args.kill,
        )
        flown = []
        with ProcessPoolExecutor(args.jobs) as pool:
            for row in pool.map(one, range(args.first_seed, args.first_seed + args.flights)):
                print(f"{sensor.value}: {row}", flush=True)
                flown.append(row)
        sums.append(_sum_up(sensor.value, flown))
    print(
        "\n| sensor | flights | grades | vehicles that touched | bark, m | separation, m | way over the straight, % |"
    )
    print("|---|---|---|---|---|---|---|", *sums, sep="\n")
    return 0


def _sum_up(name: str, flown: Sequence[Flown]) -> str:
    grades = ", ".join(f"{count} {grade}" for grade, count in sorted(Counter(row.grade for row in flown).items()))
    touched: Counter[str] = Counter()
    for row in flown:
        touched.update(row.touched)
    what = ", ".join(f"{count} {word}" for word, count in sorted(touched.items())) or "none"
    over = [100.0 * row.overhead for row in flown if row.overhead is not None]
    cells = [spread([row.bark_m for row in flown], ""), spread([row.separation_m for row in flown], "")]
    cells.append(spread(over, "") if over else "")
    return f"| {name} | {len(flown)} | {grades} | {what} of {8 * len(flown)} | {' | '.join(cells)} |"
