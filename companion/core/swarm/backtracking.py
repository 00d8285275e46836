"""The way back of a leader that does not know where it is any more: its own way, by its own odometer.

What odometry has got wrong on the way out it mostly gets wrong alike on the way back (a compass wholly, a bias not),
and where a vehicle has flown nothing stands. Positions are NED m of the vehicle's own odometer.
"""

from __future__ import annotations

from typing import Final, final

from companion.core.model.vectors import norm, sub
from mission.common.frames import Vec3

STEP_M: Final = 2.0  # between two places, until there are too many
KEPT: Final = 512  # places; then every second is forgotten, and steps are twice as long
AHEAD_M: Final = 12.0  # of the way back: beyond one that hangs on it
BESIDE_M: Final = 8.0  # as far off its way as another that hangs there may push it
AT_ONCE: Final = 8  # places of the way back that one may be past at once
LOOP_M: Final = 4.0  # what comes as near as that again is a loop


@final
class Track:
    """Where a vehicle has been since the swarm left d1, newest last."""

    __slots__ = ("_places", "_step_m", "turned")

    def __init__(self) -> None:
        self._places: list[Vec3] = []
        self._step_m = STEP_M
        self.turned = False  # it is on its way back

    def note(self, pos_ned_m: Vec3) -> None:
        """It is here, on its way out."""
        if self._places and norm(sub(pos_ned_m, self._places[-1])) < self._step_m:
            return
        self._places.append(pos_ned_m)
        if len(self._places) > KEPT:
            del self._places[1::2]
            self._step_m *= 2.0

    def turn(self, pos_ned_m: Vec3) -> None:
        """From here on back, by where its way came nearest to here first: without the loops that it has flown."""
        self.turned = True
        off_m = [norm(sub(place, pos_ned_m)) for place in self._places]
        for k, metres in enumerate(off_m):
            if metres <= min(off_m) + LOOP_M:
                del self._places[k + 1 :]
                return

    def back(self, pos_ned_m: Vec3) -> Vec3 | None:
        """Where to fly now; None: it has kept no places. What it has come back along is forgotten."""
        places = self._places
        # Of some places the nearest: a vehicle cuts corners, and passes those that hang in its way.
        off_m = [norm(sub(pos_ned_m, place)) for place in places[-AT_ONCE:]]
        if off_m and min(off_m) <= max(BESIDE_M, self._step_m):
            nearest = len(places) - len(off_m) + off_m.index(min(off_m))
            del places[max(1, nearest) :]
        if not places:
            return None
        k, way_m = len(places) - 1, norm(sub(pos_ned_m, places[-1]))
        while k > 0 and way_m < AHEAD_M:
            way_m += norm(sub(places[k], places[k - 1]))
            k -= 1
        return places[k]

    def left_m(self, pos_ned_m: Vec3) -> float:
        """The way that is left, to where it began."""
        places = self._places
        total_m = norm(sub(pos_ned_m, places[-1])) if places else 0.0
        for k in range(1, len(places)):
            total_m += norm(sub(places[k], places[k - 1]))
        return total_m
