"""Surveys that stop by the interval of their basal area, against the truth: `python -m tests.bench stand-until`.

Records that never flew (tests/unit/stand/stand_kit.py), fused every 15 s as an acting leader does with all records made
until then. Told are: how many stop, after which share of the whole survey, and how often the true basal area is inside
the interval then, beside that of the same surveys flown to their end.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.records.summary import Range
from companion.stand.figures.estimate import DBH_MIN_M
from companion.stand.figures.intervals import M2_PER_HA
from companion.stand.summarise import summarise
from companion.stand.update import PERIOD_S
from mission.document.model import Mission
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.options import number
from tests.unit.stand.stand_kit import Survey, Trees, clustered_stand, records_of, regular_stand, rows_of

SIDES_M = (80.0, 60.0)
DENSITIES_PER_HA = (200.0, 300.0, 400.0, 500.0)
FIRST_SEED = 9001
SURVEY = Survey(vehicles=4, lane_m=5.0)


@dataclass(frozen=True, slots=True)
class Stopped:
    """A survey that stopped: after which share of its time, and whether the truth is inside then, and at its end."""

    at_share: float
    is_inside: bool
    is_inside_at_end: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: a measurement."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench stand-until", description=__doc__)
    parser.add_argument("--stands", type=positive, default=48, metavar="N", help="(48)")
    parser.add_argument("--first-seed", type=as_seed, default=FIRST_SEED, metavar="K", help=f"({FIRST_SEED})")
    parser.add_argument(
        "--pct", type=number(1.0, 100.0), nargs="+", default=[10.0, 15.0, 20.0], metavar="P", help="(10 15 20)"
    )
    args = parser.parse_args(argv)
    found: dict[float, list[Stopped]] = {pct: [] for pct in args.pct}
    for seed in range(args.first_seed, args.first_seed + args.stands):
        for pct, stopped in survey_of(seed, args.pct).items():
            found[pct].append(stopped)
    print("| until | stopped | after, of the survey | inside then | inside at the end |\n|---|---|---|---|---|")
    for pct, own in found.items():
        share = 100.0 * np.median([one.at_share for one in own]) if own else float("nan")
        then, end = sum(one.is_inside for one in own), sum(one.is_inside_at_end for one in own)
        print(
            f"| {pct:g} % | {len(own)} of {args.stands} | {share:.0f} % | {then} of {len(own)} | {end} of {len(own)} |"
        )
    return 0


def survey_of(seed: int, pcts: Sequence[float]) -> dict[float, Stopped]:
    """When one survey stops by each of `pcts`; not those by which it does not."""
    density_per_ha = DENSITIES_PER_HA[seed % len(DENSITIES_PER_HA)]
    make = regular_stand if seed % 2 else clustered_stand
    trees = make(seed, density_per_ha, east_m=SIDES_M[0], north_m=SIDES_M[1])
    survey = Survey(seed=seed, vehicles=SURVEY.vehicles, lane_m=SURVEY.lane_m)
    records = records_of(trees, rows_of((0.0, 0.0), SIDES_M, survey), survey)
    began_s, ended_s = min(r.made_s for r in records), max(r.made_s for r in records)
    times_s = [*np.arange(began_s + PERIOD_S, ended_s, PERIOD_S).tolist(), ended_s]
    mission, true = mission_of(), true_basal_area(trees)
    looks = [summarise([r for r in records if r.made_s <= now_s], mission).basal_area_m2_per_ha for now_s in times_s]
    found = {}
    for pct in pcts:
        for now_s, basal in zip(times_s, looks, strict=True):
            width = None if basal is None else basal.half_width_pct
            if basal is not None and width is not None and width <= pct:
                share = (now_s - began_s) / (ended_s - began_s)
                found[pct] = Stopped(share, is_inside(basal, true), is_inside(looks[-1], true))
                break
    return found


def is_inside(told: Range | None, true: float) -> bool:
    """The interval holds the truth."""
    return told is not None and told.low is not None and told.high is not None and told.low <= true <= told.high


def true_basal_area(trees: Trees) -> float:
    """Of stems of DBH_MIN_M and more in the rectangle, m2/ha."""
    is_in = (trees.dbh_m >= DBH_MIN_M) & (trees.east_m >= 0.0) & (trees.east_m <= SIDES_M[0])
    d_m = trees.dbh_m[is_in & (trees.north_m >= 0.0) & (trees.north_m <= SIDES_M[1])]
    return float((np.pi / 4.0 * d_m**2).sum() / (SIDES_M[0] * SIDES_M[1] / M2_PER_HA))


def mission_of() -> Mission:
    """Of the whole rectangle."""
    (east_m, north_m), up_m = SIDES_M, 4.0
    corners = [[0.0, 0.0], [east_m, 0.0], [east_m, north_m], [0.0, north_m]]
    route = {"d1_enu_m": [20.0, 30.0, up_m], "d2_enu_m": [60.0, 30.0, up_m], "vel_leader_mps": 2.0}
    tables = {"fence": {"polygon_enu_m": corners}, "sensing": {"sensor": "multi-layer"}, "survey": {}}
    small = {"swarm": {"size": 1}}
    return Mission.model_validate({"schema": 1, "route": route, **tables, **small})
