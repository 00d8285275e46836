"""Vehicles as the safety filter sees them: velocity lags the setpoint, beacons come ten a second and late."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

from companion.core.localisation.peer_table import PeerTable
from companion.core.model.events import Position
from companion.core.model.states import FlightState
from companion.core.model.vectors import ZERO, add, scale, sub
from companion.core.model.velocity_bias import VelocityBias
from companion.core.perception.obstacle_cloud import Trunk, trunks_of
from companion.core.safety.safety_filter import SafetyFilter
from mission.common.frames import Vec3
from tests.unit.core.core_kit import heard_beacon, mission
from tests.unit.core.core_surroundings import applied

DT_S = 0.05
TRUNKS = trunks_of(mission())
LAG_S = 0.3  # of the velocity behind its setpoint
DELAY_TICKS = 2  # of a setpoint, and of a beacon: 100 ms

Wish = Callable[[Vec3, float], Vec3]  # position, time -> wanted velocity


class Plant:
    """One vehicle and its safety filter. `bias_ned_mps`: what its estimator adds to its true velocity."""

    def __init__(
        self,
        safety_filter: SafetyFilter,
        start_ned_m: Vec3,
        wish: Wish,
        *,
        bias_ned_mps: Vec3 = ZERO,
        trunks: Sequence[Trunk] = TRUNKS,
    ) -> None:
        self.pos_ned_m, self.vel_ned_mps, self.setpoint = start_ned_m, ZERO, ZERO
        self._filter, self._wish, self._bias = safety_filter, wish, bias_ned_mps
        self._trunks = trunks
        self._drift = VelocityBias()
        self.hears = FlightState.TRANSIT  # what the others are said to do
        self._peers = PeerTable(size=8)
        self._under_way: deque[Vec3] = deque([ZERO] * DELAY_TICKS)

    @property
    def told_ned_mps(self) -> Vec3:
        """As the estimator has it."""
        return add(self.vel_ned_mps, self._bias)

    def hear(self, sender: int, pos_ned_m: Vec3, vel_ned_mps: Vec3, time_s: float, now_s: float) -> None:
        """A beacon sent at `time_s`."""
        rel = sub(pos_ned_m, self.pos_ned_m)
        said = heard_beacon(
            sender, time_ms=round(time_s * 1e3), rel_ned_m=rel, vel_ned_mps=vel_ned_mps, airborne=True, state=self.hears
        )
        self._peers.store_beacon(said, self.pos_ned_m, now_s)

    def step(self, now_s: float) -> None:
        self._drift.update(self.pos_ned_m, self.told_ned_mps, now_s)
        silent = self._peers.silent_airborne(self.pos_ned_m, now_s, range_m=55.0)
        self.setpoint = applied(
            self._filter,
            self._wish(self.pos_ned_m, now_s),
            self.setpoint,
            Position(self.pos_ned_m, add(self.told_ned_mps, self._drift.ned_mps)),
            self._peers.neighbours(self.pos_ned_m, now_s),
            [sighting.rel_ned_m for sighting in silent.values()],
            dt_s=DT_S,
            trunks=self._trunks,
            drift=self._drift.ned_mps,
        )
        self._under_way.append(self.setpoint)
        wanted = sub(self._under_way.popleft(), self._bias)
        self.vel_ned_mps = add(self.vel_ned_mps, scale(sub(wanted, self.vel_ned_mps), DT_S / LAG_S))
        self.pos_ned_m = add(self.pos_ned_m, scale(self.vel_ned_mps, DT_S))


def fly(plants: Sequence[Plant], seconds: float, *, after: Callable[[], None] = lambda: None) -> float:
    """The least distance between any two. `after` is called each tick."""
    least_m = math.inf
    under_way: deque[tuple[int, int, Vec3, Vec3]] = deque()
    for tick in range(round(seconds / DT_S)):
        now_s = tick * DT_S
        if tick % 2 == 0:
            under_way += [(tick, k, p.pos_ned_m, p.told_ned_mps) for k, p in enumerate(plants, start=1)]
        while under_way and under_way[0][0] <= tick - DELAY_TICKS:
            sent, sender, pos, vel = under_way.popleft()
            for k, plant in enumerate(plants, start=1):
                if k != sender:
                    plant.hear(sender, pos, vel, sent * DT_S, now_s)
        for plant in plants:
            plant.step(now_s)
        for k, plant in enumerate(plants):
            least_m = min([least_m, *(math.dist(plant.pos_ned_m, other.pos_ned_m) for other in plants[:k])])
        after()
    return least_m


def towards(velocity: Vec3) -> Wish:
    return lambda _pos, _now: velocity
