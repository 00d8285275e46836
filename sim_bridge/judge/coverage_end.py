"""End of the coverage of a mission that holds: its time is up, and the ring or sphere has formed."""

from __future__ import annotations

import numpy as np

from mission.common.forming import FORMED_RATIO, FormingTime
from mission.common.frames import enu_to_ned
from mission.document.model import CoverageShape, Mission
from mission.stand.stand import Stand
from sim_bridge.judge.metrics import ring_gap_deg, sphere_gap_deg, tolerance_m
from sim_bridge.judge.metrics.places import ideals_among_trees_deg
from sim_bridge.judge.tick import Tick


class CoverageEnd:
    """Looks at every tick of coverage at d2. The time of a mission counts from when the leader arrived."""

    def __init__(self, mission: Mission, stand: Stand) -> None:
        self._mission, self._stand = mission, stand
        self._ideals_deg: list[float] = []
        self._time: FormingTime | None = None
        self._alive: tuple[int, ...] = ()
        self._changed_s = 0.0  # when that was another set last

    def is_over(self, tick: Tick) -> bool:
        """True when it has been formed for GAP_WINDOW_S as the verdict asks, or does not form any more."""
        if self._time is None:
            self._time = FormingTime(self._mission.coverage.duration_s, tick.time_s)
        if tick.alive != self._alive:
            self._alive, self._changed_s = tick.alive, tick.time_s
        if self._time.is_near_end(tick.time_s) and not self._is_formed(tick):
            self._time.note_unformed(tick.time_s)
        return self._time.is_over(tick.time_s, changed_s=self._changed_s)

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
