"""Intervals of a stand's figures: what blocks of ground differ by, for the ground not seen, and errors of measuring.

A figure is of the mission's area (without one, of the ground that was seen). What was not seen of it is taken to be as
what was: how far that may be off, blocks of the ground tell. Each is left out in turn, detection fitted without it to
first order (the jackknife for blocks of unequal size; Busing, Meijer & van der Leeden 1999, "Delete-m jackknife for
unequal m", Statistics and Computing 9, 3-8), and the variance counts by the share that was not seen (the finite
population correction; Cochran 1977, "Sampling Techniques", chapter 2). On all ground counts: that stems were not found,
and how uncertain the detection is; errors of the diameters, each stem's own and what all have in common; stems that
fusion took for two, or two for one; stems at the edge, which an error of position moves in or out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy import stats

from companion.stand.figures.detection import PARAMETERS, Fit, Sightings
from companion.stand.figures.ground import Floats, Ints
from companion.stand.fusion.fuse import FusedStem
from mission.common.plane import Point, area_m2

M2_PER_HA: Final = 10_000.0
CONFIDENCE: Final = 0.95
BLOCKS: Final = 20  # about so many,
BLOCK_MIN_M: Final = 8.0  # not smaller: neighbours would be alike
BLOCK_MAX_M: Final = 30.0
BLOCKS_MIN: Final = 6  # fewer tell nothing of what was not seen
SEEN_WHOLE: Final = 0.999  # share from which nothing is left that blocks must tell
FOUND_LEAST: Final = 0.25  # of a stem: when a block is left out, detection may turn out lower than where ground counts
FUSION_SD: Final = 0.01  # share of stems that fusion splits or merges wrongly (docs/explanation/stand-figures.md)


class Estimate(NamedTuple):
    """A figure and its interval; None: nothing tells one."""

    value: float
    low: float | None
    high: float | None


class Influence(NamedTuple):
    """Changes of a figure (of a relative one, of its logarithm) with each stem's weight, and with each's diameter; the
    standard deviation of what all have in common; and that of what is of no single stem."""

    of_weight: Floats
    of_dbh_per_m: Floats
    common_sd: float
    other_sd: float = 0.0


class IntervalOf(Protocol):
    """A figure's estimate from its replicates: rows of Sample.weights and Sample.ha."""

    def __call__(self, replicates: Floats, influence: Influence, *, is_relative: bool) -> Estimate: ...


@dataclass(frozen=True, slots=True)
class Sample:
    """n stems on the ground seen, in replicates: all; then without each of B blocks; then with detection off by one
    standard deviation, in each of its principal directions."""

    dbh_m: Floats
    dbh_sd_m: Floats
    taper_sd_m: Floats
    weights: Floats  # (1 + B + parameters) x n: one over the probability that it was found
    ha: Floats  # ground seen
    block_share: Floats  # B
    parameters: int
    seen_share: float  # of the area; 1 without one
    edge_stems: float  # expected number that an error of position moves over the edge


def sample_of(
    stems: Sequence[FusedStem],
    places_m: Floats,
    kept: npt.NDArray[np.bool_],
    detection: tuple[Sightings, Fit, Floats],
    ground: tuple[Floats, float],
    area_m: Sequence[Point] | None,
) -> Sample:
    """Of the stems that are `kept`. detection: looks at the stems, fit and scores; ground: cells seen, their size."""
    sighted, fit, own = detection
    ground_m, cell_m = ground
    seen_m2 = len(ground_m) * cell_m**2
    side_m = min(BLOCK_MAX_M, max(BLOCK_MIN_M, math.sqrt(seen_m2 / BLOCKS)))
    squares = np.floor(np.vstack((ground_m, places_m[kept])) / side_m).astype(np.int64)
    _, block = np.unique(squares, axis=0, return_inverse=True)
    block = block.ravel()
    block_m2 = np.bincount(block[: len(ground_m)], minlength=int(block.max()) + 1) * cell_m**2
    values = _values(fit, own[kept], block[len(ground_m) :], np.flatnonzero(block_m2))
    count = int(kept.sum())
    weights = np.empty((len(values), count))
    for row, (theta, left_out) in enumerate(values):
        found = sighted.found(theta)[kept]
        weights[row] = np.where(left_out, 0.0, 1.0 / np.maximum(found, FOUND_LEAST))
    block_m2 = block_m2[block_m2 > 0.0]
    gone_m2 = np.concatenate(([0.0], block_m2, np.zeros(PARAMETERS)))
    chosen = [s for s, is_kept in zip(stems, kept.tolist(), strict=True) if is_kept]
    position_sd_m = float(np.median([s.position_sd_m for s in chosen])) if chosen else 0.0
    return Sample(
        dbh_m=np.asarray([s.dbh_m for s in chosen]),
        dbh_sd_m=np.asarray([s.dbh_sd_m for s in chosen]),
        taper_sd_m=np.asarray([s.taper_sd_m for s in chosen]),
        weights=weights,
        ha=np.maximum(seen_m2 - gone_m2, cell_m**2) / M2_PER_HA,
        block_share=np.asarray(block_m2 / seen_m2, dtype=np.float64),
        parameters=PARAMETERS,
        seen_share=1.0 if area_m is None else min(1.0, seen_m2 / area_m2(area_m)),
        # a band as wide as the mean error, along an edge as long as a square's
        edge_stems=count / seen_m2 * 4.0 * math.sqrt(seen_m2) * math.sqrt(2.0 / math.pi) * position_sd_m,
    )


def intervals_of(sample: Sample, confidence: float = CONFIDENCE) -> IntervalOf:
    """Makes the estimates of `sample`; `confidence`: that the true value is in an interval, 0..1."""
    blocks = len(sample.block_share)
    freedom = 1.0 / float((sample.block_share**2).sum()) - 1.0
    normal = float(stats.norm.ppf(0.5 + confidence / 2.0))
    student = float(stats.t.ppf(0.5 + confidence / 2.0, max(freedom, 1.0)))
    is_whole = sample.seen_share >= SEEN_WHOLE

    def interval(replicates: Floats, influence: Influence, *, is_relative: bool) -> Estimate:
        value = float(replicates[0])
        if (blocks < BLOCKS_MIN and not is_whole) or (is_relative and value <= 0.0):
            return Estimate(value, None, None)
        told = np.log(np.maximum(replicates, value * 1e-3)) if is_relative else replicates
        varied = _jackknife_variance(told[: blocks + 1], sample.block_share) * (1.0 - sample.seen_share)
        measured = _measured_variance(sample, told[blocks + 1 :] - told[0], influence)
        half = math.sqrt(student**2 * varied + normal**2 * measured)
        if is_relative:
            return Estimate(value, value * math.exp(-half), value * math.exp(half))
        return Estimate(value, max(0.0, value - half), value + half)

    return interval


def _values(fit: Fit, own: Floats, block: Ints, blocks: Ints) -> list[tuple[Floats, npt.NDArray[np.bool_]]]:
    """Parameters of detection in each replicate, and the stems that are left out there."""
    nobody = np.zeros(len(own), dtype=np.bool_)
    found = [(fit.values, nobody)]
    for k in blocks.tolist():
        left_out = block == k
        found.append((fit.values - fit.covariance @ own[left_out].sum(axis=0), left_out))
    return found + [(fit.values + column, nobody) for column in np.linalg.cholesky(fit.covariance).T]


def _measured_variance(sample: Sample, detection: Floats, influence: Influence) -> float:
    """Of the figure, had all ground been seen; `detection`: its changes with the parameters, each by one sd."""
    weight = sample.weights[0]
    squares = influence.of_weight**2
    missed = float((weight * (weight - 1.0) * squares).sum())
    diameters = float(((weight * influence.of_dbh_per_m * sample.dbh_sd_m) ** 2).sum())
    fusion = (FUSION_SD * len(weight)) ** 2 * float(np.mean(squares)) if len(weight) else 0.0
    edge = sample.edge_stems * float(np.mean(squares)) if len(weight) else 0.0
    rest = influence.common_sd**2 + influence.other_sd**2
    return missed + diameters + fusion + edge + rest + float((detection**2).sum())


def _jackknife_variance(replicates: Floats, share: Floats) -> float:
    """Of a figure: with all blocks, then without each."""
    pseudo = replicates[0] / share - (1.0 / share - 1.0) * replicates[1:]
    middle = len(share) * replicates[0] - ((1.0 - share) * replicates[1:]).sum()
    return float(np.mean((pseudo - middle) ** 2 / (1.0 / share - 1.0)))
