"""Quality of a recorded flight's coverage of d2: the gap that it left, against the smallest one possible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mission.common.forming import GAP_WINDOW_S, ring_tolerance_m
from mission.common.frames import enu_to_ned
from mission.document.model import CoverageShape, Mission
from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.recording import Recording

# A gap this close to the ideal: every vehicle has found its place, give or take.
SETTLED_RATIO = {CoverageShape.RING: 1.15, CoverageShape.SPHERE: 1.2}
ROUNDING = 1e-6  # of a cosine, generously

# Least angle within which n points can have every direction: best known coverings, degrees, n = 1, 2, ...
SPHERE_COVERING_DEG = (
    *(180.0, 90.0, 90.0, 70.5288, 63.4349, 54.7356, 51.0265, 48.1395, 45.8789, 42.3078),
    *(41.4272, 37.3774, 37.0685, 34.9379, 34.0399, 32.8988, 32.0929, 31.0132, 30.3686, 29.6231),
)


@dataclass(frozen=True, slots=True)
class Coverage:
    """Figures of coverage, as `Metrics` names them."""

    gap_deg: float | None
    gap_ideal_deg: float | None
    radius_error_m: float | None
    settled_s: float | None
    uncovering: tuple[int, ...]  # ids


def coverage_figures(
    recording: Recording, mission: Mission, covering: Bools, ideals: Callable[[int], list[float]]
) -> Coverage:
    """The coverage of a flight; `covering` (T,): the phase is COVERAGE; `ideals`: smallest gaps of 1, 2 ... vehicles,
    deg, up to so many."""
    ticks = np.flatnonzero(covering)
    if ticks.size == 0:
        return Coverage(None, None, None, None, ())
    shape = mission.coverage.shape
    time_s = recording.time_s[ticks]
    alive = recording.agent_alive[ticks]
    on_shape = covers(recording, mission)[ticks]
    error_m = radius_error_m(recording, mission)[ticks]
    from_d2_m = recording.pos_ned_m[ticks] - np.array(enu_to_ned(mission.route.d2_enu_m))
    gap_of = ring_gap_deg if shape is CoverageShape.RING else sphere_gap_deg
    gaps_deg = np.array([gap_of(tick_m[on]) for tick_m, on in zip(from_d2_m, on_shape, strict=True)])
    counts = alive.sum(axis=1)
    ideal_of_count = np.array([0.0, *ideals(int(counts.max()))])
    ideals_deg = ideal_of_count[counts]
    loose = np.flatnonzero((gaps_deg > SETTLED_RATIO[shape] * ideals_deg) | (alive & ~on_shape).any(axis=1))
    settled = int(loose[-1]) + 1 if loose.size else 0
    last = time_s >= time_s[-1] - GAP_WINDOW_S
    flying_error_m = error_m[last][(alive & ~recording.on_ground[ticks])[last]]
    return Coverage(
        gap_deg=float(gaps_deg[last].mean()),
        gap_ideal_deg=float(ideals_deg[-1]),
        radius_error_m=float(flying_error_m.max()) if flying_error_m.size else None,
        settled_s=float(time_s[settled] - time_s[0]) if settled < len(time_s) else None,
        uncovering=tuple(int(k) + 1 for k in np.flatnonzero((alive & ~on_shape)[last].any(axis=0))),
    )


def last_of(time_s: Floats, covering: Bools) -> Bools:
    """(T,) the last GAP_WINDOW_S of the ticks in phase COVERAGE, `covering` (T,)."""
    ends_s = float(time_s[covering].max(initial=-np.inf))
    return np.asarray(covering & (time_s >= ends_s - GAP_WINDOW_S))


def covers(recording: Recording, mission: Mission) -> Bools:
    """(T, n) alive, airborne, and on the ring or sphere, give or take `tolerance_m`."""
    on_shape = radius_error_m(recording, mission) <= tolerance_m(mission)
    return np.asarray(recording.agent_alive & ~recording.on_ground & on_shape)


def radius_error_m(recording: Recording, mission: Mission) -> Floats:
    """(T, n) between coverage.radius_m and the distance to d2: level, to its vertical axis, for a ring."""
    from_d2_m = recording.pos_ned_m - np.array(enu_to_ned(mission.route.d2_enu_m))
    axes = 2 if mission.coverage.shape is CoverageShape.RING else 3
    distance_m: Floats = np.linalg.norm(from_d2_m[:, :, :axes], axis=2)
    return np.abs(distance_m - mission.coverage.radius_m)


def tolerance_m(mission: Mission) -> float:
    """Greatest distance from the ring or sphere of a vehicle that counts as on it."""
    return ring_tolerance_m(mission.coverage.radius_m)


def ideal_gap_deg(shape: CoverageShape, n: int) -> float:
    """Smallest gap that n >= 1 vehicles can leave: covering circle or sphere as well as is known."""
    if shape is CoverageShape.RING:
        return 360.0 / n
    if n <= len(SPHERE_COVERING_DEG):
        return SPHERE_COVERING_DEG[n - 1]
    return sphere_covering_bound_deg(n)


def sphere_covering_bound_deg(n: int) -> float:
    """No n >= 3 points cover the sphere within less (L. Fejes Toth).

    It is the circumradius of the equilateral spherical triangle of which 2n - 4 have the sphere's area:
    cos R = cot(A / 2) cot(pi / 3), A its angle.
    """
    angle_rad = (np.pi + 4.0 * np.pi / (2.0 * n - 4.0)) / 3.0
    return float(np.degrees(np.arccos(1.0 / (np.tan(angle_rad / 2.0) * np.tan(np.pi / 3.0)))))


def ring_gap_deg(from_d2_m: Floats) -> float:
    """Largest difference in azimuth between neighbours among k vehicles at (k, 3) NED about d2; none: 360."""
    if len(from_d2_m) == 0:
        return 360.0
    azimuth_deg = np.sort(np.degrees(np.arctan2(from_d2_m[:, 1], from_d2_m[:, 0])))
    return float(np.diff(azimuth_deg, append=azimuth_deg[0] + 360.0).max())


def sphere_gap_deg(from_d2_m: Floats) -> float:
    """Largest angle from any direction to the nearest of k vehicles at (k, 3) NED about d2; none: 180.

    The direction farthest from all points has its nearest ones all round it, three or more: a normal of the
    convex hull. Only when the points leave a hemisphere empty can it face away from the middle of two instead,
    or away from one. Each is a direction: one that is not the farthest does no harm among the candidates.
    """
    radius_m = np.linalg.norm(from_d2_m, axis=1)
    units = from_d2_m[radius_m > 0.0] / radius_m[radius_m > 0.0, None]
    if len(units) == 0:
        return 180.0
    normals = _hull_normals(units)
    nearest = _cosine_of_farthest(normals, units)
    if nearest < ROUNDING:  # an empty hemisphere, which some normal shows
        first, second = np.triu_indices(len(units))
        middles = units[first] + units[second]  # of a point and itself, too
        length = np.linalg.norm(middles, axis=1)
        opposite = -middles[length > 0.0] / length[length > 0.0, None]
        nearest = min(nearest, _cosine_of_farthest(opposite, units))
    return float(np.degrees(np.arccos(np.clip(nearest, -1.0, 1.0))))


def _cosine_of_farthest(directions: Floats, units: Floats) -> float:
    """Cosine of the angle to the nearest of `units` (k, 3), from the farthest of `directions` (D, 3)."""
    return float((directions @ units.T).max(axis=1).min())


def _hull_normals(units: Floats) -> Floats:
    """(F, 3) outward unit normals of the faces of the convex hull of `units` (k, 3); both sides of a flat one."""
    if len(units) > 3:
        from scipy.spatial import ConvexHull, QhullError  # takes half a second, which a ring does not need

        try:
            return np.asarray(ConvexHull(units).equations[:, :3], dtype=np.float64)
        except QhullError:  # all in one plane
            pass
    # Of a flat hull, the direction in which the points extend least
    normal = np.linalg.svd(units - units.mean(axis=0))[2][-1]
    return np.stack((normal, -normal))
