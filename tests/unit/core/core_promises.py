"""What the safety filter promises (`SafetyFilter.apply`), checked on any input; and inputs of restless flights."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace

from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import ZERO, add, dot, norm, scale, sub
from companion.core.perception.obstacle_cloud import Trunk
from companion.core.safety.bounds import TOLERANCE_MPS
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from tests.unit.core.core_kit import mission, neighbour
from tests.unit.core.core_surroundings import applied, surroundings

Input = tuple[SafetyFilter, Sequence[Trunk], Vec3, Vec3, Position, Sequence[Neighbour], Sequence[Vec3], Vec3]

DT_S = 0.05
EPS = 1e-6
FILTER = SafetyFilter.of(mission())
POLYGONS = {
    "none": (),
    "square": ((-30.0, -30.0), (-30.0, 30.0), (30.0, 30.0), (30.0, -30.0)),
    "triangle": ((-20.0, -30.0), (-20.0, 30.0), (32.0, 0.0)),
    "hexagon": tuple((30 * math.cos(k * math.pi / 3), 30 * math.sin(k * math.pi / 3)) for k in range(6)),
    "L": ((-30.0, -30.0), (30.0, -30.0), (30.0, 0.0), (0.0, 0.0), (0.0, 30.0), (-30.0, 30.0)),
}


def broken_promises(
    safety_filter: SafetyFilter,
    trunks: Sequence[Trunk],
    wanted: Vec3,
    last: Vec3,
    own: Position,
    around: Sequence[Neighbour],
    silent: Sequence[Vec3],
    drift: Vec3,
    v: Vec3,
) -> list[str]:
    """Of the setpoint `v` that came of the rest; empty: all are kept."""
    broken = []
    if not all(map(math.isfinite, v)):
        return [f"not finite: {v}"]
    if norm(v) > safety_filter.speed_max_mps + EPS or abs(v[2]) > safety_filter.climb_max_mps + EPS:
        broken.append(f"too fast: {v}")
    if not all(map(math.isfinite, (*wanted, *own.pos_ned_m))):
        return broken if v == ZERO else [*broken, f"moves by what is not finite: {v}"]
    if norm(last) <= safety_filter.speed_max_mps and abs(last[2]) <= safety_filter.climb_max_mps:
        share = min(1.0, max(0.0, dot(v, last) / dot(last, last))) if norm(last) > 0.0 else 0.0
        if norm(sub(v, scale(last, share))) > safety_filter.acceleration_max_mps2 * DT_S + EPS:
            broken.append(f"steps from {last} to {v}")
    there = surroundings(own, around, silent, trunks=trunks)
    limits = [
        (b.along, b.most_mps - dot(b.along, drift)) for b in safety_filter.limits(own.pos_ned_m, there.cloud.trunks)
    ]
    for along, most_mps in limits:
        if dot(v, along) > max(0.0, most_mps) + TOLERANCE_MPS + EPS:
            broken.append(f"limit {along}, {most_mps}: {v}")
    bounds = replace(safety_filter, senses=False).separations(there)
    apart = [(b.along, b.most_mps - dot(b.along, drift)) for b in bounds]
    pushed = any(most_mps < 0.0 for _, most_mps in limits)
    for along, most_mps in apart:
        if not pushed and dot(v, along) > max(0.0, most_mps) + TOLERANCE_MPS + EPS:
            broken.append(f"separation {along}, {most_mps}: {v}")
    return broken


def restless_inputs(rng: random.Random, count: int) -> Iterator[tuple[Input, Vec3]]:
    """Inputs along flights whose wishes, neighbours and ghosts change at random, each with what came of it."""
    last: Vec3 = ZERO
    for k in range(count):
        if k % 200 == 0:
            polygon = rng.choice(list(POLYGONS.values()))
            upright = rng.random() < 0.5
            trunks = (Trunk((rng.uniform(-30, 30), rng.uniform(-30, 30), -10.0), 2.0, upright=upright),)
            safety_filter = replace(FILTER, polygon_m=polygon, hard_separation_m=rng.uniform(1.0, 8.0))
            pos, last = (rng.uniform(-29, 29), rng.uniform(-29, 29), -rng.uniform(1, 31)), ZERO
            others = [tuple(rng.uniform(-12, 12) for _ in range(3)) for _ in range(rng.randrange(7))]
        if k % 20 == 0:
            wish = tuple(rng.uniform(-8, 8) for _ in range(3))
            drift = tuple(rng.uniform(-0.5, 0.5) for _ in range(3))
        around = [
            neighbour(
                i + 2,
                tuple(x + rng.gauss(0, 0.3) for x in rel),  # type: ignore[arg-type]
                vel_ned_mps=tuple(rng.uniform(-5, 5) for _ in range(3)),
                age_s=rng.uniform(0, 0.5),
            )
            for i, rel in enumerate(others)
        ]
        silent = [tuple(rng.uniform(-10, 10) for _ in range(3))] if rng.random() < 0.3 else []
        own = Position(pos, add(last, tuple(rng.gauss(0, 0.3) for _ in range(3))))  # type: ignore[arg-type]
        given = (safety_filter, trunks, wish, last, own, around, silent, drift)
        last = applied(safety_filter, wish, last, own, around, silent, dt_s=DT_S, drift=drift, trunks=trunks)  # type: ignore[arg-type]
        yield given, last  # type: ignore[misc]
        pos = add(pos, scale(last, DT_S))
        others = [sub(rel, scale(last, DT_S)) for rel in others]  # type: ignore[arg-type]


def any_inputs(rng: random.Random, count: int) -> Iterator[tuple[Input, Vec3]]:
    """Inputs of anything at all, each by itself: huge, tiny, on a limit, not finite."""

    def number(most: float) -> float:
        pick = rng.random()
        if pick < 0.02:
            return rng.choice([math.nan, math.inf, -math.inf, 1e300, -1e300])
        if pick < 0.2:
            return rng.choice([0.0, 1e-9, -1e-9, 2.0, 5.0, 5.3, -5.3, 30.0, -30.0])
        return rng.uniform(-most, most) if pick < 0.7 else rng.uniform(-12.0, 12.0)

    def vector(most: float) -> Vec3:
        return (number(most), number(most), number(most))

    for _ in range(count):
        safety_filter, upright = replace(FILTER, polygon_m=rng.choice(list(POLYGONS.values()))), rng.random() < 0.5
        place = (rng.uniform(-40, 40), rng.uniform(-40, 40), rng.uniform(-40, 40))
        trunks = (Trunk(place, 2.0, upright=upright),)
        wish, last, own = vector(1e4), tuple(rng.uniform(-4, 4) for _ in range(3)), Position(vector(5e4), vector(100.0))
        last = (last[0], last[1], max(-1.5, min(1.5, last[2])))
        around = [neighbour(i + 2, vector(5e4), vel_ned_mps=vector(100.0), age_s=rng.random()) for i in range(4)]
        around, silent = around[: rng.randrange(5)], [vector(100.0) for _ in range(rng.randrange(3))]
        drift = tuple(rng.uniform(-0.5, 0.5) for _ in range(3))
        given = (safety_filter, trunks, wish, last, own, around, silent, drift)
        v = applied(safety_filter, wish, last, own, around, silent, dt_s=DT_S, drift=drift, trunks=trunks)  # type: ignore[arg-type]
        yield given, v  # type: ignore[misc]
