"""What holds in every tick of every flight, whatever happens in it; contacts, fence and leaders are the verdict's."""

from __future__ import annotations

import math
from typing import Final

from mission.document.model import Mission
from sim_bridge.judge.tick import Tick

OVER_SHARE: Final = 1.02  # of a limit: setpoints travel as 32-bit floats
OVER_MPS: Final = 0.02


class Setpoints:
    """Looks at what companions ask of their autopilots: finite velocities within the mission's limits."""

    def __init__(self, mission: Mission) -> None:
        self.violation = ""  # the first one
        self._speed_mps = OVER_SHARE * mission.limits.speed_max_mps + OVER_MPS
        self._climb_mps = OVER_SHARE * mission.limits.climb_max_mps + OVER_MPS

    def check_tick(self, tick: Tick) -> None:
        """At every tick, in the order of time."""
        if self.violation:
            return
        for vehicle_id, asked_ned_mps in enumerate(tick.asked_ned_mps, start=1):
            if asked_ned_mps is None:
                continue
            finite = all(math.isfinite(value) for value in asked_ned_mps)
            fast = math.hypot(*asked_ned_mps) > self._speed_mps or abs(asked_ned_mps[2]) > self._climb_mps
            if not finite or fast:
                asked = ", ".join([f"{value:.2f}" for value in asked_ned_mps])
                self.violation = f"setpoint of vehicle {vehicle_id} at {tick.time_s:.2f} s: {asked} m/s (NED)"
                return
