"""Trunks and boxes in a recorded flight: how near vehicles came to them, and what they leave of the links."""

from __future__ import annotations

import math

import numpy as np

from mission.stand.stand import Stand
from sim_bridge.judge.metrics.arrays import Bools, Floats, Ints
from sim_bridge.judge.recording import Recording
from sim_bridge.trunk_attenuation import RangeShare

LOOKED_AT_M = 20.0  # nearer than this a trunk's distance is of interest


def least_clearance_m(recording: Recording, stand: Stand) -> float | None:
    """Least level distance from a vehicle's centre to a trunk's surface, as in Metrics; None: none within 20 m."""
    if not stand.trees:
        return None
    least_m = LOOKED_AT_M
    for tick, column in np.argwhere(~recording.on_ground & (recording.touched == 0)).tolist():
        north_m, east_m, down_m = recording.pos_ned_m[tick, column].tolist()
        for tree in stand.near(east_m, north_m, least_m):  # ever nearer: soon there is nothing to look at
            if -down_m < stand.ground_up_m(tree.east_m, tree.north_m) + tree.height_m:
                away_m = math.hypot(tree.east_m - east_m, tree.north_m - north_m) - tree.radius_m
                least_m = max(0.0, min(least_m, away_m))
    return least_m if least_m < LOOKED_AT_M else None


def bark_of_each(recording: Recording, stand: Stand) -> list[tuple[float, float] | None]:
    """Of each vehicle the least level distance from its centre to a trunk's surface, m, and when, s, as above."""
    found: list[tuple[float, float] | None] = []
    for column in range(recording.on_ground.shape[1]):
        least_m, at_s = LOOKED_AT_M, 0.0
        for tick in np.flatnonzero(~recording.on_ground[:, column] & (recording.touched[:, column] == 0)).tolist():
            north_m, east_m, down_m = recording.pos_ned_m[tick, column].tolist()
            for tree in stand.near(east_m, north_m, least_m):
                away_m = max(0.0, math.hypot(tree.east_m - east_m, tree.north_m - north_m) - tree.radius_m)
                if away_m < least_m and -down_m < stand.ground_up_m(tree.east_m, tree.north_m) + tree.height_m:
                    least_m, at_s = away_m, float(recording.time_s[tick])
        found.append((least_m, at_s) if least_m < LOOKED_AT_M else None)
    return found


def least_box_clearance_m(recording: Recording, stand: Stand) -> float | None:
    """Least level distance from a vehicle's centre to a box's surface, as in Metrics; None: none within 20 m."""
    at = ~recording.on_ground & (recording.touched == 0)
    north_m, east_m, down_m = recording.pos_ned_m[at].T
    least_m = LOOKED_AT_M
    for box in stand.boxes:
        low = -down_m < stand.ground_up_m(box.east_m, box.north_m) + box.height_m
        x, y = box.local(east_m[low], north_m[low])
        away_m = np.hypot(np.maximum(0.0, abs(x) - box.along_m), np.maximum(0.0, abs(y) - box.across_m))
        least_m = min(least_m, float(away_m.min(initial=LOOKED_AT_M)))
    return least_m if least_m < LOOKED_AT_M else None


def unhidden(
    recording: Recording, at: slice, pairs: tuple[Ints, Ints], linked: Bools, distance_m: Floats, share: RangeShare
) -> Bools:
    """(ticks, P): the links of `linked` that stand when trunks between two vehicles take their `share` of the range."""
    found = linked.copy()
    pos_ned_m = recording.pos_ned_m[at]
    range_m = np.minimum(recording.range_m[at][:, pairs[0]], recording.range_m[at][:, pairs[1]])
    for tick, pair in np.argwhere(linked).tolist():
        a, b = pos_ned_m[tick, pairs[0][pair]].tolist(), pos_ned_m[tick, pairs[1][pair]].tolist()
        kept = share((a[0], a[1], a[2]), (b[0], b[1], b[2]))
        if kept < 1.0 and distance_m[tick, pair] > range_m[tick, pair] * kept:
            found[tick, pair] = False
    return found
