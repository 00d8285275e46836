"""Association of observations with stems: assignment window by window, by turns with the adjustment.

A window's observations are assigned to stems, each to one at most (scipy's linear_sum_assignment), at the cost of their
misfit in position and diameter against that of a stem of its own: the Bayes factor, with stems standing at random. Two
observations of one log whose times overlap are distinct: they are never of one stem.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from companion.stand.fusion.adjustment import Solution, knots_of, solve_positions
from companion.stand.fusion.clusters import Clusters
from companion.stand.fusion.register import register_window
from companion.stand.fusion.windows import CORRELATION_S, Columns, Floats, Ints, knot_spacing_s, windows_of

MAX_ROUNDS: Final = 8  # of assignment and adjustment: three or four do
START_SD_M: Final = 0.15  # of an observation, besides, before frames are adjusted


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
    _start(columns, windows, stems)
    knots = knots_of(columns, spacing_s)
    stem, count = stems.numbered()
    solution = solve_positions(columns, stem, count, knots)
    for _ in range(MAX_ROUNDS):
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


def _start(columns: Columns, windows: list[Ints], stems: Clusters) -> None:
    """Each window registered with the stems of those before it, and assigned."""
    last: dict[int, tuple[float, Floats, float]] = {}  # of each log: time, error and its sd
    for window in windows:
        log, time_s = int(columns.log[window[0]]), float(columns.time_s[window].mean())
        frame_sd_m = float(np.median(columns.frame_sd_m[window]))
        error_m, error_sd_m = np.zeros(2), frame_sd_m
        if log in last:
            then_s, then_m, then_sd_m = last[log]
            decay = float(np.exp(-abs(time_s - then_s) / CORRELATION_S))
            error_m = decay * then_m
            error_sd_m = float(np.sqrt((decay * then_sd_m) ** 2 + frame_sd_m**2 * (1.0 - decay**2)))
        there_m = columns.pos_m[window] - error_m
        known = stems.known()
        found = register_window(there_m, columns.dbh_m[window], stems.dbh_sd_m[window], error_sd_m, known)
        last[log] = (time_s, error_m + found.shift_m, found.sd_m)
        stems.pos_m[window] = there_m - found.shift_m
        stems.sd_m[window] = np.sqrt(columns.position_sd_m[window] ** 2 + START_SD_M**2 + found.sd_m**2)
        stems.assign(window, known)
