"""Defects planted in a copy of the programs, one at a time: after how many flights does the search find each?"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.bench.table import Row
from tests.bench.turns import ROOT, pure_copy

MOST_FLIGHTS = 200
AT_ONCE = 4
FIRST_SEED = 50_000


@dataclass(frozen=True, slots=True)
class Defect:
    """What is replaced in one file, and the cause by which the search is to find it."""

    name: str
    file: str
    replaced: tuple[tuple[str, str], ...]
    cause: str


DEFECTS = (
    Defect(
        "the fence is not looked at",
        "companion/core/safety/safety_filter.py",
        (
            ("            mission.fence.altitude_max_m,\n", "            1000.0,\n"),
            ("tuple((y, x) for x, y in mission.fence.polygon_enu_m or ())", "()"),
        ),
        "fence",
    ),
    Defect(
        "separation is halved",
        "companion/core/safety/safety_filter.py",
        (("            mission.separation.hard_m,\n", "            0.5 * mission.separation.hard_m,\n"),),
        "separation",
    ),
    Defect(
        "a leader never yields to another",
        "companion/core/swarm/election.py",
        (("if not succeeds and not self._precedes", "if self.leads or not succeeds and not self._precedes"),),
        "leaders",
    ),
    Defect(
        "the leader waits for followers that keep their distance from it",
        "companion/core/guidance/formation.py",
        (("GOVERNOR_FULL: Final = 0.70", "GOVERNOR_FULL: Final = 0.10"), ("ZERO: Final = 0.92", "ZERO: Final = 0.20")),
        "not arrived",
    ),
)


def planted_defects() -> Iterator[Row]:
    """Point masses; flights count until the first that fails by the defect's cause."""
    for defect in DEFECTS:
        with pure_copy(ROOT) as copy, tempfile.TemporaryDirectory() as folder:
            plant(defect, copy)
            _compile(copy)
            found = _search(defect, copy, Path(folder))
        seen = "not found" if found is None else f"flight {found[0]}, seed {found[1]['seed']}: {found[1]['verdict']}"
        yield Row(defect.name, f"{defect.cause}, within {MOST_FLIGHTS} flights", seen, found is not None)


def _compile(copy: Path) -> None:
    """As it ships: two hundred flights of pure Python take hours. Without a compiler it stays pure."""
    shutil.copy(ROOT / "setup.py", copy)
    build = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    subprocess.run(build, cwd=copy, env={**os.environ, "PYTHONPATH": str(copy)}, check=False)


def plant(defect: Defect, copy: Path) -> None:
    """Into the file of a checkout's copy. ValueError: what is to be replaced does not stand there once."""
    file = copy / defect.file
    text = file.read_text(encoding="utf-8")
    for before, after in defect.replaced:
        if text.count(before) != 1:
            raise ValueError(f"{defect.file}: {before!r} stands there {text.count(before)} times: must be once")
        text = text.replace(before, after)
    file.write_text(text, encoding="utf-8")


def _search(defect: Defect, copy: Path, folder: Path) -> tuple[int, dict[str, Any]] | None:
    """How many flights it took, and the row of the one that shows it."""
    for first in range(0, MOST_FLIGHTS, AT_ONCE):
        options = ("--backend", "point-mass", "--seed", str(FIRST_SEED + first), "--flights", str(AT_ONCE), "--json")
        command = [sys.executable, "-c", "import sys; from sim_bridge.cli import main; sys.exit(main())", "search"]
        done = subprocess.run(
            [*command, *options, "--out", str(folder)],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy)},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        for place, row in enumerate(json.loads(done.stdout), start=first + 1):
            if defect.cause in row["causes"] and row["grade"] in ("UNSAFE", "INCOMPLETE"):
                return place, row
    return None
