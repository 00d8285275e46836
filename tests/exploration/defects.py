"""Defects planted in a copy of the programs: each must be found by what the tests explore."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.bench.planted_defects import Defect, plant
from tests.bench.turns import ROOT, pure_copy

ELECTION, ROSTER = "companion/core/swarm/election.py", "companion/core/swarm/roster.py"
ORDERS = "companion/core/vehicle/operator_orders.py"
FOUR, CHAIN = "four, one trouble", "chain of four, one trouble"
MISSION = "a mission of three, one trouble or an order"

# Each with the slice that is to find it; its cause is one of the rules, "error" an exception.
DEFECTS: tuple[tuple[Defect, str], ...] = (
    (
        Defect("a half is a quorum", ROSTER, (("= here > missing or", "= here >= missing or"),), "majority"),
        FOUR,
    ),
    (
        Defect(
            "a new leader decides as soon as it has counted the majority",
            ROSTER,
            (("DECIDES_AFTER_S: Final = 5.0", "DECIDES_AFTER_S: Final = 0.0"),),
            "two exclusive leaders",
        ),
        FOUR,
    ),
    (
        Defect(
            "a lower count renews a lease",
            ELECTION,
            (("if lease.seq <= mine.seq or 0 < mine.seq", "if lease.seq == mine.seq or 0 < mine.seq"),),
            "liveness",
        ),
        CHAIN,
    ),
    (
        Defect(
            "a leader never yields to another",
            ELECTION,
            (("if not succeeds and not self._precedes", "if self.leads or not succeeds and not self._precedes"),),
            "two leaders",
        ),
        FOUR,
    ),
    (
        Defect(
            "an order to land is forgotten",
            ORDERS,
            (("self.aborts |= beacon.abort", "self.aborts = beacon.abort"),),
            "latch",
        ),
        MISSION,
    ),
)


def find(defect: Defect, part: str) -> str:
    """By what it is found in a copy that has it, in words; empty: it is not. `part`: name of the slice."""
    with pure_copy(ROOT) as copy:
        plant(defect, copy)
        done = subprocess.run(
            [sys.executable, "-m", "tests.exploration", "--quick", "--only", part],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": f"{copy}{os.pathsep}{ROOT}", "UNDERSTORY_PURE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    if "Traceback" in done.stderr:
        raise RuntimeError(done.stderr)
    return done.stderr.strip()
