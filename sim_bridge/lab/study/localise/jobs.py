"""What a worker does: one flight of a study, to its row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim_bridge.lab.study.localise import batch, figures, paths, spec
from sim_bridge.lab.study.localise.flight import believed, fly
from sim_bridge.lab.study.localise.sensors import measure

Row = dict[str, Any]


def path_file(case: spec.Case, folder: Path) -> Path:
    """Of the paths that are flown once for all filters of a case."""
    study, density = case.study, case.run.motion.density_per_ha
    return folder / f"flight-{case.path_seed}-{study.size}-{study.duration_s:g}-{density:g}.npz"


def fly_among_trees(case: spec.Case, file: Path) -> None:
    """Flown once, and kept."""
    if not file.exists():
        flight = paths.among_trees(
            case.study.size, case.study.duration_s, case.run.motion.density_per_ha, case.path_seed
        )
        np.savez_compressed(file, pos=flight.pos_ne_m, vel=flight.vel_ne_mps, blocked=flight.blocked)


def flown(case: spec.Case, folder: Path) -> Row:
    """The row of one flight. The vehicles in the first and the last row observe."""
    study, motion, sensors = case.study, case.run.motion, case.run.sensors
    rngs = [np.random.default_rng([case.seed, 0x10CA1, k]) for k in range(2)]
    if motion.kind == "trees":
        file = path_file(case, folder)
        fly_among_trees(case, file)
        with np.load(file) as kept:
            flight = paths.Paths(kept["pos"], kept["vel"], kept["blocked"])
    else:
        flight = paths.in_the_open(study.size, study.duration_s, motion.weave_mps, rngs[0])
    measured, errors = measure(flight, sensors, rngs[1]), believed(sensors)
    seen = [fly(flight, measured, errors, row, sensors.place_m) for row in (0, study.size - 1)]
    row: Row = {"key": case.key, "run": case.run.name, "seed": case.seed, **figures.of_flight(seen)}
    if study.bound:
        row["bound_m"], row["smoothed_m"] = batch.solve(flight, measured, errors, 0, sensors.place_m)
    return row
