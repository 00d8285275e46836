"""Records the figures of one flight through a forest: every tick, from the truth alone."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mission.document.model import Mission
from sim_bridge.judge.metrics import gathered_within_m
from sim_bridge.lab.study.forest.air import MODELS
from sim_bridge.lab.study.law import Bools, Floats
from sim_bridge.lab.study.point_mass import is_connected
from sim_bridge.world.contacts import Touched


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one flight; those of `metrics.Metrics` are named and defined as there. None: there was nothing to measure.

    A vehicle that touches a trunk, a crown or the ground is lost: its radio is silent, and it counts no more.
    """

    arrived: bool  # gathered at d2, and no vehicle was lost
    alone_s: float  # T0: one vehicle of the same law without trees, gusts and errors, from departure to arrival
    straight_time_s: float | None
    arrival_leader_s: float | None
    arrival_last_s: float | None
    overhead_leader: float | None
    overhead_last: float | None
    over_alone_leader: float | None  # arrival over alone_s - 1
    over_alone_last: float | None
    contacts: int  # all kinds
    contacts_trunks: int
    contacts_vehicles: int
    contacts_crowns: int
    contacts_ground: int
    lost: int
    min_separation_m: float | None
    trunk_clearance_min_m: float | None  # from a vehicle's centre to the surface of a trunk
    connected_fraction_transit: float | None  # under the mission's own radio model
    connected_disc: float | None  # under each model, of the same flight
    connected_attenuated: float | None
    connected_cut: float | None
    longest_gap_s: float | None  # for how long at most the swarm was in parts, under the mission's model
    speed_mean_transit_mps: float | None  # level, over all vehicles, from departure until the leader arrives
    speed_max_mps: float | None
    acceleration_mean_mps2: float | None
    acting_leaders_max: int
    leader_changes: int
    coverage_gap_deg: float | None
    coverage_gap_ideal_deg: float | None
    sim_time_s: float
    vehicle_s: float

    def as_dict(self) -> dict[str, Any]:
        """Name -> value."""
        return asdict(self)


class FlightRecorder:
    """Looks at every tick of one flight."""

    def __init__(self, mission: Mission, n: int, dt_s: float) -> None:
        self._mission, self._dt_s, self._model = mission, dt_s, mission.sim.radio_trunks.value
        self._d1, self._d2 = np.array(mission.route.d1_enu_m), np.array(mission.route.d2_enu_m)
        self.alive: Bools = np.ones(n, dtype=np.bool_)
        self.departed_s: float | None = None
        self.leader_s: float | None = None
        self.last_s: float | None = None
        self.straight_s: float | None = None
        self.contacts = {"trunk": 0, "crown": 0, "vehicle": 0, "ground": 0}
        self.least_m = self.clearance_m = math.inf
        self.acting_max = self.changes = 0
        self._leader: int | None = None
        self._gathered_m = math.inf
        self._touching = np.zeros((n, n), dtype=np.bool_)
        self._looks = 0  # beacon periods in transit
        self._connected = dict.fromkeys(MODELS, 0)
        self._gap_s = self._gap_longest_s = 0.0
        self._speed_sum = self._speed_max = self._change_sum = 0.0
        self._moving = self._transit = 0  # ticks

    @property
    def in_transit(self) -> bool:
        """On the way to d2, until all are there."""
        return self.departed_s is not None and self.last_s is None

    def record_leader(
        self, leader: int | None, acting: int, *, departed: bool, pos_enu_m: Floats, now_s: float
    ) -> None:
        """Records who leads in this tick, and whether the swarm is under way."""
        if leader is not None:
            self.changes += self._leader not in (None, leader)
            self._leader = leader
        if self.departed_s is None and departed and leader is not None:
            self.departed_s = now_s
            route = self._mission.route
            way_m = float(np.linalg.norm(self._d2 - pos_enu_m[leader])) - route.arrival_distance_m
            self.straight_s = max(0.0, way_m) / route.vel_leader_mps
            width_m = float(np.linalg.norm(pos_enu_m - self._d1, axis=1)[self.alive].max())
            self._gathered_m = float(gathered_within_m(self._mission, width_m))
        if self.departed_s is not None:
            self.acting_max = max(self.acting_max, acting)

    def record_contacts(
        self, touched: dict[int, Touched], clearance_m: Floats, distance_m: Floats, steered: Bools
    ) -> None:
        """Records what vehicles touch in this tick, by row: they are lost. Those that are `steered` (n,) count.

        `clearance_m`: (n,) from each one's centre to the surface of the nearest trunk.
        """
        flies = self.alive & steered
        if not flies.any():
            return
        self.clearance_m = min(self.clearance_m, float(clearance_m[flies].min()))
        apart_m = np.where(flies[:, None] & flies, distance_m, np.inf)
        self.least_m = min(self.least_m, float(apart_m.min()))
        touching = apart_m < 2.0 * self._mission.vehicle_radius_m
        self.contacts["vehicle"] += int((touching & ~self._touching).sum()) // 2
        self._touching = touching
        for row, what in touched.items():
            self.contacts[what.value] += 1
            self.alive[row] = False

    def record_motion(self, vel_enu_mps: Floats, change_mps: Floats) -> None:
        """Adds this tick's velocities, (n, 3), and the amounts of their change, (n,)."""
        if not self.in_transit:
            return
        self._transit += 1
        self._change_sum += float(change_mps[self.alive].mean()) if self.alive.any() else 0.0
        if self.leader_s is None and self.alive.any():
            speeds = np.hypot(vel_enu_mps[self.alive, 0], vel_enu_mps[self.alive, 1])
            self._moving += 1
            self._speed_sum += float(speeds.mean())
            self._speed_max = max(self._speed_max, float(speeds.max()))

    def record_links(self, links: dict[str, Bools], pos_enu_m: Floats, period_s: float, now_s: float) -> None:
        """Every beacon period: which vehicles hear each other under each model, and whether they are there."""
        if not self.in_transit or not self.alive.any():
            return
        rows = np.flatnonzero(self.alive)
        whole = {model: bool(is_connected(linked[np.ix_(rows, rows)][None])[0]) for model, linked in links.items()}
        self._looks += 1
        for model, is_whole in whole.items():
            self._connected[model] += is_whole
        self._gap_s = 0.0 if whole[self._model] else self._gap_s + period_s
        self._gap_longest_s = max(self._gap_longest_s, self._gap_s)
        to_d2_m = np.linalg.norm(pos_enu_m - self._d2, axis=1)
        assert self.departed_s is not None
        near_m = self._mission.route.arrival_distance_m
        leader = self._leader
        if self.leader_s is None and leader is not None and self.alive[leader] and to_d2_m[leader] <= near_m:
            self.leader_s = now_s - self.departed_s
        if self.leader_s is not None and whole[self._model] and to_d2_m[rows].max() <= self._gathered_m:
            self.last_s = now_s - self.departed_s

    def figures(self, alone_s: float, now_s: float, gap: tuple[float | None, float | None]) -> Figures:
        """At the end; `gap`: of coverage, and the ideal one."""

        def over(arrival_s: float | None, by_s: float | None) -> float | None:
            return arrival_s / by_s - 1.0 if arrival_s is not None and by_s else None

        def share(count: float, of: int) -> float | None:
            return count / of if of else None

        n = len(self.alive)
        return Figures(
            arrived=self.last_s is not None and bool(self.alive.all()),
            alone_s=alone_s,
            straight_time_s=self.straight_s,
            arrival_leader_s=self.leader_s,
            arrival_last_s=self.last_s,
            overhead_leader=over(self.leader_s, self.straight_s),
            overhead_last=over(self.last_s, self.straight_s),
            over_alone_leader=over(self.leader_s, alone_s),
            over_alone_last=over(self.last_s, alone_s),
            contacts=sum(self.contacts.values()),
            contacts_trunks=self.contacts["trunk"],
            contacts_vehicles=self.contacts["vehicle"],
            contacts_crowns=self.contacts["crown"],
            contacts_ground=self.contacts["ground"],
            lost=n - int(self.alive.sum()),
            min_separation_m=self.least_m if math.isfinite(self.least_m) else None,
            trunk_clearance_min_m=self.clearance_m if math.isfinite(self.clearance_m) else None,
            connected_fraction_transit=share(self._connected[self._model], self._looks),
            connected_disc=share(self._connected["disc"], self._looks),
            connected_attenuated=share(self._connected["attenuated"], self._looks),
            connected_cut=share(self._connected["cut"], self._looks),
            longest_gap_s=round(self._gap_longest_s, 6) if self._looks else None,
            speed_mean_transit_mps=share(self._speed_sum, self._moving),
            speed_max_mps=self._speed_max if self._moving else None,
            acceleration_mean_mps2=share(self._change_sum / self._dt_s, self._transit),
            acting_leaders_max=self.acting_max,
            leader_changes=self.changes,
            coverage_gap_deg=gap[0],
            coverage_gap_ideal_deg=gap[1],
            sim_time_s=now_s,
            vehicle_s=now_s * n,
        )
