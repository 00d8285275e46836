"""Registration of a window's constellation of stems with those known: the shift that most of them agree on.

Frame errors can be as large as the distance of stems, where each one's nearest says nothing: but the constellation fits
in one place only. Shifts alone are tried: what heading errors do within sight of a vehicle is in position_sd_m.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from companion.stand.fusion.odometry import turned
from companion.stand.fusion.windows import Floats, Ints

SEARCH_SDS: Final = 5.0  # of the frame error
PRIOR_FREEDOM: Final = 4.0  # of Student's t: now and then a frame is off by more than its vehicle thinks
SEARCH_MAX_M: Final = 6.0  # more would be searched among dozens of stems for each
SPREAD_M: Final = (
    0.25  # by which stems of one constellation may differ: their own errors, and the frame's within KNOT_S
)
REFINEMENTS: Final = 3
TRIED_MAX: Final = 1_000  # shifts
TURNS: Final = 12  # tried to either side,
TURNS_SDS: Final = 3.0  # up to so many of its standard deviations
TURN_SPREAD_M: Final = 0.5  # by which stems may differ then: half of a turn's step over 60 m, and the odometry's drift
VOTE_M: Final = 1.0
CLUTTER: Final = 0.05  # likelihood of a stem that has no partner, beside 1 of one that fits exactly


class Registered(NamedTuple):
    """Shift to take off a window's positions, and its error."""

    shift_m: Floats  # north, east
    sd_m: float


class Constellation(NamedTuple):
    """Stems that one log saw."""

    pos_m: Floats  # k x 2
    dbh_m: Floats
    dbh_sd_m: Floats


def register_stems(seen: Constellation, prior_sd_m: float, known: KnownStems, spread_m: float = SPREAD_M) -> Registered:
    """The shift of `seen` against the known stems; within prior_sd_m of nothing before they are looked at."""
    own, shifts, alike = _pairs(seen, min(SEARCH_SDS * prior_sd_m, SEARCH_MAX_M), known)
    if not len(own):
        return Registered(np.zeros(2), prior_sd_m)
    tried = np.vstack((np.zeros((1, 2)), shifts[:: 1 + len(shifts) // TRIED_MAX]))
    scores = np.asarray([_score(shift, shifts, alike, own, prior_sd_m, spread_m) for shift in tried])
    shift = tried[int(np.argmax(scores))]
    for _ in range(REFINEMENTS):  # mean shift
        fit = alike * np.exp(-np.sum((shifts - shift) ** 2, axis=1) / (2.0 * spread_m**2))
        total = float(fit.sum()) + spread_m**2 / prior_sd_m**2
        shift = fit @ shifts / total
    return Registered(shift, spread_m / np.sqrt(total))


def find_turn(seen: Constellation, pivot_m: Floats, turn_sd_rad: float, prior_sd_m: float, known: KnownStems) -> float:
    """The turn of `seen` about a place, clockwise, with which some shift fits it best to the known stems, rad.

    For each turn the shift that most pairs agree on is scored.
    """
    best, found_rad = -math.inf, 0.0
    within_m = min(SEARCH_SDS * prior_sd_m, SEARCH_MAX_M)
    for k in range(-TURNS, TURNS + 1):
        turn_rad = k * TURNS_SDS * turn_sd_rad / TURNS
        there = seen._replace(pos_m=turned(seen.pos_m - pivot_m, turn_rad) + pivot_m)
        own, shifts, alike = _pairs(there, within_m, known)
        if not len(own):
            continue
        shift = _most_voted(shifts, alike, within_m)
        score = _score(shift, shifts, alike, own, prior_sd_m, TURN_SPREAD_M) - 0.5 * (turn_rad / turn_sd_rad) ** 2
        if score > best:
            best, found_rad = score, turn_rad
    return found_rad


def _most_voted(shifts: Floats, alike: Floats, within_m: float) -> Floats:
    """The middle of the fullest square of VOTE_M, of squares that overlap by half."""
    count = 2 * math.ceil(within_m / VOTE_M) + 1
    cell = np.floor(shifts / (VOTE_M / 2.0)).astype(np.int64) + count
    votes = np.zeros((2 * count, 2 * count))
    np.add.at(votes, (cell[:, 0], cell[:, 1]), alike)
    squares = votes[:-1, :-1] + votes[1:, :-1] + votes[:-1, 1:] + votes[1:, 1:]
    place = np.unravel_index(int(np.argmax(squares)), squares.shape)
    return (np.asarray(place, dtype=np.float64) + 1.0 - count) * (VOTE_M / 2.0)


class KnownStems:
    """Stems so far, for looking up."""

    def __init__(self, pos_m: Floats, sd_m: Floats, dbh_m: Floats, dbh_sd_m: Floats, number: Ints) -> None:
        self.pos_m, self.sd_m, self.dbh_m, self.dbh_sd_m, self.number = pos_m, sd_m, dbh_m, dbh_sd_m, number
        self._tree = cKDTree(pos_m) if len(pos_m) else None

    def pairs(self, pos_m: Floats, within_m: float) -> tuple[Ints, Ints]:
        """Indices into pos_m, and of known stems, of all pairs within that distance, sorted."""
        none = np.zeros(0, dtype=np.int64)
        if self._tree is None:
            return none, none
        near: Any = self._tree.query_ball_point(pos_m, within_m, return_sorted=True)
        own = np.repeat(np.arange(len(pos_m)), [len(found) for found in near])
        other = np.concatenate([none, *(np.asarray(found, dtype=np.int64) for found in near)])
        return own.astype(np.int64), other


def _pairs(seen: Constellation, within_m: float, known: KnownStems) -> tuple[Ints, Floats, Floats]:
    """Of all pairs so near: which was seen, its shift from the known one, and how alike their diameters are."""
    own, other = known.pairs(seen.pos_m, within_m)
    misfit = (seen.dbh_m[own] - known.dbh_m[other]) ** 2 / (seen.dbh_sd_m[own] ** 2 + known.dbh_sd_m[other] ** 2)
    return own, seen.pos_m[own] - known.pos_m[other], np.exp(-0.5 * np.minimum(misfit, 25.0))


def _score(shift: Floats, shifts: Floats, alike: Floats, own: Ints, prior_sd_m: float, spread_m: float) -> float:
    """Log likelihood of `shift`, over that of no partner at all: of each stem its best partner, and of the prior."""
    fit = alike * np.exp(-np.sum((shifts - shift) ** 2, axis=1) / (2.0 * spread_m**2))
    best = np.zeros(int(own.max()) + 1)
    np.maximum.at(best, own, fit)
    away = float(np.sum(shift**2)) / (PRIOR_FREEDOM * prior_sd_m**2)
    return float(np.log1p(best / CLUTTER).sum()) - (PRIOR_FREEDOM / 2.0 + 1.0) * math.log1p(away)
