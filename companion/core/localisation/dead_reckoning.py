"""Dead-reckoning uncertainty of a position whose autopilot has lost its GNSS fix.

The autopilot goes on by inertial sensors, and reports such positions like those before, until it gives them up; then
its companion reports the last. Only the receiver says at once that it has no fix (GPS_RAW_INT). A vehicle that never
had one flies by something else, and loses nothing.

Where the autopilot is told of the own motion by trunks (ODOMETRY) its position goes on by that, and errs far less. That
it does so is not taken on trust: what it reports must agree with what is seen.
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
ODOMETRY_FRESH_S: Final = 0.6  # three turns of a slow sensor
ODOMETRY_AGREES_MPS: Final = 0.5  # the autopilot's velocity with what is seen: a little more than with satellites
# Of a position whose motion trunks tell: 0.1 m/s of error, in a new direction each second, are 0.5 m in half a minute
# (2 standard deviations: 1.1)
ODOMETRY_DRIFT_MPS: Final = 0.04
FLIES_ON_M: Final = 1.5  # by a position that errs by more it holds


class DeadReckoning:
    """One vehicle's. Feed it what the receiver says; times are the local clock's, s."""

    def __init__(self) -> None:
        self._fix_s: float | None = None  # when it had one last
        self._lost_s: float | None = None  # since when it has none
        self._back_s = 0.0  # since when it has one again
        self._odometry_s: float | None = None  # when trunks told the motion last, and the autopilot agreed
        self._drifted_m = 0.0  # until then

    def receive_fix(self, now_s: float, *, has_fix: bool) -> None:
        """Take in one report of the receiver."""
        if not has_fix:
            if self._fix_s is not None and self._lost_s is None:
                self._lost_s = self._fix_s
                self._drifted_m = 0.0
            self._back_s = now_s
            return
        self._fix_s = now_s
        if self._lost_s is not None and now_s - self._back_s >= BACK_S:
            self._lost_s = None

    def note_odometry(self, now_s: float, *, off_mps: float) -> None:
        """The autopilot was told of the motion that is seen; what it had reported was off by so much."""
        if off_mps > ODOMETRY_AGREES_MPS:
            return
        if self._lost_s is not None:
            self._drifted_m += self._find_drift_m(now_s)
        self._odometry_s = now_s

    @property
    def is_lost(self) -> bool:
        """It has had no fix since the last one."""
        return self._lost_s is not None

    def lasts_s(self, now_s: float) -> float:
        """For how long it has had nothing to go by; 0: it has a fix, or trunks carry its position well enough."""
        if self._lost_s is None:
            return 0.0
        is_seen = self._odometry_s is not None and now_s - self._odometry_s <= ODOMETRY_FRESH_S
        if is_seen and self._drifted_m <= FLIES_ON_M:
            return 0.0
        return now_s - self._lost_s

    def error_m(self, now_s: float) -> float:
        """Level error of the position that it may have AHEAD_S from now; 0: it has a fix."""
        if self._lost_s is None:
            return 0.0
        return min(self._drifted_m + self._find_drift_m(now_s + AHEAD_S), ERROR_MAX_M)

    def _unaided_s(self, now_s: float) -> float:
        """Since the last fix, or the last motion that trunks told."""
        assert self._lost_s is not None
        return now_s - (self._lost_s if self._odometry_s is None else max(self._lost_s, self._odometry_s))

    def _find_drift_m(self, until_s: float) -> float:
        """Since then."""
        unaided_s = self._unaided_s(until_s)
        reckons_s = min(unaided_s, RECKONS_S)
        inertial_m = DRIFT_MPS2 * reckons_s * (unaided_s - 0.5 * reckons_s)
        return inertial_m if self._odometry_s is None else inertial_m + ODOMETRY_DRIFT_MPS * unaided_s
