"""Relative errors with trunks shared and without: `python -m tests.bench shared-trunks`.

mission/studies/by_ranges.toml by raw scans of 1 degree and 12 m; how many fly, the stand's density and the radio's loss
are drawn, or given. Each flight is flown twice, on point masses: its vehicles tell of trunks, and do not; with
`--alone` instead by range radios and trunks, and by trunks alone. An estimate is held against the places from before
the tick in which it is read, as its odometers are. Neighbours that a vehicle has not heard for a second, whom it places
nowhere, are counted apart. Then false alignments: constellations of drawn stands, leafy clumps among them, held against
other stands, and against their own, narrowly and widely.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import mission
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_denied.wide_search import align_wide
from companion.core.model.beacon import ToldTrunk
from companion.core.model.states import SwarmPhase
from companion.core.perception.landmarks.constellation import TURN_RAD, Alignment, align, turned
from companion.core.perception.obstacle_perception import SensingPerception
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.options.search import as_count, as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.autopilot.estimates.odometry import Odometer
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.options import as_density, as_loss, whole
from tests.bench.table import spread
from tests.flights import flown

STUDY = Path(mission.__file__).parent / "studies" / "by_ranges.toml"
MOST = len(tomllib.loads(STUDY.read_text())["ranging"]["start_enu_m"])  # vehicles that it has places for
SALT = 0x7A1B
EVERY = 10  # ticks between two looks
FALSE_M, FALSE_RAD = 1.5, math.radians(5.0)
CLEARING_S = 10.0  # since the first has departed: until then hardly two vehicles have six trunks in common
SENSORS = {"scan-1deg": 12.0, "scan-0.5deg": 20.0, "multi-layer": 12.0}  # and their reach, m
WIDE_M, WIDE_SD_M = 30.0, 8.0  # of false alignments that are searched for widely
PHASES = (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE)


@dataclass(slots=True)
class Errors:
    """Of one flight: of every vehicle about every other, while the swarm is under way."""

    place_m2: list[float] = field(default_factory=list)
    among_m2: list[float] = field(default_factory=list)  # of them, later than CLEARING_S
    unheard_m2: list[float] = field(default_factory=list)  # of neighbours that are not heard, not among the others
    turn_rad2: list[float] = field(default_factory=list)
    aligned: int = 0
    false: int = 0
    worst_m: float = 0.0  # of an alignment's place
    places: dict[int, Vec3] = field(default_factory=dict)  # before this tick
    departed_s: float | None = None
    unsure_s: float = 0.0  # under way, held as a neighbour's place was too uncertain; of all vehicles together
    seen_s: dict[tuple[int, int], float] = field(default_factory=dict)  # by pair: the last alignment

    def watch(self, flight: fly.Flight) -> None:
        """After each tick."""
        agents = {k: c.endpoint.agent for k, c in flight.lockstep.companions.items() if isinstance(c, InProcess)}
        tick = round(flight.world.now_s * 20.0)
        places, self.places = self.places, flight.world.positions()
        if not any(agent.swarm.phases.phase in PHASES for agent in agents.values()):
            return
        if self.departed_s is None:
            self.departed_s = flight.world.now_s
        is_among = flight.world.now_s - self.departed_s > CLEARING_S
        frames = {k: _frame_rad(flight, k, agent.perception) for k, agent in agents.items()}
        for k, agent in agents.items():
            localiser = agent.localiser
            if not (isinstance(localiser, GnssDeniedLocaliser) and agent.flight.vehicle.airborne):
                continue
            self.unsure_s += 0.05 * (agent.status(flight.world.now_s).cause is Cause.PEER_UNCERTAIN)
            joint = localiser.ranging.filter
            for other in [j for j in agents if j != k and agents[j].flight.vehicle.airborne]:
                there = turned(-frames[k], places[other][0] - places[k][0], places[other][1] - places[k][1])
                turn_rad = frames[other] - frames[k]
                if tick % EVERY == 0:
                    self._note(joint, other, there, turn_rad, is_among=is_among)
                found = None if localiser.trunks is None else localiser.trunks.aligned.get(other)
                if found is not None and self.seen_s.get((k, other)) != found[1]:
                    self.seen_s[k, other] = found[1]
                    self._hold(found[0], joint, localiser.ranging.odo_ne_m, other, there, turn_rad)

    def _note(self, joint: Any, other: int, there: tuple[float, float], turn_rad: float, *, is_among: bool) -> None:
        known = joint.relative(other)
        if known is None:
            return
        at = turned(-joint.compass[0], *known.ne_m)
        off_m2 = (at[0] - there[0]) ** 2 + (at[1] - there[1]) ** 2
        if joint.has_lost(other):
            self.unheard_m2.append(off_m2)
            return
        self.place_m2.append(off_m2)
        if is_among:
            self.among_m2.append(off_m2)
        self.turn_rad2.append(math.remainder(joint.compass_of(other) - joint.compass[0] - turn_rad, math.tau) ** 2)

    def _hold(
        self,
        found: Alignment,
        joint: Any,
        own: tuple[float, float],
        other: int,
        there: tuple[float, float],
        turn_rad: float,
    ) -> None:
        odo = joint.odometer_of(other)
        if odo is None:
            return
        n, e = found.place(odo)
        off_m = math.hypot(n - own[0] - there[0], e - own[1] - there[1])
        self.aligned += 1
        self.worst_m = max(self.worst_m, off_m)
        self.false += off_m > FALSE_M or abs(math.remainder(found.turn_rad - turn_rad, math.tau)) > FALSE_RAD


def _frame_rad(flight: fly.Flight, vehicle_id: int, perception: object) -> float:
    """By how much the north of a vehicle's odometry, as its scans correct it, is off the true one."""
    believed = flight.world.vehicles[vehicle_id].believed
    north_off = believed.north_off_rad if isinstance(believed, Odometer) else 0.0
    return north_off - (perception.motion.turn_rad if isinstance(perception, SensingPerception) else 0.0)


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight. Root mean squares."""

    seed: int
    n: int
    density_per_ha: float
    loss: float
    way: str
    verdict: str
    place_m: float
    among_m: float
    unheard: float  # share of what was looked at
    unheard_m: float
    turn_deg: float
    separation_m: float
    contacts: int
    aligned: int
    false: int
    worst_m: float
    unsure_s: float


COLUMNS = ("trunks", "flights", "arrived", "place, m", "among, m", "turn, deg", "apart, m", "contacts")
COLUMNS += ("unsure, s", "aligned", "falsely")
NOT_SHARED, SHARED, ALONE = "not shared", "shared", "alone"  # trunks: beside ranges, the last without them


def mission_of(
    seed: int, n: int | None, density_per_ha: float | None, loss: float | None, sensor: str, way: str
) -> Mission:
    """What is not given is drawn."""
    rng = np.random.default_rng([SALT, seed])
    drawn = (int(rng.integers(4, 9)), float(rng.choice([100.0, 200.0, 400.0])), round(float(rng.uniform(0.0, 0.2)), 2))
    tables: dict[str, Any] = tomllib.loads(STUDY.read_text())
    tables["route"]["d2_enu_m"] = [90.0, 0.0, 4.0]
    tables["coverage"] = {"duration_s": 15.0}
    tables["swarm"]["size"] = n or drawn[0]
    tables["sensing"] |= {"sensor": sensor, "range_m": SENSORS[sensor]}
    tables["ranging"]["radio"] = way != ALONE
    tables["forest"]["stand"]["density_per_ha"] = density_per_ha or drawn[1]
    tables["sim"] |= {"seed": seed, "radio_loss": drawn[2] if loss is None else loss}
    return Mission.model_validate(tables).with_origin(DEFAULT_ORIGIN)


def fly_one(job: tuple[int, int | None, float | None, float | None, str, str, bool]) -> Flown:
    """Flies one; without sharing as before it was built."""
    *drawn, sensor, way, point_mass = job
    flies = mission_of(*drawn, sensor, way)
    errors = Errors()
    kept = property(lambda _: False) if way == NOT_SHARED else Mission.shares_trunks
    with tempfile.TemporaryDirectory() as folder, mock.patch.object(Mission, "shares_trunks", kept):
        outcome, _ = flown(flies, Path(folder), watch=errors.watch, point_mass=point_mass)
    stand = flies.forest.stand
    assert stand is not None
    return Flown(
        flies.sim.seed,
        flies.swarm.size,
        stand.density_per_ha,
        flies.sim.radio_loss,
        way,
        str(outcome.summary["verdict"]),
        _root_mean(errors.place_m2),
        _root_mean(errors.among_m2),
        len(errors.unheard_m2) / max(1, len(errors.unheard_m2) + len(errors.place_m2)),
        _root_mean(errors.unheard_m2),
        math.degrees(_root_mean(errors.turn_rad2)),
        outcome.metrics.min_separation_m or 0.0,
        outcome.metrics.contacts,
        errors.aligned,
        errors.false,
        errors.worst_m,
        errors.unsure_s,
    )


def _root_mean(squares: Sequence[float]) -> float:
    return math.sqrt(float(np.mean(squares))) if squares else math.nan


# --- false alignments ---


def draw_stand(rng: np.random.Generator, density_per_ha: float, *, leafy: bool) -> list[ToldTrunk]:
    """Trunks within 40 m; `leafy`: four of ten are clumps, of two to five stems within a metre."""
    found: list[ToldTrunk] = []
    for _ in range(rng.poisson(density_per_ha * 0.64)):
        n, e = rng.uniform(-40.0, 40.0, 2)
        stems = int(rng.integers(2, 6)) if leafy and rng.random() < 0.4 else 1
        for n_off, e_off in rng.uniform(-0.7, 0.7, (stems, 2)) if stems > 1 else [(0.0, 0.0)]:
            found.append((float(n + n_off), float(e + e_off), float(rng.uniform(0.12, 0.5))))
    return found


def remembered(rng: np.random.Generator, stand: Sequence[ToldTrunk], at: tuple[float, float]) -> list[ToldTrunk]:
    """What a vehicle there has seen on its way of 40 m, about it; one in seven was hidden."""
    found = []
    for north_m, east_m, diameter_m in stand:
        n, e = north_m - at[0], east_m - at[1]
        away_m = math.hypot(n - min(0.0, max(-40.0, n)), e)
        if away_m <= 11.0 and rng.random() < 0.85:
            off = rng.normal(0.0, 0.05, 2)
            found.append((n + float(off[0]), e + float(off[1]), diameter_m + float(rng.normal(0.0, 0.03))))
    return sorted(found, key=lambda trunk: math.hypot(trunk[0], trunk[1]))


def try_one(seed: int) -> tuple[str, bool, bool]:
    """Kind of the try; whether it was accepted, and falsely."""
    rng = np.random.default_rng([SALT, 1, seed])
    leafy, strangers, is_wide = bool(rng.random() < 0.5), bool(rng.random() < 0.8), seed % 2 == 1
    density = float(rng.choice([50.0, 100.0, 200.0, 400.0, 600.0]))
    stand = draw_stand(rng, density, leafy=leafy)
    other = draw_stand(rng, density, leafy=leafy) if strangers else stand
    bearing, away_m, turn = (
        rng.uniform(0.0, math.tau),
        rng.uniform(5.0, 25.0),
        float(rng.normal(0.0, math.radians(3.0))),
    )
    there = (float(away_m * math.cos(bearing)), float(away_m * math.sin(bearing)))
    known = remembered(rng, stand, (0.0, 0.0))[-128:]
    told = [(*turned(-turn, n, e), d) for n, e, d in remembered(rng, other, there)[:24]]
    wrong = rng.normal(0.0, WIDE_SD_M if is_wide else 0.7, 2)
    prior = (there[0] + float(wrong[0]), there[1] + float(wrong[1]))
    turned_rad = turn + float(rng.normal(0.0, 2.0)) * TURN_RAD
    if is_wide:
        found = align_wide(told, known, prior, turned_rad, WIDE_M)
    else:
        found = align(told, known, prior, turned_rad, is_wide=False)
    kind = f"{'strangers' if strangers else 'the same stand'}, {'leafy' if leafy else 'stems'}"
    kind += ", searched for widely" if is_wide else ""
    if found is None:
        return kind, False, False
    at = found.place((0.0, 0.0))
    is_off = math.dist(at, there) > FALSE_M or abs(math.remainder(found.turn_rad - turn, math.tau)) > FALSE_RAD
    return kind, True, strangers or is_off


def _tell_tries(pool: ProcessPoolExecutor, tries: int) -> Iterator[str]:
    counts: dict[str, list[int]] = {}
    for kind, accepted, false in pool.map(try_one, range(tries), chunksize=200):
        row = counts.setdefault(kind, [0, 0, 0])
        row[0], row[1], row[2] = row[0] + 1, row[1] + accepted, row[2] + false
    yield "| constellations | tries | accepted | falsely |"
    yield "|---|---|---|---|"
    for kind, row in sorted(counts.items()):
        yield f"| {kind} | {row[0]} | {row[1]} | {row[2]} |"


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then the pooled figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench shared-trunks", description=__doc__)
    parser.add_argument("--flights", type=positive, default=8, metavar="N", help="of each way (8)")
    parser.add_argument("--first-seed", type=as_seed, default=2000, metavar="S", help="(2000)")
    parser.add_argument("--n", type=whole(1, MOST), metavar="N", help="vehicles (drawn, 4 to 8)")
    parser.add_argument("--density", type=as_density, metavar="TREES", help="per ha (drawn: 100, 200, 400)")
    parser.add_argument("--alone", action="store_true", help="by trunks alone, and by range radios beside them")
    parser.add_argument("--sensor", choices=sorted(SENSORS), default="scan-1deg", help="(scan-1deg)")
    parser.add_argument("--jsbsim", action="store_true", help="on JSBSim, not on point masses")
    parser.add_argument("--loss", type=as_loss, metavar="SHARE", help="of beacons (drawn, up to 0.2)")
    parser.add_argument("--tries", type=as_count, default=10_000, metavar="N", help="of false alignments (10000)")
    parser.add_argument("--jobs", type=positive, default=os.cpu_count() or 1, metavar="N", help="at once")
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.flights)
    rows: list[Flown] = []
    ways = (SHARED, ALONE) if args.alone else (NOT_SHARED, SHARED)
    with ProcessPoolExecutor(args.jobs) as pool:
        jobs = [
            (seed, args.n, args.density, args.loss, args.sensor, way, not args.jsbsim) for seed in seeds for way in ways
        ]
        for row in pool.map(fly_one, jobs):
            print(row, flush=True)
            rows.append(row)
        if rows:
            print(f"\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
        for way in ways if rows else ():
            print(_pooled([row for row in rows if row.way == way], way))
        print()
        for line in _tell_tries(pool, args.tries):
            print(line, flush=True)
    return 0


def _pooled(rows: Sequence[Flown], what: str) -> str:
    arrived = sum(row.verdict == "ARRIVED" for row in rows)
    names = ("place_m", "among_m", "turn_deg", "separation_m")
    cells = [spread([getattr(row, name) for row in rows], "") for name in names]
    sums = [f"{sum(getattr(row, name) for row in rows):.0f}" for name in ("contacts", "unsure_s", "aligned", "false")]
    return f"| {' | '.join([what, str(len(rows)), str(arrived), *cells, *sums])} |"
