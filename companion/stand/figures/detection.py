"""Detection: the probability that a look finds a stem, and all looks at a place together, fitted to what looks found.

A look finds a stem with 1 - exp(-h). The hazard h adds up over the points of the track that had the stem in sight; what
a point adds depends on its ring of distance, farther ones alike to nearer ones but for what the looks say, and on the
stem's diameter. The fit is that of capture-recapture with covariates, given that a stem was found at all (Huggins 1989,
"On the statistical analysis of capture experiments", Biometrika 76, 133-140). It learns from stems that were looked at
more than once, and from them alone: it needs neither that stems stand at random about the track, as distance sampling
does (vehicles keep clear of trunks), nor that a near stem is surely found. Priors hold where looks say nothing,
loosely.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from companion.stand.figures.ground import RINGS, Floats, Ints, Looks

LEVEL: Final = (-1.0, 1.5)  # log hazard of a point near by, before anything is known, and its standard deviation
FALL: Final = (-0.5, 1.0)  # its change from one ring to the next farther
SIZE: Final = (0.3, 0.3)  # power of the diameter over DBH_REFERENCE_M
DBH_REFERENCE_M: Final = 0.25  # of a stem that might stand on a cell
PARAMETERS: Final = RINGS + 1
LOG_HAZARD: Final = (-8.0, 4.0)  # beyond, nothing or all is found
STEP: Final = 1e-4  # of differences
LEAST: Final = 1e-6  # probability
HAZARD_MAX: Final = 50.0
CURVATURE_STEP: Final = 1e-2


@dataclass(frozen=True, slots=True)
class Sightings:
    """Places, stems or cells, and the looks at them."""

    points: Floats  # of each look, in each ring
    place: Ints  # of each look
    log_size: Floats  # of each place: log of its diameter over DBH_REFERENCE_M
    looks: Ints  # of each place, how many

    def hazard(self, values: Floats) -> Floats:
        """Of each look."""
        near = self.points @ np.exp(np.clip(values[:RINGS], *LOG_HAZARD))
        size = np.clip(values[RINGS] * self.log_size[self.place], *LOG_HAZARD)
        hazard: Floats = near * np.exp(size)
        return np.minimum(hazard, HAZARD_MAX)

    def found(self, values: Floats) -> Floats:
        """Probability, of each place, that one look at least finds a stem there; 0 without a look."""
        return -np.expm1(-np.bincount(self.place, self.hazard(values), len(self.log_size)))


class Fit(NamedTuple):
    """Log hazards of a point in each ring, and the power of the diameter; the inverse of the information about them."""

    values: Floats
    covariance: Floats


def sightings_of(looks: Looks, dbh_m: Floats) -> Sightings:
    """Of places with stems of these diameters."""
    count = len(dbh_m)
    size = np.log(np.maximum(dbh_m, 0.01) / DBH_REFERENCE_M)
    return Sightings(looks.points, looks.place, size, np.bincount(looks.place, minlength=count))


def fit_detection(stems: Sightings, is_found: npt.NDArray[np.bool_]) -> Fit:
    """`stems`: that were found; `is_found`: of their looks, those that found them."""
    start = np.append(LEVEL[0] + FALL[0] * np.arange(RINGS), SIZE[0])

    def loss(values: Floats) -> float:
        return _surprise(values) - float(_log_likelihoods(values, stems, is_found).sum())

    fitted = np.asarray(minimize(loss, start, method="BFGS").x)
    information = _curvature(loss, fitted)
    if np.linalg.eigvalsh(information).min() <= 0.0:
        information = _curvature(_surprise, fitted)  # the prior alone tells as much
    return Fit(fitted, np.linalg.inv(information).astype(np.float64))


def _surprise(values: Floats) -> float:
    """Minus the log of the prior."""
    told = (values[0] - LEVEL[0]) / LEVEL[1], (values[RINGS] - SIZE[0]) / SIZE[1]
    falls = (np.diff(values[:RINGS]) - FALL[0]) / FALL[1]
    return 0.5 * float(told[0] ** 2 + told[1] ** 2 + (falls**2).sum())


def _curvature(function: Callable[[Floats], float], at: Floats) -> Floats:
    found = np.empty((PARAMETERS, PARAMETERS))
    steps = np.eye(PARAMETERS) * CURVATURE_STEP
    for i, a in enumerate(steps):
        for j, b in enumerate(steps):
            around = function(at + a + b) - function(at + a - b) - function(at - a + b) + function(at - a - b)
            found[i, j] = around / (4.0 * CURVATURE_STEP**2)
    return found


def scores(fit: Fit, stems: Sightings, is_found: npt.NDArray[np.bool_]) -> Floats:
    """Of each stem, the gradient of its log likelihood: count x parameters."""
    columns = []
    for k in range(PARAMETERS):
        step = np.eye(PARAMETERS)[k] * STEP
        up, down = (_log_likelihoods(fit.values + s, stems, is_found) for s in (step, -step))
        columns.append((up - down) / (2.0 * STEP))
    return np.column_stack(columns)


def _log_likelihoods(values: Floats, stems: Sightings, is_found: npt.NDArray[np.bool_]) -> Floats:
    """Of each stem, given that it was found: which looks found it."""
    hazard = stems.hazard(values)
    each = np.where(is_found, np.log(np.maximum(-np.expm1(-hazard), LEAST)), -hazard)
    own = np.bincount(stems.place, each, len(stems.log_size)).astype(np.float64)
    return own - np.log(np.maximum(stems.found(values), LEAST))
