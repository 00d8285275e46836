"""Swarms that must all pass one gap in a closed wall of trunks, there and back: `python -m tests.bench gaps`.

The wall stands across the way, from fence to fence, with one gap of drawn width, place and depth. With `--kind cut`
some vehicles are cut off at a drawn time about it, so that those that look for the others meet those that go on.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from companion.core.model.states import FlightState
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.schema.check import validated
from sim_bridge.drive.fly import Flight
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.bench.table import spread
from tests.flights import flown

WALL_EAST_M, WALL_M = 40.0, 25.0  # half as long as from fence to fence
TRUNK_M, STEP_M = 0.2, 0.75  # radius, and from axis to axis: no vehicle passes
WIDE_M = (1.9, 4.0)  # from bark to bark
ASIDE_M = 8.0  # of the straight way, at most
SLANT_RAD = math.radians(40.0)  # of a funnel's rows, out of the wall, to both sides of it
DEEP_M = (0.0, 0.0, 6.0)  # rows along the gap, from the wall on
NEAR_M = 12.0  # of the gap: who stands there may wait for another
PAIR_M = 8.0  # from one that stands to one that it may wait for
STANDS_M = 1.0  # of progress: less is none
LONG_S = 20.0  # so long without is a deadlock
SAMPLED_S = 0.5
SENSORS = {"sectors": 8.0, "scan-1deg": 12.0}  # and their reach, m
ON_WAY = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.SEEKING)


@dataclass(frozen=True, slots=True)
class Wait:
    """One vehicle that got nowhere for a while, near the gap, on its way, with others near by."""

    vehicle: int
    at_s: float
    lasted_s: float
    from_gap_m: tuple[float, float]  # east, north
    others: tuple[int, ...]  # on their way too, within PAIR_M
    state: str


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight."""

    seed: int
    size: int
    wide_m: float
    deep_m: float
    grade: str
    through_s: float | None  # from the first vehicle near the gap until all are beyond the wall; None: never
    back_s: float | None  # the same on the way back
    waits: tuple[Wait, ...]
    separation_m: float
    contacts: int
    verdict: str


class Watch:
    """Samples a flight."""

    def __init__(self, gap_en: tuple[float, float], wide_m: float, deep_m: float) -> None:
        self.gap_en, self.wide_m, self.deep_m = gap_en, wide_m, deep_m
        self.due_s = 0.0
        self.anchors: dict[int, tuple[float, Vec3, set[int], str]] = {}
        self.waits: list[Wait] = []
        self.first_s: float | None = None
        self.through_s: float | None = None
        self.back_first_s: float | None = None
        self.back_s: float | None = None

    def __call__(self, flight: Flight) -> None:
        """After each tick."""
        tick = flight.last
        if tick.time_s < self.due_s:
            return
        self.due_s = tick.time_s + SAMPLED_S
        now_s = tick.time_s
        states = {k: FlightState(tick.said[k].flight_state) for k in tick.alive if k in tick.said}
        going = {k: tick.pos_ned_m[k - 1] for k, state in states.items() if state in ON_WAY}
        for k in list(self.anchors):
            if k not in going or math.dist(self.anchors[k][1], going[k]) > STANDS_M:
                self.end_wait(k, now_s)
        for k, pos in going.items():
            near = {j for j, other in going.items() if j != k and math.dist(pos, other) < PAIR_M}
            if k not in self.anchors:
                self.anchors[k] = (now_s, pos, near, states[k].name)
            else:
                self.anchors[k][2].update(near)
        self._note_passage(states, {k: tick.pos_ned_m[k - 1] for k in states}, now_s)

    def _note_passage(self, states: dict[int, FlightState], pos: dict[int, Vec3], now_s: float) -> None:
        if not any(state in (*ON_WAY, FlightState.COVERAGE) for state in states.values()):
            return
        from_gap_m = {k: math.hypot(p[1] - self.gap_en[0], p[0] - self.gap_en[1]) for k, p in pos.items()}
        far_m = WALL_EAST_M + self.deep_m + 1.0
        if self.first_s is None:
            if min(from_gap_m.values()) < NEAR_M:
                self.first_s = now_s
        elif self.through_s is None:
            if all(p[1] > far_m for p in pos.values()):
                self.through_s = now_s - self.first_s
        elif self.back_first_s is None:
            if FlightState.RETURNING in states.values() and min(from_gap_m.values()) < NEAR_M + self.deep_m:
                self.back_first_s = now_s
        elif self.back_s is None and all(p[1] < WALL_EAST_M - 1.0 for p in pos.values()):
            self.back_s = now_s - self.back_first_s

    def end_wait(self, k: int, now_s: float) -> None:
        """It has moved, or is not on its way any more."""
        since_s, at, near, state = self.anchors.pop(k)
        east, north = at[1] - self.gap_en[0], at[0] - self.gap_en[1]
        if now_s - since_s >= 5.0 and near and math.hypot(east, north) < NEAR_M + self.deep_m:
            self.waits.append(
                Wait(
                    k, round(since_s, 1), now_s - since_s, (round(east, 1), round(north, 1)), tuple(sorted(near)), state
                )
            )


def tables(seed: int, *, kind: str, size: int, shape: str, sensor: str) -> tuple[dict[str, Any], Watch]:
    """The mission of one flight, as tables, and what looks at it."""
    drawn = np.random.default_rng(seed)
    wide_m, aside_m = round(float(drawn.uniform(*WIDE_M)), 2), round(float(drawn.uniform(-ASIDE_M, ASIDE_M)), 2)
    deep_m = float(drawn.choice(DEEP_M))
    half_m = wide_m / 2.0 + TRUNK_M
    places = [(WALL_EAST_M, aside_m - half_m), (WALL_EAST_M, aside_m + half_m)]
    places += [
        (WALL_EAST_M + e, aside_m + side * half_m) for side in (-1, 1) for e in np.arange(STEP_M, deep_m, STEP_M)
    ]
    slants = [(0.0, 0.0)] if shape == "wall" else [(-SLANT_RAD, 0.0), (SLANT_RAD, deep_m)]
    for slant, from_m in slants:
        for side in (-1.0, 1.0):
            for along in np.arange(STEP_M, 4.0 * WALL_M, STEP_M):
                north = aside_m + side * (half_m + along * math.cos(slant))
                if abs(north) <= WALL_M + 1.0:
                    places.append((WALL_EAST_M + from_m + along * math.sin(slant), north))
    faults: list[dict[str, Any]] = []
    trunks = str(drawn.choice(["disc", "attenuated"]))
    if kind == "cut":
        cut_off = sorted((drawn.permutation(size)[: int(drawn.integers(1, size // 2 + 1))] + 1).tolist())
        at_s, for_s = (round(float(drawn.uniform(*span)), 1) for span in ((4.0, 22.0), (5.0, 40.0)))
        faults = [{"kind": "partition", "vehicles": cut_off, "phase": "transit", "at_s": at_s, "for_s": for_s}]
    north_m = WALL_M
    flown: dict[str, Any] = {
        "schema": 1,
        "name": "gap",
        "route": {"d1_enu_m": [0.0, 0.0, 4.4], "d2_enu_m": [85.0, 0.0, 4.4], "vel_leader_mps": 3.0, "at_end": "return"},
        "swarm": {"size": size},
        "coverage": {"shape": "ring", "radius_m": 15.0, "keep_out_m": 2.0, "duration_s": 5.0},
        "fence": {
            "altitude_min_m": 2.0,
            "altitude_max_m": 6.0,
            "polygon_enu_m": [[-40.0, -north_m], [120.0, -north_m], [120.0, north_m], [-40.0, north_m]],
        },
        "sensing": {"sensor": sensor, "range_m": SENSORS[sensor], "rate_hz": 10.0},
        "forest": {
            "trees": [
                {"base_enu_m": [round(e, 3), round(n, 3)], "trunk_radius_m": TRUNK_M, "height_m": 15.0}
                for e, n in places
            ]
        },
        "sim": {"seed": seed, "radio_trunks": trunks, "faults": faults, "time_limit_s": 420.0},
    }
    return flown, Watch((WALL_EAST_M, aside_m), wide_m, deep_m)


def fly_one(seed: int, *, kind: str, size: int, shape: str, sensor: str) -> Flown:
    """Flies one on point masses."""
    values, watch = tables(seed, kind=kind, size=size, shape=shape, sensor=sensor)
    mission = validated(Mission, values, "gap").with_origin(DEFAULT_ORIGIN)
    with tempfile.TemporaryDirectory(prefix="gaps-") as place:
        outcome, _ = flown(mission, Path(place) / "run", watch=watch)
    for k in list(watch.anchors):
        watch.end_wait(k, watch.due_s)
    metrics = outcome.metrics
    return Flown(
        seed,
        size,
        watch.wide_m,
        watch.deep_m,
        str(outcome.summary["grade"]),
        watch.through_s,
        watch.back_s,
        tuple(watch.waits),
        metrics.min_separation_m or math.nan,
        metrics.contacts,
        str(outcome.summary["verdict"]),
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each flight, then the sums."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench gaps", description=__doc__)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="(20)")
    parser.add_argument("--first-seed", type=as_seed, default=6000, metavar="S", help="(6000)")
    parser.add_argument("--size", type=positive, default=4, metavar="N", help="vehicles (4)")
    parser.add_argument("--kind", choices=("through", "cut"), default="through")
    parser.add_argument("--shape", choices=("wall", "funnel"), default="funnel")
    parser.add_argument("--sensor", choices=SENSORS, default="sectors", help="(sectors)")
    parser.add_argument("--jobs", type=positive, default=1, metavar="N", help="flights at once (1)")
    args = parser.parse_args(argv)
    rows = []
    with ProcessPoolExecutor(args.jobs) as pool:
        one = partial(fly_one, kind=args.kind, size=args.size, shape=args.shape, sensor=args.sensor)
        for row in pool.map(one, range(args.first_seed, args.first_seed + args.flights)):
            print(json.dumps(asdict(row)), flush=True)
            rows.append(row)
    waits = [wait.lasted_s for row in rows for wait in row.waits]
    through = [row.through_s for row in rows if row.through_s is not None]
    back = [row.back_s for row in rows if row.back_s is not None]
    print(f"n = {args.size}, {args.shape}, {args.kind}, {args.sensor}: {_sum_up(through, len(rows))} through, ", end="")
    print(f"{_sum_up(back, len(rows))} back; {len(waits)} waits of 5 s and more, ", end="")
    print(f"{sum(s > LONG_S for s in waits)} above {LONG_S:.0f} s; {sum(row.contacts for row in rows)} contacts")
    return 0


def _sum_up(after_s: Sequence[float], flights: int) -> str:
    times = f" (after {spread(after_s, ' s')})" if after_s else ""
    return f"{len(after_s)} of {flights} all{times}"
