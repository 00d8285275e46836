"""Dead-reckoning uncertainty of a position whose autopilot has lost its GNSS fix.

The autopilot goes on by inertial sensors, and reports such positions like those before, until it gives them up; then
its companion reports the last. Only the receiver says at once that it has no fix (GPS_RAW_INT). A vehicle that never
had one flies by something else, and loses nothing. A receiver of which nothing is heard any more has none.

With the first fixes the position is not yet by them: the estimator resets to them, or is pulled, seconds later. Until
its position has jumped, or there was time enough, one that may have drifted far still counts as lost.

Where the autopilot is told of the own motion by trunks (ODOMETRY) its position goes on by that, and errs far less. That
it does so is not taken on trust: what it reports must agree with what is seen.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.localisation.integrity.position_gate import GAP_S, find_since_s, integrate_step
from companion.core.model.events import Position
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause

# Of the velocity's error while nothing corrects it: 2.5 standard deviations of what a tilt wrong by half a degree makes
DRIFT_MPS2: Final = 0.25
RECKONS_S: Final = 5.0  # PX4's EKF2_NOAID_TOUT: then nobody controls the drift, but it grows no faster
AHEAD_S: Final = 1.0  # of what is said: the others need so long to be further away
BACK_S: Final = failsafe_engine.row(Cause.GNSS_LOST).lingers_s  # fixes that come for so long are gone by again
# Of fixes, by which an estimator goes by them at the latest: EKF2 checks them for 1 s, and resets after 7 s without one
RESETS_S: Final = 10.0 * BACK_S
RESET_M: Final = 0.5  # a position that leaves its velocity so far in one step was reset: inertial ones are smooth
SILENT_S: Final = 5.0  # asked for at 5 Hz, some send it at 1 Hz, and it is asked for again twice (streams) by then
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
        self._back_s = 0.0  # since when it has one again, and its estimator goes by it
        self._heard_s = 0.0  # when the receiver said anything last
        self._was_used = False  # its estimator went by the last fix
        self._is_reset = False  # its position has jumped since it has one again
        self._told: Position | None = None  # reported last
        self._told_s = 0.0
        self._odometry_s: float | None = None  # when trunks told the motion last, and the autopilot agreed
        self._drifted_m = 0.0  # until then

    def receive_fix(self, now_s: float, *, has_fix: bool, is_used: bool = True) -> None:
        """Take in one report of the receiver. `is_used`: the estimator goes by GNSS, as far as it tells."""
        self._heard_s = now_s
        if not has_fix:
            self._lose_fix(now_s)
            return
        self._fix_s = now_s
        if self._lost_s is None:
            self._was_used = is_used
        elif self._was_used and not is_used:
            self._back_s = now_s
        elif self._has_returned(now_s):
            self._lost_s = None

    def _lose_fix(self, now_s: float) -> None:
        if self._fix_s is not None and self._lost_s is None:
            self._lost_s = self._fix_s
            self._drifted_m = 0.0
        self._back_s, self._is_reset = now_s, False

    def _has_returned(self, now_s: float) -> bool:
        """Its position goes by fixes again, or is so little off that it makes no difference."""
        fixes_s = now_s - self._back_s
        if fixes_s < BACK_S:
            return False
        is_near = self._drifted_m + self._find_drift_m(self._back_s) <= FLIES_ON_M
        return is_near or self._is_reset or fixes_s >= RESETS_S

    def note_silence(self, now_s: float) -> None:
        """Once a tick: a receiver that says nothing has no fix."""
        if self._fix_s is not None and now_s - self._heard_s > SILENT_S:
            self._lose_fix(now_s)

    def handle_stall(self, now_s: float) -> None:
        """This companion has heard nothing for a while, whatever was said."""
        self._heard_s = max(self._heard_s, now_s)

    def note_position(self, told: Position, now_s: float) -> None:
        """Each position as reported: one that jumps after the fix has come was reset to it."""
        before, heard_s = self._told, now_s - self._told_s
        self._told, self._told_s = told, now_s
        if before is None or self._lost_s is None:
            return
        since_s = find_since_s(before, told, heard_s)
        if not 0.0 < since_s <= GAP_S:
            return
        north, east, _ = integrate_step(before.vel_ned_mps, told.vel_ned_mps, since_s)
        off_n = told.pos_ned_m[0] - before.pos_ned_m[0] - north
        off_e = told.pos_ned_m[1] - before.pos_ned_m[1] - east
        self._is_reset |= math.hypot(off_n, off_e) > RESET_M

    def note_odometry(self, now_s: float, *, off_mps: float) -> None:
        """The autopilot was told of the motion that is seen; what it had reported was off by so much."""
        if off_mps > ODOMETRY_AGREES_MPS:
            return
        if self._lost_s is not None:
            self._drifted_m += self._find_drift_m(now_s)
        self._odometry_s = now_s

    @property
    def is_lost(self) -> bool:
        """It has had no fix since the last one, or its position does not go by it yet."""
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
        aided_s = self._lost_s if self._odometry_s is None else max(self._lost_s, self._odometry_s)
        return max(0.0, now_s - aided_s)

    def _find_drift_m(self, until_s: float) -> float:
        """Since then."""
        unaided_s = self._unaided_s(until_s)
        reckons_s = min(unaided_s, RECKONS_S)
        inertial_m = DRIFT_MPS2 * reckons_s * (unaided_s - 0.5 * reckons_s)
        return inertial_m if self._odometry_s is None else inertial_m + ODOMETRY_DRIFT_MPS * unaided_s
