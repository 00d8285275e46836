"""Tune the laws that pass trees: `python -m sim_bridge.lab.laws.tune_forest`. Same flights and objective for each.

Search and verdict as in `tune`, over two to four values: TRIALS trials of the flights with TRAINING seeds, then the
start and the best fly the HELD_OUT seeds. Ours is not tuned here; its rows are those of the flight software.

Objective of a flight, to be small: time of the last over one alone without trees, or 1 if not all arrive; 0.1 for each
m/s2 of acceleration; 0.1 for each metre by which the least separation falls short of 6 m; 10 times the share of transit
in which the swarm was not connected; and 1 for each contact. Vehicles that dodge to and fro pay for it, and one that
trusts its luck pays more.

Flights: 60 m at 3 m/s through a stand of the seed's own at 200 and 400 trees/ha, two vehicles, gusts of 0.3 m/s rms
that no autopilot holds against, 0.05 m of noise on a range, 2 % of sectors missed, positions 0.2 m and velocities
0.1 m/s wrong (slow errors), 10 % of beacons lost. The leader turns as the trunks make it.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping, Sequence

import numpy as np

from mission.document.model import Mission
from sim_bridge.lab.laws.tune import EFFORT_COST, SEPARATION_WANTED_M, asked, cells_of, interval, search
from sim_bridge.lab.study.forest import flight as among_trees
from sim_bridge.lab.study.forest.figures import Figures
from sim_bridge.lab.study.law import law_module

TRAINING = range(1, 3)
HELD_OUT = range(1000, 1006)
DENSITIES = (200.0, 400.0)
TRIALS = 12
POPULATION = 6
GUSTS_MPS = 0.3
TUNED: dict[str, tuple[str, ...]] = {
    "heading-scan": ("clear_m", "blocked_cost", "flip_cost"),
    "potential-field": ("eta", "rho0_m", "push_max_mps"),
}
OURS = "ours"
COLUMNS = (
    *("law", "trees/ha", "values", "cost", "gain", "arrived", "over one alone, last, %"),
    *("mean acceleration, m/s2", "worst separation, m", "least connected, %", "contacts"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """A table of each law before and after, and what was found."""
    args = asked(argv, "tune_forest", __doc__, (OURS, *TUNED), TRIALS)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    found = []
    for name in args.laws:
        start = values_of(name)
        tuned = search(start, functools.partial(cost, name), args.trials, POPULATION) if start else {}
        found.append((name, start, tuned))
        for density in DENSITIES:
            before = [fly(name, density, start, seed) for seed in HELD_OUT]
            print(row(name, density, "start", before, ""), flush=True)
            if tuned != start:
                after = [fly(name, density, tuned, seed) for seed in HELD_OUT]
                gains = [objective(was) - objective(now) for was, now in zip(before, after, strict=True)]
                print(row(name, density, "tuned", after, interval(gains, ".3f", "+")), flush=True)
    for name, start, tuned in found:
        print(
            f"\n{name}: " + (", ".join(f"{key} {start[key]:.3g} -> {tuned[key]:.3g}" for key in start) or "not tuned")
        )
    return 0


def values_of(name: str) -> dict[str, float]:
    """Where tuning starts; ours: nothing."""
    return {key: float(getattr(law_module(name).Params(), key)) for key in TUNED.get(name, ())}


def cost(name: str, values: Mapping[str, float]) -> float:
    """Of these values over the training flights."""
    flights = [fly(name, density, values, seed) for density in DENSITIES for seed in TRAINING]
    return float(np.mean([objective(flight) for flight in flights]))


def fly(name: str, density_per_ha: float, values: Mapping[str, float], seed: int) -> Figures:
    """One flight with these values."""
    mission = Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (60.0, 0.0, 4.0), "vel_leader_mps": 3.0},
            "swarm": {"size": 2},
            "coverage": {"duration_s": 0.0},
            "sensing": {},
            "forest": {"stand": {"density_per_ha": density_per_ha, "margin_m": 30.0}},
            "sim": {
                "seed": seed,
                "radio_loss": 0.1,
                "radio_delay_s": 0.1,
                "position_noise_m": 0.2,
                "velocity_noise_mps": 0.1,
            },
        }
    )
    return among_trees.fly(mission, name, law_module(name).Params(**values), GUSTS_MPS)


def objective(f: Figures) -> float:
    """Of one flight; see above."""
    late = 1.0 if not f.arrived or f.over_alone_last is None else f.over_alone_last
    close = 0.1 * max(0.0, SEPARATION_WANTED_M - (f.min_separation_m or 0.0))
    apart = 10.0 * (1.0 - (f.connected_fraction_transit or 0.0))
    effort = EFFORT_COST * (f.acceleration_mean_mps2 or 0.0)
    return late + effort + close + apart + f.contacts


def row(name: str, density_per_ha: float, values: str, flights: Sequence[Figures], gain: str) -> str:
    """Held-out figures, as of COLUMNS."""
    overheads = [100.0 * f.over_alone_last for f in flights if f.arrived and f.over_alone_last is not None]
    cells = [name, f"{density_per_ha:g}", values, interval([objective(f) for f in flights], ".3f"), gain]
    cells.append(f"{sum(f.arrived for f in flights)}/{len(flights)}")
    cells.append(interval(overheads, ".1f") if overheads else "-")
    return f"| {' | '.join([*cells, *cells_of(flights)])} |"


if __name__ == "__main__":
    sys.exit(main())
