"""Rest of a vehicle that sees nothing new: it brakes, and then holds the place at which it came to rest.

Zero velocity alone is no rest: reported velocities are wrong by 0.25 m/s rms for seconds, and who holds them drifts by
metres while it is blind. Reported positions wander by 0.3 m. Without GNSS both are odometry, and drift alike: such a
vehicle only brakes well (search, seed 35000: in 10 s from 1.2 m off into a trunk).
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3

STANDS_MPS: Final = 0.3  # from then on the place counts,
BRAKES_S: Final = 3.0  # or once it has braked for so long
SLACK_M: Final = 0.15  # of it: positions are noisy
PULL_PER_S: Final = 0.8  # m/s for each metre beyond
PULL_MAX_MPS: Final = 0.5  # more than what the velocity errs by; it leads to where the vehicle has been
JUMPS_M: Final = 1.5  # a place so far off is none: the position has jumped, or wind has carried the vehicle away
AGAIN_S: Final = 0.2  # not asked for so long: another rest


@final
class RestHold:
    """One vehicle's: asked each tick for as long as it is to rest."""

    __slots__ = ("_asked_s", "_began_s", "_place_ne_m")

    def __init__(self) -> None:
        self._asked_s = self._began_s = -math.inf
        self._place_ne_m: tuple[float, float] | None = None

    def hold(self, own: Position | None, bias_ned_mps: Vec3, now_s: float) -> Vec3:
        """Velocity to command, NED m/s, level. `own`: None while its position is old: it brakes, and that is all.

        Its velocity is the true one, as far as it is known; `bias_ned_mps`: true velocity less the autopilot's.
        """
        if own is None or now_s - self._asked_s > AGAIN_S:
            self._place_ne_m, self._began_s = None, now_s
        self._asked_s = now_s
        if own is None:
            return ZERO
        north, east = own.pos_ned_m[0], own.pos_ned_m[1]
        stands = math.hypot(own.vel_ned_mps[0], own.vel_ned_mps[1]) <= STANDS_MPS
        if self._place_ne_m is None and (stands or now_s - self._began_s > BRAKES_S):
            self._place_ne_m = (north, east)
        elif self._place_ne_m is not None and math.dist(self._place_ne_m, (north, east)) > JUMPS_M:
            self._place_ne_m = (north, east)  # blind, nobody flies so far to where nothing is known to be free any more
        pull_n, pull_e = (0.0, 0.0) if self._place_ne_m is None else _pull(self._place_ne_m, north, east)
        return pull_n - bias_ned_mps[0], pull_e - bias_ned_mps[1], 0.0


def _pull(place_ne_m: tuple[float, float], north: float, east: float) -> tuple[float, float]:
    """Back to a place, m/s."""
    off_n, off_e = place_ne_m[0] - north, place_ne_m[1] - east
    off_m = math.hypot(off_n, off_e)
    if not off_m > SLACK_M:  # or no number
        return 0.0, 0.0
    share = min(PULL_PER_S * (off_m - SLACK_M), PULL_MAX_MPS) / off_m
    return share * off_n, share * off_e
