"""The fused stem map of a flight against the trees that stood there: `python -m tests.bench stand-map RUN`.

RUN is the folder of a flight with [survey]: its stand/stems.csv, and the forest of its mission.toml. Each tree belongs
to one stem at most, pairs by assignment; a stem is false where no tree of 7 cm or more is left within 1.2 m of it.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from mission.document.load import load_mission
from mission.stand.resolve import resolve_stand
from sim_bridge.drive.stand_files import STAND_FOLDER
from sim_bridge.judge.metrics.stems import NEAR_M, THIN_M
from sim_bridge.judge.run_folder import MISSION_NAME

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
FAR_M = 1e6  # more than any: no pair
DIAMETER = 2  # column of a map: east, north, DBH and its standard error, metres
COLUMNS = (("east_m", 1.0), ("north_m", 1.0), ("dbh_cm", 0.01), ("dbh_sd_cm", 0.01))


@dataclass(frozen=True, slots=True)
class Compared:
    """A map's counted stems, and errors of those that are trees."""

    stems: int
    trees: int
    dbh_off_m: Floats
    dbh_sd_m: Floats
    tree: Ints  # of each such stem, its tree
    place_m: Floats  # where they are told to be, n x 2: east, north,
    off_m: Floats  # less where their trees stand

    def said(self) -> str:
        """In lines."""
        lines = [f"{self.stems} counted stems: {self.trees} are trees, {self.stems - self.trees} none"]
        if self.trees:
            off_cm = 100.0 * self.dbh_off_m
            within = float((np.abs(self.dbh_off_m) <= 2.0 * self.dbh_sd_m).mean())
            lines += [
                f"DBH: RMSE {_rms(off_cm):.2f} cm, bias {float(off_cm.mean()):+.2f} cm, "
                f"{within:.0%} within two of their standard errors",
                f"place: RMSE {_rms(np.hypot(*self.off_m.T)):.2f} m, level",
            ]
        return "\n".join(lines)


def compare(told: Floats, trees: Floats) -> Compared:
    """`told`: east, north, DBH and its standard error of each stem; `trees`: east, north, DBH. Metres."""
    thick = np.flatnonzero(trees[:, DIAMETER] >= THIN_M)
    apart_m = cdist(told[:, :2], trees[thick, :2])
    stem, tree = linear_sum_assignment(np.where(apart_m < NEAR_M, apart_m, FAR_M))
    near = apart_m[stem, tree] < NEAR_M
    stem, tree = stem[near], thick[tree[near]]
    dbh_off_m, off_m = told[stem, DIAMETER] - trees[tree, DIAMETER], told[stem, :2] - trees[tree, :2]
    return Compared(len(told), len(stem), dbh_off_m, told[stem, 3], tree, told[stem, :2], off_m)


def read_stems(file: Path) -> Floats:
    """The counted stems of a map: east, north, DBH and its standard error, metres."""
    with file.open(encoding="utf-8", newline="") as text:
        rows = [row for row in csv.DictReader(text) if row["counted"] == "1"]
    return np.asarray([[unit * float(row[name]) for name, unit in COLUMNS] for row in rows]).reshape(-1, 4)


def main(argv: Sequence[str] | None = None) -> int:
    """The comparison, printed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench stand-map", description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a flight with [survey]")
    run = parser.parse_args(argv).run
    file = run / MISSION_NAME
    stand = resolve_stand(load_mission(file), file)
    trees = np.asarray([(t.east_m, t.north_m, 2.0 * t.radius_m) for t in stand.trees]).reshape(-1, 3)
    print(compare(read_stems(run / STAND_FOLDER / "stems.csv"), trees).said())
    return 0


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
