"""B flights of n point masses at once: for laws, where a hundred seeds must cost seconds.

Each flight begins as the simulator's do: at rest at the height of d1, on the places that its seed draws. The swarm
gathers around the leader, vehicle 1; when all have been slow for a moment it departs to d2, and the flight is over
when it is gathered there. Beacons and control at `radio.beacon_rate_hz`, heard one period late, within
`radio.transit_range_m`; no loss, no wind, no trees, no coverage: flights with those have agents (backend "agents").
The body is `airframe.PointMass`'s: first-order lag of 0.3 s, at most 3 m/s^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from companion.core.guidance.movement import GATHER_MPS
from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import DWELL_S, GATHER_LIMIT_S, Phases
from companion.core.vehicle.flight import SETTLED_MPS
from mission.common.frames import Vec3, ned_to_enu
from mission.document.model import Mission
from sim_bridge.judge.metrics import gathered_within_m
from sim_bridge.lab.study.law import Bools, Floats, Law, View
from sim_bridge.world.world import spawn_points

LAG_S = 0.3  # as airframe.PointMass
ACCELERATION_MAX_MPS2 = 3.0
STRAIGHT_TIMES = 3.0  # a flight that takes longer than so many straight times has failed


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one flight, named and defined as in `metrics.Metrics`; the last one is of point masses only."""

    arrived: bool
    straight_time_s: float
    arrival_leader_s: float | None
    arrival_last_s: float | None
    overhead_leader: float | None
    overhead_last: float | None
    min_separation_m: float | None
    contacts: int
    connected_fraction_transit: float | None
    acting_leaders_max: int
    leader_changes: int
    acceleration_mean_mps2: float | None = None  # what the flight costs in effort: in transit, over all vehicles

    def as_dict(self) -> dict[str, Any]:
        """Name -> value."""
        return asdict(self)


def starts(mission: Mission, seeds: Sequence[int]) -> Floats:
    """(B, n, 3) ENU m: where each flight begins, as `world.World` places them, at the height of d1."""
    d1_up_m = mission.route.d1_enu_m[2]
    starts_ned_m = [spawn_points(mission, np.random.default_rng([seed, 0x5BA3])) for seed in seeds]
    return np.array([[(*ned_to_enu(p)[:2], d1_up_m) for p in flight] for flight in starts_ned_m])


def fly(mission: Mission, seeds: Sequence[int], law: Law) -> list[Figures]:
    """One flight for each seed, all with the same mission and law (made for as many flights).

    With two seeds or more, a flight's figures do not depend on the others, to the bit.
    """
    swarm = Swarm(mission, starts(mission, seeds))
    while not swarm.over:
        swarm.tick(law)
    return swarm.figures()


class Swarm:
    """The state of a batch. `tick` until `over`."""

    def __init__(self, mission: Mission, pos_enu_m: Floats) -> None:
        flights, n, _ = pos_enu_m.shape
        self.mission = mission
        self.dt_s = 1.0 / mission.radio.beacon_rate_hz
        # Flights innermost in memory, here and in all that is made of it: several times as fast, and sums over vehicles
        # then run in the order of their ids, however many flights there are (from two on).
        self.pos_enu_m = pos_enu_m = np.asfortranarray(pos_enu_m)
        self.vel_enu_mps = np.zeros_like(pos_enu_m)
        self.ticks = 0
        self.departed_tick = np.full(flights, -1)
        self.leader_tick = np.full(flights, -1)
        self.last_tick = np.full(flights, -1)
        self.straight_s = np.zeros(flights)
        self.gathered_m = np.zeros(flights)  # see metrics.gathered_within_m
        self.over_flight = np.zeros(flights, dtype=np.bool_)
        self._leads = np.zeros((flights, n), dtype=np.bool_)
        self._leads[:, 0] = True  # the lease goes to the lowest id where all batteries are alike
        self._routes = [mission] * flights  # whose route each flight's leader flies
        (d1, self._d1_stop_m), (d2, self._d2_stop_m) = _goals(mission)
        self._d1, self._d2 = np.tile(d1, (flights, 1)), np.tile(d2, (flights, 1))
        self._sent_from = pos_enu_m
        self._sent_pos, self._sent_vel = self._reported()
        self._diagonal = np.eye(n, dtype=np.bool_)
        self._settled = np.zeros(flights, dtype=np.intp)
        self._least_m = np.full(flights, np.inf)
        self._contacts = np.zeros(flights, dtype=np.intp)
        self._touching = np.zeros((flights, n, n), dtype=np.bool_)
        self._transit_ticks = np.zeros(flights, dtype=np.intp)
        self._connected_ticks = np.zeros(flights, dtype=np.intp)
        self._transit = np.zeros(flights, dtype=np.bool_)  # now
        self._change_mps = np.zeros(flights)  # of a vehicle's velocity in all of transit, mean over vehicles
        limit_s = GATHER_LIMIT_S + STRAIGHT_TIMES * mission.route.length_m / mission.route.vel_leader_mps
        self._limit_ticks = round(limit_s / self.dt_s)

    @property
    def over(self) -> bool:
        """Every flight has ended."""
        return bool(self.over_flight.all())

    def tick(self, law: Law) -> None:
        """One beacon period."""
        distance_m = self._distances()
        self._note(distance_m)
        pos, vel = self._reported()
        command = law.velocity(self._view(pos, vel))
        self._sent_from, self._sent_pos, self._sent_vel = self.pos_enu_m, pos, vel
        self._move(command)
        self.ticks += 1

    def _reported(self) -> tuple[Floats, Floats]:
        """Position and velocity as each vehicle's autopilot reports them: here, the truth."""
        return self.pos_enu_m, self.vel_enu_mps

    def _view(self, pos_enu_m: Floats, vel_enu_mps: Floats) -> View:
        rel = self._sent_pos[:, None, :, :] - pos_enu_m[:, :, None, :]
        distance_m = np.sqrt((rel * rel).sum(axis=3))
        distance_m[:, self._diagonal] = np.inf
        sent = self._sent_from[:, None, :, :] - self._sent_from[:, :, None, :]
        range_m = self.mission.radio.transit_range_m
        heard = ((sent * sent).sum(axis=3) <= range_m * range_m) & ~self._diagonal
        departed = self.departed_tick >= 0
        goal = np.where(departed[:, None], self._d2, self._d1)
        cruise = self.mission.route.vel_leader_mps
        return View(
            dt_s=self.dt_s,
            pos_enu_m=pos_enu_m,
            vel_enu_mps=vel_enu_mps,
            rel_enu_m=rel,
            distance_m=distance_m,
            heard=heard,
            vel_heard_enu_mps=self._sent_vel,
            leads=self._leads,
            routes=self._routes,
            departed=departed,
            to_goal_enu_m=goal - pos_enu_m[:, 0],
            stop_m=np.where(departed, self._d2_stop_m, self._d1_stop_m),
            cruise_mps=np.where(departed, cruise, min(cruise, GATHER_MPS)),
        )

    def _move(self, command: Floats) -> None:
        fraction = -math.expm1(-self.dt_s / LAG_S)
        change = fraction * (command - self.vel_enu_mps)
        most_mps = ACCELERATION_MAX_MPS2 * self.dt_s
        size = np.sqrt((change * change).sum(axis=2, keepdims=True))
        change = change * (most_mps / np.maximum(size, most_mps))
        size = np.sqrt((change * change).sum(axis=2))
        self._change_mps += np.where(self._transit, size.sum(axis=1) / size.shape[1], 0.0)
        self.pos_enu_m = np.asfortranarray(self.pos_enu_m + (self.vel_enu_mps + 0.5 * change) * self.dt_s)
        self.vel_enu_mps = np.asfortranarray(self.vel_enu_mps + change)

    def _distances(self) -> Floats:
        """(B, n, n), inf on the diagonal."""
        rel = self.pos_enu_m[:, None, :, :] - self.pos_enu_m[:, :, None, :]
        distance_m: Floats = np.sqrt((rel * rel).sum(axis=3))
        distance_m[:, self._diagonal] = np.inf
        return distance_m

    # --- figures ---

    def _note(self, distance_m: Floats) -> None:
        flying = ~self.over_flight
        range_m = self.mission.radio.transit_range_m
        least_m = distance_m.min(axis=(1, 2))
        self._least_m = np.where(flying, np.minimum(self._least_m, least_m), self._least_m)
        touching = distance_m < 2.0 * self.mission.vehicle_radius_m
        if touching.any() or self._touching.any():
            new = (touching & ~self._touching).sum(axis=(1, 2)) // 2
            self._contacts += np.where(flying, new, 0)
            self._touching = touching
        connected = is_connected(distance_m <= range_m)
        self._depart(connected)
        self._transit = transit = flying & (self.departed_tick >= 0) & (self.last_tick < 0)
        self._transit_ticks += transit
        self._connected_ticks += transit & connected
        to_d2 = self.pos_enu_m - self._d2[:, None]
        to_d2_m = np.sqrt((to_d2 * to_d2).sum(axis=2))
        there = transit & (to_d2_m[:, 0] <= self.mission.route.arrival_distance_m)
        self.leader_tick[there & (self.leader_tick < 0)] = self.ticks
        gathered = connected & (to_d2_m.max(axis=1) <= self.gathered_m) & (self.leader_tick >= 0)
        self.last_tick[gathered & (self.last_tick < 0)] = self.ticks
        self.over_flight |= (self.last_tick >= 0) | (self.ticks >= self._limit_ticks)

    def _depart(self, connected: Bools) -> None:
        speed2 = (self.vel_enu_mps * self.vel_enu_mps).sum(axis=2).max(axis=1)
        from_d1 = self.pos_enu_m[:, 0] - self._d1
        at_d1 = (from_d1 * from_d1).sum(axis=1) <= self.mission.route.arrival_distance_m**2
        self._settled = np.where((speed2 < SETTLED_MPS**2) & at_d1 & connected, self._settled + 1, 0)
        ready = self._settled > round(DWELL_S / self.dt_s)
        ready |= self.ticks * self.dt_s >= GATHER_LIMIT_S
        leaving = ready & (self.departed_tick < 0)
        if leaving.any():
            route = self.mission.route
            to_d2 = self._d2 - self.pos_enu_m[:, 0]
            way_m = np.sqrt((to_d2 * to_d2).sum(axis=1)) - route.arrival_distance_m
            self.departed_tick[leaving] = self.ticks
            self.straight_s[leaving] = way_m[leaving] / route.vel_leader_mps
            from_d1 = self.pos_enu_m - self._d1[:, None]
            width_m = np.sqrt((from_d1 * from_d1).sum(axis=2)).max(axis=1)
            self.gathered_m[leaving] = gathered_within_m(self.mission, width_m)[leaving]

    def figures(self) -> list[Figures]:
        """Of every flight, in order."""
        return [self._figures(b) for b in range(len(self.over_flight))]

    def _figures(self, b: int) -> Figures:
        straight_s = float(self.straight_s[b])
        departed = int(self.departed_tick[b])
        leader_s, last_s = (
            float(tick - departed) * self.dt_s if tick >= 0 else None
            for tick in (int(self.leader_tick[b]), int(self.last_tick[b]))
        )
        ticks = int(self._transit_ticks[b])
        return Figures(
            arrived=last_s is not None,
            straight_time_s=straight_s,
            arrival_leader_s=leader_s,
            arrival_last_s=last_s,
            overhead_leader=None if leader_s is None else leader_s / straight_s - 1.0,
            overhead_last=None if last_s is None else last_s / straight_s - 1.0,
            min_separation_m=float(self._least_m[b]) if math.isfinite(self._least_m[b]) else None,
            contacts=int(self._contacts[b]),
            connected_fraction_transit=int(self._connected_ticks[b]) / ticks if ticks else None,
            acting_leaders_max=1,
            leader_changes=0,
            acceleration_mean_mps2=float(self._change_mps[b]) / (ticks * self.dt_s) if ticks else None,
        )


def _goals(mission: Mission) -> list[tuple[Vec3, float]]:
    """The leader's goals, ENU m, and how far before each it stops: to gather, then in transit."""
    phases, found = Phases(mission), []
    for phase in (SwarmPhase.GATHER, SwarmPhase.TRANSIT):
        phases.adopt_phase(phase, 0.0)
        goal = phases.goal()
        assert goal is not None
        found.append((ned_to_enu(goal[0]), goal[1]))
    return found


def is_connected(adjacency: Bools) -> Bools:
    """(B,) whether each graph (B, n, n) is one component."""
    if adjacency[:, 0, 1:].all():  # everyone hears the first: the usual case
        return np.ones(len(adjacency), dtype=np.bool_)
    reached = np.zeros(adjacency.shape[:2], dtype=np.bool_)
    reached[:, 0] = True
    for _ in range(adjacency.shape[1]):
        more = np.asarray(reached | (adjacency & reached[:, :, None]).any(axis=1), dtype=np.bool_)
        if (more == reached).all():
            break
        reached = more
    return np.asarray(reached.all(axis=1))
