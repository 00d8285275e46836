"""Distance by which vehicles left the mission's fence."""

from __future__ import annotations

import numpy as np

from mission.common import plane
from mission.document.model import Mission
from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.recording import Recording


def fence_exceeded_m(recording: Recording, mission: Mission) -> float:
    """Greatest distance outside of fence.polygon_enu_m (level) or above fence.altitude_max_m, of a vehicle off the
    ground that has run into nothing; 0.0: none left it. Of all the highest one alone may be up to survey.rise_to_m."""
    flying = ~recording.on_ground & (recording.touched == 0)
    above_m = _above_m(np.where(flying, -recording.pos_ned_m[..., 2], -np.inf), mission)
    north_m, east_m = (recording.pos_ned_m[..., axis][flying] for axis in range(2))
    polygon = mission.fence.polygon_enu_m
    if polygon is None:
        return above_m
    outside = ~_inside(east_m, north_m, polygon)
    points = zip(east_m[outside].tolist(), north_m[outside].tolist(), strict=True)
    return max([above_m, *(-plane.clearance_m(point, polygon) for point in points)])


def _above_m(up_m: Floats, mission: Mission) -> float:
    """Greatest height of (ticks, vehicles) above what each may; 0.0: none is."""
    if mission.rise_to_m is None or up_m.shape[1] == 0:
        return float((up_m - mission.fence.altitude_max_m).max(initial=0.0))
    rising = np.sort(up_m, axis=1)
    others_m = float((rising[:, :-1] - mission.fence.altitude_max_m).max(initial=0.0))
    return max(others_m, float((rising[:, -1] - mission.rise_to_m).max(initial=0.0)))


def _inside(east_m: Floats, north_m: Floats, polygon: tuple[tuple[float, float], ...]) -> Bools:
    """(k,) even-odd rule."""
    inside = np.zeros(east_m.shape, dtype=np.bool_)
    for a, b in plane.edges(polygon):
        if a[1] != b[1]:
            crosses = (a[1] > north_m) != (b[1] > north_m)
            inside ^= crosses & (east_m < a[0] + (north_m - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
    return inside
