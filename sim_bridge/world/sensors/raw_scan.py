"""The geometry of one turn of a lidar whose rays are told one by one: each at its own time, from its own place.

A lidar moves and turns with its airframe while it turns by itself: what it tells is distorted. Its motion, and that of
the other vehicles, goes on as at the end of the turn: 0.1 s at 3 m/s^2 are 1.5 cm.

Obstacles as in scan.py: upright cylinders, boxes, and the ground, a plane. A ray is as wide as its beam, and tells the
nearest of the cylinder's side that is in it: so a trunk's edges are seen too wide by half a beam, as real lidars do.
Cylinders are cast in pairs with the rays whose bearings may meet them, all pairs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.schema.kinds import RawLidar
from mission.stand.stand import StandBox
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.box_scan import within
from sim_bridge.world.sensors.scan import Plane

Floats = NDArray[np.float64]
NEARBY_M = (0.0, 6.0, 12.0, math.inf)
LAYER_RAD: Final = 8.0 * math.pi  # between layers in one row of azimuths: more than twice round
LEAST: Final = 1e-9  # of a unit vector


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays of one turn: when, before its end, from where, and unit vectors of their directions."""

    ages_s: Floats  # (rays around,)
    eyes_ned_m: Floats  # (3, rays around)
    ways_ned: Floats  # (3, layers, rays around)


class RayPattern:
    """Directions of a class of lidar in the airframe's frame (front, right, down), in the order of a turn.

    It turns clockwise from ahead, mounted upright; upside down counter-clockwise, and its layers are mirrored.
    """

    def __init__(self, lidar: RawLidar, period_s: float, *, upside_down: bool = False) -> None:
        count = round(360.0 / lidar.step_deg)
        side = -1.0 if upside_down else 1.0
        self.step_deg: Final = side * lidar.step_deg
        self.elevations_deg: Final = tuple(side * elevation for elevation in lidar.elevations_deg)
        self.ray_time_s: Final = period_s / count
        self.ages_s: Final = self.ray_time_s * np.arange(count - 1, -1, -1.0)
        bearings = np.radians(self.step_deg * np.arange(count))
        elevations = np.radians(self.elevations_deg)[:, None]
        level, down = np.cos(elevations), np.broadcast_to(-np.sin(elevations), (len(elevations), count))
        body = np.stack([level * np.cos(bearings), level * np.sin(bearings), down])
        self._body: Final = np.ascontiguousarray(body.transpose(2, 0, 1))  # (rays around, 3, layers)
        self.bearings_deg: Final = self.step_deg * np.arange(count)

    def rays(self, state: AirframeState, mounted_up_m: float) -> Rays:
        """The rays of a turn that ends now."""
        eye = np.array(state.pos_ned_m) - (0.0, 0.0, mounted_up_m)
        eyes = eye[:, None] - self.ages_s * np.array(state.vel_ned_mps)[:, None]
        turns = _axes_ned(state.attitude_rad) @ _turned(np.array(state.rates_radps), -self.ages_s)  # (rays, 3, 3)
        return Rays(self.ages_s, eyes, np.ascontiguousarray((turns @ self._body).transpose(1, 2, 0)))


def cast(
    rays: Rays,
    cylinders: Floats,
    boxes: list[tuple[StandBox, float]],
    ground: Plane,
    *,
    max_m: float,
    beam_deg: float,
) -> Floats:
    """(layers, rays around) metres along each ray to the nearest; inf: nothing within `max_m`; 0: it is inside.

    `cylinders` (k, 7): north, east of the axis at the end of the turn, radius, lower and upper end (up), velocity north
    and east. `boxes`: with their tops' heights, up.
    """
    found = _to_ground(rays, ground)
    _take_cylinders(found, rays, cylinders, max_m, math.radians(beam_deg) / 2.0)
    if boxes:
        _take_boxes(found, rays, boxes)
    found[found > max_m] = math.inf
    return found


def _to_ground(rays: Rays, ground: Plane) -> Floats:
    """Metres to the ground, whose height is that below the last ray's place and rises north and east."""
    up_m, rise_n, rise_e = ground
    eyes, ways = rays.eyes_ned_m, rays.ways_ned
    heights = -eyes[2] - up_m - rise_n * (eyes[0] - eyes[0, -1]) - rise_e * (eyes[1] - eyes[1, -1])
    falls = ways[2] + rise_n * ways[0] + rise_e * ways[1]
    meets = (falls > LEAST) & (heights > 0.0)
    return np.where(meets, heights / np.where(meets, falls, 1.0), math.inf)


def _take_cylinders(found: Floats, rays: Rays, cylinders: Floats, max_m: float, half_beam_rad: float) -> None:
    """The nearest of the cylinders into `found`: those nearby first, which hide most of what is behind them."""
    which, ray, near_m = find_pairs(rays, cylinders, max_m, half_beam_rad)
    told = found.reshape(-1)
    for least_m, most_m in pairwise(NEARBY_M):
        chosen = np.flatnonzero((near_m >= least_m) & (near_m < most_m) & (near_m < told[ray]))
        if len(chosen):
            _meet_cylinders(told, rays, cylinders.T.take(which[chosen], axis=1), ray[chosen], half_beam_rad)


def _meet_cylinders(told: Floats, rays: Rays, cylinders: Floats, ray: NDArray[np.intp], half_beam_rad: float) -> None:
    """Into `told` (layers x rays,) where cylinder k, of `cylinders` (7, k), meets the ray `ray[k]`."""
    axis_n, axis_e, radius, low, high, vel_n, vel_e = cylinders
    at = ray % len(rays.ages_s)
    eyes, age = rays.eyes_ned_m.take(at, axis=1), rays.ages_s.take(at)
    way_n, way_e, way_d = rays.ways_ned.reshape(3, -1).take(ray, axis=1)
    to_n, to_e = axis_n - vel_n * age - eyes[0], axis_e - vel_e * age - eyes[1]
    level = np.maximum(np.sqrt(way_n * way_n + way_e * way_e), LEAST)
    along = (to_n * way_n + to_e * way_e) / level  # level metres to where the ray is nearest to the axis
    aside = np.abs(to_e * way_n - to_n * way_e) / level - half_beam_rad * np.maximum(along, 0.0)
    aside = np.maximum(aside, 0.0)
    half = np.sqrt(np.maximum(radius * radius - aside * aside, 0.0))
    enters, leaves = (along - half) / level, (along + half) / level
    # Along a ray, heights of both ends; a level ray is between them, or is not
    up = np.where(np.abs(way_d) < LEAST, LEAST, -way_d)
    one, other = (low + eyes[2]) / up, (high + eyes[2]) / up
    enters = np.maximum(np.maximum(enters, np.minimum(one, other)), 0.0)
    leaves = np.minimum(leaves, np.maximum(one, other))
    meets = (aside < radius) & (enters < leaves)
    np.minimum.at(told, ray[meets], enters[meets])


def find_pairs(
    rays: Rays, cylinders: Floats, max_m: float, half_beam_rad: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Indices of cylinders and of rays (layer by layer) that may meet, and from what distance on.

    By bearings and heights about the middle of the turn.
    """
    _, layers, around = rays.ways_ned.shape
    middle = rays.eyes_ned_m[:, around // 2]
    moved = np.ptp(rays.eyes_ned_m, axis=1)
    to = cylinders[:, :2] - middle[:2] - cylinders[:, 5:] * rays.ages_s[around // 2]
    away = np.hypot(to[:, 0], to[:, 1])
    # Wider by how far either moves in half a turn
    wide = cylinders[:, 2] + 0.5 * math.hypot(*moved[:2]) + 0.5 * rays.ages_s[0] * np.hypot(*cylinders[:, 5:].T) + 0.01
    near, far = np.maximum(away - wide, 0.0), np.minimum(away + wide, max_m)
    half = np.where(away > wide, np.arcsin(np.minimum(wide / np.maximum(away, LEAST), 1.0)), math.pi) + half_beam_rad
    bearing = np.arctan2(to[:, 1], to[:, 0])
    ways = rays.ways_ned
    climbs = -ways[2] / np.maximum(np.hypot(ways[0], ways[1]), LEAST)
    least, most = climbs.min(axis=1)[:, None], climbs.max(axis=1)[:, None]
    below = cylinders[:, 3] + middle[2] - moved[2]
    above = cylinders[:, 4] + middle[2] + moved[2]
    # Heights that a layer's rays have where they are as near as the cylinder, and as far
    lowest, highest = np.minimum(least * near, least * far), np.maximum(most * near, most * far)
    may = (near <= max_m) & (lowest <= above) & (highest >= below)
    layer, which = np.nonzero(may)
    # Azimuths of all layers one after the other, each rising, and twice round
    azimuths = np.arctan2(ways[1], ways[0])
    order = np.argsort(azimuths, axis=1, kind="stable") + around * np.arange(layers)[:, None]
    rising = azimuths.reshape(-1)[order]
    row = np.concatenate([rising, rising + math.tau], axis=1) + LAYER_RAD * np.arange(layers)[:, None]
    ray_of_row = np.concatenate([order, order], axis=1).reshape(-1)
    least_rad = rising[:, 0][layer]
    first_rad = np.remainder((bearing - half)[which] - least_rad, math.tau) + least_rad + LAYER_RAD * layer
    last_rad = first_rad + np.minimum(2.0 * half, math.tau - LEAST)[which]
    first, last = np.searchsorted(row.reshape(-1), [first_rad, last_rad])
    count = last - first
    at = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    which = np.repeat(which, count)
    return which, ray_of_row[at], near[which]


def _take_boxes(found: Floats, rays: Rays, boxes: list[tuple[StandBox, float]]) -> None:
    """The nearest of the boxes into `found`. They reach as far down as the ground does."""
    ways = rays.ways_ned
    eyes = rays.eyes_ned_m
    for box, top_up_m in boxes:
        east, north = eyes[1] - box.east_m, eyes[0] - box.north_m
        x, y = east * box.cos - north * box.sin, east * box.sin + north * box.cos
        way_x = ways[1] * box.cos - ways[0] * box.sin
        way_y = ways[1] * box.sin + ways[0] * box.cos
        enters, leaves = np.zeros(found.shape), np.full(found.shape, math.inf)
        for start, way, low, high in (
            (x, way_x, -box.along_m, box.along_m),
            (y, way_y, -box.across_m, box.across_m),
            (-eyes[2], -ways[2], -math.inf, top_up_m),
        ):
            first, last = within(start, way, low, high)
            np.maximum(enters, first, out=enters)
            np.minimum(leaves, last, out=leaves)
        np.minimum(found, np.where(enters < leaves, enters, math.inf), out=found)


def _axes_ned(attitude_rad: Vec3) -> Floats:
    """(3, 3): columns are the airframe's axes ahead, to the right and below, in NED."""
    roll, pitch, yaw = attitude_rad
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    sy, cy = math.sin(yaw), math.cos(yaw)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def _turned(rates_radps: Floats, times_s: Floats) -> Floats:
    """(t, 3, 3): rotations by steady body rates over each of `times_s` (t,), by Rodrigues' formula."""
    rate = float(np.linalg.norm(rates_radps))
    if rate < LEAST:
        return np.broadcast_to(np.eye(3), (len(times_s), 3, 3))
    x, y, z = rates_radps / rate
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angles = (rate * times_s)[:, None, None]
    turns: Floats = np.eye(3) + np.sin(angles) * cross + (1.0 - np.cos(angles)) * (cross @ cross)
    return turns
