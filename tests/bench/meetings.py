"""Two and three vehicles that meet at one gap between rows of trunks: `python -m tests.bench meetings`.

Planner and safety filter as they fly, on point masses with a lag; each hears the others and sees the trunks within
8 m. Each keeps to a course of its own: from both sides, from one side, or both; whether it leads or follows is drawn.
"""

from __future__ import annotations

import argparse
import math
import random
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.sensing_planner import SensingPlanner
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, norm, scale, sub
from companion.core.perception.obstacle_cloud import LocalObstacleCloud
from companion.core.perception.obstacle_memory import ObstacleMemory
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.options.search import as_seed
from sim_bridge.options.study import positive
from tests.bench.table import spread
from tests.unit.core.core_kit import beacon, mission

TICK_S, LAG_S, RANGE_M, CLEAR_M = 0.05, 0.3, 8.0, 0.65
TRUNK_M, STEP_M, ROW_M = 0.2, 0.75, 60.0  # radius; from axis to axis; length of each row
WIDE_M, DEEP_M = (2.4, 3.5), (0.0, 6.0)  # of the gap, from bark to bark, and along it
SLANT_RAD = math.radians(40.0)  # of the rows: a funnel on both sides
START_M, ASIDE_M = (6.0, 16.0), 5.0  # from the gap, and of its axis at most
APART_M = 6.0  # at the start, at least
BEYOND_M = 6.0  # the gap: it is through
CRUISE_MPS = 3.0
LIMIT_S, LONG_S = 120.0, 20.0
BLOCKED_M = 1.0  # of progress: less for LONG_S is a deadlock
KINDS = {
    "from both sides": (1, -1),
    "side by side": (1, 1),
    "two meet one": (1, 1, -1),
    "three side by side": (1, 1, 1),
}


@dataclass(frozen=True, slots=True)
class Met:
    """One encounter."""

    through_s: float | None  # all; None: not within LIMIT_S
    stood_s: float  # the longest time in which one that was not through came no BLOCKED_M nearer
    least_m: float  # apart
    bark_m: float  # of an axis to bark


class Vehicle:
    """One: `way` 1 flies north, -1 south."""

    def __init__(self, flown: Mission, id_: int, pos: Vec3, way: int, *, leads: bool) -> None:
        assert flown.sensing is not None
        self.id, self.pos, self.vel, self.last, self.way, self.leads = id_, pos, ZERO, ZERO, way, leads
        self.filter, self.memory = SafetyFilter.of(flown), ObstacleMemory()
        self.planner = SensingPlanner(flown, flown.sensing, self.filter)
        self.through_s: float | None = None
        self.best_m, self.best_s, self.stood_s = -math.inf, 0.0, 0.0

    def look(self, trunks: Sequence[tuple[float, float]], now_s: float) -> LocalObstacleCloud:
        """What it sees."""
        norths, easts = [], []
        for n, e in trunks:
            to_n, to_e = n - self.pos[0], e - self.pos[1]
            away_m = math.hypot(to_n, to_e)
            if away_m < RANGE_M:
                share = 1.0 - TRUNK_M / away_m
                norths.append(share * to_n)
                easts.append(share * to_e)
        self.memory.note_points(norths, easts, self.pos, [False] * 72, RANGE_M, now_s)
        seen = self.memory.seen_before(self.pos, CLEAR_M)
        cloud = LocalObstacleCloud(7.35, [False] * 72, sensor_m=RANGE_M, seen_before=seen)
        cloud.add_points(norths, easts, CLEAR_M)
        return cloud

    def command(self, others: Sequence[Neighbour], trunks: Sequence[tuple[float, float]], now_s: float) -> None:
        """A tick of its companion."""
        around = Surroundings(
            Position(self.pos, self.vel), others, {}, self.look(trunks, now_s), commanded_ned_mps=self.last
        )
        now = GuidanceInput(
            around,
            state=FlightState.TRANSIT,
            phase=SwarmPhase.TRANSIT,
            route=formation.LEADER_ROUTE,
            range_m=30.0,
            role=Role.LEADER if self.leads else Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=3,
        )
        course = self.course
        if self.leads:
            _, desired = self.planner.plan_leader(now, course, scale(course, 100.0), 0.0)
        else:
            desired = add(course, self.planner.separate(now, course))
        planned = self.planner.plan(now, desired, TICK_S)
        self.last = self.filter.apply(planned, around, dt_s=TICK_S).vel_ned_mps

    @property
    def course(self) -> Vec3:
        """That it keeps to."""
        return (CRUISE_MPS * self.way, 0.0, 0.0)

    def move(self, now_s: float, deep_m: float) -> None:
        """A tick of its airframe."""
        self.vel = add(self.vel, scale(sub(self.last, self.vel), -math.expm1(-TICK_S / LAG_S)))
        self.pos = add(self.pos, scale(self.vel, TICK_S))
        gained_m = self.way * self.pos[0]
        if gained_m > self.best_m + BLOCKED_M or self.through_s is not None:
            self.best_m, self.best_s = gained_m, now_s
        self.stood_s = max(self.stood_s, now_s - self.best_s)
        if self.through_s is None and gained_m > deep_m / 2.0 + BEYOND_M:
            self.through_s = now_s


def trunks_about(wide_m: float, deep_m: float) -> list[tuple[float, float]]:
    """Rows of trunks with a gap at the middle, north and east."""
    half_m = wide_m / 2.0 + TRUNK_M
    trunks = []
    for east in (-1, 1):
        trunks += [(-deep_m / 2.0 + STEP_M * k, east * half_m) for k in range(1 + int(deep_m / STEP_M))]
        for side in (-1, 1):
            for k in range(1, int(ROW_M / STEP_M)):
                along_m = STEP_M * k
                trunks.append(
                    (
                        side * (deep_m / 2.0 + along_m * math.sin(SLANT_RAD)),
                        east * (half_m + along_m * math.cos(SLANT_RAD)),
                    )
                )
    return trunks


def meet(seed: int, *, kind: str) -> Met:
    """One encounter."""
    rng = random.Random(seed)
    wide_m, deep_m = rng.uniform(*WIDE_M), rng.choice(DEEP_M)
    trunks = trunks_about(wide_m, deep_m)
    flown = mission(sensing={"range_m": RANGE_M})
    vehicles: list[Vehicle] = []
    ids = rng.sample(range(1, 9), len(KINDS[kind]))
    leading = [rng.random() < 0.5 for _ in ids]
    for k, way in enumerate(KINDS[kind]):
        while True:
            pos = (-way * (deep_m / 2.0 + rng.uniform(*START_M)), rng.uniform(-ASIDE_M, ASIDE_M), -8.0)
            is_clear = all(math.hypot(pos[0] - n, pos[1] - e) > 1.2 for n, e in trunks)
            if is_clear and all(math.dist(pos, other.pos) > APART_M for other in vehicles):
                break
        vehicles.append(Vehicle(flown, ids[k], pos, way, leads=leading[k]))
    now_s, least_m, bark_m = 10.0, math.inf, math.inf
    end_s = now_s + LIMIT_S
    while now_s < end_s and any(vehicle.through_s is None for vehicle in vehicles):
        now_s += TICK_S
        heard = {
            vehicle.id: [_heard(other, vehicle) for other in vehicles if other is not vehicle] for vehicle in vehicles
        }
        for vehicle in vehicles:
            vehicle.command(heard[vehicle.id], trunks, now_s)
        for vehicle in vehicles:
            vehicle.move(now_s, deep_m)
            bark_m = min([bark_m, *[math.hypot(n - vehicle.pos[0], e - vehicle.pos[1]) - TRUNK_M for n, e in trunks]])
        least_m = min([least_m, *[math.dist(a.pos, b.pos) for a in vehicles for b in vehicles if a is not b]])
    through = [vehicle.through_s for vehicle in vehicles]
    done = [s for s in through if s is not None]
    stood_s = max(vehicle.stood_s for vehicle in vehicles)
    return Met(max(done) - 10.0 if len(done) == len(through) else None, stood_s, least_m, bark_m)


def _heard(other: Vehicle, by: Vehicle) -> Neighbour:
    rel = sub(other.pos, by.pos)
    said = beacon(other.id, state=FlightState.TRANSIT, airborne=True, vel_ned_mps=other.vel, ref_ned_mps=other.course)
    return Neighbour(said, rel, None, 0.0, other.vel, norm(rel))


def main(argv: Sequence[str]) -> int:
    """Prints a row for each kind."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench meetings", description=__doc__)
    parser.add_argument("--runs", type=positive, default=30, metavar="N", help="of each kind (30)")
    parser.add_argument("--first-seed", type=as_seed, default=7000, metavar="S", help="(7000)")
    parser.add_argument("--jobs", type=positive, default=1, metavar="N", help="at once (1)")
    args = parser.parse_args(argv)
    print(
        "| encounter | runs | all through | after | longest without 1 m of progress | above 20 s | apart, m | bark, m |"
    )
    print("|---" * 8 + "|")
    for kind in KINDS:
        with ProcessPoolExecutor(args.jobs) as pool:
            met = list(pool.map(partial(meet, kind=kind), range(args.first_seed, args.first_seed + args.runs)))
        through = [one.through_s for one in met if one.through_s is not None]
        stood = [one.stood_s for one in met]
        after = spread(through, " s") if through else "never"
        print(
            f"| {kind} | {len(met)} | {len(through)} | {after} | {spread(stood, ' s')} | "
            f"{sum(s > LONG_S for s in stood)} | {min(one.least_m for one in met):.2f} | "
            f"{min(one.bark_m for one in met):.2f} |",
            flush=True,
        )
    return 0
