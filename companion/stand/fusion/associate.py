"""Association of observations with stems: assignment window by window, by turns with the adjustment.

A window's observations are assigned to stems, each to one at most (scipy's linear_sum_assignment), at the cost of their
misfit in position and diameter against that of a stem of its own: the Bayes factor, with stems standing at random. Two
observations of one log whose times overlap are distinct: they are never of one stem.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from companion.stand.fusion.adjustment import Solution, knots_of, solve_positions
from companion.stand.fusion.clusters import Clusters
from companion.stand.fusion.odometry import fit_turn
from companion.stand.fusion.register import SPREAD_M, Constellation, find_turn, register_stems
from companion.stand.fusion.windows import DRIFT_M, Columns, Ints, knot_spacing_s, windows_of

MAX_ROUNDS: Final = 8  # of assignment and adjustment: three or four do
START_SD_M: Final = 0.15  # of an observation, besides, before frames are adjusted
WANDER: Final = 2.0**-0.5  # share of a frame's standard error that is not there from the start on
TURN_SD_RAD: Final = math.radians(2.0)  # of odometry by a compass, turned to what it was told of the mission's frame
LEAST_SHARED: Final = 4  # stems by which it is turned to others'
COMMON_M: Final = 3.0  # so near before registration: perhaps the same stem


class Association(NamedTuple):
    """The stem of each observation, 0 .. stems - 1 by the first observation of each, and the adjustment of that."""

    stem: Ints
    stems: int
    solution: Solution


def associate_observations(columns: Columns) -> Association:
    """Of one observation at least."""
    spacing_s = knot_spacing_s(columns)
    windows = windows_of(columns)
    stems = Clusters(columns)
    columns = _start(columns, windows, stems)
    knots = knots_of(columns, spacing_s)
    stem, count = stems.numbered()
    solution = solve_positions(columns, stem, count, knots)
    for _ in range(MAX_ROUNDS):
        columns = _turn_logs(columns, stem, solution)
        stems.place(columns.pos_m - solution.error_m, np.hypot(columns.position_sd_m, solution.error_sd_m))
        known = stems.known()
        for window in windows:
            stems.remove(window)
            stems.assign(window, known)
        stems.merge()
        before = stem
        stem, count = stems.numbered()
        solution = solve_positions(columns, stem, count, knots)
        if np.array_equal(before, stem):
            break
    return Association(stem, count, solution)


def _turn_logs(columns: Columns, stem: Ints, solution: Solution) -> Columns:
    """Odometry that goes by a compass is turned to the stems that others saw, too; then all of it to satellites."""
    places_m = solution.stem_m[stem]
    by_compass = [log for log, frame in enumerate(columns.odometry) if frame is not None]
    for log in by_compass:
        own = columns.log == log
        shared = own & np.isin(stem, stem[~own])
        if np.count_nonzero(shared) < LEAST_SHARED:
            continue
        weight = solution.weight[shared] / (columns.position_sd_m[shared] ** 2 + columns.wander_sd_m[shared] ** 2)
        turn_rad = fit_turn(columns.pos_m[shared], places_m[shared], weight, 1.0 / TURN_SD_RAD**2)
        columns = columns.turned(log, turn_rad, weight @ columns.pos_m[shared] / weight.sum())
    own = np.isin(columns.log, by_compass)
    shared = ~own & np.isin(stem, stem[own])
    if np.count_nonzero(shared) >= LEAST_SHARED:  # errors of these wander, and do not turn with the place
        weight = solution.weight[shared]
        turn_rad = fit_turn(places_m[shared], columns.pos_m[shared], weight, 0.0)
        for log in by_compass:
            columns = columns.turned(log, turn_rad, weight @ places_m[shared] / weight.sum())
    return columns


def _start(columns: Columns, windows: list[Ints], stems: Clusters) -> Columns:
    """Log by log, each where it fits best those before it; the next is the one that has most in common with them.

    The first is one that has satellites. Returns the columns with odometry turned to fit.
    """
    of_log: dict[int, list[Ints]] = {}
    for window in windows:
        of_log.setdefault(int(columns.log[window[0]]), []).append(window)
    left = {log: np.concatenate(own) for log, own in sorted(of_log.items())}
    while left:
        known = stems.known()
        common = {log: len(np.unique(known.pairs(columns.pos_m[own], COMMON_M)[0])) for log, own in left.items()}
        log = max(left, key=lambda k: (common[k], columns.odometry[k] is None, len(left[k]), -k))
        columns = _start_log(columns, left.pop(log), of_log[log], stems)
    return columns


def _start_log(columns: Columns, own: Ints, windows: list[Ints], stems: Clusters) -> Columns:
    """Registers a log as a whole, then its windows about that, and assigns them.

    A window alone may fit a wrong constellation, and those after it follow; a whole log does not.
    """
    known = stems.known()
    log, frame_sd_m = int(columns.log[own[0]]), float(np.median(columns.frame_sd_m[own]))
    correlation_s = float(columns.correlation_s[log])
    wander_m = WANDER * frame_sd_m if columns.odometry[log] is None else DRIFT_M
    whole = Constellation(columns.pos_m[own], columns.dbh_m[own], stems.dbh_sd_m[own])
    if columns.odometry[log] is not None:
        pivot_m = whole.pos_m.mean(axis=0)
        turn_rad = find_turn(whole, pivot_m, TURN_SD_RAD, frame_sd_m, known)
        columns = columns.turned(log, turn_rad, pivot_m)
        whole = whole._replace(pos_m=columns.pos_m[own])
    usual_m = register_stems(whole, frame_sd_m, known, float(np.hypot(SPREAD_M, wander_m))).shift_m
    last_s, error_m, sd_m = -np.inf, usual_m, wander_m
    for window in windows:
        time_s = float(columns.time_s[window].mean())
        decay = float(np.exp(-(time_s - last_s) / correlation_s))
        error_m = usual_m + decay * (error_m - usual_m)
        sd_m = float(np.sqrt((decay * sd_m) ** 2 + wander_m**2 * (1.0 - decay**2)))
        there_m = columns.pos_m[window] - error_m
        known = stems.known()
        seen = Constellation(there_m, columns.dbh_m[window], stems.dbh_sd_m[window])
        found = register_stems(seen, sd_m, known)
        stems.pos_m[window] = there_m - found.shift_m
        stems.sd_m[window] = np.sqrt(columns.position_sd_m[window] ** 2 + START_SD_M**2 + found.sd_m**2)
        stems.assign(window, known)
        last_s, error_m, sd_m = time_s, error_m + found.shift_m, found.sd_m
    return columns
