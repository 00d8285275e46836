"""A ring closes up after some of its vehicles fell silent for good: guidance and safety filter, velocities that lag."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass
from typing import Any

import pytest

from companion.core.guidance import formation
from companion.core.guidance.guidance_input import GuidanceInput
from companion.core.guidance.movement import STRANDED_S, Guidance
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, add, limit, norm, scale, sub
from companion.core.perception.obstacle_perception import OpenSkyPerception
from companion.core.safety.safety_filter import SafetyFilter
from companion.core.safety.surroundings import Surroundings
from mission.common.frames import Vec3
from mission.document.model import Mission
from tests.unit.core import core_kit

DT_S = 0.05
LAG_S = 0.4
ACCELERATION_MPS2 = 4.0
RANGE_M = 100.0
DOWN_M = -8.0


@dataclass
class Vehicle:
    guidance: Guidance
    safety_filter: SafetyFilter
    pos_ned_m: Vec3
    dies_s: float = math.inf
    vel_ned_mps: Vec3 = ZERO
    setpoint_ned_mps: Vec3 = ZERO


def setpoint_of(me: int, vehicles: list[Vehicle], mission: Mission, now_s: float) -> Vec3:
    own, neighbours, silent = vehicles[me], [], {}
    for k, other in enumerate(vehicles):
        rel = sub(other.pos_ned_m, own.pos_ned_m)
        if k != me and now_s >= other.dies_s:
            silent[k + 1] = PeerReport(k + 1, rel, now_s - other.dies_s, silent=True)
        elif k != me:
            flies: dict[str, Any] = {"state": FlightState.COVERAGE, "airborne": True, "vel_ned_mps": other.vel_ned_mps}
            neighbours.append(core_kit.neighbour(k + 1, rel, **flies))
    around = Surroundings(
        Position(own.pos_ned_m, own.vel_ned_mps),
        neighbours,
        silent,
        OpenSkyPerception(mission).observe_obstacles(own.pos_ned_m, own.pos_ned_m, silent, now_s),
        bias_ned_mps=ZERO,
        commanded_ned_mps=own.setpoint_ned_mps,
    )
    north, east, down = own.pos_ned_m
    desired = own.guidance.guide(
        GuidanceInput(
            around,
            state=FlightState.COVERAGE,
            phase=SwarmPhase.COVERAGE,
            route=formation.LEADER_ROUTE,
            range_m=RANGE_M,
            role=Role.FOLLOWER,
            governor=1.0,
            lease_freshness=1.0,
            goal=None,
            size=len(vehicles),
            dest_ned_m=(-north, -east, DOWN_M - down),
        ),
        dt_s=DT_S,
    )
    return own.safety_filter.apply(desired.vel_ned_mps, around, dt_s=DT_S).vel_ned_mps


def fly(vehicles: list[Vehicle], mission: Mission, *, seconds: float) -> float:
    """Moves them; the least distance of any two."""
    least_m = math.inf
    for tick in range(round(seconds / DT_S)):
        now_s = tick * DT_S
        for me, vehicle in enumerate(vehicles):
            alive = now_s < vehicle.dies_s
            vehicle.setpoint_ned_mps = setpoint_of(me, vehicles, mission, now_s) if alive else ZERO
        for vehicle in vehicles:
            lag = scale(sub(vehicle.setpoint_ned_mps, vehicle.vel_ned_mps), 1.0 / LAG_S)
            vehicle.vel_ned_mps = add(vehicle.vel_ned_mps, scale(limit(lag, ACCELERATION_MPS2), DT_S))
            vehicle.pos_ned_m = add(vehicle.pos_ned_m, scale(vehicle.vel_ned_mps, DT_S))
        pairs = itertools.combinations(vehicles, 2)
        least_m = min(least_m, *[norm(sub(a.pos_ned_m, b.pos_ned_m)) for a, b in pairs])
    return least_m


def draw_swarm(seed: int) -> tuple[list[Vehicle], Mission]:
    """3 to 8 vehicles, evenly on the ring or just arriving from one side; fewer than half of them die there."""
    rng = random.Random(seed)
    n = rng.randint(3, 8)
    radius_m = max(rng.choice([10.5, 15.0, 19.5]), 6.25 / (2.0 * math.sin(math.pi / n)))
    mission = core_kit.mission(coverage={"radius_m": radius_m}, swarm={"size": n})
    positions: list[Vec3] = []
    arrives = rng.random() < 0.5
    while len(positions) < n:
        if arrives:
            here = rng.uniform(-radius_m - 15.0, 3.0 - radius_m), rng.uniform(-15.0, 15.0), DOWN_M
        else:
            bearing = math.tau * len(positions) / n
            here = radius_m * math.cos(bearing), radius_m * math.sin(bearing), DOWN_M
        if not arrives or all(norm(sub(here, there)) > 7.0 for there in positions):
            positions.append(here)
    vehicles = [Vehicle(Guidance(mission, k), SafetyFilter.of(mission), here) for k, here in enumerate(positions, 1)]
    for vehicle in rng.sample(vehicles, rng.randint(1, (n - 1) // 2)):
        vehicle.dies_s = rng.uniform(0.0, 20.0 if arrives else 1.0)
    return vehicles, mission


@pytest.mark.parametrize("seed", range(12))
def test_ring_closes_up_about_those_that_hang_in_it(seed: int) -> None:
    vehicles, mission = draw_swarm(seed)
    least_m = fly(vehicles, mission, seconds=120.0)
    alive = [vehicle for vehicle in vehicles if vehicle.dies_s == math.inf]
    assert least_m >= mission.separation.hard_m
    radius_m = mission.coverage.radius_m
    off_m = [abs(math.hypot(*vehicle.pos_ned_m[:2]) - radius_m) for vehicle in alive]
    assert max(off_m) <= max(2.0, 0.1 * radius_m)
    bearings = sorted(math.atan2(vehicle.pos_ned_m[1], vehicle.pos_ned_m[0]) for vehicle in alive)
    gaps = [b - a for a, b in itertools.pairwise([*bearings, bearings[0] + math.tau])]
    assert max(gaps) <= 1.5 * math.tau / len(alive)


def test_one_that_is_silent_for_a_moment_keeps_its_rank() -> None:
    vehicles, mission = draw_swarm(0)
    n, radius_m = len(vehicles), mission.coverage.radius_m
    for k, vehicle in enumerate(vehicles):
        bearing = math.tau * k / n
        vehicle.pos_ned_m = radius_m * math.cos(bearing), radius_m * math.sin(bearing), DOWN_M
        vehicle.dies_s = 0.0 if k == 0 else math.inf
    before = [vehicle.pos_ned_m for vehicle in vehicles]
    fly(vehicles, mission, seconds=STRANDED_S - 1.0)
    assert max(norm(sub(v.pos_ned_m, there)) for v, there in zip(vehicles, before, strict=True)) < 0.3
