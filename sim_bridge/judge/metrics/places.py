"""The smallest gap that vehicles on a ring can leave where trunks stand in it."""

from __future__ import annotations

import math

import numpy as np

from mission.document.model import CoverageShape, Mission
from mission.stand.stand import Stand
from sim_bridge.judge.metrics.arrays import Floats
from sim_bridge.judge.metrics.coverage import ideal_gap_deg, tolerance_m

BEARINGS = 720  # half a degree
STEP_M = 0.5  # along the radius
CLEAR_M = 0.3  # around a vehicle, where the mission has no [sensing] that says more


def ideal_among_trees_deg(mission: Mission, stand: Stand, n: int) -> float:
    """Smallest gap that n >= 1 vehicles can leave about d2, none of them in a place where a trunk stands.

    A bearing is free when a vehicle that is on the ring, give or take `tolerance_m`, keeps its radius and margin
    from all trunks there. Without a free one: that of an open ring.
    """
    return ideals_among_trees_deg(mission, stand, n)[-1]


def ideals_among_trees_deg(mission: Mission, stand: Stand, most: int) -> list[float]:
    """The same for 1, 2 ... `most` vehicles."""
    open_deg = [ideal_gap_deg(mission.coverage.shape, n) for n in range(1, most + 1)]
    if mission.coverage.shape is not CoverageShape.RING:
        return open_deg
    free_deg = _free_bearings_deg(mission, stand)
    if len(free_deg) in (0, BEARINGS):
        return open_deg
    return [_least_that_closes_deg(free_deg, ideal_deg, n) for n, ideal_deg in enumerate(open_deg, start=1)]


def _least_that_closes_deg(free_deg: Floats, ideal_deg: float, n: int) -> float:
    low, high = ideal_deg, 360.0
    while high - low > 180.0 / BEARINGS:
        middle = (low + high) / 2.0
        low, high = (low, middle) if _closes(free_deg, middle, n) else (middle, high)
    return high


def _free_bearings_deg(mission: Mission, stand: Stand) -> Floats:
    sensing = mission.sensing
    clear_m = CLEAR_M if sensing is None else sensing.vehicle_radius_m + sensing.margin_m
    east_m, north_m, _ = mission.route.d2_enu_m
    off_m = tolerance_m(mission)
    offsets_m = np.arange(-off_m, off_m + STEP_M / 2.0, STEP_M)
    free = []
    for k in range(BEARINGS):
        bearing = math.tau * k / BEARINGS
        for radius_m in mission.coverage.radius_m + offsets_m:
            pos_enu_m = (east_m + radius_m * math.sin(bearing), north_m + radius_m * math.cos(bearing))
            if not stand.near(*pos_enu_m, clear_m):
                free.append(360.0 * k / BEARINGS)
                break
    return np.array(free)


def _closes(free_deg: Floats, gap_deg: float, n: int) -> bool:
    """True where n of the free bearings go round with no gap above `gap_deg`: from each start as far as it goes."""
    twice = np.concatenate((free_deg, free_deg + 360.0))
    reach = np.searchsorted(twice, twice + gap_deg + 1e-9, side="right") - 1
    starts = np.flatnonzero(free_deg <= free_deg[0] + gap_deg)
    at = starts.copy()
    for _ in range(n - 1):
        at = reach[at] if (at < len(twice)).all() else at
    return bool((twice[at] + gap_deg + 1e-9 >= free_deg[starts] + 360.0).any())
