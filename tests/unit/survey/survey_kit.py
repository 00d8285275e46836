"""Rays at one stem, made as a lidar that flies past would have them."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable

import numpy as np

from companion.survey.alignment import JointFit, ScanCorrections
from companion.survey.stem_fit import StemFit
from companion.survey.stem_rays import COLUMNS, LEFT, RIGHT, StemRays
from mission.schema.kinds import RAW_LIDARS, RawLidar, SensorClass

LIDAR = RAW_LIDARS[SensorClass.MULTI_LAYER]
SLANT = 0.8  # cosine of how far the rays point down


def passing(length_m: float = 8.0, aside_m: float = 3.0, scans: int = 60) -> list[tuple[float, float]]:
    """Eyes along a straight way past the origin."""
    return [(-aside_m, length_m * (k / (scans - 1) - 0.5)) for k in range(scans)]


def rays_at(
    outline_m: Callable[[float], float],
    eyes: Iterable[tuple[float, float]],
    rng: np.random.Generator,
    *,
    lidar: RawLidar = LIDAR,
    place: tuple[float, float] = (0.0, 0.0),
    lean: tuple[float, float] = (0.0, 0.0),
    up_m: tuple[float, ...] = (1.0, 1.3, 1.6),
) -> array[float]:
    """Rows of StemRays.rays at a stem whose radius in each direction is `outline_m(bearing)`."""
    rows: array[float] = array("f")
    half = math.radians(lidar.beam_deg) / 2.0
    step = math.radians(lidar.step_deg)
    for scan, (eye_n, eye_e) in enumerate(eyes):
        for up in up_m:
            n, e = place[0] + lean[0] * (up - 1.3) - eye_n, place[1] + lean[1] * (up - 1.3) - eye_e
            away, towards = math.hypot(n, e), math.atan2(e, n)
            phase = rng.random() * step
            bearings = [towards + k * step + phase for k in range(-40, 41)]
            hits = [_first_hit(outline_m, away, towards, bearing, half) for bearing in bearings]
            for k in range(1, 80):
                hit = hits[k]
                if hit is None:
                    continue
                edge = (LEFT if hits[k - 1] is None else 0) + (RIGHT if hits[k + 1] is None else 0)
                level = hit + rng.normal(0.0, lidar.range_sd_m) * SLANT
                place_n, place_e = eye_n + level * math.cos(bearings[k]), eye_e + level * math.sin(bearings[k])
                rows.extend((place_n, place_e, up, eye_n, eye_e, float(edge), level / SLANT, float(scan), 0.0))
    return rows


def _first_hit(
    outline_m: Callable[[float], float], away: float, towards: float, bearing: float, half: float
) -> float | None:
    """Level metres to where a ray as wide as its beam meets the outline first."""
    best: float | None = None
    for within in np.linspace(-half, half, 5) / SLANT:
        off = bearing + within - towards
        radius = outline_m(bearing + math.pi)
        for _ in range(4):  # the outline hardly changes from there to there
            aside = away * math.sin(off)
            if abs(aside) >= radius:
                break
            along = away * math.cos(off) - math.sqrt(radius * radius - aside * aside)
            at = math.atan2(along * math.sin(off), along * math.cos(off) - away) + towards
            radius = outline_m(at)
        else:
            best = along if best is None else min(best, along)
    return best


def stem_of(rays: array[float], start: tuple[float, float, float] = (0.05, -0.05, 0.1)) -> StemRays:
    """As it was tracked, with these rays."""
    stem = StemRays(*start, now_s=0.0)
    stem.rays = rays
    return stem


def fitted(*rays: array[float], lidar: RawLidar = LIDAR, taper: float = 0.0) -> list[StemFit | None]:
    """The stems of one window, fitted together."""
    starts = [(float(np.median(one[0::COLUMNS])), float(np.median(one[1::COLUMNS])), 0.1) for one in rays]
    stems = [stem_of(one, start) for one, start in zip(rays, starts, strict=True)]
    joint = JointFit([(stem, 1.3) for stem in stems], lidar, taper, ScanCorrections())
    for _ in joint.steps():
        pass
    return [joint.fit_of(k) for k in range(len(stems))]
