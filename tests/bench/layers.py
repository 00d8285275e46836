"""Flights whose parts do not hear each other, with layers of height and without: the same cuts in both.

mission/examples/natural_stand.toml, where one to three of eight vehicles are cut off at a drawn time in transit:
`python -m tests.bench layers`.
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
from mission.document.model import Mission
from mission.schema.check import validated
from sim_bridge import fly
from sim_bridge.judge.metrics import separation_m
from tests.bench.table import spread

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
CUT_S = 28.0
CUT_AT_S = (3.0, 35.0)  # in transit
NEAR_M, TOO_NEAR_M = 4.5, 2.0


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight. Distances are level ones of two whose heights differ by less than between layers."""

    seed: int
    grade: str
    contacts: int
    least_m: float


def tables(seed: int, *, layers: bool, density_per_ha: float, estimates: str) -> dict[str, Any]:
    """The mission of one flight, as tables."""
    drawn = np.random.default_rng(seed)
    flown: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
    count = int(drawn.integers(1, 4))
    cut_off = sorted(int(k) + 1 for k in drawn.choice(flown["swarm"]["size"], count, replace=False))
    at_s = round(float(drawn.uniform(*CUT_AT_S)), 1)
    flown["forest"]["stand"]["density_per_ha"] = density_per_ha
    flown["separation"] = {"height_layers": layers}
    flown["sim"] |= {"seed": seed, "estimates": estimates}
    flown["sim"]["faults"] = [
        {"kind": "partition", "vehicles": cut_off, "phase": "transit", "at_s": at_s, "for_s": CUT_S}
    ]
    return flown


def fly_one(seed: int, *, layers: bool, density_per_ha: float, estimates: str) -> Flown:
    """Flies one, and judges it as if in layers."""
    drawn = partial(tables, seed, density_per_ha=density_per_ha, estimates=estimates)
    result = fly(drawn(layers=layers))
    judged_by = validated(Mission, drawn(layers=True), "layers")
    least_m = float(separation_m(result.recording, judged_by).min())
    return Flown(seed, str(result.summary["grade"]), result.metrics.contacts, least_m)


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then both sums."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench layers", description=__doc__)
    parser.add_argument("--flights", type=int, default=20, metavar="N", help="with and without layers, each (20)")
    parser.add_argument("--first-seed", type=int, default=3000, metavar="S", help="(3000)")
    parser.add_argument("--density", type=float, default=400.0, metavar="TREES", help="per ha (400)")
    parser.add_argument("--estimates", default="exact", metavar="KIND", help="sim.estimates (exact)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.flights)
    sums = []
    for layers in (False, True):
        one = partial(fly_one, layers=layers, density_per_ha=args.density, estimates=args.estimates)
        flown = []
        with ProcessPoolExecutor(args.jobs) as pool:
            for row in pool.map(one, seeds):
                print(f"{'layers' if layers else 'one height'}: {row}", flush=True)
                flown.append(row)
        sums.append(_sum_up("layers" if layers else "one height", flown))
    print(f"\n| | flights | grades | contacts | level distance, m | below {NEAR_M} m | below {TOO_NEAR_M} m |")
    print("|---|---|---|---|---|---|---|", *sums, sep="\n")
    return 0


def _sum_up(name: str, flown: Sequence[Flown]) -> str:
    grades = ", ".join(f"{count} {grade}" for grade, count in sorted(Counter(row.grade for row in flown).items()))
    least_m = [row.least_m for row in flown]
    near, too_near = (sum(m < limit_m for m in least_m) for limit_m in (NEAR_M, TOO_NEAR_M))
    contacts = sum(row.contacts for row in flown)
    return f"| {name} | {len(flown)} | {grades} | {contacts} | {spread(least_m, '')} | {near} | {too_near} |"
