"""What level lidars of many vehicles see at once, as drivers fill OBSTACLE_DISTANCE: the nearest of each sector."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.lab.study.law import Floats

SECTORS = 72
STEP_RAD = math.tau / SECTORS


def scan_m(
    pos_enu_m: Floats, yaw_rad: Floats, trunks_enu_m: Floats, bodies_enu_m: Floats, *, reach_m: float, radius_m: float
) -> Floats:
    """(n, 72) metres to the nearest surface in each sector, inf beyond `reach_m`.

    Sector k lies about k times 5 degrees, clockwise from ahead. `trunks_enu_m`: (k, 4) east, north, radius, height;
    `bodies_enu_m`: (m, 3) vehicles, upright cylinders of `radius_m`, of which each scan misses its own.
    """
    seen = np.full((len(pos_enu_m), SECTORS), np.inf)
    discs = np.concatenate(
        [
            np.column_stack([trunks_enu_m[:, :3], np.zeros(len(trunks_enu_m)), trunks_enu_m[:, 3]]),
            np.column_stack(
                [
                    bodies_enu_m[:, :2],
                    np.full(len(bodies_enu_m), radius_m),
                    bodies_enu_m[:, 2] - radius_m,
                    bodies_enu_m[:, 2] + radius_m,
                ]
            ),
        ]
    )
    east, north = (discs[:, k] - pos_enu_m[:, k, None] for k in (0, 1))
    away_m = np.sqrt(east * east + north * north)
    up_m = pos_enu_m[:, 2, None]
    near = (away_m < reach_m + discs[:, 2]) & (away_m > discs[:, 2]) & (discs[:, 3] <= up_m) & (up_m <= discs[:, 4])
    who, what = np.nonzero(near)
    if not len(who):
        return seen
    d, r = away_m[who, what, None], discs[what, 2, None]
    bearing = np.arctan2(east[who, what], north[who, what]) - yaw_rad[who]
    off = bearing[:, None] - STEP_RAD * np.arange(SECTORS)
    off = np.abs(off - math.tau * np.round(off / math.tau))
    aside = d * np.sin(np.maximum(0.0, off - STEP_RAD / 2.0))  # of the sector's ray that passes nearest to the axis
    hits = (aside < r) & (off < math.pi / 2.0)
    ahead = np.sqrt(np.where(hits, d * d - aside * aside, 0.0)) - np.sqrt(np.where(hits, r * r - aside * aside, 0.0))
    ranges = np.where(hits & (ahead <= reach_m), ahead, np.inf)
    starts = np.flatnonzero(np.diff(who, prepend=-1))
    seen[who[starts]] = np.minimum.reduceat(ranges, starts, axis=0)
    return seen
