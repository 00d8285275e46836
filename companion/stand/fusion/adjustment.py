"""Positions of stems and the vehicles' frame errors, solved together by robust least squares.

Each observation is its stem's position, plus the error of its vehicle's frame at that time, plus its own error. A frame
error has one part from the start on, and one that is a first-order Gauss-Markov process, at knots between which it is
linear; how large they are, and how slow, `windows` says. North and east are alike and independent. Stems are
eliminated (the Schur complement of their diagonal block), what is left is one dense matrix of the frames' unknowns: it
is solved, and inverted for the errors. Observations that fit badly count less (Huber 1964, "Robust estimation of a
location parameter", Annals of Mathematical Statistics 35, 73-101), by reweighting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import linalg, sparse

from companion.stand.fusion.odometry import OdometryFrame
from companion.stand.fusion.windows import Columns, Floats, Ints

HUBER: Final = 2.5  # standard deviations; of good observations in a plane 4 % are beyond
REWEIGHTINGS: Final = 3
LEAST_VARIANCE: Final = 1e-9  # m2
BLOCK: Final = 2_000  # rows at a time: 48 MB with MAX_KNOTS


@dataclass(frozen=True, slots=True)
class Knots:
    """Times at which the logs' frame errors are unknowns."""

    log: Ints
    time_s: Floats
    constant_sd_m: Floats  # of the frame there, before anything is known: its log's constant,
    wander_sd_m: Floats  # and what wanders
    spacing_s: float


@dataclass(frozen=True, slots=True)
class Frames:
    """Frame errors of all logs: north, east."""

    knots: Knots
    error_m: Floats  # knots x 2
    odometry: tuple[OdometryFrame | None, ...]  # of each log, where its track tells it

    def errors_m(self, log: int, times_s: Floats, recorded_m: Floats) -> Floats:
        """Of places that one log recorded at these times, k x 2: to be taken off.

        Where it has no knot 0; beyond the first and last as at the nearest.
        """
        own = self.knots.log == log
        if not own.any():
            return np.zeros((len(times_s), 2))
        at, frame = self.knots.time_s[own], self.odometry[log]
        drifted = np.column_stack([np.interp(times_s, at, self.error_m[own, axis]) for axis in (0, 1)])
        return drifted if frame is None else drifted + recorded_m - frame.place(recorded_m, times_s, times_s)


@dataclass(frozen=True, slots=True)
class Solution:
    """An adjustment's result for J stems and n observations."""

    stem_m: Floats  # J x 2
    stem_sd_m: Floats  # J: of each coordinate
    frames: Frames
    error_m: Floats  # n x 2: frame errors at the observations
    error_sd_m: Floats  # n
    weight: Floats  # n: of robust fitting, 1 = full


def knots_of(columns: Columns, spacing_s: float) -> Knots:
    """The two ends of every interval in which a log has an observation."""
    cell = np.floor(columns.time_s / spacing_s)
    both = np.concatenate([np.column_stack((columns.log, cell + end)) for end in (0, 1)])
    pairs, which = np.unique(both, axis=0, return_inverse=True)
    log, wander_m = pairs[:, 0].astype(np.int64), _rms_of(np.tile(columns.wander_sd_m, 2), which.ravel())
    # Of a log one and the same: what is there from the start on would change with it
    constant_m = _rms_of(columns.constant_sd_m, columns.log)[log]
    return Knots(log, pairs[:, 1] * spacing_s, constant_m, wander_m, spacing_s)


def _rms_of(values: Floats, group: Ints) -> Floats:
    """Root mean square of each group."""
    mean: Floats = np.bincount(group, values**2) / np.bincount(group)
    return np.sqrt(mean)


def solve_positions(columns: Columns, stem: Ints, count: int, knots: Knots) -> Solution:
    """`stem`: of each observation, 0 .. count - 1, each with one at least."""
    design = _design(columns, knots)
    prior = _prior(knots, columns.correlation_s)
    weight = np.ones(columns.n)
    for _ in range(REWEIGHTINGS):
        solved = _solve(columns, stem, count, design, prior, weight)
        misfit = columns.pos_m - solved[0][stem] - design @ solved[2]
        distance = np.hypot(misfit[:, 0], misfit[:, 1]) / columns.position_sd_m
        weight = np.minimum(1.0, HUBER / np.maximum(distance, 1e-9))
    stem_m, stem_var, u, covariance = solved
    # Where observations fit worse than their errors say, nobody is told the smaller ones.
    factor = max(1.0, float(np.sum(weight * distance**2)) / max(1, 2 * (columns.n - count)))
    error_var = _variances(design, covariance)
    return Solution(
        stem_m=stem_m,
        stem_sd_m=np.sqrt(np.maximum(factor * stem_var, LEAST_VARIANCE)),
        frames=Frames(knots, _at_knots(knots, len(columns.logs)) @ u, columns.odometry),
        error_m=design @ u,
        error_sd_m=np.sqrt(np.maximum(error_var, LEAST_VARIANCE)),
        weight=weight,
    )


def _design(columns: Columns, knots: Knots) -> Any:
    """n x unknowns: an observation's frame error of those at the knots."""
    place = {pair: k for k, pair in enumerate(zip(knots.log.tolist(), knots.time_s.tolist(), strict=True))}
    cell = np.floor(columns.time_s / knots.spacing_s)
    share = columns.time_s / knots.spacing_s - cell
    rows = np.arange(columns.n)
    parts = []
    for end, part in ((0, 1.0 - share), (1, share)):
        times = ((cell + end) * knots.spacing_s).tolist()
        index = np.asarray([place[pair] for pair in zip(columns.log.tolist(), times, strict=True)], dtype=np.int64)
        parts.append(sparse.csr_array((part, (rows, index)), shape=(columns.n, len(knots.log))))
    return sparse.csr_array((parts[0] + parts[1]) @ _at_knots(knots, len(columns.logs)))


def _at_knots(knots: Knots, logs: int) -> Any:
    """K x unknowns: frame errors of the processes' values and the logs' constants, each of unit variance."""
    rows = np.arange(len(knots.log))
    constants = sparse.csr_array((knots.constant_sd_m, (rows, knots.log)), shape=(len(rows), logs))
    return sparse.hstack([sparse.diags_array(knots.wander_sd_m), constants], format="csr")


def _prior(knots: Knots, correlation_s: Floats) -> Any:
    """Information of the Gauss-Markov processes, and of the logs' constants."""
    n = len(knots.log)
    same = np.flatnonzero(np.diff(knots.log) == 0)
    first = np.setdiff1d(np.arange(n), same + 1)
    decay = np.exp(-np.diff(knots.time_s)[same] / correlation_s[knots.log[same]])
    inverse = 1.0 / np.sqrt(1.0 - decay**2)
    rows = np.arange(len(same))
    steps = sparse.csr_array((inverse, (rows, same + 1)), shape=(len(same), n))
    steps = steps - sparse.csr_array((inverse * decay, (rows, same)), shape=(len(same), n))
    starts = sparse.csr_array((np.ones(len(first)), (first, first)), shape=(n, n))
    return sparse.block_diag([steps.T @ steps + starts, sparse.eye_array(len(correlation_s))], format="csr")


def _solve(
    columns: Columns, stem: Ints, count: int, design: Any, prior: Any, weight: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Stems, their variances, the frames' unknowns, and the covariance of these."""
    w = weight / columns.position_sd_m**2
    of_stem = np.bincount(stem, w, count)
    chosen = sparse.csr_array((w, (stem, np.arange(columns.n))), shape=(count, columns.n))
    coupling = chosen @ design  # J x unknowns
    scaled = sparse.diags_array(1.0 / of_stem) @ coupling
    reduced = (design.T @ sparse.diags_array(w) @ design + prior - coupling.T @ scaled).toarray()
    stem_sum = chosen @ columns.pos_m
    right = design.T @ (w[:, None] * columns.pos_m) - scaled.T @ stem_sum
    factor = linalg.cho_factor(reduced, lower=True)
    covariance = linalg.cho_solve(factor, np.eye(len(reduced)))
    u = linalg.cho_solve(factor, right)
    stem_m = (stem_sum - coupling @ u) / of_stem[:, None]
    return np.asarray(stem_m), 1.0 / of_stem + _variances(scaled, covariance), np.asarray(u), np.asarray(covariance)


def _variances(rows: Any, covariance: Floats) -> Floats:
    """Of each row's combination of knots."""
    blocks = [rows[k : k + BLOCK] for k in range(0, rows.shape[0], BLOCK)]
    found = [np.asarray(block.multiply(block @ covariance).sum(axis=1)).ravel() for block in blocks]
    return np.concatenate(found) if found else np.zeros(0)
