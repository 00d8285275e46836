"""The task of every simulator: eight quadrotors, from the air, 130 m to positions at d2 at 3 m/s by velocity setpoints.

Each simulator has an environment of its own: this imports nothing but the standard library. Steered at 20 Hz, as our
agents steer. A line on standard input asks for so many simulated seconds, its answer is a line of JSON with the
processor time; the end of the input ends the flight, and the last answer tells where the vehicles are.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Sequence
from typing import Protocol

N = 8
RING_M = 8.0  # about d1, 6 m apart
ALTITUDE_M = 8.0
D2_M = 130.0  # east of d1
SPEED_MPS = 3.0
STEER_HZ = 20
NEAR_M = 1.0  # of its place, where a vehicle has arrived
SLOW_PER_S = 1.0  # m/s for each metre that is left

Vec = tuple[float, float, float]


class Simulator(Protocol):
    """Eight vehicles, ENU metres."""

    def positions(self) -> Sequence[Sequence[float]]: ...

    def step(self, velocities_mps: Sequence[Vec]) -> None:
        """1 / STEER_HZ seconds with these velocity setpoints."""


def starts() -> list[Vec]:
    """Where the vehicles are at first."""
    turns = [math.tau * k / N for k in range(N)]
    return [(RING_M * math.cos(turn), RING_M * math.sin(turn), ALTITUDE_M) for turn in turns]


def setpoint(here: Sequence[float], place: Vec) -> Vec:
    """Straight to its place, m/s."""
    way = [float(there) - float(own) for there, own in zip(place, here, strict=True)]
    left_m = math.hypot(*way)
    if left_m == 0.0:
        return (0.0, 0.0, 0.0)
    speed = min(SPEED_MPS, SLOW_PER_S * left_m) / left_m
    return (way[0] * speed, way[1] * speed, way[2] * speed)


def fly_course(simulator: Simulator, **about: object) -> None:
    """Fly as asked. `about`: what to tell of the simulator at first."""
    places = [(x + D2_M, y, z) for x, y, z in starts()]
    answer(**about)
    for line in sys.stdin:
        steps = round(float(line) * STEER_HZ)
        began_s, began_wall_s = time.process_time(), time.perf_counter()
        for _ in range(steps):
            here = simulator.positions()
            simulator.step([setpoint(own, place) for own, place in zip(here, places, strict=True)])
        cpu_s, wall_s = time.process_time() - began_s, time.perf_counter() - began_wall_s
        answer(vehicle_s=N * steps / STEER_HZ, cpu_s=cpu_s, wall_s=wall_s)
    left_m = [math.dist(map(float, own), place) for own, place in zip(simulator.positions(), places, strict=True)]
    answer(ended="flown", arrived=max(left_m) < NEAR_M, left_m=max(left_m))


def answer(**figures: object) -> None:
    """One line of JSON."""
    print(json.dumps(figures), flush=True)
