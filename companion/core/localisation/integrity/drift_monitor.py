"""GNSS fixes held against the way that trunks tell: a Kalman filter without a drift, and each drift's likelihood ratio.

A receiver that is led astray slowly passes every gate of an estimator. The way that it tells departs from the way that
trunks tell, and so it does without a spoofer: fixes err for seconds, trunks slip, their frame is turned from that of
fixes by some degrees, more while it flies, and is turned back as far as the own motion believes to know by how much. A
turned frame parts both ways across the course and as fast as the vehicle flies, a drift in one direction: a winding
way, or a rest, tells them apart; a straight one does not.

All that is the state of one filter. Its innovations are white while nothing else parts the ways; a drift that begins at
a note adds a known signature to them. For each of the last NOTES notes the drift that explains them best is weighed
against none. Source: A. S. Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems", IEEE Transactions on Automatic Control 21 (1976).
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, final

from companion.core.localisation.integrity.fix_monitor import NOTE_S, Level, Parted

Frame = tuple[float, float, float]  # turned clockwise, rad, then moved north and east, m

NOTES: Final = 100
ALARM: Final = 20.0  # twice the logarithm of the ratio
FIX_M: Final = 0.2  # of a fix on an axis: recorded, 0.17 to 0.28 m
FIX_MEMORY_S: Final = 5.0
READ_M: Final = 0.02  # so much of it is forgotten at once
OFFSET_M: Final = 10.0  # of where trunks' frame begins: anywhere
WALK_M2_PER_S: Final = 0.005  # of trunks, as the bench `spoofing --open-loop` has it, and the next
SHARE: Final = 0.005  # of the way, by which it is too long or short
FRAME_RAD: Final = math.radians(4.0)  # by which trunks' frame is turned when it begins
FRAME_RAD2_PER_S: Final = math.radians(0.2) ** 2
# Of how far the own motion has turned that frame, so much was there to be turned: it follows a drift, too
TURNED_SHARE: Final = 0.3
# States: offset north and east, m; frame, rad; share of its turn; share of the way; error of the fix north and east, m
STATES: Final = 7


@final
class _Onset:
    """A drift that began at a note: per m/s north and east, what it has made of the filter's errors since then."""

    __slots__ = ("at_s", "ee", "frame_rad", "ne", "nn", "of_east", "of_north", "to_east", "to_north")

    def __init__(self, at_s: float, frame_rad: float) -> None:
        self.at_s: Final = at_s
        self.frame_rad: Final = frame_rad  # turned by then
        self.of_north: list[float] = [0.0] * STATES
        self.of_east: list[float] = [0.0] * STATES
        # Information matrix and vector of the drift
        self.nn = self.ne = self.ee = 0.0
        self.to_north = self.to_east = 0.0

    def solve(self) -> tuple[float, float, float]:
        """Twice the logarithm of the likelihood ratio, and the drift, m/s north and east."""
        det = self.nn * self.ee - self.ne * self.ne
        if not det > 1e-9 * self.nn * self.ee:
            return 0.0, 0.0, 0.0
        north = (self.ee * self.to_north - self.ne * self.to_east) / det
        east = (self.nn * self.to_east - self.ne * self.to_north) / det
        return north * self.to_north + east * self.to_east, north, east


@final
class DriftMonitor:
    """One vehicle's."""

    __slots__ = (
        "_at_s",
        "_cov",
        "_frame",
        "_frame_rad2",
        "_onsets",
        "_state",
        "_turned_rad",
        "_way_ne_m",
        "_went_ne_m",
    )

    def __init__(self) -> None:
        self._onsets: deque[_Onset] = deque(maxlen=NOTES)
        self.forget()

    def forget(self) -> None:
        """Begins anew: of what was before nothing can be said."""
        self._onsets.clear()
        self._at_s = -math.inf
        self._way_ne_m: Level = (0.0, 0.0)
        self._frame: Frame = (0.0, 0.0, 0.0)
        self._frame_rad2 = 0.0
        self._turned_rad = 0.0  # the frame, since it began
        self._went_ne_m: Level = (0.0, 0.0)  # by trunks, in the frame as it was then
        self._state: list[float] = [0.0] * STATES
        sds = (OFFSET_M, OFFSET_M, FRAME_RAD, TURNED_SHARE, SHARE, FIX_M, FIX_M)
        self._cov: list[list[float]] = [[sds[i] ** 2 if i == j else 0.0 for j in range(STATES)] for i in range(STATES)]

    def update(
        self, fix_ne_m: Level, way_ne_m: Level, now_s: float, *, frame: Frame, frame_rad2: float
    ) -> Parted | None:
        """Both positions now, m; None: they agree, as far as is known.

        `frame`: how trunks' frame has been turned and moved by now; `frame_rad2`: variance of how far it is turned
        from that of fixes: where that grows it has begun anew.
        """
        since_s = now_s - self._at_s
        if since_s < NOTE_S - 1e-6:
            return None
        if since_s < math.inf:
            self._predict(way_ne_m, since_s, frame, frame_rad2)
        self._at_s, self._way_ne_m, self._frame, self._frame_rad2 = now_s, way_ne_m, frame, frame_rad2
        for axis in (0, 1):
            self._correct(axis, fix_ne_m[axis] - self._went_ne_m[axis])
        best, parted = ALARM, None
        for onset in self._onsets:
            score, north_mps, east_mps = onset.solve()
            if score > best:
                led_s = now_s - onset.at_s
                led = (fix_ne_m[0] - north_mps * led_s, fix_ne_m[1] - east_mps * led_s)
                best, parted = score, Parted(onset.at_s, led, frame[0] - onset.frame_rad)
        self._onsets.append(_Onset(now_s, frame[0]))
        return parted

    def _predict(self, way_ne_m: Level, since_s: float, frame: Frame, frame_rad2: float) -> None:
        """Over the way since the last note, in the frame as it began."""
        turn = -self._turned_rad
        self._turned_rad += frame[0] - self._frame[0]
        n, e = _place_in_frame(way_ne_m, frame, self._frame)
        n, e = n - self._way_ne_m[0], e - self._way_ne_m[1]
        c, s = math.cos(turn), math.sin(turn)
        north, east = c * n - s * e, s * n + c * e
        self._went_ne_m = (self._went_ne_m[0] + north, self._went_ne_m[1] + east)
        turned = self._turned_rad
        # Of each offset by frame, share of its turn, and share of the way
        by_n, by_e = (-east, -east * turned, north), (north, north * turned, east)
        kept = math.exp(-since_s / FIX_MEMORY_S)
        cov = self._cov
        _propagate_vector(self._state, by_n, by_e, kept)
        for row in cov:
            _propagate_vector(row, by_n, by_e, kept)
        for j in range(STATES):
            column = [cov[i][j] for i in range(STATES)]
            _propagate_vector(column, by_n, by_e, kept)
            for i in range(STATES):
                cov[i][j] = column[i]
        for k in (0, 1):
            cov[k][k] += WALK_M2_PER_S * since_s
            cov[5 + k][5 + k] += FIX_M * FIX_M * (1.0 - kept * kept)
        cov[2][2] += FRAME_RAD2_PER_S * since_s + max(0.0, frame_rad2 - self._frame_rad2)
        for onset in self._onsets:
            _propagate_vector(onset.of_north, by_n, by_e, kept)
            _propagate_vector(onset.of_east, by_n, by_e, kept)
            onset.of_north[0] += since_s
            onset.of_east[1] += since_s

    def _correct(self, axis: int, parted_m: float) -> None:
        """By how far fix and way are apart on an axis: offset and error of the fix."""
        cov, state, fix = self._cov, self._state, 5 + axis
        column = [row[axis] + row[fix] for row in cov]
        variance = column[axis] + column[fix] + READ_M * READ_M
        innovation = parted_m - state[axis] - state[fix]
        gains = [one / variance for one in column]
        for onset in self._onsets:
            of_north, of_east = onset.of_north, onset.of_east
            north, east = of_north[axis] + of_north[fix], of_east[axis] + of_east[fix]
            onset.nn += north * north / variance
            onset.ne += north * east / variance
            onset.ee += east * east / variance
            onset.to_north += north * innovation / variance
            onset.to_east += east * innovation / variance
            for i in range(STATES):
                of_north[i] -= gains[i] * north
                of_east[i] -= gains[i] * east
        for i in range(STATES):
            state[i] += gains[i] * innovation
            row, gain = cov[i], gains[i]
            for j in range(STATES):
                row[j] -= gain * column[j]


def _propagate_vector(
    values: list[float], by_n: tuple[float, float, float], by_e: tuple[float, float, float], kept: float
) -> None:
    """Applies the transition of the states to a vector of them, in place."""
    frame, turned, share = values[2], values[3], values[4]
    values[0] += by_n[0] * frame + by_n[1] * turned + by_n[2] * share
    values[1] += by_e[0] * frame + by_e[1] * turned + by_e[2] * share
    values[5] *= kept
    values[6] *= kept


def _place_in_frame(place: Level, now: Frame, then: Frame) -> Level:
    """A place of now as the frame of then has it."""
    n, e = place[0] - now[1], place[1] - now[2]
    turn = then[0] - now[0]
    c, s = math.cos(turn), math.sin(turn)
    return c * n - s * e + then[1], s * n + c * e + then[2]
