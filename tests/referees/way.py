"""The way that whoever leads flies, in truth, beside which the shortest one is held."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.states import SwarmPhase
from mission.common.plane import Point
from mission.document.model import Mission
from sim_bridge.judge.tick import Tick

ESTIMATE_M: Final = 1.0  # by which a vehicle's estimate of its place may be wrong


class Way:
    """How far whoever leads has flown, level, until it has arrived. `look` at each tick."""

    def __init__(self, mission: Mission) -> None:
        self._d2 = mission.route.d2_enu_m
        self._near_m = mission.route.arrival_distance_m + ESTIMATE_M
        self._last = len(mission.visits) - 1
        self._was: Tick | None = None
        self._flown_m = 0.0
        self.way_m: float | None = None  # None: not arrived yet
        self.time_s: float | None = None  # that it took
        self._began_s = 0.0
        self.began: Point | None = None  # east, north of whoever led, when transit began
        self.ended: Point | None = None  # and on arrival

    def look(self, tick: Tick) -> None:
        """The next tick of the flight."""
        before, self._was = self._was, tick
        leader, phase = tick.leader(tick.alive), tick.phase(tick.alive)
        if self.way_m is not None or before is None or leader is None or phase < SwarmPhase.TRANSIT:
            return
        here = place(tick, leader)
        if self.began is None:
            self.began, self._began_s = place(before, leader), before.time_s
        self._flown_m += math.dist(here, place(before, leader))
        there = math.dist(here, self._d2[:2]) <= self._near_m
        if there and phase is SwarmPhase.COVERAGE and tick.stop(tick.alive) == self._last:
            self.way_m, self.time_s, self.ended = self._flown_m, tick.time_s - self._began_s, here

    def all_arrived(self, within_m: float) -> bool:
        """The leader has arrived, and at the end all are so near the last place, level."""
        last = self._was
        if self.way_m is None or last is None:
            return False
        return all(math.dist(place(last, k), self._d2[:2]) <= within_m for k in range(1, len(last.pos_ned_m) + 1))


def place(tick: Tick, vehicle_id: int) -> Point:
    """East, north of a vehicle."""
    north_m, east_m, _ = tick.pos_ned_m[vehicle_id - 1]
    return east_m, north_m
