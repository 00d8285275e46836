"""Ground within sight of the vehicles' tracks: a grid of cells, and each place's looks.

A look is an unbroken time in which one log's vehicle had a place in sight: within its sight_m, and not behind a trunk
that is known. What trunks hid is found by angle: each direction from a point of the track ends at the nearest trunk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from companion.stand.fusion.fuse import Fusion
from companion.stand.records import KeyedPoint
from companion.survey.track import TrackPoint
from mission.common.plane import Point

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CELL_M: Final = 1.0  # a trunk's shadow is as wide within sight
MAX_CELLS: Final = 400_000  # 40 ha; a survey that ranges farther has larger cells
LOOK_GAP_S: Final = 10.0  # out of sight for so long: the next is another look
KEPT_M: Final = 1.0  # nearer to the point before, a point of a track is left out,
KEPT_S: Final = 8.0  # if it is not so much later: a look goes on while a vehicle hovers
DIRECTIONS: Final = 360
RINGS: Final = 5  # of distance: 0 to 0.2 of sight_m, and so on
TRUNK_M: Final = 0.6  # beyond a trunk's face that is itself still in sight: its axis, and half of a cell
BLOCK: Final = 400  # points of a track at a time


@dataclass(frozen=True, slots=True)
class Looks:
    """Rows: one look at one place each, sorted by place."""

    place: Ints
    log: Ints
    first_s: Floats
    last_s: Floats
    points: Floats  # rows x RINGS: points of the track that had it in sight, by distance over sight_m


@dataclass(frozen=True, slots=True)
class Track:
    """Points of all logs, their frame errors taken off, by log and time. Positions: east, north."""

    log: Ints
    time_s: Floats
    pos_m: Floats
    sight_m: Floats


@dataclass(frozen=True, slots=True)
class Grid:
    """Square cells: east, north of their middles."""

    middle_m: Floats  # cells x 2
    cell_m: float


def track_of(points: Sequence[KeyedPoint], fusion: Fusion) -> Track:
    """In the stems' frame: what the adjustment found of each log's error is taken off."""
    index = {log: k for k, log in enumerate(fusion.logs)}
    for unseen in sorted({p.session for p in points}):
        index.setdefault(unseen, len(index))
    told = sorted((p for p in points if p.point.range_m > 0.0), key=lambda p: (index[p.session], p.point.at_s, p.key))
    kept: list[KeyedPoint] = []
    for p in told:
        if not kept or kept[-1].session != p.session or _is_apart(kept[-1].point, p.point):
            kept.append(p)
    log = np.asarray([index[p.session] for p in kept], dtype=np.int64)
    time_s = np.asarray([p.point.at_s for p in kept])
    pos_m = np.asarray([(p.point.east_m, p.point.north_m) for p in kept]).reshape(-1, 2)
    for k in np.unique(log).tolist():
        own = log == k
        pos_m[own] -= fusion.frames.errors_m(k, time_s[own], pos_m[own][:, ::-1])[:, ::-1]
    return Track(log, time_s, pos_m, np.asarray([p.point.range_m for p in kept]))


def _is_apart(before: TrackPoint, point: TrackPoint) -> bool:
    """True if it shows more than the one before: a vehicle that hovers sees the same again."""
    moved_m = math.hypot(point.north_m - before.north_m, point.east_m - before.east_m)
    return moved_m >= KEPT_M or point.at_s - before.at_s >= KEPT_S


def grid_of(track: Track, area_m: Sequence[Point] | None) -> Grid:
    """Cells within sight of the track, without regard to trunks; with `area_m` those whose middle is in it."""
    if not len(track.log):
        return Grid(np.zeros((0, 2)), CELL_M)
    reach_m = float(track.sight_m.max())
    low, high = track.pos_m.min(axis=0) - reach_m, track.pos_m.max(axis=0) + reach_m
    if area_m is not None:
        low, high = np.maximum(low, np.min(area_m, axis=0)), np.minimum(high, np.max(area_m, axis=0))
    if (high <= low).any():
        return Grid(np.zeros((0, 2)), CELL_M)
    cell_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / MAX_CELLS))
    axes = [
        (np.arange(math.floor(a / cell_m), math.ceil(b / cell_m)) + 0.5) * cell_m
        for a, b in zip(low, high, strict=True)
    ]
    east, north = (axis.ravel() for axis in np.meshgrid(*axes))
    middle_m = np.column_stack((east, north))
    inside = np.isfinite(cKDTree(track.pos_m).query(middle_m, distance_upper_bound=reach_m)[0])
    if area_m is not None:
        inside &= within_area(middle_m, area_m)
    return Grid(middle_m[inside], cell_m)


def within_area(places_m: Floats, area_m: Sequence[Point]) -> npt.NDArray[np.bool_]:
    """True of the places inside the polygon: an odd number of its sides is east of them."""
    inside = np.zeros(len(places_m), dtype=np.bool_)
    for k, (east, north) in enumerate(area_m):
        east_0, north_0 = area_m[k - 1]
        if north == north_0:
            continue
        crosses = (north > places_m[:, 1]) != (north_0 > places_m[:, 1])
        at = east + (places_m[:, 1] - north) / (north_0 - north) * (east_0 - east)
        inside ^= crosses & (places_m[:, 0] < at)
    return inside


def looks_at(places_m: Floats, track: Track, trunks_m: Floats, radii_m: Floats) -> Looks:
    """Of all places (east, north); `trunks_m` and `radii_m`: all that hide something."""
    parts: list[Looks] = []
    places = cKDTree(places_m) if len(places_m) else None
    trunks = cKDTree(trunks_m) if len(trunks_m) else None
    for log in np.unique(track.log).tolist():
        own = np.flatnonzero(track.log == log)
        rows = [_in_sight(own[k : k + BLOCK], track, places, trunks, radii_m) for k in range(0, len(own), BLOCK)]
        place, point, distance_m = (np.concatenate([row[k] for row in rows]) for k in range(3))
        parts.append(_looks(place.astype(np.int64), point.astype(np.int64), distance_m, track, log))
    if not parts:
        none, nobody = np.zeros(0), np.zeros(0, dtype=np.int64)
        return Looks(nobody, nobody, none, none, np.zeros((0, RINGS)))
    order = np.argsort(np.concatenate([p.place for p in parts]), kind="stable")
    return Looks(
        place=np.concatenate([p.place for p in parts])[order],
        log=np.concatenate([p.log for p in parts])[order],
        first_s=np.concatenate([p.first_s for p in parts])[order],
        last_s=np.concatenate([p.last_s for p in parts])[order],
        points=np.concatenate([p.points for p in parts])[order],
    )


def _in_sight(
    own: Ints, track: Track, places: cKDTree | None, trunks: cKDTree | None, radii_m: Floats
) -> tuple[Floats, Floats, Floats]:
    """Pairs of a place and a point of the track that has it in sight, and how far apart they are."""
    none = np.zeros(0)
    if places is None:
        return none, none, none
    found = []
    for k in own.tolist():
        at, sight_m = track.pos_m[k], float(track.sight_m[k])
        near = np.asarray(places.query_ball_point(at, sight_m, return_sorted=True), dtype=np.int64)
        if not len(near):
            continue
        away = places.data[near] - at
        distance_m = np.hypot(away[:, 0], away[:, 1])
        limit_m = _shadows(at, sight_m, trunks, radii_m)[_direction(away)] + TRUNK_M
        seen = distance_m <= limit_m
        found.append((near[seen], np.full(int(seen.sum()), k), distance_m[seen]))
    if not found:
        return none, none, none
    place, point, distance_m = (np.concatenate(column) for column in zip(*found, strict=True))
    return place, point, distance_m


def _shadows(at: Floats, sight_m: float, trunks: cKDTree | None, radii_m: Floats) -> Floats:
    """Of each direction, how far it is to the nearest trunk; infinite where there is none."""
    limit_m = np.full(DIRECTIONS, np.inf)
    if trunks is None:
        return limit_m
    for k in trunks.query_ball_point(at, sight_m, return_sorted=True):
        away = trunks.data[k] - at
        distance_m, radius_m = float(np.hypot(*away)), float(radii_m[k])
        if distance_m <= radius_m:
            continue
        half = math.asin(radius_m / distance_m) * DIRECTIONS / (2.0 * math.pi)
        middle = math.atan2(away[1], away[0]) * DIRECTIONS / (2.0 * math.pi)
        # Directions whose middle the trunk hides
        hidden = np.arange(math.ceil(middle - half - 0.5), math.floor(middle + half - 0.5) + 1) % DIRECTIONS
        limit_m[hidden] = np.minimum(limit_m[hidden], distance_m - radius_m)
    return limit_m


def _direction(away: Floats) -> Ints:
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * math.pi)
    return np.floor(turns * DIRECTIONS).astype(np.int64) % DIRECTIONS


def _looks(place: Ints, point: Ints, distance_m: Floats, track: Track, log: int) -> Looks:
    """Pairs of one log, cut where a place was out of sight for LOOK_GAP_S."""
    order = np.lexsort((point, place))
    place, point, distance_m = place[order], point[order], distance_m[order]
    time_s = track.time_s[point]
    cuts = np.flatnonzero((np.diff(place) != 0) | (np.diff(time_s) > LOOK_GAP_S)) + 1
    starts = np.concatenate((np.zeros(min(1, len(place)), dtype=np.int64), cuts))
    ends = np.concatenate((cuts, np.full(min(1, len(place)), len(place), dtype=np.int64))) - 1
    look = np.cumsum(np.isin(np.arange(len(place)), starts)) - 1
    ring = np.minimum((distance_m / track.sight_m[point] * RINGS).astype(np.int64), RINGS - 1)
    return Looks(
        place=place[starts],
        log=np.full(len(starts), log, dtype=np.int64),
        first_s=time_s[starts],
        last_s=time_s[ends],
        points=np.bincount(look * RINGS + ring, minlength=len(starts) * RINGS).reshape(-1, RINGS).astype(np.float64),
    )
