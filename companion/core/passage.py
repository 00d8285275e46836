"""The way through what the obstacle sensor saw: from what a vehicle wishes to what it can fly, level.

Planned at 10 Hz (`planner`); the last stage verifies every setpoint once more (`safety`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.planner import Planner
from companion.core.safety import Bound, Envelope
from companion.core.scan_map import ObstacleMap
from companion.core.stopping import Points
from companion.core.types import Position
from mission.frames import Vec3
from mission.model import Sensing

PLAN_S: Final = 0.1
BEYOND_M: Final = 1.0  # points this far beyond the sensor's range still matter: they were seen on the way


@final
class Passage:
    """One vehicle's."""

    __slots__ = ("_course", "_planner", "_since_s", "_stale_s", "_stopping", "clear_m")

    def __init__(self, sensing: Sensing, envelope: Envelope) -> None:
        self.clear_m: Final = sensing.vehicle_radius_m + sensing.margin_m
        self._stale_s: Final = sensing.stale_s
        self._stopping: Final = envelope.stopping
        self._planner: Final = Planner(envelope.stopping)
        self._since_s = PLAN_S
        self._course: tuple[float, float] | None = None

    def rest(self) -> None:
        """Not steered."""
        self._planner.rest()
        self._since_s, self._course = PLAN_S, None

    def look(self, seen: ObstacleMap, own: Position, now_s: float) -> Points:
        """What stands about the vehicle, as far as scans saw. While they are stale, all is blind."""
        points = Points(seen.max_m - self.clear_m, seen.blind(now_s, fresh_s=self._stale_s))
        norths, easts = seen.near(own.pos_ned_m, seen.max_m + BEYOND_M)
        points.add(norths, easts, self.clear_m)
        return points

    def course(
        self,
        wish: Vec3,
        own: Position,
        last_ned_mps: Vec3,
        points: Points,
        bounds: Sequence[Bound],
        *,
        reach_m: float,
        dt_s: float,
    ) -> Vec3:
        """`wish` (NED m/s), turned and slowed so that it leads clear; rest where nothing is found to."""
        self._since_s += dt_s
        if self._since_s >= PLAN_S - 1e-9:
            self._since_s = 0.0
            vel = own.vel_ned_mps
            self._course = self._planner.plan(
                (wish[0], wish[1]),
                (vel[0], vel[1]),
                (last_ned_mps[0], last_ned_mps[1]),
                points,
                bounds,
                clear_m=self.clear_m,
                reach_m=reach_m,
                dt_s=PLAN_S,
            )
        course = self._course
        return (0.0, 0.0, wish[2]) if course is None else (course[0], course[1], wish[2])
