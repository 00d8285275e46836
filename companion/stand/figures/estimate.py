"""Figures of the stand: stems weighed by how likely they were found, per hectare of ground seen, with intervals.

The weighing is Horvitz & Thompson's (1952, Journal of the American Statistical Association 47, 663-685); `intervals`
says how far a figure may be off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import stats

from companion.stand.figures.detection import DBH_REFERENCE_M, fit_detection, scores, sightings_of
from companion.stand.figures.ground import LOOK_GAP_S, Grid, Looks, grid_of, looks_at, track_of, within_area
from companion.stand.figures.intervals import (
    CONFIDENCE,
    M2_PER_HA,
    Estimate,
    Influence,
    Sample,
    intervals_of,
    sample_of,
)
from companion.stand.form_height import FORM_HEIGHT_M
from companion.stand.fusion.fuse import FusedStem, Fusion
from companion.stand.records import Harvest
from companion.survey.observation import Grade
from mission.common.plane import Point, area_m2

DBH_MIN_M: Final = 0.10  # stems that are counted: from 10 cm, as many inventories have it
LIMIT_BAND_M: Final = 0.02  # on both sides of it, to see how many stems stand there
CLASS_M: Final = 0.05  # of diameters
FOUND_MIN: Final = 0.5  # ground is seen where a stem would have been found more likely than not: weights are 2 at most
REPEATED_MIN: Final = 25  # stems looked at twice: from so many on, ground that was looked at once counts, too
SEEN_MIN_HA: Final = 0.03  # of less ground, or fewer stems, nothing is said
STEMS_MIN: Final = 10
COMMON_SD_M: Final = 0.003  # of all diameters: what a sensor of 0.5 cm bias at most may have, evenly between
TAPER_COMMON: Final = 0.5  # share of the variance that taper adds which trees of one stand have in common


@dataclass(frozen=True, slots=True)
class DiameterClass:
    """Stems per hectare whose diameter is from_cm to less than from_cm + 5."""

    from_cm: int
    stems_per_ha: Estimate


@dataclass(frozen=True, slots=True)
class StandFigures:
    """Of stems of DBH_MIN_M and more, on the ground that was seen."""

    stems: int  # found there
    seen_ha: float
    area_ha: float | None  # of the mission's area; None: it has none
    found_share: float  # of the stems on the ground seen, as estimated
    stems_per_ha: Estimate
    basal_area_m2_per_ha: Estimate
    volume_m3_per_ha: Estimate
    dbh_mean_cm: Estimate
    dbh_quadratic_mean_cm: Estimate
    classes: tuple[DiameterClass, ...]
    blocks: int
    form_height_m: float

    @property
    def seen_share(self) -> float:
        """Of the mission's area; 1 where there is none."""
        return min(1.0, self.seen_ha / self.area_ha) if self.area_ha else 1.0


@dataclass(frozen=True, slots=True)
class SeenGround:
    """Figures, and the grid that they are of."""

    figures: StandFigures | None  # None: too little ground was seen
    grid: Grid
    is_seen: npt.NDArray[np.bool_]  # of each cell


def figures_of(
    harvest: Harvest,
    fusion: Fusion,
    *,
    area_m: Sequence[Point] | None,
    form_height_m: float = FORM_HEIGHT_M,
    confidence: float = CONFIDENCE,
) -> SeenGround:
    """`area_m`: the polygon (east, north) that the figures are of; None: all that was seen.

    `confidence`: of the intervals.
    """
    track = track_of(harvest.track, fusion)
    grid = grid_of(track, area_m)
    trunks_m = np.asarray([(s.east_m, s.north_m) for s in fusion.stems]).reshape(-1, 2)
    radii_m = np.asarray([s.dbh_m / 2.0 for s in fusion.stems])
    stems = [s for s in fusion.stems if s.is_counted and s.dbh_m >= DBH_MIN_M]
    places_m = np.asarray([(s.east_m, s.north_m) for s in stems]).reshape(-1, 2)
    looks = looks_at(places_m, track, trunks_m, radii_m)
    sighted = sightings_of(looks, np.asarray([s.dbh_m for s in stems]))
    cells = looks_at(grid.middle_m, track, trunks_m, radii_m)
    ground = sightings_of(cells, np.full(len(grid.middle_m), DBH_REFERENCE_M))
    is_found = _found(looks, stems, harvest, fusion)
    fit = fit_detection(sighted, is_found)
    looks_min = 1 if int((sighted.looks > 1).sum()) >= REPEATED_MIN else 2
    is_seen = (ground.found(fit.values) >= FOUND_MIN) & (ground.looks >= looks_min)
    kept = (sighted.found(fit.values) >= FOUND_MIN) & (sighted.looks >= looks_min)
    if area_m is not None:
        kept &= within_area(places_m, area_m)
    seen_ha = float(is_seen.sum()) * grid.cell_m**2 / M2_PER_HA
    if seen_ha < SEEN_MIN_HA or kept.sum() < STEMS_MIN:
        return SeenGround(None, grid, is_seen)
    own = scores(fit, sighted, is_found)
    sample = sample_of(stems, places_m, kept, (sighted, fit, own), (grid.middle_m[is_seen], grid.cell_m), area_m)
    thin = _at_limit([s for s in fusion.stems if s.is_counted])
    return SeenGround(_figures(sample, thin, area_m, form_height_m, confidence), grid, is_seen)


def _found(looks: Looks, stems: Sequence[FusedStem], harvest: Harvest, fusion: Fusion) -> npt.NDArray[np.bool_]:
    """Of each look, whether an observation of its stem was made in it."""
    index = {log: k for k, log in enumerate(fusion.logs)}
    times: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for j, stem in enumerate(stems):
        for i in stem.observed:
            _, observation, session = harvest.observations[i]
            if observation.grade is Grade.POOR:  # as if it were not: only better ones make a stem count
                continue
            times.setdefault((j, index[session]), []).append((observation.first_s, observation.last_s))
    margin_s = LOOK_GAP_S / 2.0
    ends = zip(looks.place.tolist(), looks.log.tolist(), looks.first_s.tolist(), looks.last_s.tolist(), strict=True)
    return np.asarray(
        [
            any(a <= last_s + margin_s and first_s - margin_s <= b for a, b in times.get((j, log), ()))
            for j, log, first_s, last_s in ends
        ],
        dtype=np.bool_,
    )


def _at_limit(stems: Sequence[FusedStem]) -> tuple[float, float]:
    """Stems that an error of all diameters would bring over DBH_MIN_M, per metre of it, and the standard deviation of
    those that errors of their own do: both over the number of stems."""
    d_m, sd_m = np.asarray([s.dbh_m for s in stems]), np.asarray([s.dbh_sd_m for s in stems])
    count = max(1, int((d_m >= DBH_MIN_M).sum()))
    near = float((np.abs(d_m - DBH_MIN_M) < LIMIT_BAND_M).sum()) / (2.0 * LIMIT_BAND_M)
    above = stats.norm.cdf((d_m - DBH_MIN_M) / sd_m)
    return near / count, float(np.sqrt((above * (1.0 - above)).sum())) / count


def _figures(
    sample: Sample,
    at_limit: tuple[float, float],
    area_m: Sequence[Point] | None,
    form_height_m: float,
    confidence: float,
) -> StandFigures:
    d_m, count = sample.dbh_m, len(sample.dbh_m)
    weights, ha = sample.weights, sample.ha
    total = np.maximum(weights.sum(axis=1), 1e-12)
    squares = np.pi / 4.0 * (d_m**2 - sample.dbh_sd_m**2)  # an error of a diameter makes its square larger
    basal = weights @ squares
    mean_m = weights @ d_m / total
    quadratic_m = np.sqrt(np.maximum(basal / total * 4.0 / np.pi, 1e-12))
    taper_m = math.sqrt(TAPER_COMMON) * float(np.median(sample.taper_sd_m)) if count else 0.0
    common_m = math.hypot(COMMON_SD_M, taper_m)
    interval = intervals_of(sample, confidence)
    n, g, q_m = float(total[0]), max(float(basal[0]), 1e-12), float(quadratic_m[0])
    number = Influence(np.full(count, 1.0 / n), np.zeros(count), common_m * at_limit[0], at_limit[1])
    area = Influence(squares / g, np.pi / 2.0 * d_m / g, 2.0 * common_m / q_m)
    mean = Influence((d_m - mean_m[0]) / n * 100.0, np.full(count, 100.0 / n), 100.0 * common_m)
    quadratic = Influence((squares - g / n) * 200.0 / (np.pi * q_m * n), d_m * 100.0 / (q_m * n), 100.0 * common_m)
    return StandFigures(
        stems=count,
        seen_ha=float(ha[0]),
        area_ha=None if area_m is None else area_m2(area_m) / M2_PER_HA,
        found_share=min(1.0, count / n) if count else 1.0,
        stems_per_ha=interval(weights.sum(axis=1) / ha, number, is_relative=True),
        basal_area_m2_per_ha=interval(basal / ha, area, is_relative=True),
        volume_m3_per_ha=interval(basal / ha * form_height_m, area, is_relative=True),
        dbh_mean_cm=interval(100.0 * mean_m, mean, is_relative=False),
        dbh_quadratic_mean_cm=interval(100.0 * quadratic_m, quadratic, is_relative=False),
        classes=tuple(_classes(sample, confidence)),
        blocks=len(ha) - 1 - sample.parameters,
        form_height_m=form_height_m,
    )


def _classes(sample: Sample, confidence: float) -> Iterator[DiameterClass]:
    """From the thinnest to the thickest, empty ones between them too."""
    own = np.floor(sample.dbh_m / CLASS_M + 1e-9).astype(np.int64)
    interval = intervals_of(sample, confidence)
    for k in range(int(own.min()), int(own.max()) + 1) if len(own) else ():
        is_in = (own == k).astype(np.float64)
        low, high = (stats.norm.cdf((edge * CLASS_M - sample.dbh_m) / sample.dbh_sd_m) for edge in (k, k + 1))
        doubt = (high - low) * (1.0 - (high - low))  # variance of being in it, for the error of the diameter
        # sqrt(doubt) as if by a diameter of that error
        influence = Influence(is_in / sample.ha[0], np.sqrt(doubt) / sample.dbh_sd_m / sample.ha[0], 0.0)
        replicates = sample.weights @ is_in / sample.ha
        yield DiameterClass(round(100 * CLASS_M) * k, interval(replicates, influence, is_relative=False))
