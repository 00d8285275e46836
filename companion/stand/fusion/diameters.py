"""Diameters of one stem, measured several times, become one with its error.

Inverse variance, with a variance between observations besides (bark, a trunk that is not round, fits that are worse
than they say): one for the whole stand, in a share of the diameter, by the method of Paule & Mandel (1982, "Consensus
values and weighting factors", Journal of Research of the National Bureau of Standards 87, 377-385), because a stem
alone has too few. Observations that fit badly count less. An error that taper adds is common to all that came to breast
height by it: it is not averaged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.stand.fusion.windows import DIAMETER_SD_MIN_M, Floats
from companion.survey.observation import StemObservation

BETWEEN_MAX: Final = 0.5  # share of the diameter
REPEATED_MIN: Final = 10  # stems seen more than once; fewer do not tell it,
BETWEEN_USUAL: Final = 0.02  # and it is taken to be what a trunk is out of round
BISECTIONS: Final = 40
HUBER: Final = 2.0  # standard deviations of a diameter: 5 % of good ones are beyond
HUBER_SQUARES: Final = 2.0 * HUBER**2  # a single wrong diameter must not speak for the stand
REWEIGHTINGS: Final = 5
SAME_CUT_M: Final = 0.3  # cuts within this height of each other are of one diameter
MEASURED, TAPER, BOTH = "measured", "taper", "measured and taper"


class FusedDiameter(NamedTuple):
    """A stem's diameters."""

    dbh_m: float
    dbh_sd_m: float
    dbh_from: str  # MEASURED, TAPER or BOTH
    taper_sd_m: float  # the part of dbh_sd_m that taper adds
    cut_up_m: float  # above the ground
    diameter_m: float  # at the cut
    diameter_sd_m: float


def between_share(stems: Sequence[Sequence[StemObservation]]) -> float:
    """Standard deviation between observations of one stem, over its diameter; 0 where errors explain all."""
    kept = [part for members in stems if len(members) > 1 and len(part := _at_cut(members)) > 1]
    if len(kept) < REPEATED_MIN:
        return BETWEEN_USUAL
    stem = np.repeat(np.arange(len(kept)), [len(part) for part in kept])
    d: Floats = np.asarray([o.diameter_m for part in kept for o in part])
    sd: Floats = np.maximum([o.diameter_sd_m for part in kept for o in part], DIAMETER_SD_MIN_M)
    typical = np.asarray([np.median([o.diameter_m for o in part]) for part in kept])[stem]

    def excess(share: float) -> float:
        weight = 1.0 / (sd**2 + (share * typical) ** 2)
        mean = np.bincount(stem, weight * d) / np.bincount(stem, weight)
        squares = weight * (d - mean[stem]) ** 2
        return float(np.minimum(squares, HUBER_SQUARES).sum()) - (len(d) - len(kept))

    low, high = 0.0, BETWEEN_MAX
    if excess(low) <= 0.0:
        return 0.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high


def fuse_diameters(members: Sequence[StemObservation], between: float) -> FusedDiameter:
    """Of one stem; `between`: of the stand, as `between_share` finds it."""
    measured = [o for o in members if o.is_dbh_measured]
    tapered = [o for o in members if not o.is_dbh_measured]
    parts = []  # diameter, its variance, the part of that by taper
    if measured:
        value, variance = _fused([(o.dbh_m, o.dbh_sd_m) for o in measured], between)
        parts.append((value, variance, 0.0))
    if tapered:
        noise = [(o.dbh_m, min(o.diameter_sd_m, o.dbh_sd_m)) for o in tapered]
        value, variance = _fused(noise, between)
        added = float(np.median([max(0.0, o.dbh_sd_m**2 - o.diameter_sd_m**2) for o in tapered]))
        parts.append((value, variance + added, added))
    total = sum(1.0 / variance for _, variance, _ in parts)
    taper = sum(added / variance**2 for _, variance, added in parts) / total**2
    cut = _at_cut(members)
    diameter, diameter_variance = _fused([(o.diameter_m, o.diameter_sd_m) for o in cut], between)
    return FusedDiameter(
        dbh_m=sum(value / variance for value, variance, _ in parts) / total,
        dbh_sd_m=total**-0.5,
        dbh_from=BOTH if len(parts) > 1 else MEASURED if measured else TAPER,
        taper_sd_m=taper**0.5,
        cut_up_m=float(np.average([o.cut_up_m for o in cut], weights=[max(1, o.rays) for o in cut])),
        diameter_m=diameter,
        diameter_sd_m=diameter_variance**0.5,
    )


def _at_cut(members: Sequence[StemObservation]) -> list[StemObservation]:
    """Observations cut at the height of the one with the least error."""
    best = min(members, key=lambda o: (o.diameter_sd_m, o.cut_up_m, o.diameter_m))
    return [o for o in members if abs(o.cut_up_m - best.cut_up_m) <= SAME_CUT_M]


def _fused(values: Sequence[tuple[float, float]], between: float) -> tuple[float, float]:
    """Of (diameter, sd): the robust weighted mean, and its variance."""
    column: Floats = np.asarray(values, dtype=np.float64)
    d = column[:, 0]
    middle = float(np.median(d))
    variance = np.maximum(column[:, 1], DIAMETER_SD_MIN_M) ** 2 + (between * middle) ** 2
    mean = middle if len(d) > 2 else float(np.sum(d / variance) / np.sum(1.0 / variance))
    weight = 1.0 / variance
    for _ in range(REWEIGHTINGS):
        away = np.abs(d - mean) / np.sqrt(variance)
        weight = np.minimum(1.0, HUBER / np.maximum(away, 1e-9)) / variance
        mean = float(np.sum(weight * d) / np.sum(weight))
    return mean, float(1.0 / np.sum(weight))
