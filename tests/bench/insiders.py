"""One member with all its own keys lies in its own beacons: `python -m tests.bench insiders`.

Point masses in lockstep, in process: size, route, fence, radio, which member lies, when, and each lie's numbers are
drawn. Figures are those of the others, on ground truth.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.core.model.states import STEERED, FlightState
from companion.core.safety.bounds import is_inside, to_edges
from mission.common.frames import enu_to_ned
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge.metrics import CONTACT_M
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S
from tests.bench.table import spread

SALT = 0x1251
TIME_LIMIT_S = 330.0  # a swarm that cannot go on has landed by then
UP_M = 1.0  # lower, a vehicle is on its way up or down
COVERED = 0.9  # of the mission's time at d2: a landing or return before it is early
MOVES_MPS = 0.5
DENIED_SHARE = 0.15
SENSING_SHARE = 0.15
GOOD_M = 0.1  # outside the fence


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of one flight, for the others than the liar."""

    seed: int
    lie: str
    n: int
    contacts: int  # pairs of the others that touched
    nearest_m: float
    outside_m: float
    early: int  # vehicles that landed, or turned back, before the mission's time at d2 was over
    arrived: bool  # all of them spread about d2
    led_s: float  # longest time for which one of them flew behind the liar
    led_off_m: float  # and how far from the line d1-d2 that led it
    ended: str


def draw_tables(seed: int, lie: Lie) -> tuple[dict[str, Any], int]:
    """The mission of a seed, and who lies in it."""
    rng = np.random.default_rng([SALT, seed, list(Lie).index(lie)])
    n, length_m = int(rng.integers(4, 11)), float(rng.uniform(40.0, 70.0))
    height_m = float(rng.uniform(6.0, 12.0)) if lie is not Lie.TRUNKS else 3.5  # below all crowns
    radius_m = max(10.0, 6.5 * n / math.tau) * float(rng.uniform(1.1, 1.4))
    is_denied = lie in (Lie.RANGES, Lie.TRUNKS) or rng.random() < DENIED_SHARE
    aside_m = max(22.0, radius_m + float(rng.uniform(8.0, 25.0)))
    if is_denied:
        aside_m = max(aside_m, 32.0)
    liar = int(rng.integers(1, n + 1))
    fault = {
        "kind": "insider",
        "vehicles": [liar],
        "lie": lie.value,
        "phase": str(rng.choice(["gather", "transit", "transit", "coverage"])),
        "at_s": round(float(rng.uniform(0.0, 10.0)), 1),
    }
    faults = [fault]
    if rng.random() < 0.5:
        faults[0]["for_s"] = round(float(rng.uniform(10.0, 60.0)), 1)
    if lie is Lie.GHOST and rng.random() < 0.6:  # one that nobody hears can be a ghost
        killed = int(rng.choice([k for k in range(1, n + 1) if k != liar]))
        faults.append({"kind": "kill", "vehicles": [killed], "phase": "gather", "at_s": 15.0})
    tables: dict[str, Any] = {
        "schema": 1,
        "name": f"insider {lie.value} {seed}",
        "origin": DEFAULT_ORIGIN.model_dump(),
        "route": {
            "d1_enu_m": [0.0, 0.0, height_m],
            "d2_enu_m": [length_m, 0.0, height_m],
            "vel_leader_mps": round(float(rng.uniform(1.5, 4.0)), 1),
            "at_end": str(rng.choice(["land", "return", "hold"])),
        },
        "coverage": {"duration_s": 20.0, "radius_m": radius_m},
        "swarm": {"size": n},
        "fence": {
            "altitude_min_m": 2.0,
            "altitude_max_m": height_m + 6.0,
            "polygon_enu_m": [
                [-aside_m, -aside_m],
                [length_m + aside_m, -aside_m],
                [length_m + aside_m, aside_m],
                [-aside_m, aside_m],
            ],
        },
        "sim": {
            "seed": seed,
            "time_limit_s": TIME_LIMIT_S,
            "radio_loss": round(float(rng.uniform(0.0, 0.3)), 2) if rng.random() < 0.5 else 0.0,
            "faults": faults,
        },
    }
    if is_denied:
        tables["swarm"] |= {"gnss": "leader", "leader_priority": [1]}
        side = math.ceil(math.sqrt(n))
        middle = (side - 1) / 2.0
        starts = [[(k % side - middle) * 8.0, (k // side - middle) * 8.0, 0.0] for k in range(n)]
        tables["ranging"] = {"start_enu_m": starts, "reach_m": 35.0}
    elif rng.random() < 0.4:
        tables["swarm"]["leader_priority"] = [int(k) + 1 for k in rng.permutation(n)[:2]]
    if lie is Lie.TRUNKS:  # told where there are some, by lidars that tell every ray
        tables["sensing"] = {"sensor": "scan-1deg", "range_m": 12.0}
        tables["forest"] = {"stand": {"density_per_ha": round(float(rng.uniform(100.0, 400.0))), "dbh_min_m": 0.12}}
        tables["fence"]["altitude_max_m"] = 4.8
    elif rng.random() < SENSING_SHARE:
        tables["sensing"] = {"range_m": 8.0, "rate_hz": 5.0, "stale_s": 0.6}
    return tables, liar


class Watch:
    """After each tick: where the others truly are, and what they do."""

    def __init__(self, mission: Mission, liar: int) -> None:
        self._mission, self._liar = mission, liar
        polygon = mission.fence.polygon_enu_m or ()
        self._polygon = tuple([(y, x) for x, y in polygon])
        self.nearest_m = math.inf
        self._touching: set[tuple[int, int]] = set()
        self.contacts = 0
        self.outside_m = self.led_s = self.led_off_m = 0.0
        self._led_s: dict[int, float] = {}
        self._covered_s: dict[int, float] = {}
        self.early: set[int] = set()
        self._spread: set[int] = set()
        self._lost: set[int] = set()
        self._fallen: set[int] = set()

    def __call__(self, flight: Flight) -> None:
        """See `fly.fly`."""
        places = {k: place for k, place in flight.world.positions().items() if k != self._liar}
        companions = flight.lockstep.companions
        self._lost |= places.keys() - companions.keys()
        self._check_pairs({k: p for k, p in places.items() if -p[2] > UP_M and k not in self._fallen})
        for k, place in places.items():
            companion = companions.get(k)
            if not isinstance(companion, InProcess):
                continue
            state = companion.endpoint.agent.flight.state
            if not flight.faults.happened:
                self._note_state(k, state)
                continue
            if state in STEERED and -place[2] > UP_M and k not in self._fallen:
                self._check_fence(place)
            self._note_state(k, state)
            lease = companion.endpoint.agent.swarm.election.lease
            led = lease is not None and lease.established and lease.leader == self._liar
            speed_mps = math.hypot(*flight.world.vehicles[k].airframe.state.vel_ned_mps)
            self._note_lead(k, place, led=led and state in STEERED and speed_mps > MOVES_MPS)

    def _check_pairs(self, up: dict[int, tuple[float, float, float]]) -> None:
        ids = sorted(up)
        touching: set[tuple[int, int]] = set()
        for i, a in enumerate(ids):
            for b in ids[i + 1 :]:
                apart_m = math.dist(up[a], up[b])
                self.nearest_m = min(self.nearest_m, apart_m)
                if apart_m < CONTACT_M:
                    touching.add((a, b))
                    self._fallen |= {a, b}  # from then on they fall, through every limit
        self.contacts += len(touching - self._touching)
        self._touching = touching

    def _check_fence(self, place: tuple[float, float, float]) -> None:
        fence, up_m = self._mission.fence, -place[2]
        out_m = max(fence.altitude_min_m - up_m, up_m - fence.altitude_max_m, 0.0)
        if self._polygon and not is_inside(place[0], place[1], self._polygon):
            out_m = max(out_m, min(math.hypot(edge[0], edge[1]) for edge in to_edges(place, self._polygon)))
        self.outside_m = max(self.outside_m, out_m)

    def _note_state(self, k: int, state: FlightState) -> None:
        if state is FlightState.COVERAGE:
            self._covered_s[k] = self._covered_s.get(k, 0.0) + TICK_S
            self._spread.add(k)
        covered_s = max(self._covered_s.values(), default=0.0)
        turns = state in (FlightState.LANDING, FlightState.LANDED, FlightState.RETURNING)
        if turns and covered_s < COVERED * self._mission.coverage.duration_s:
            self.early.add(k)

    def _note_lead(self, k: int, place: tuple[float, float, float], *, led: bool) -> None:
        self._led_s[k] = self._led_s.get(k, 0.0) + TICK_S if led else 0.0
        self.led_s = max(self.led_s, self._led_s[k])
        if led:
            d1, d2 = (enu_to_ned(p) for p in (self._mission.route.d1_enu_m, self._mission.route.d2_enu_m))
            way = (d2[0] - d1[0], d2[1] - d1[1])
            length2 = way[0] ** 2 + way[1] ** 2
            share = max(0.0, min(1.0, ((place[0] - d1[0]) * way[0] + (place[1] - d1[1]) * way[1]) / length2))
            off_m = math.hypot(place[0] - d1[0] - share * way[0], place[1] - d1[1] - share * way[1])
            self.led_off_m = max(self.led_off_m, off_m)

    @property
    def arrived(self) -> bool:
        """All that live, but for the liar."""
        ids = {k for k in range(1, self._mission.swarm.size + 1) if k != self._liar} - self._lost
        return ids <= self._spread


def fly_one(seed: int, lie: Lie) -> Flown:
    """One flight."""
    tables, liar = draw_tables(seed, lie)
    mission = Mission.model_validate(tables)
    watch = Watch(mission, liar)
    outcome = fly_stack(mission, None, on_jsbsim=False, watch=watch)
    return Flown(
        seed,
        lie.value,
        mission.swarm.size,
        watch.contacts,
        round(watch.nearest_m, 2),
        round(watch.outside_m, 2),
        len(watch.early),
        watch.arrived,
        round(watch.led_s, 1),
        round(watch.led_off_m, 1),
        outcome.ended,
    )


def row(lie: str, flown: Sequence[Flown]) -> str:
    """A row of the table."""
    count = len(flown)
    outside = sum(f.outside_m > GOOD_M for f in flown)
    return (
        f"| {lie} | {count} | {sum(f.contacts for f in flown)} | {spread([f.nearest_m for f in flown], '')} "
        f"| {outside}, worst {max(f.outside_m for f in flown):.2f} | {sum(f.early > 0 for f in flown)} "
        f"| {sum(f.arrived for f in flown)} | {spread([f.led_s for f in flown], '')} "
        f"| {max(f.led_off_m for f in flown):.1f} |"
    )


def main(argv: Sequence[str]) -> int:
    """Prints a row for each lie. Exit code 1: a contact, or a fence left by more than 0.1 m."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench insiders", description=__doc__)
    parser.add_argument("--flights", type=positive, default=20, metavar="N", help="of each lie (20)")
    parser.add_argument("--first-seed", type=as_seed, default=1, metavar="S", help="(1)")
    parser.add_argument("--lies", nargs="*", default=[lie.value for lie in Lie], metavar="LIE", help="(all)")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="a JSON line for each flight, too")
    args = parser.parse_args(argv)
    print(
        "| lie | flights | contacts | nearest, m | outside the fence: flights, m | landed or turned back early, flights"
        " | arrived, flights | behind the liar, s | off the line then, m |\n|---|---|---|---|---|---|---|---|---|"
    )
    all_flown: list[Flown] = []
    for name in args.lies:
        flown = [fly_one(seed, Lie(name)) for seed in range(args.first_seed, args.first_seed + args.flights)]
        print(row(name, flown), flush=True)
        all_flown += flown
        if args.rows is not None:
            with args.rows.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(asdict(f)) + "\n" for f in flown)
    print(row("all", all_flown))
    return int(any(f.contacts or f.outside_m > GOOD_M for f in all_flown))
