"""The way back of a leader that does not know where it is any more: its own way, by its own odometer.

What odometry has got wrong on the way out it mostly gets wrong alike on the way back (a compass wholly, a bias not),
and where a vehicle has flown nothing stands. Positions are NED m of the vehicle's own odometer.
"""

from __future__ import annotations

from typing import Final, final

from companion.core.model.breadcrumbs import BreadcrumbTrail
from mission.common.frames import Vec3

STEP_M: Final = 2.0  # between two positions, until there are too many
KEPT: Final = 512  # positions; then every second is forgotten, and steps are twice as long
AHEAD_M: Final = 12.0  # of the way back: beyond one that hangs on it
BESIDE_M: Final = 8.0  # as far off its way as another that hangs there may push it
AT_ONCE: Final = 8  # positions of the way back that one may be past at once
LOOP_M: Final = 4.0  # what comes as near as that again is a loop


@final
class Backtracking:
    """A vehicle's way since the swarm left d1, and its way back along it."""

    __slots__ = ("_trail", "has_turned")

    def __init__(self) -> None:
        self._trail = BreadcrumbTrail(STEP_M, KEPT, thins=True)
        self.has_turned = False  # it is on its way back

    def record_position(self, pos_ned_m: Vec3) -> None:
        """It is here, on its way out."""
        self._trail.append(pos_ned_m)

    def turn_back(self, pos_ned_m: Vec3) -> None:
        """From here on back, by where its way came nearest to here first: without the loops that it has flown."""
        self.has_turned = True
        self._trail.drop_loops(pos_ned_m, LOOP_M)

    def next_waypoint(self, pos_ned_m: Vec3) -> Vec3 | None:
        """The position to fly to now; None: it has kept none. What it has come back along is forgotten."""
        trail = self._trail
        # Of some positions the nearest: a vehicle cuts corners, and passes those that hang in its way.
        nearest = trail.nearest(pos_ned_m, AT_ONCE)
        if nearest is None:
            return None
        number, away_m = nearest
        if away_m <= max(BESIDE_M, trail.spacing_m):
            trail.drop(min(number + 1, trail.count - 1))
        return trail.crumb(min(trail.count_within(pos_ned_m, AHEAD_M), trail.count - 1))

    def left_m(self, pos_ned_m: Vec3) -> float:
        """The way that is left, to where it began."""
        return self._trail.length_m(pos_ned_m)
