"""A million inputs to the safety filter: half of them along restless flights, half of anything at all."""

from __future__ import annotations

import random
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

from tests.bench.table import Row
from tests.unit.core.core_promises import any_inputs, broken_promises, restless_inputs

SEEDS = range(1, 251)
OF_EACH = 2_000  # of either kind, for each seed


def broken(seed: int) -> list[str]:
    """The promises that were not kept."""
    found = []
    for inputs in (restless_inputs, any_inputs):
        for given, setpoint in inputs(random.Random(seed), OF_EACH):
            found += broken_promises(*given, setpoint)
    return found


def safety_filter(jobs: int) -> Iterator[Row]:
    """One row; `jobs`: worker processes."""
    with ProcessPoolExecutor(jobs) as pool:
        found = [what for each in pool.map(broken, SEEDS) for what in each]
    count = 2 * OF_EACH * len(SEEDS)
    seen = f"{len(found)}" + (f", the first: {found[0]}" if found else "")
    yield Row(f"safety filter, {count} inputs, seeds 1-{len(SEEDS)}: promises not kept", "0", seen, not found)
