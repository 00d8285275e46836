"""The bias of a told velocity, from how the told position changes.

Estimators lie about velocity: up to 0.4 m/s level and 0.27 m/s in height for seconds, seen on real PX4, while the
position said so. A vehicle that steers by velocity alone drifts with the lie; what is found here is given back to the
setpoint (own velocity) or added to what a neighbour claims.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.vectors import ZERO, limit
from mission.common.frames import Vec3

# slower than the autopilot's lag in velocity, faster than a vehicle drifts a separation away
BANDWIDTH_PER_S: Final = 1.0
LIMIT_MPS: Final = 1.0  # more than twice what was seen
JUMP_M: Final = 1.5  # a position that jumps so far says nothing of the velocity
GAP_S: Final = 1.0  # after a longer silence it is watched anew


class VelocityBias:
    """A position observer (critically damped) whose velocity bias is `ned_mps`: true = told + `ned_mps`.

    Of positions only differences are used, so it does not matter where the frame has its origin (rule 5).
    """

    __slots__ = ("_off_m", "_pos_ned_m", "_time_s", "bandwidth_per_s", "ned_mps")

    def __init__(self, bandwidth_per_s: float = BANDWIDTH_PER_S) -> None:
        self.bandwidth_per_s = bandwidth_per_s  # may be changed in flight
        self.ned_mps: Vec3 = ZERO
        self._pos_ned_m: Vec3 = ZERO  # as told last
        self._off_m: Vec3 = ZERO  # of that from where the observer had it
        self._time_s: float | None = None

    def begin_anew(self) -> None:
        """Forgets the bias; the next position is taken for the first."""
        self.ned_mps, self._time_s = ZERO, None

    def update(self, pos_ned_m: Vec3, vel_ned_mps: Vec3, time_s: float) -> None:
        """A told position and velocity; `time_s` by the teller's clock. Repeated or overtaken ones change nothing."""
        since_s = GAP_S if self._time_s is None else time_s - self._time_s
        if -GAP_S < since_s <= 0.0:
            return
        before = self._pos_ned_m
        self._time_s, self._pos_ned_m = time_s, pos_ned_m
        if not 0.0 < since_s < GAP_S:
            self._off_m = self.ned_mps = ZERO
            return
        # Written out: this runs for every beacon. The error is what the observer's course misses the told position by.
        off, vel, bias = self._off_m, vel_ned_mps, self.ned_mps
        x = pos_ned_m[0] - before[0] + off[0] - (vel[0] + bias[0]) * since_s
        y = pos_ned_m[1] - before[1] + off[1] - (vel[1] + bias[1]) * since_s
        z = pos_ned_m[2] - before[2] + off[2] - (vel[2] + bias[2]) * since_s
        if not math.sqrt(x * x + y * y + z * z) <= JUMP_M:  # a jump, or no number
            self._off_m = ZERO
            return
        gain = self.bandwidth_per_s * since_s
        left, learnt = max(0.0, 1.0 - 2.0 * gain), self.bandwidth_per_s * gain
        self._off_m = (x * left, y * left, z * left)
        self.ned_mps = limit((bias[0] + x * learnt, bias[1] + y * learnt, bias[2] + z * learnt), LIMIT_MPS)
