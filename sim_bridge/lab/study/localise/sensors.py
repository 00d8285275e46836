"""Simulates what the vehicles of one flight measure and broadcast, from where they truly are.

Odometers count along the north of each vehicle's compass, with white noise and a bias. Ranges between two vehicles come
in turn, `range_hz` for each pair that is near enough; both learn of one, and one of them tells it in its next beacon.
Beacons carry the sender's odometer and the ranges that it measured since the last; what is lost is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from companion.core.agent import TICK_S
from sim_bridge.lab.study.law import Floats
from sim_bridge.lab.study.localise.paths import Paths

BEACON_TICKS = 2  # 10 Hz
FLIGHT_TICKS = 1  # of a beacon through the air


class Sensors(BaseModel):
    """True errors of the sensors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    velocity_mps: float = Field(default=0.1, ge=0.0, description="On each axis, white, new with every beacon.")
    bias_mps: float = Field(default=0.05, ge=0.0, description="On each axis.")
    bias_s: float = Field(default=20.0, gt=0.0)
    yaw_deg: float = Field(default=2.0, ge=0.0, description="Of each compass.")
    yaw_s: float = Field(default=300.0, gt=0.0)
    range_m: float = Field(default=0.1, ge=0.0)
    range_hz: float = Field(default=10.0, gt=0.0, le=20.0, description="Of each pair.")
    reach_m: float = Field(default=25.0, gt=0.0)
    loss: float = Field(default=0.1, ge=0.0, lt=1.0, description="Of ranges, and of beacons at each receiver.")
    nlos: float = Field(default=0.0, ge=0.0, lt=1.0, description="Share of ranges that come late.")
    nlos_m: tuple[float, float] = Field(default=(0.2, 1.2), description="By so much, even.")
    trunks: Literal["clear", "late", "cut"] = Field(
        default="clear", description="Ranges past a trunk: as others, all late by one draw, none."
    )
    bearing_hz: float = Field(default=0.0, ge=0.0, le=10.0)
    bearing_deg: float = Field(default=5.0, ge=0.0)
    start_m: float = Field(default=0.5, ge=0.0, description="On each axis: off the mission's position at the start.")


@dataclass(slots=True)
class Range:
    """Between rows `a` < `b`, measured at `tick`."""

    a: int
    b: int
    tick: int
    metres: float


@dataclass(slots=True)
class Broadcast:
    """A beacon of row `sender`, sent at `tick` and heard by these."""

    sender: int
    tick: int
    heard: list[bool]
    ranges: list[Range]


@dataclass(slots=True)
class Measured:
    """A whole flight. `odo_ne_m`, `vel_ne_mps`: (T, n, 2) as each vehicle's own odometry tells them, each tick."""

    odo_ne_m: Floats
    vel_ne_mps: Floats
    yaw_rad: Floats  # (T, n) true less told
    starts_ne_m: Floats  # (n, 2) as the mission has them
    ranges: list[list[Range]]  # by tick
    broadcasts: list[list[Broadcast]]  # by the tick of sending
    bearings: list[list[tuple[int, int, float]]]  # by tick: which sees which where, clockwise from its own north


def measure(paths: Paths, sensors: Sensors, rng: np.random.Generator) -> Measured:
    """Draws from `rng` alone."""
    ticks, n, _ = paths.pos_ne_m.shape
    yaw = _wander(rng, math.radians(sensors.yaw_deg), sensors.yaw_s, (ticks, n))
    bias = _wander(rng, sensors.bias_mps, sensors.bias_s, (ticks, n, 2))
    noise = np.repeat(rng.normal(0.0, sensors.velocity_mps, (ticks // BEACON_TICKS + 1, n, 2)), BEACON_TICKS, axis=0)
    c, s = np.cos(yaw), np.sin(yaw)
    north, east = paths.vel_ne_mps[..., 0], paths.vel_ne_mps[..., 1]
    vel = np.stack([c * north + s * east, -s * north + c * east], axis=-1) + bias + noise[:ticks]
    odo = np.concatenate([np.zeros((1, n, 2)), np.cumsum(vel, axis=0)[:-1] * TICK_S])
    positions = paths.pos_ne_m[0] + rng.normal(0.0, sensors.start_m, (n, 2))
    ranges = _ranges(paths, sensors, rng)
    return Measured(
        odo, vel, yaw, positions, ranges, _beacons(ranges, n, sensors, rng), _bearings(paths, yaw, sensors, rng)
    )


def _wander(rng: np.random.Generator, sd: float, memory_s: float, shape: tuple[int, ...]) -> Floats:
    """Ornstein-Uhlenbeck along the first axis."""
    keep = math.exp(-TICK_S / memory_s)
    out = rng.normal(0.0, sd, shape)
    for k in range(1, shape[0]):
        out[k] = keep * out[k - 1] + math.sqrt(1.0 - keep * keep) * out[k]
    return out


def _ranges(paths: Paths, sensors: Sensors, rng: np.random.Generator) -> list[list[Range]]:
    ticks, n, _ = paths.pos_ne_m.shape
    found: list[list[Range]] = [[] for _ in range(ticks)]
    every = round(1.0 / (sensors.range_hz * TICK_S))
    pairs = [(a, b) for a in range(n) for b in range(a + 1, n)]
    for turn, (a, b) in enumerate(pairs):
        at = np.arange(turn % every, ticks, every)
        true_m = np.hypot(*(paths.pos_ne_m[at, b] - paths.pos_ne_m[at, a]).T)
        blocked = paths.blocked[at, a, b]
        kept = (rng.random(len(at)) >= sensors.loss) & (true_m <= sensors.reach_m)
        late_m = np.where(rng.random(len(at)) < sensors.nlos, rng.uniform(*sensors.nlos_m, len(at)), 0.0)
        if sensors.trunks == "late":
            late_m = np.maximum(late_m, _by_trunk(blocked, sensors, rng))
        elif sensors.trunks == "cut":
            kept &= ~blocked
        metres = np.maximum(true_m + late_m + rng.normal(0.0, sensors.range_m, len(at)), 0.05)
        for k in np.flatnonzero(kept):
            found[at[k]].append(Range(a, b, int(at[k]), float(metres[k])))
    return found


def _by_trunk(blocked: Floats, sensors: Sensors, rng: np.random.Generator) -> Floats:
    """The same for as long as a trunk stands between."""
    begins = blocked & ~np.concatenate([[False], blocked[:-1]])
    draws = rng.uniform(*sensors.nlos_m, len(blocked))
    which = np.maximum.accumulate(np.where(begins, np.arange(len(blocked)), 0))
    return np.where(blocked, draws[which], 0.0)


def _beacons(ranges: list[list[Range]], n: int, sensors: Sensors, rng: np.random.Generator) -> list[list[Broadcast]]:
    """Of a pair, that vehicle tells whose turn it is: the lower if the ids' sum is even."""
    pending: list[list[Range]] = [[] for _ in range(n)]
    broadcasts: list[list[Broadcast]] = []
    for tick, new in enumerate(ranges):
        for one in new:
            pending[one.a if (one.a + one.b) % 2 == 0 else one.b].append(one)
        sent = []
        for sender in range(n):
            if tick % BEACON_TICKS == sender % BEACON_TICKS:
                heard = (rng.random(n) >= sensors.loss).tolist()
                sent.append(Broadcast(sender, tick, heard, pending[sender]))
                pending[sender] = []
        broadcasts.append(sent)
    return broadcasts


def _bearings(
    paths: Paths, yaw: Floats, sensors: Sensors, rng: np.random.Generator
) -> list[list[tuple[int, int, float]]]:
    ticks, n, _ = paths.pos_ne_m.shape
    found: list[list[tuple[int, int, float]]] = [[] for _ in range(ticks)]
    if sensors.bearing_hz == 0.0:
        return found
    every = round(1.0 / (sensors.bearing_hz * TICK_S))
    for tick in range(0, ticks, every):
        positions = paths.pos_ne_m[tick]
        rel = positions - positions[:, None]
        seen = np.arctan2(rel[..., 1], rel[..., 0]) - yaw[tick][:, None]
        seen += rng.normal(0.0, math.radians(sensors.bearing_deg), (n, n))
        near = (np.hypot(rel[..., 0], rel[..., 1]) <= sensors.reach_m) & ~paths.blocked[tick]
        found[tick] = [(a, b, float(seen[a, b])) for a in range(n) for b in range(n) if a != b and near[a, b]]
    return found
