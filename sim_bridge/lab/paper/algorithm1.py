"""Algorithm 1 of the paper, line by line, over B flights at once. Simulation only: it cannot fly (docs/paper.md).

The numbers in the comments are the lines of the algorithm, its two comments not counted (docs/paper.md). Where the
print cannot be meant, `Params` has the choice: its defaults are the reading (`Params()`), `LITERAL` is the print.
A step is one pass of the loop over all UAVs, and takes dt_s; the paper's Table I counts steps as seconds. ENU metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

import numpy as np
from pydantic import Field

from mission.document.model import Mission
from mission.schema.fields import Number
from sim_bridge.judge.metrics import CONTACT_M
from sim_bridge.lab.paper import khopca
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Bools, Floats
from sim_bridge.lab.study.point_mass import STRAIGHT_TIMES, Figures, is_connected

GAIN = 0.2  # 21, 26
GONE = 10.0  # routes away from d2: a flight with a UAV beyond has failed


class Election(StrEnum):
    """Election: the UAV that gets Weight(u) = leaderID."""

    PRINTED = "printed"  # lines 4-18, once a step
    UNNESTED = "unnested"  # its rules one after the other instead of inside one another, once a step
    KHOPCA = "khopca"  # the rules that lines 4-18 are taken from, once a step
    LEASE = "lease"  # our election's result: the lowest id leads


class Update(StrEnum):
    """Time at which the others see a UAV's new velocity and position."""

    IN_PLACE = "in-place"  # one UAV after the other, as the loop of line 1
    PARALLEL = "parallel"  # all at once, as real vehicles


class Arrival(StrEnum):
    """Arrival: what has to be within 5 m of d2. The paper: "the swarm"."""

    LEADER = "leader"
    CENTROID = "centroid"  # the mean position
    ALL = "all"


class Params(law.Params):
    """The choices. The paper leaves open: dt_s, start_radius_m, arrival_of, and how to read lines 20 to 27."""

    election: Annotated[Election, Field(description="How the leader is found.")] = Election.LEASE
    update: Annotated[Update, Field(description="When the others see a UAV's new state.")] = Update.IN_PLACE
    centre_is_mean: Annotated[bool, Field(strict=True, description="20: a mean; printed: a sum.")] = True
    separation_m: Annotated[Number, Field(ge=0.0, le=1e3, description="22: fitted (docs/paper.md); printed: 100.")] = (
        0.75
    )
    separate_from_all: Annotated[
        bool, Field(strict=True, description="22: from each such neighbour; printed: from one.")
    ] = True
    alignment_is_mean: Annotated[bool, Field(strict=True, description="25: a mean; printed: 1/(|N|-1).")] = True
    speed_is_limited: Annotated[bool, Field(strict=True, description="35: to vel_leader; printed: never.")] = True
    arrival_is_distance: Annotated[bool, Field(strict=True, description="29: |diff| < 5; printed: diff < 5.")] = True
    arrival_of: Annotated[Arrival, Field(description="What has to arrive; the flight goes on until then.")] = (
        Arrival.LEADER
    )
    start_radius_m: Annotated[
        Number, Field(ge=0.0, le=1e3, description="UAVs start evenly distributed in a ball about d1.")
    ] = 2.0
    dt_s: Annotated[Number, Field(gt=0.0, le=10.0, description="36: how long a step moves.")] = 1.0


LITERAL = {
    "election": "printed",
    "centre_is_mean": False,
    "separation_m": 100.0,
    "separate_from_all": False,
    "alignment_is_mean": False,
    "speed_is_limited": False,
    "arrival_is_distance": False,
}


def fly(mission: Mission, seeds: Sequence[int], params: Params) -> list[Figures]:
    """One flight for each seed: from the start until the swarm is gathered at d2, or time is up."""
    swarm = Swarm(mission, seeds, params)
    limit_s = STRAIGHT_TIMES * mission.route.length_m / mission.route.vel_leader_mps
    with np.errstate(invalid="ignore", divide="ignore"):  # the print divides by zero; such a flight is over
        while not swarm.over.all() and swarm.steps * params.dt_s < limit_s:
            swarm.run_pass()
    return [swarm.figures(b) for b in range(len(seeds))]


def starts(mission: Mission, seeds: Sequence[int], radius_m: float) -> Floats:
    """(B, n, 3) evenly distributed in the ball of `radius_m` about d1."""
    flights = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 0xA160])
        direction = rng.normal(size=(mission.swarm.size, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        reach = radius_m * rng.random((mission.swarm.size, 1)) ** (1.0 / 3.0)
        flights.append(np.array(mission.route.d1_enu_m) + reach * direction)
    return np.array(flights)


class Swarm:
    """A batch of flights. `run_pass` is one pass of Algorithm 1's loop."""

    def __init__(self, mission: Mission, seeds: Sequence[int], params: Params) -> None:
        self.mission = mission
        self.params = params
        self.steps = 0
        self.pos_enu_m = np.asfortranarray(starts(mission, seeds, params.start_radius_m))
        self.vel_enu_mps = np.zeros_like(self.pos_enu_m)
        flights, n, _ = self.pos_enu_m.shape
        self.weight = np.array(
            [khopca.initial_weights(n, np.random.default_rng([seed, 0xE1EC])) for seed in seeds],
            dtype=np.int64,
            order="F",
        )
        if params.election is Election.LEASE:
            self.weight[:] = khopca.WEIGHT_LIMIT
            self.weight[:, 0] = khopca.LEADER_ID
        self.over = np.zeros(flights, dtype=np.bool_)
        self._d2 = np.array(mission.route.d2_enu_m)
        self._diagonal = np.eye(n, dtype=np.bool_)
        self._leader_step = np.full(flights, -1)
        self._last_step = np.full(flights, -1)
        self._least_m = np.full(flights, np.inf)
        self._contacts = np.zeros(flights, dtype=np.intp)
        self._touching = np.zeros((flights, n, n), dtype=np.bool_)
        self._flown_steps = np.zeros(flights, dtype=np.intp)
        self._connected_steps = np.zeros(flights, dtype=np.intp)
        self._leaders_max = np.zeros(flights, dtype=np.intp)
        self._leader_changes = np.zeros(flights, dtype=np.intp)
        self._note()

    def run_pass(self) -> None:
        """Lines 1 to 37."""
        seen_pos, seen_vel, seen_weight = self.pos_enu_m, self.vel_enu_mps, self.weight
        pos, vel = np.array(seen_pos, order="F"), np.array(seen_vel, order="F")
        weight = np.array(seen_weight, order="F")
        if self.params.update is Update.IN_PLACE:
            seen_pos, seen_vel, seen_weight = pos, vel, weight
        for u in range(pos.shape[1]):
            apart = seen_pos - seen_pos[:, u, None]
            distance_m = np.sqrt((apart * apart).sum(axis=2))
            near = distance_m <= self.mission.radio.full_range_m  # 3: FindDirectNeighbors
            near[:, u] = False
            match self.params.election:  # 4-18
                case Election.PRINTED:
                    weight[:, u] = khopca.printed(seen_weight, near, u)
                case Election.UNNESTED:
                    weight[:, u] = khopca.unnested(seen_weight, near, u)
                case Election.KHOPCA:
                    weight[:, u] = khopca.clean(seen_weight, near, u)
                case Election.LEASE:
                    pass
            leads = weight[:, u] == khopca.LEADER_ID
            vel[:, u] = self._velocity(u, seen_pos, seen_vel, near, distance_m, leads)
            pos[:, u] += vel[:, u] * self.params.dt_s  # 36: Move
        # A flight that is over stays as it is: its figures do not depend on how long others of the batch take.
        gone = self.over[:, None]
        self.pos_enu_m = np.where(gone[:, :, None], self.pos_enu_m, pos)
        self.vel_enu_mps = np.where(gone[:, :, None], self.vel_enu_mps, vel)
        before, self.weight = self.weight, np.where(gone, self.weight, weight)
        self.steps += 1
        self._count_leaders(before)
        self._note()

    def _velocity(self, u: int, pos: Floats, vel: Floats, near: Bools, distance_m: Floats, leads: Bools) -> Floats:
        """(B, 3) Vel(u): lines 20 to 35."""
        params, count = self.params, near.sum(axis=1)[:, None]
        here, some = pos[:, u], count > 0
        centre = np.where(near[:, :, None], pos, 0.0).sum(axis=1)  # 20
        cohesion = (centre / np.maximum(count, 1) - here if params.centre_is_mean else centre - here) * GAIN  # 21
        close = near & (distance_m < params.separation_m)  # 22
        if not params.separate_from_all:
            close &= close.cumsum(axis=1) == 1
        separation = np.where(close[:, :, None], here[:, None] - pos, 0.0).sum(axis=1)  # 23
        total = np.where(near[:, :, None], vel, 0.0).sum(axis=1)  # 25
        divisor = np.maximum(count, 1) if params.alignment_is_mean else count - 1
        alignment = (total / divisor - vel[:, u]) * GAIN  # 25, 26
        if params.centre_is_mean:
            cohesion = np.where(some, cohesion, 0.0)
            alignment = np.where(some, alignment, 0.0)
        diff = self._d2 - here  # 28
        norm = np.sqrt((diff * diff).sum(axis=1, keepdims=True))
        stop_m = self.mission.route.arrival_distance_m
        there = norm < stop_m if params.arrival_is_distance else (diff < stop_m).all(axis=1, keepdims=True)  # 29
        cruise = diff / np.maximum(norm, 1e-9) * self.mission.route.vel_leader_mps  # 32
        pull = np.where(leads[:, None] & ~there, cruise, 0.0)  # 27, 30
        v = vel[:, u] + (cohesion + separation + alignment + pull)  # 35
        if params.speed_is_limited:
            most = self.mission.route.vel_leader_mps
            v = v * (most / np.maximum(np.sqrt((v * v).sum(axis=1, keepdims=True)), most))
        return np.asarray(v)

    # --- figures ---

    def _count_leaders(self, before: khopca.Ints) -> None:
        leads, led = self.weight == khopca.LEADER_ID, before == khopca.LEADER_ID
        self._leaders_max = np.maximum(self._leaders_max, leads.sum(axis=1))
        first, first_before = leads.argmax(axis=1), led.argmax(axis=1)
        self._leader_changes += leads.any(axis=1) & led.any(axis=1) & (first != first_before)

    def _note(self) -> None:
        flying = ~self.over
        apart = self.pos_enu_m[:, None] - self.pos_enu_m[:, :, None]
        distance_m = np.sqrt((apart * apart).sum(axis=3))
        distance_m[:, self._diagonal] = np.inf
        self._least_m = np.where(flying, np.minimum(self._least_m, distance_m.min(axis=(1, 2))), self._least_m)
        touching = distance_m < CONTACT_M
        self._contacts += np.where(flying, (touching & ~self._touching).sum(axis=(1, 2)) // 2, 0)
        self._touching = touching
        range_m = self.mission.radio.full_range_m
        connected = is_connected(distance_m <= range_m)
        self._flown_steps += flying
        self._connected_steps += flying & connected
        diff = self.pos_enu_m - self._d2
        to_d2_m = np.sqrt((diff * diff).sum(axis=2))
        there = flying & self._there(diff, to_d2_m < self.mission.route.arrival_distance_m)
        self._leader_step[there & (self._leader_step < 0)] = self.steps
        gathered = flying & connected & (to_d2_m <= range_m).all(axis=1) & (self._leader_step >= 0)
        self._last_step[gathered] = self.steps
        # Not a number, after a division by zero, is not within either.
        self.over |= gathered | ~(to_d2_m <= GONE * self.mission.route.length_m).all(axis=1)

    def _there(self, diff: Floats, within: Bools) -> Bools:
        """(B,) arrived; `diff` (B, n, 3) from d2, `within` (B, n) the arrival distance."""
        match self.params.arrival_of:
            case Arrival.LEADER:
                return np.asarray(((self.weight == khopca.LEADER_ID) & within).any(axis=1))
            case Arrival.CENTROID:
                centroid = diff.mean(axis=1)
                return np.asarray(np.sqrt((centroid * centroid).sum(axis=1)) < self.mission.route.arrival_distance_m)
            case Arrival.ALL:
                return np.asarray(within.all(axis=1))

    def figures(self, b: int) -> Figures:
        """Of flight b."""
        route, dt_s = self.mission.route, self.params.dt_s
        straight_s = (route.length_m - route.arrival_distance_m) / route.vel_leader_mps
        leader_s, last_s = (
            float(step) * dt_s if step >= 0 else None for step in (self._leader_step[b], self._last_step[b])
        )
        least_m = float(self._least_m[b])
        return Figures(
            arrived=last_s is not None,
            straight_time_s=straight_s,
            arrival_leader_s=leader_s,
            arrival_last_s=last_s,
            overhead_leader=None if leader_s is None else leader_s / straight_s - 1.0,
            overhead_last=None if last_s is None else last_s / straight_s - 1.0,
            min_separation_m=least_m if np.isfinite(least_m) else None,
            contacts=int(self._contacts[b]),
            connected_fraction_transit=float(self._connected_steps[b] / self._flown_steps[b]),
            acting_leaders_max=int(self._leaders_max[b]),
            leader_changes=int(self._leader_changes[b]),
        )
