"""Flies the relative filter: measurements of a flight, simulated, through the estimators of its vehicles."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_bridge.lab.study.backends.base import FlightBackend
from sim_bridge.lab.study.localise import batch, flight_figures, paths
from sim_bridge.lab.study.localise.flight import believed, fly
from sim_bridge.lab.study.localise.sensors import measure
from sim_bridge.lab.study.localise.spec import EstimatorCase

COST_S = 0.05  # of a vehicle-second, relatively
TREES = 2.0  # times as dear among trees, where the path is flown, too
PATHS_KEPT = 8  # in each worker


class EstimatorBackend(FlightBackend[EstimatorCase]):
    """See `localise`."""

    always = "rmse_m"

    def fly(self, cases: Sequence[EstimatorCase]) -> list[dict[str, Any]]:
        """See FlightBackend."""
        return [_figures(case) for case in cases]

    def estimate_cost(self, case: EstimatorCase) -> float:
        """See FlightBackend."""
        return COST_S * case.n * case.duration_s * (TREES if case.motion.kind == "trees" else 1.0)


@functools.lru_cache(maxsize=PATHS_KEPT)
def _among_trees(n: int, duration_s: float, density_per_ha: float, seed: int) -> paths.Paths:
    """Flown once in each worker, for all cases with that path."""
    return paths.among_trees(n, duration_s, density_per_ha, seed)


def _figures(case: EstimatorCase) -> dict[str, Any]:
    """The vehicles in the first and the last row observe."""
    motion, sensors = case.motion, case.sensors
    rngs = [np.random.default_rng([case.seed, 0x10CA1, k]) for k in range(2)]
    if motion.kind == "trees":
        flight = _among_trees(case.n, case.duration_s, motion.density_per_ha, case.path_seed)
    else:
        flight = paths.in_the_open(case.n, case.duration_s, motion.weave_mps, rngs[0])
    measured, errors = measure(flight, sensors, rngs[1]), believed(sensors)
    seen = [fly(flight, measured, errors, row, sensors.start_m) for row in (0, case.n - 1)]
    figures = flight_figures.of_flight(seen)
    if case.bound:
        figures["bound_m"], figures["smoothed_m"] = batch.solve(flight, measured, errors, 0, sensors.start_m)
    return figures
