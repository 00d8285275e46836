"""Satellites led astray, and own positions that lie: `python -m tests.bench spoofing`.

Whole flights on JSBSim: who is struck, by what, when, which way and how fast, how many fly, the stand's density, the
sensor and the wind are drawn; each is flown again without the fault, for false alarms. With `--open-loop` one vehicle
flies its course alone (see `fix_traces`), which is cheap: error when noticed, and false alarms; with `--velocities`
one whose position leaves its velocity under the open sky (see `velocity_errors`); with `--open-sky` swarms fly on point
masses where nothing else tells a position, with range radios and without.
"""

from __future__ import annotations

import argparse
import io
import math
import re
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mission
from companion.core.localisation.integrity.fix_monitor import FixMonitor
from companion.core.localisation.integrity.own_position import BY_TRUNKS
from mission.document.model import Mission
from mission.schema.kinds import RAW_LIDARS, SensorClass
from sim_bridge.drive import fly as bridge
from sim_bridge.judge.progress import Progress
from sim_bridge.options.search import as_count, as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.fix_traces import HOVERS_S, Led, trace
from tests.bench.open_sky import report_open_sky
from tests.bench.own_motion import LENGTH_S, SENSORS
from tests.bench.table import spread
from tests.bench.velocity_errors import report_velocities
from tests.flights import point_masses

EXAMPLE = Path(mission.__file__).parent / "examples" / "natural_stand.toml"
SALT = 0x5B00F
RATES_MPS = (0.05, 0.5)
RANGES_M = {SensorClass.SECTORS: 8.0, SensorClass.MULTI_LAYER: 20.0}
KINDS = ("gnss-drift", "gnss-drift", "gnss-drift", "position-drift", "position-jump", "position-freeze", "height-error")
SAID = re.compile(r"vehicle (\d+): (?:position doubted|hold: position (?:jumped|frozen))")


def draw_drift(rng: np.random.Generator) -> tuple[float, float]:
    """North and east, m/s: any direction, rates even by their logarithm."""
    rate_mps = math.exp(rng.uniform(math.log(RATES_MPS[0]), math.log(RATES_MPS[1])))
    bearing = rng.uniform(0.0, math.tau)
    return rate_mps * math.cos(bearing), rate_mps * math.sin(bearing)


# --- open loop ---


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a vehicle by itself."""

    sensor: SensorClass
    rate_mps: float  # 0: nothing leads it astray
    noticed: bool
    off_m: float  # of the fix, when it was noticed, or at the end


def run_alone(seed: int, *, spoofed: bool) -> Run:
    """Draws one, and flies it until it is noticed."""
    rng = np.random.default_rng([SALT, seed])
    sensor = list(SENSORS)[seed % len(SENSORS)]
    density_per_ha, at_s, drift = float(rng.uniform(100.0, 450.0)), float(rng.uniform(5.0, 45.0)), draw_drift(rng)
    monitor, off_m = FixMonitor(BY_TRUNKS), 0.0
    rate_mps = math.hypot(*drift) if spoofed else 0.0
    for moment in trace(density_per_ha, sensor, seed, Led(at_s, drift) if spoofed else None):
        off_m = moment.off_m
        way = moment.perception.read_way(moment.reported, moment.now_s)
        if way is None:
            continue
        fix = (moment.reported.pos_ned_m[0], moment.reported.pos_ned_m[1])
        if monitor.update(fix, way.ne_m, moment.now_s, frame=way.frame, frame_rad2=way.frame_rad2) is not None:
            return Run(sensor, rate_mps, True, off_m)
    return Run(sensor, rate_mps, False, off_m)


def report_open_loop(runs: int, first_seed: int) -> None:
    """A row for each sensor, and one for all."""
    flown: list[Run] = []
    for seed in range(first_seed, first_seed + runs):
        flown += [run_alone(seed, spoofed=True), run_alone(seed, spoofed=False)]
    print(
        "| sensor | spoofed | noticed | error when noticed, m: median | 95 % | most | false alarms, of runs | an hour |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, of in [*((s.value, (s,)) for s in SENSORS), ("all", tuple(SENSORS))]:
        led = [run for run in flown if run.rate_mps > 0.0 and run.sensor in of]
        found = [run.off_m for run in led if run.noticed and run.off_m > 0.0]
        clean = [run for run in flown if run.rate_mps == 0.0 and run.sensor in of]
        alarms = sum(run.noticed for run in clean)
        hours = len(clean) * (LENGTH_S + HOVERS_S) / 3600.0
        quantiles = [f"{q:.1f}" for q in np.quantile(found, [0.5, 0.95, 1.0])] if found else ["-"] * 3
        counts = f"{len(led)} | {len(found)}"
        rate = f"{alarms} of {len(clean)} | {alarms / hours if hours else 0.0:.1f}"
        print(f"| {name} | {counts} | {' | '.join(quantiles)} | {rate} |", flush=True)
    missed = [f"{run.off_m:.1f} m at {run.rate_mps:.2f} m/s" for run in flown if run.rate_mps > 0.0 and not run.noticed]
    print(f"\nnot noticed by the end: {', '.join(missed) or 'none'}")


# --- flights ---


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight."""

    seed: int
    drawn: str
    kind: str  # empty: without a fault
    grade: str
    off_m: float | None  # of the position, when it was noticed; None: it was not
    alarms: int  # of vehicles that no fault struck
    outside_m: float
    contacts: int
    separation_m: float


def draw_tables(seed: int) -> tuple[dict[str, Any], str, dict[str, Any]]:
    """The mission of a seed without its fault, what was drawn in words, and the fault."""
    rng = np.random.default_rng([SALT, 1, seed])
    n, density_per_ha = int(rng.integers(4, 9)), round(float(rng.uniform(100.0, 450.0)))
    sensor = SensorClass(str(rng.choice([kind.value for kind in SensorClass])))
    kind, struck = KINDS[seed % len(KINDS)], int(rng.integers(1, n + 1))
    bearing, wind_mps = float(rng.uniform(0.0, math.tau)), round(float(rng.uniform(0.0, 3.0)), 1)
    fault: dict[str, Any] = {"kind": kind, "vehicles": [struck], "phase": "transit"}
    fault["at_s"] = round(float(rng.uniform(2.0, 30.0)), 1)
    (north, east), far_m = draw_drift(rng), float(rng.uniform(4.0, 15.0))
    if kind.endswith("drift"):
        fault["drift_mps"] = [round(east, 3), round(north, 3)]
    elif kind == "position-jump":
        away = far_m / math.hypot(north, east)
        fault["jump_m"] = [round(east * away, 1), round(north * away, 1)]
    elif kind == "height-error":
        fault["height_m"] = round(far_m if rng.uniform() < 0.7 else -far_m, 1)
    tables: dict[str, Any] = tomllib.loads(EXAMPLE.read_text())
    tables["swarm"]["size"] = n
    tables["forest"]["stand"]["density_per_ha"] = density_per_ha
    range_m = RANGES_M.get(sensor) or RAW_LIDARS[sensor].range_max_m
    tables["sensing"] |= {"sensor": sensor.value, "range_m": range_m}
    wind = [wind_mps * math.sin(bearing), wind_mps * math.cos(bearing), 0.0]
    tables["sim"] |= {"seed": seed, "estimates": "recorded", "wind_mps": wind, "time_limit_s": 240.0}
    words = f"{n} vehicles, {density_per_ha}/ha, {sensor.value}, {wind_mps} m/s, {fault}"
    return tables, words, fault


class Watch:
    """How far the struck vehicle's position is off when its companion says so; and others that do."""

    def __init__(self, struck: int, shown: io.StringIO) -> None:
        self._struck = struck
        self._shown = shown
        self._read = 0
        self.off_m: float | None = None
        self.alarmed: set[int] = set()

    def __call__(self, flight: bridge.Flight) -> None:
        """One tick: what has been shown since the last."""
        text = self._shown.getvalue()[self._read :]
        self._read += len(text)
        for said in SAID.finditer(text):
            vehicle = int(said[1])
            if vehicle != self._struck:
                self.alarmed.add(vehicle)
            elif self.off_m is None:
                one = flight.world.vehicles[vehicle]
                self.off_m = math.dist(one.airframe.state.pos_ned_m, one.believed.state.pos_ned_m)


def fly_one(seed: int, *, spoofed: bool, point_mass: bool) -> Flown:
    """Flies one, with its fault or without."""
    tables, words, fault = draw_tables(seed)
    tables["sim"]["faults"] = [fault] if spoofed else []
    flown = Mission.model_validate(tables).with_origin(DEFAULT_ORIGIN)
    shown = io.StringIO()
    watch = Watch(int(fault["vehicles"][0]) if spoofed else 0, shown)
    airframes = point_masses if point_mass else None
    with tempfile.TemporaryDirectory() as folder, Progress(shown) as progress:
        outcome = bridge.fly(flown, Path(folder), progress, in_process=True, airframes=airframes, watch=watch)
    metrics = outcome.metrics
    return Flown(
        seed,
        words,
        fault["kind"] if spoofed else "",
        str(outcome.summary["grade"]),
        watch.off_m,
        len(watch.alarmed),
        metrics.fence_exceeded_m,
        metrics.contacts,
        metrics.min_separation_m or 0.0,
    )


def rows_of(flights: int, first_seed: int, *, clean: bool, point_mass: bool) -> Iterator[Flown]:
    """Each flight, as it ends."""
    for seed in range(first_seed, first_seed + flights):
        yield fly_one(seed, spoofed=True, point_mass=point_mass)
        if clean:
            yield fly_one(seed, spoofed=False, point_mass=point_mass)


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then one for each kind."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench spoofing", description=__doc__)
    parser.add_argument("--flights", type=positive, default=14, metavar="N", help="with a fault (14)")
    parser.add_argument("--first-seed", type=as_seed, default=6000, metavar="S", help="(6000)")
    parser.add_argument("--clean", action="store_true", help="each without its fault, too")
    parser.add_argument("--point-mass", action="store_true", help="without JSBSim")
    parser.add_argument("--open-loop", type=as_count, default=0, metavar="N", help="N runs of a vehicle alone instead")
    parser.add_argument(
        "--velocities", type=as_count, default=0, metavar="N", help="N runs against the own velocity instead"
    )
    parser.add_argument(
        "--open-sky", type=as_count, default=0, metavar="N", help="N flights where nothing else tells instead"
    )
    args = parser.parse_args(argv)
    if args.open_sky:
        report_open_sky(args.open_sky, args.first_seed)
        return 0
    if args.velocities:
        report_velocities(args.velocities, args.first_seed)
        return 0
    if args.open_loop:
        report_open_loop(args.open_loop, args.first_seed)
        return 0
    flown: list[Flown] = []
    for row in rows_of(args.flights, args.first_seed, clean=args.clean, point_mass=args.point_mass):
        print(row, flush=True)
        flown.append(row)
    print("\n| fault | flights | noticed | off then, m | outside, m | contacts | others' alarms | separation, m |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in [*dict.fromkeys(KINDS), ""]:
        rows = [row for row in flown if row.kind == kind]
        if not rows:
            continue
        found = [row.off_m for row in rows if row.off_m is not None]
        off = spread(found, "") if found else "-"
        worst_m, contacts = max(row.outside_m for row in rows), sum(row.contacts for row in rows)
        cells = [len(rows), len(found), off, f"{worst_m:.2f}", contacts, sum(row.alarms for row in rows)]
        apart = spread([row.separation_m for row in rows], "")
        print(f"| {kind or 'none'} | {' | '.join(map(str, cells))} | {apart} |")
    return 0
