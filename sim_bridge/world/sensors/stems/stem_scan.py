"""Rays of a turn where they meet trunks that lean, taper, and have a section of their own: as `raw_scan`, of shapes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from sim_bridge.world.sensors.raw_scan import LEAST, Rays, find_pairs
from sim_bridge.world.sensors.stems import shapes
from sim_bridge.world.sensors.stems.shapes import Floats

ROUNDS: Final = 3  # of height, axis and radius where a ray meets the bark: then it is right to a millimetre
WIDER_M: Final = 0.03  # than the radius at breast height: butt, ellipse and bark


def take_stems(found: Floats, rays: Rays, trunks: Floats, *, max_m: float, beam_deg: float) -> None:
    """The nearest of the trunks into `found` (layers, rays around); `trunks`: rows of `shapes`."""
    if not len(trunks):
        return
    half_beam = math.radians(beam_deg) / 2.0
    which, ray, near_m = find_pairs(rays, _bounds(trunks), max_m, half_beam)
    told = found.reshape(-1)
    near = np.flatnonzero(near_m < told[ray])
    which, ray = which[near], ray[near]
    rows, at = trunks[which], ray % len(rays.ages_s)
    eye_n, eye_e, eye_d = rays.eyes_ned_m.take(at, axis=1)
    way_n, way_e, way_d = rays.ways_ned.reshape(3, -1).take(ray, axis=1)
    level = np.maximum(np.hypot(way_n, way_e), LEAST)
    way_n, way_e, climb = way_n / level, way_e / level, -way_d / level
    up = np.array(rows[:, shapes.REF])
    bearing = np.arctan2(-way_e, -way_n)  # from the axis to the eye: so to where it is met, nearly
    along = aside = radius = np.zeros(len(ray))
    for _ in range(ROUNDS):
        to_n = rows[:, shapes.NORTH] + rows[:, shapes.LEAN_N] * (up - rows[:, shapes.REF]) - eye_n
        to_e = rows[:, shapes.EAST] + rows[:, shapes.LEAN_E] * (up - rows[:, shapes.REF]) - eye_e
        radius = shapes.radius_m(rows, up, bearing)
        middle = to_n * way_n + to_e * way_e
        beam = half_beam * np.maximum(middle, 0.0) / level  # along the ray: as wide as that
        right = to_e * way_n - to_n * way_e
        aside = np.maximum(np.abs(right) - beam, 0.0)
        deep = np.sqrt(np.maximum(radius * radius - aside * aside, 0.0))
        along = middle - deep
        up = along * climb - eye_d
        bearing = np.arctan2(
            -deep * way_e - np.sign(right) * aside * way_n, -deep * way_n + np.sign(right) * aside * way_e
        )
    meets = (aside < radius) & (along > 0.0) & (up >= rows[:, shapes.LOW]) & (up <= rows[:, shapes.HIGH])
    ranges = along / level
    meets &= ranges <= max_m
    np.minimum.at(told, ray[meets], ranges[meets])


def _bounds(trunks: Floats) -> Floats:
    """Upright cylinders about trunks, as `raw_scan.cast` has them."""
    low, high = np.maximum(trunks[:, shapes.LOW], trunks[:, shapes.GROUND]), trunks[:, shapes.HIGH]
    middle = 0.5 * (low + high) - trunks[:, shapes.REF]
    leans = np.hypot(trunks[:, shapes.LEAN_N], trunks[:, shapes.LEAN_E])
    wide = 1.1 * trunks[:, shapes.RADIUS] + WIDER_M + leans * 0.5 * (high - low)
    still = np.zeros(len(trunks))
    return np.stack(
        [
            trunks[:, shapes.NORTH] + trunks[:, shapes.LEAN_N] * middle,
            trunks[:, shapes.EAST] + trunks[:, shapes.LEAN_E] * middle,
            wide,
            trunks[:, shapes.LOW],
            high,
            still,
            still,
        ],
        axis=1,
    )
