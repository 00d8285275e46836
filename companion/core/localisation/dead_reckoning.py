"""Dead-reckoning uncertainty of a position whose autopilot has lost its GNSS fix and goes on by inertial sensors.

The autopilot reports such positions like those before, until it gives them up; then its companion reports the last.
Only the receiver says at once that it has no fix (GPS_RAW_INT). A vehicle that never had one flies by something else,
and loses nothing.
"""

from __future__ import annotations

from typing import Final

from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause

# Of the velocity's error while nothing corrects it: 2.5 standard deviations of what a tilt wrong by half a degree makes
DRIFT_MPS2: Final = 0.25
RECKONS_S: Final = 5.0  # PX4's EKF2_NOAID_TOUT: then nobody controls the drift, but it grows no faster
AHEAD_S: Final = 1.0  # of what is said: the others need so long to be further away
BACK_S: Final = failsafe_engine.row(Cause.GNSS_LOST).lingers_s  # fixes that come for so long are gone by again
ERROR_MAX_M: Final = 25.0


class DeadReckoning:
    """One vehicle's. Feed it what the receiver says; times are the local clock's, s."""

    def __init__(self) -> None:
        self._fix_s: float | None = None  # when it had one last
        self._lost_s: float | None = None  # since when it has none
        self._back_s = 0.0  # since when it has one again

    def receive_fix(self, now_s: float, *, has_fix: bool) -> None:
        """Take in one report of the receiver."""
        if not has_fix:
            if self._fix_s is not None and self._lost_s is None:
                self._lost_s = self._fix_s
            self._back_s = now_s
            return
        self._fix_s = now_s
        if self._lost_s is not None and now_s - self._back_s >= BACK_S:
            self._lost_s = None

    def lasts_s(self, now_s: float) -> float:
        """For how long it has had no fix to go by; 0: it has one."""
        return 0.0 if self._lost_s is None else now_s - self._lost_s

    def error_m(self, now_s: float) -> float:
        """Level error of the position that it may have AHEAD_S from now; 0: it has a fix."""
        if self._lost_s is None:
            return 0.0
        lasts_s = self.lasts_s(now_s) + AHEAD_S
        reckons_s = min(lasts_s, RECKONS_S)
        return min(DRIFT_MPS2 * reckons_s * (lasts_s - 0.5 * reckons_s), ERROR_MAX_M)
