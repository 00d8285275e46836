"""Figures of drawn and of real stands against the truth: `python -m tests.bench stand-figures`.

Surveys that never flew (tests/unit/stand/stand_kit.py), fused and estimated as `companion stand` does. Real stem
maps are those of R's spatstat.data, read where it is installed (Debian: r-cran-spatstat.data).
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from shutil import which

import numpy as np

from companion.stand.figures.estimate import DBH_MIN_M, StandFigures, figures_of
from companion.stand.figures.intervals import M2_PER_HA, Estimate
from companion.stand.fusion.fuse import fuse
from companion.stand.records import harvest_of
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.options import number
from tests.unit.stand.stand_kit import Survey, Trees, clustered_stand, records_of, regular_stand, rows_of, tree_of

SIDES_M = (80.0, 60.0)
DENSITIES_PER_HA = (200.0, 300.0, 400.0, 500.0)
FIRST_SEED = 5001
EDGE_SHARE = 0.05  # of a real map's shorter side
WANTED_SHARE = 0.93  # of stands whose true value is inside the interval of 95 %
LIMIT = {  # how each is surveyed, and the share of the area that is flown over
    "all seen": (Survey(vehicles=6, lane_m=5.0), 1.0),
    "half seen": (Survey(vehicles=6, lane_m=5.0), 0.5),
    "seldom found": (Survey(vehicles=6, lane_m=5.0, found_in_step=0.25), 1.0),
}
REAL = {"longleaf": 1.0, "waka": 1.0, "spruces": 1.0, "finpines": 4.0}  # enlarged so many times: saplings of 7 cm
_R = """
suppressMessages(library(spatstat.data))
for (name in c({names})) {{
  d <- get(name); m <- d$marks; if (is.data.frame(m)) m <- m$diameter
  unit <- if (max(m) < 3) 1 else 0.01
  cat(name, d$window$xrange, d$window$yrange, "\\n")
  cat(d$x, "\\n"); cat(d$y, "\\n"); cat(m * unit, "\\n")
}}
"""


@dataclass(frozen=True, slots=True)
class Judged:
    """A stand's figures: true, estimated."""

    case: str
    seed: int
    stems_per_ha: tuple[float, Estimate]
    basal_area: tuple[float, Estimate]
    dbh_mean_cm: tuple[float, Estimate]
    dbh_quadratic_mean_cm: tuple[float, Estimate]
    observed: int  # trees that were observed
    stems: int  # that fusion made of them
    mixed: int  # stems of observations of more than one tree


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 when intervals hold the truth too seldom."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench stand-figures", description=__doc__)
    parser.add_argument(
        "--stands", type=positive, default=96, metavar="N", help="drawn ones, besides the real ones (96)"
    )
    parser.add_argument("--first-seed", type=as_seed, default=FIRST_SEED, metavar="K", help=f"({FIRST_SEED})")
    parser.add_argument(
        "--frame-sd-m", type=number(0.0, 10.0), default=0.6, metavar="M", help="of the vehicles' positions (0.6)"
    )
    args = parser.parse_args(argv)
    sd_m = args.frame_sd_m
    judged = [j for k in range(args.stands) if (j := drawn(args.first_seed + k, frame_sd_m=sd_m)) is not None]
    real = [
        judge(f"real: {name}", args.first_seed, trees, sides_m, replace(survey, frame_sd_m=sd_m), 1.0)
        for name, (trees, sides_m, survey) in real_stands().items()
    ]
    judged += [j for j in real if j is not None]
    print("| case | figure | inside | bias % | sd % | half-width % | n |\n|---|---|---|---|---|---|---|")
    reached = True
    for case in [*LIMIT, "real", ""]:
        own = [j for j in judged if j.case.startswith(case)]
        for row, is_reached in rows(case or "all", own) if own else ():
            print(row)
            reached &= is_reached or case != ""
    off = np.asarray([j.stems / j.observed - 1.0 for j in judged]) * 100.0
    mixed = 100.0 * sum(j.mixed for j in judged) / sum(j.stems for j in judged)
    spread = f"{off.mean():+.2f} % ({off.min():+.1f} to {off.max():+.1f})"
    print(f"\nfusion, frame error {sd_m:g} m: stems over trees observed {spread}; {mixed:.2f} % of more than one tree")
    return 0 if reached else 1


def drawn(seed: int, *, frame_sd_m: float = 0.6) -> Judged | None:
    """A stand by its seed: regular and clustered, four densities and all ways of surveying in turn."""
    make = (regular_stand, clustered_stand)[seed % 2]
    case = list(LIMIT)[seed % len(LIMIT)]
    trees = make(seed, DENSITIES_PER_HA[seed // 2 % 4], east_m=SIDES_M[0], north_m=SIDES_M[1])
    survey, share = LIMIT[case]
    return judge(case, seed, trees, SIDES_M, replace(survey, frame_sd_m=frame_sd_m), share)


def judge(
    case: str, seed: int, trees: Trees, sides_m: tuple[float, float], survey: Survey, share: float
) -> Judged | None:
    """Survey the southern `share` of the area from 0, 0 to `sides_m`. None: nothing could be said."""
    survey = replace(survey, seed=seed)
    edge_m = EDGE_SHARE * min(sides_m) if case.startswith("real") else 0.0  # beyond a map's edge nothing stands
    ways = rows_of((0.0, 0.0), (sides_m[0], share * sides_m[1]), survey)
    harvest = harvest_of(records_of(trees, ways, survey))
    low, high = (edge_m, edge_m), (sides_m[0] - edge_m, sides_m[1] - edge_m)
    area = (low, (high[0], low[1]), high, (low[0], high[1]))
    fusion = fuse(harvest.observations)
    figures = figures_of(harvest, fusion, area_m=area).figures
    if figures is None:
        return None
    trees_of = [{tree_of(harvest.observations[i].observation) for i in stem.observed} for stem in fusion.stems]
    counts = len(set().union(*trees_of)), len(trees_of), sum(len(found) > 1 for found in trees_of)
    return _judged(case, seed, trees, (low, high), figures, counts)


def _judged(
    case: str,
    seed: int,
    trees: Trees,
    area: tuple[tuple[float, float], tuple[float, float]],
    figures: StandFigures,
    counts: tuple[int, int, int],
) -> Judged:
    (west, south), (east, north) = area
    inside = (trees.east_m >= west) & (trees.east_m <= east) & (trees.dbh_m >= DBH_MIN_M)
    inside &= (trees.north_m >= south) & (trees.north_m <= north)
    d_m, ha = trees.dbh_m[inside], (east - west) * (north - south) / M2_PER_HA
    return Judged(
        case,
        seed,
        (len(d_m) / ha, figures.stems_per_ha),
        (float(np.sum(np.pi / 4.0 * d_m**2)) / ha, figures.basal_area_m2_per_ha),
        (100.0 * float(d_m.mean()), figures.dbh_mean_cm),
        (100.0 * float(np.sqrt((d_m**2).mean())), figures.dbh_quadratic_mean_cm),
        *counts,
    )


def rows(case: str, judged: Sequence[Judged]) -> Iterator[tuple[str, bool]]:
    """A row for each figure, and whether its intervals hold the truth often enough."""
    for name in ("stems_per_ha", "basal_area", "dbh_mean_cm", "dbh_quadratic_mean_cm"):
        told = [(true, e) for true, e in (getattr(j, name) for j in judged) if e.low is not None]
        if not told:
            continue
        held = sum(e.low <= true <= e.high for true, e in told)
        off = np.asarray([e.value / true - 1.0 for true, e in told]) * 100.0
        half = np.asarray([(e.high - e.low) / 2.0 / e.value for _, e in told]) * 100.0
        spread = f"{off.mean():+.1f} | {off.std():.1f} | {np.median(half):.1f}"
        yield (
            f"| {case} | {name} | {held} of {len(told)} | {spread} | {len(judged)} |",
            held >= WANTED_SHARE * len(told),
        )


def real_stands() -> dict[str, tuple[Trees, tuple[float, float], Survey]]:
    """Real maps from 0, 0, and how they are surveyed; none where R or its data are not installed."""
    if which("Rscript") is None:
        return {}
    program = _R.format(names=", ".join(f'"{name}"' for name in REAL))
    told = subprocess.run(["Rscript", "-e", program], capture_output=True, text=True, check=False)
    if told.returncode != 0:
        return {}
    lines = told.stdout.splitlines()
    found = {}
    for k in range(0, len(lines), 4):
        name, west, east, south, north = lines[k].split()
        times = REAL[name]
        x, y, d = (np.asarray(line.split(), dtype=np.float64) * times for line in lines[k + 1 : k + 4])
        trees = Trees(x - times * float(west), y - times * float(south), d)
        sides_m = (times * (float(east) - float(west)), times * (float(north) - float(south)))
        found[name] = (trees, sides_m, Survey(vehicles=8, lane_m=5.0))
    return found


if __name__ == "__main__":
    raise SystemExit(main())
