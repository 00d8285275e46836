"""Flights whose parts do not hear each other, with layers of height and without: the same cuts in both.

mission/examples/natural_stand.toml, where one to three of eight vehicles are cut off at a drawn time in transit, for a
drawn time: `python -m tests.bench layers`. With `--kill-leader` the leader's companion ends while they are; with
`--three-parts` a second part of one to three is cut off within 10 s.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import mission
from mission.document.model import Mission
from mission.schema.check import validated
from mission.schema.faults import FaultKind
from mission.schema.fields import MAX_VEHICLES
from mission.stand.resolve import stand_of
from sim_bridge import fly
from sim_bridge.judge.metrics import separation_m
from sim_bridge.judge.metrics.graph import connectivity
from sim_bridge.judge.metrics.pairs import look_at_pairs
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.run_folder import load_faults
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.trunk_attenuation import range_share
from tests.bench.options import ESTIMATES, SENSORS, as_density
from tests.bench.table import spread

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
CUT_FOR_S = (10.0, 60.0)
CUT_AT_S = (3.0, 35.0)  # in transit
SECOND_WITHIN_S = 10.0
NEAR_M, TOO_NEAR_M = 4.5, 2.0
TOGETHER_S = 20.0  # within so much of the cut's end


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight. Distances are level ones of two whose heights differ by less than between layers."""

    seed: int
    layers: bool
    grade: str
    arrived: bool
    absent: int
    contacts_vehicles: int
    contacts: int  # with trunks, crowns and the ground, too
    least_m: float
    closest: tuple[int, int] | None
    closest_at_s: float | None
    cuts_s: tuple[tuple[float, float], ...]  # as they were in force
    together_s: float | None  # from the last cut's end until the alive are one part that names one leader; None: never
    verdict: str
    contacts_killed: int = 0  # of `contacts`: vehicles whose companion had ended, and that drifted into something


@dataclass(frozen=True, slots=True)
class Course:
    """What is the same in all flights of a run."""

    density_per_ha: float
    estimates: str
    sensor: str
    kills_leader: bool
    three_parts: bool

    def tables(self, seed: int, *, layers: bool) -> dict[str, Any]:
        """The mission of one flight, as tables."""
        drawn = np.random.default_rng(seed)
        flown: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
        cuts = []
        vehicles = drawn.permutation(flown["swarm"]["size"]) + 1
        at_s = float(drawn.uniform(*CUT_AT_S))
        for _ in range(1 + self.three_parts):
            count = int(drawn.integers(1, 4))
            cut_off, vehicles = sorted(vehicles[:count].tolist()), vehicles[count:]
            for_s = round(float(drawn.uniform(*CUT_FOR_S)), 1)
            cuts.append(
                {"kind": "partition", "vehicles": cut_off, "phase": "transit", "at_s": round(at_s, 1), "for_s": for_s}
            )
            at_s += float(drawn.uniform(0.0, SECOND_WITHIN_S))
        faults: list[dict[str, Any]] = list(cuts)
        if self.kills_leader:
            first = cuts[0]
            killed_s = first["at_s"] + float(drawn.uniform(0.0, first["for_s"]))
            faults.append({"kind": "kill", "phase": "transit", "at_s": round(killed_s, 1)})
        flown["forest"]["stand"]["density_per_ha"] = self.density_per_ha
        flown["separation"] = {"height_layers": layers}
        flown["sensing"]["sensor"] = self.sensor
        if self.sensor != "sectors":
            flown["sensing"]["range_m"] = 12.0
        flown["sim"] |= {"seed": seed, "estimates": self.estimates, "faults": faults}
        return flown


def fly_one(seed: int, course: Course, *, layers: bool) -> Flown:
    """Flies one, and judges it as if in layers."""
    with tempfile.TemporaryDirectory(prefix="layers-") as place:
        result = fly(course.tables(seed, layers=layers), folder=place)
        happened = load_faults(Path(place))
    judged_by = validated(Mission, course.tables(seed, layers=True), "layers")
    recording, metrics = result.recording, result.metrics
    stand = stand_of(result.mission)
    pairs = look_at_pairs(recording, result.mission, range_share(result.mission.sim, stand))
    connected, _ = connectivity(recording, pairs, np.zeros(len(recording.time_s), dtype=np.bool_))
    cuts = [
        (fault.at_s, fault.until_s)
        for fault in happened
        if fault.kind is FaultKind.PARTITION and fault.until_s is not None
    ]
    together_s = None
    if cuts:
        end_s = max(until_s for _, until_s in cuts)
        one = np.flatnonzero(connected & _name_one_leader(recording) & (recording.time_s >= end_s))
        together_s = float(recording.time_s[one[0]]) - end_s if one.size else None
    killed = [k for fault in happened if fault.kind is FaultKind.KILL for k in fault.vehicles]
    touched = recording.touched[-1]
    return Flown(
        seed,
        layers,
        str(result.summary["grade"]),
        metrics.arrived,
        len(metrics.absent),
        metrics.contacts_vehicles,
        metrics.contacts,
        float(separation_m(recording, judged_by).min()),
        metrics.closest,
        metrics.closest_at_s,
        tuple(cuts),
        together_s,
        str(result.summary["verdict"]),
        sum(TOUCHED[touched[k - 1]] not in {"", "vehicle"} for k in killed),
    )


def _name_one_leader(recording: Recording) -> npt.NDArray[np.bool_]:
    """(T,) all whose companions live name the same leader."""
    alive = recording.agent_alive
    most = np.where(alive, recording.leader, 0).max(axis=1)
    least = np.where(alive, recording.leader, MAX_VEHICLES).min(axis=1)
    same: npt.NDArray[np.bool_] = (most == least) & (most > 0)
    return same


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then the sums."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench layers", description=__doc__)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="with and without layers, each (20)")
    parser.add_argument("--first-seed", type=as_seed, default=3000, metavar="S", help="(3000)")
    parser.add_argument("--density", type=as_density, default=400.0, metavar="TREES", help="per ha (400)")
    parser.add_argument("--estimates", choices=ESTIMATES, default="exact", metavar="KIND", help="sim.estimates (exact)")
    parser.add_argument(
        "--sensor", choices=SENSORS, default="sectors", metavar="CLASS", help="sensing.sensor (sectors)"
    )
    parser.add_argument("--kill-leader", action="store_true", help="while they are cut off")
    parser.add_argument("--three-parts", action="store_true", help="two cuts of one to three each")
    parser.add_argument("--only-layers", action="store_true", help="not in one height as well")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="keep each flight here, and fly only what it lacks")
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    course = Course(args.density, args.estimates, args.sensor, args.kill_leader, args.three_parts)
    seeds = range(args.first_seed, args.first_seed + args.flights)
    sums = []
    for layers in (True,) if args.only_layers else (False, True):
        name = "layers" if layers else "one height"
        flown = _kept(args.rows, course, layers)
        with ProcessPoolExecutor(args.jobs) as pool:
            missing = [seed for seed in seeds if seed not in flown]
            for row in pool.map(partial(fly_one, course=course, layers=layers), missing):
                print(f"{name}: {row}", flush=True)
                flown[row.seed] = row
                if args.rows:
                    with args.rows.open("a", encoding="utf-8") as file:
                        file.write(json.dumps({"course": asdict(course), "flown": asdict(row)}) + "\n")
        sums.append(_sum_up(name, [flown[seed] for seed in seeds]))
    print("\n| | flights | grades | arrived | contacts: vehicles | all (of those killed) | level distance, m ", end="")
    print(f"| below {NEAR_M} m ", end="")
    print(f"| below {TOO_NEAR_M} m | together {TOGETHER_S:.0f} s after |")
    print("|---" * 10 + "|", *sums, sep="\n")
    return 0


def _kept(rows: Path | None, course: Course, layers: bool) -> dict[int, Flown]:
    """Flights of `course` that a file has, by their seeds."""
    flown: dict[int, Flown] = {}
    if rows and rows.exists():
        for line in rows.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            if row["course"] == asdict(course) and row["flown"]["layers"] == layers:
                kept = Flown(**row["flown"])
                flown[kept.seed] = kept
    return flown


def _sum_up(name: str, flown: Sequence[Flown]) -> str:
    grades = ", ".join(f"{count} {grade}" for grade, count in sorted(Counter(row.grade for row in flown).items()))
    least_m = [row.least_m for row in flown]
    near, too_near = (sum(m < limit_m for m in least_m) for limit_m in (NEAR_M, TOO_NEAR_M))
    vehicles, contacts, killed = (
        sum(getattr(row, what) for row in flown) for what in ("contacts_vehicles", "contacts", "contacts_killed")
    )
    cut = [row.together_s for row in flown if row.cuts_s]
    together = sum(late_s is not None and late_s <= TOGETHER_S for late_s in cut)
    arrived = sum(row.arrived for row in flown)
    return (
        f"| {name} | {len(flown)} | {grades} | {arrived} | {vehicles} | {contacts} ({killed}) | {spread(least_m, '')} "
        f"| {near} | {too_near} | {together} of {len(cut)} |"
    )
