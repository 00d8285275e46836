"""End of the coverage of a mission that holds: its time is up, and the ring or sphere has formed."""

from __future__ import annotations

from typing import Final

import numpy as np

from mission.common.frames import enu_to_ned
from mission.document.model import CoverageShape, Mission
from mission.stand.stand import Stand
from sim_bridge.judge.metrics import GAP_WINDOW_S, ring_gap_deg, sphere_gap_deg, tolerance_m
from sim_bridge.judge.metrics.places import ideals_among_trees_deg
from sim_bridge.judge.tick import Tick
from sim_bridge.judge.verdict import FORMED_RATIO

INSTANT_S: Final = 0.01  # less than any tick, more than times are rounded by
FORMING_LIMIT_S: Final = 60.0  # after the time is up, or since a vehicle was lost or came back


class CoverageEnd:
    """Looks at every tick of coverage at d2. The time of a mission counts from when the leader arrived."""

    def __init__(self, mission: Mission, stand: Stand) -> None:
        self._mission, self._stand = mission, stand
        self._ideals_deg: list[float] = []
        self._since_s: float | None = None
        self._unformed_s = 0.0  # when it was not formed last
        self._alive: tuple[int, ...] = ()
        self._changed_s = 0.0  # when that was another set last

    def is_over(self, tick: Tick) -> bool:
        """True when it has been formed for GAP_WINDOW_S as the verdict asks, or does not form any more."""
        if self._since_s is None:
            self._since_s = self._unformed_s = tick.time_s
        if tick.alive != self._alive:
            self._alive, self._changed_s = tick.alive, tick.time_s
        duration_s = self._mission.coverage.duration_s
        over_s = tick.time_s - self._since_s - duration_s
        if over_s >= -GAP_WINDOW_S and not self._is_formed(tick):
            self._unformed_s = tick.time_s
        if tick.time_s - self._since_s < duration_s:
            return False
        if duration_s == 0.0:
            return True
        formed = (
            tick.time_s - self._unformed_s > min(GAP_WINDOW_S, duration_s) + INSTANT_S
        )  # the window's first tick, too
        return formed or min(over_s, tick.time_s - self._changed_s) >= FORMING_LIMIT_S

    def _is_formed(self, tick: Tick) -> bool:
        mission = self._mission
        up = [k - 1 for k in tick.alive if not tick.on_ground[k - 1]]
        if not up:
            return False
        from_d2_m = np.array([tick.pos_ned_m[k] for k in up]) - np.array(enu_to_ned(mission.route.d2_enu_m))
        is_ring = mission.coverage.shape is CoverageShape.RING
        radii_m = np.linalg.norm(from_d2_m[:, : 2 if is_ring else 3], axis=1)
        if np.abs(radii_m - mission.coverage.radius_m).max() > tolerance_m(mission):
            return False
        if not self._ideals_deg:
            self._ideals_deg = ideals_among_trees_deg(mission, self._stand, mission.swarm.size)
        gap_deg = ring_gap_deg(from_d2_m) if is_ring else sphere_gap_deg(from_d2_m)
        return gap_deg <= FORMED_RATIO * self._ideals_deg[len(tick.alive) - 1]
