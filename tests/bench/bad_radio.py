"""Flights by a bad radio: what is said, who counts as silent, and who comes nearer than separation wants.

`python -m tests.bench bad-radio KIND`. Kinds: `open`, mission/examples/lone_tree.toml, where one to three of eight are
cut off for 28 s at a drawn time in transit; `wood`, natural_stand.toml with 12 vehicles at 200 trees/ha that cut the
radio, and 40 % loss; `late`, the same with 8 vehicles at 400 trees/ha that attenuate it, 40 % loss and 0.2 s of delay;
`denied`, as late, where only the leader has satellites; `lossy`, lone_tree.toml with `--loss`. Another checkout flies
the same by its own law: start the same command there.
"""

from __future__ import annotations

import argparse
import io
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import mission
from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from mission.document.model import Mission
from mission.schema.check import validated
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.options import ESTIMATES, SENSORS, as_loss
from tests.bench.table import spread

EXAMPLES = Path(mission.__file__).parent / "examples"
CUT_S = 28.0
CUT_AT_S = (3.0, 35.0)  # in transit
LOSS = 0.4
SECTORS = "sectors"
TEXTS = frozenset({dialect.MAVLINK_MSG_ID_STATUSTEXT})
KINDS = ("open", "wood", "late", "denied", "lossy")
START_APART_M = 8.0  # on two rows of the ground, where not all have satellites


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight."""

    seed: int
    grade: str
    absent: int  # vehicles that never came to d2
    overhead: float  # of the leader
    least_m: float
    contacts: int
    texts: float  # STATUSTEXTs a minute and vehicle
    silences: float  # how often a vehicle took another for silent in the air, a minute and vehicle
    said: dict[str, int]  # texts without their numbers


@dataclass(frozen=True, slots=True)
class Course:
    """What is the same in all flights of a run."""

    kind: str
    loss: float
    estimates: str
    sensor: str


def mission_of(course: Course, seed: int) -> Mission:
    """The mission of one flight."""
    kind = course.kind
    drawn = np.random.default_rng(seed)
    is_open = kind in ("open", "lossy")
    example = "lone_tree" if is_open else "natural_stand"
    flown: dict[str, Any] = tomllib.loads((EXAMPLES / f"{example}.toml").read_text())
    sim: dict[str, Any] = flown.setdefault("sim", {})
    sim["seed"] = seed
    if kind == "open":
        count = int(drawn.integers(1, 4))
        cut_off = sorted(int(k) + 1 for k in drawn.choice(flown["swarm"]["size"], count, replace=False))
        at_s = round(float(drawn.uniform(*CUT_AT_S)), 1)
        sim["faults"] = [{"kind": "partition", "vehicles": cut_off, "phase": "transit", "at_s": at_s, "for_s": CUT_S}]
    else:
        sim["radio_loss"] = course.loss
    if kind == "wood":
        flown["swarm"]["size"] = 12
        flown["forest"]["stand"]["density_per_ha"] = 200.0
        sim["radio_trunks"] = "cut"
    if kind in ("late", "denied"):
        sim["radio_delay_s"] = 0.2
    if kind == "denied":
        flown["swarm"] |= {"gnss": "leader", "leader_priority": [1]}
        rows = [(-START_APART_M * (k // 2), START_APART_M * (k % 2), 0.0) for k in range(flown["swarm"]["size"])]
        flown["ranging"] = {"start_enu_m": rows}
    sim["estimates"] = course.estimates
    if course.sensor != SECTORS and not is_open:
        flown["sensing"] |= {"sensor": course.sensor, "range_m": 12.0}
    return validated(Mission, flown, kind).with_origin(DEFAULT_ORIGIN)


class Listener:
    """Counts what the companions of one flight say, and whom they take for silent."""

    def __init__(self) -> None:
        self.said: Counter[str] = Counter()
        self.silences = 0
        self._framing = Framing(TEXTS)
        self._silent: dict[int, set[int]] = {}

    def watch(self, flight: fly.Flight) -> None:
        """After each tick."""
        for data in flight.lockstep.from_companion.values():
            for message in self._framing.parse(data):
                if getattr(message, "chunk_seq", 0) == 0:
                    text = message.text.decode() if isinstance(message.text, bytes) else message.text
                    self.said["".join("#" if c.isdigit() else c for c in text.rstrip("\0"))] += 1
        for vehicle, companion in flight.lockstep.companions.items():
            silent = set(companion.endpoint.agent.localiser.silent)  # type: ignore[attr-defined]
            self.silences += len(silent - self._silent.get(vehicle, set()))
            self._silent[vehicle] = silent


def fly_one(seed: int, course: Course) -> Flown:
    """Flies one."""
    flown, listener = mission_of(course, seed), Listener()
    with Progress(io.StringIO()) as progress:
        outcome = fly.fly(flown, None, progress, in_process=True, watch=listener.watch)
    metrics, minutes = outcome.metrics, outcome.metrics.sim_time_s / 60.0 * flown.swarm.size
    return Flown(
        seed,
        str(outcome.summary["grade"]),
        len(metrics.absent),
        float("inf") if metrics.overhead_leader is None else metrics.overhead_leader,
        metrics.min_separation_m,
        metrics.contacts,
        sum(listener.said.values()) / minutes,
        listener.silences / minutes,
        dict(listener.said.most_common(12)),
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then their sum."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench bad-radio", description=__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="(20)")
    parser.add_argument("--first-seed", type=as_seed, default=3000, metavar="S", help="(3000)")
    parser.add_argument("--loss", type=as_loss, default=LOSS, metavar="SHARE", help=f"of beacons, not of open ({LOSS})")
    parser.add_argument("--estimates", choices=ESTIMATES, default="exact", metavar="KIND", help="sim.estimates (exact)")
    parser.add_argument(
        "--sensor", choices=SENSORS, default=SECTORS, metavar="CLASS", help=f"not in the open ({SECTORS})"
    )
    parser.add_argument("--jobs", type=positive, default=2, metavar="N", help="flights at once (2)")
    args = parser.parse_args(argv)
    course = Course(args.kind, args.loss, args.estimates, args.sensor)
    seeds = range(args.first_seed, args.first_seed + args.flights)
    flown = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(partial(fly_one, course=course), seeds):
            print(row, flush=True)
            flown.append(row)
    grades = ", ".join(f"{count} {grade}" for grade, count in sorted(Counter(row.grade for row in flown).items()))
    figures = (
        spread([100.0 * row.overhead for row in flown], ""),
        spread([row.least_m for row in flown], ""),
        spread([row.texts for row in flown], ""),
        spread([row.silences for row in flown], ""),
    )
    print("\n| kind | flights | grades | absent | contacts | overhead, % | separation, m | texts | silences |")
    print("|---|---|---|---|---|---|---|---|---|")
    absent, contacts = (sum(getattr(row, name) for row in flown) for name in ("absent", "contacts"))
    print(f"| {args.kind} | {len(flown)} | {grades} | {absent} | {contacts} | {' | '.join(figures)} |")
    said: Counter[str] = sum((Counter(row.said) for row in flown), Counter())
    print("\nSaid, over all:", *(f"{count:6} {text}" for text, count in said.most_common(12)), sep="\n")
    return 0
