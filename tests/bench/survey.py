"""Stems measured by single vehicles against the trees of the bridge's forest: `python -m tests.bench survey --help`.

Each row: one class of lidar in one density, over some seeds: a vehicle crosses 100 m of forest whose trunks lean, taper
and fork ([forest.shapes]), on JSBSim with recorded estimates, and measures by [survey].
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.core.model.events import LidarScan
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.survey.observation import Grade
from companion.survey.surveyor import Surveyor
from mission.document.model import Mission
from mission.schema.check import validated
from mission.stand.stand import stand_of
from sim_bridge.judge import run_folder
from sim_bridge.judge.metrics.stems import DBH_LEAST_M, MeasuredStem, match_stems
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.options import as_density, number
from tests.bench.table import spread
from tests.kept_records import records_in

CLASSES = {"multi-layer": 12.0, "scan-0.5deg": 10.0, "scan-1deg": 8.0}
BY_DISTANCE_M = (0.0, 2.0, 4.0, 6.0)
BY_DIAMETER_M = (0.1, 0.15, 0.2, 0.3, 1.0)


def mission_of(
    sensor: str, density_per_ha: float, seed: int, vehicles: int, speed_mps: float, *, leader_only: bool = False
) -> Mission:
    """The flight. `leader_only`: of four vehicles, the only one with satellites."""
    tables: dict[str, Any] = {
        "schema": 1,
        "name": "survey",
        "route": {
            "d1_enu_m": [0.0, 0.0, 4.0],
            "d2_enu_m": [100.0, 0.0, 4.0],
            "vel_leader_mps": speed_mps,
            "at_end": "land",
        },
        "swarm": {"size": vehicles},
        "coverage": {"duration_s": 0.0},
        "fence": {"altitude_min_m": 2.0, "altitude_max_m": 6.0},
        "sensing": {"range_m": CLASSES[sensor], "sensor": sensor, "upside_down": sensor == "multi-layer"},
        "survey": {},
        "forest": {
            "shapes": {},
            "stand": {
                "density_per_ha": density_per_ha,
                "margin_m": 30.0,
                "crown_base_share": 0.7,
                "dbh_mean_m": 0.22,
                "species": ["spruce", "broadleaf", "pine"],
            },
        },
        "sim": {"seed": seed, "range_finder": True, "estimates": "recorded"},
    }
    if leader_only:
        tables["swarm"] |= {"gnss": "leader", "leader_priority": [1]}
        tables["ranging"] = {"start_enu_m": [[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]]}
    return validated(Mission, tables, "survey")


class Tally:
    """Measurements of some flights in one kind of forest with one class of lidar."""

    def __init__(self) -> None:
        self.stems: list[MeasuredStem] = []
        self.trees: list[tuple[float, float, bool]] = []  # diameter, how near it was passed, found
        self.poor = 0
        self.flights: list[dict[str, Any]] = []
        self.cpu_s = {"rays": 0.0, "fits": 0.0}
        self.flown_s = 0.0  # of all vehicles

    def add(self, mission: Mission) -> None:
        """Flies one."""
        with tempfile.TemporaryDirectory() as folder:
            with timed(self.cpu_s):
                outcome = fly_stack(mission, Path(folder), on_jsbsim=True)
            held = {k: records_in(Path(folder), k) for k in range(1, mission.swarm.size + 1)}
            recording = run_folder.load(Path(folder))
        self.flights.append(outcome.summary)
        self.flown_s += mission.swarm.size * outcome.metrics.sim_time_s
        stems, passed = match_stems(held, recording, mission, stand_of(mission))
        self.stems += stems
        found = {(stem.tree.north_m, stem.tree.east_m) for stem in stems if stem.tree is not None}
        self.trees += [(2.0 * tree.radius_m, m, (tree.north_m, tree.east_m) in found) for tree, m in passed]

    def row(self) -> str:
        """For the table by class and density."""
        real = self._real(lambda _: True)
        found = [of for *_, of in self.trees]
        positions = [float(summary["stems_position_rmse_m"]) for summary in self.flights]
        relative = [float(summary["stems_relative_rmse_m"]) for summary in self.flights]
        within = np.mean([abs(_off_m(stem)) <= 2.0 * stem.observation.dbh_sd_m for stem in real])
        good = np.mean([stem.observation.grade is Grade.GOOD for stem in real])
        thick = [stem for stem in self.stems if stem.observation.dbh_m >= DBH_LEAST_M]
        false = sum(stem.tree is None for stem in thick)
        cpu = " + ".join(f"{used_s / self.flown_s:.2%}" for used_s in self.cpu_s.values())
        return (
            f"{np.mean(found):.1%} of {len(found)} | {false / max(1, len(thick)):.1%} of {len(thick)} | "
            f"{_rmse_cm(real)} | {within:.0%} | {good:.0%} | {spread(relative, '')} / {spread(positions, '')} | {cpu}"
        )

    def by_distance(self) -> Iterable[str]:
        """A row for each distance at which trees were passed."""
        for low, high in itertools.pairwise(BY_DISTANCE_M):
            found = [of for _, m, of in self.trees if low <= m < high]
            stems = self._real(lambda stem, low=low, high=high: low <= stem.away_m < high)  # type: ignore[misc]
            yield f"{low:g} to {high:g} m | {_share(found)} | {_rmse_cm(stems)}"

    def by_diameter(self) -> Iterable[str]:
        """A row for each class of diameter."""
        for low, high in itertools.pairwise(BY_DIAMETER_M):
            found = [of for dbh_m, _, of in self.trees if low <= dbh_m < high]
            stems = self._real(
                lambda stem, low=low, high=high: low <= 2.0 * stem.tree.radius_m < high  # type: ignore[misc]
            )
            yield f"{100 * low:g} to {100 * high:g} cm | {_share(found)} | {_rmse_cm(stems)}"

    def _real(self, takes: Callable[[MeasuredStem], bool]) -> list[MeasuredStem]:
        return [
            stem
            for stem in self.stems
            if stem.tree is not None and 2.0 * stem.tree.radius_m >= DBH_LEAST_M and takes(stem)
        ]


@contextlib.contextmanager
def timed(cpu_s: dict[str, float]) -> Iterator[None]:
    """Adds up what surveys use of this process' CPU time."""
    integrate, take = Surveyor.integrate, Surveyor.take_records

    def timed_integrate(self: Surveyor, scan: LidarScan, pose: ScanPose, now_s: float) -> None:
        began = time.process_time()
        integrate(self, scan, pose, now_s)
        cpu_s["rays"] += time.process_time() - began

    def timed_take(self: Surveyor, pose: ScanPose | None, now_s: float) -> list[tuple[int, bytes]]:
        began = time.process_time()
        found = take(self, pose, now_s)
        cpu_s["fits"] += time.process_time() - began
        return found

    Surveyor.integrate, Surveyor.take_records = timed_integrate, timed_take  # type: ignore[method-assign]
    try:
        yield
    finally:
        Surveyor.integrate, Surveyor.take_records = integrate, take  # type: ignore[method-assign]


def _off_m(stem: MeasuredStem) -> float:
    assert stem.tree is not None
    return stem.observation.dbh_m - 2.0 * stem.tree.radius_m


def _rmse_cm(stems: Sequence[MeasuredStem]) -> str:
    if not stems:
        return "-"
    off_cm = 100.0 * np.array([_off_m(stem) for stem in stems])
    worst = float(np.percentile(np.abs(off_cm), 95))
    return f"{math.sqrt(float(np.mean(off_cm**2))):.2f}, bias {off_cm.mean():+.2f}, 95 % {worst:.1f} (n {len(stems)})"


def _share(found: Sequence[bool]) -> str:
    return f"{np.mean(found):.1%} of {len(found)}" if found else "-"


def main(argv: Sequence[str]) -> int:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench survey", description=__doc__)
    parser.add_argument("--sensors", nargs="+", default=list(CLASSES), choices=list(CLASSES))
    parser.add_argument("--per-ha", nargs="+", type=as_density, default=[200.0, 400.0])
    parser.add_argument("--seeds", nargs="+", type=as_seed, default=[1, 2, 3, 4])
    parser.add_argument("--vehicles", type=positive, default=1)
    parser.add_argument("--speed", type=number(0.1, 10.0), default=1.5, help="m/s")
    parser.add_argument("--leader-only", action="store_true", help="of 4 vehicles, the leader alone has satellites")
    options = parser.parse_args(argv)
    print(
        "lidar, trees/ha | found | false | DBH RMSE, cm | within 2 sd | GOOD | position RMSE, m, relative / absolute "
        "| of a core: rays + fits"
    )
    detail: list[str] = []
    for sensor in options.sensors:
        for per_ha in options.per_ha:
            tally = Tally()
            for seed in options.seeds:
                tally.add(
                    mission_of(sensor, per_ha, seed, options.vehicles, options.speed, leader_only=options.leader_only)
                )
            print(f"{sensor}, {per_ha:g} | {tally.row()}", flush=True)
            detail += [f"{sensor}, {per_ha:g}, {row}" for row in (*tally.by_distance(), *tally.by_diameter())]
    print("\n".join(["", "passed at, or DBH | found | DBH RMSE, cm", *detail]))
    return 0
