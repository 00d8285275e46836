"""Ghost tracks: silent vehicles that are not where they are taken to hover. A ray has passed through there.

A vehicle that is not heard is an obstacle where it was heard last (`peer_table`). Among trees most of those only fly
on, hidden from the radio: what they leave behind would bar the way. One that does hover there is seen, and stays one.
One that is taken to hover behind a closed wall of trunks bars no way either, as long as it stands between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from companion.core.model.beacon import PeerReport
from companion.core.perception.obstacle_map import BEARINGS, NEIGHBOUR_M, ObstacleMap
from mission.common.frames import Vec3

LEVEL_M: Final = 0.2  # a ray that passes farther above or below may miss the vehicle
STRAY_M: Final = 2.0  # about the reckoned place: a hit there may be the vehicle
BODY_M: Final = 0.4  # as wide is what must be seen past, to either side
EMPTY_S: Final = 0.5  # so long, without a break: some scans
BREAK_S: Final = 0.15  # since the last look: three ticks
SAME_WORD_S: Final = 0.5  # what others tell of it may be newer by so much, and still be from before
SHORT_M: Final = 0.5  # of the sensor's range: the last of it is seen badly


class GhostTracks:
    """One vehicle's. `clear` takes the silent, and leaves those out of which the place was seen empty."""

    def __init__(self) -> None:
        self._empty_since_s: dict[int, float] = {}
        self._cleared: dict[int, float] = {}  # by id: when it was heard last, at the latest
        self._looked_s = -math.inf

    def clear(
        self,
        silent: dict[int, PeerReport],
        seen: ObstacleMap,
        own_pos_ned_m: Vec3,
        now_s: float,
        *,
        fresh_s: float,
        reported: Sequence[Vec3] = (),
    ) -> dict[int, PeerReport]:
        """Leaves those that may hover where they are taken to. `fresh_s`: how old a scan may be.

        `reported`: where neighbours are, relative: hits there are left out of the map, whatever they are.
        """
        if now_s - self._looked_s > BREAK_S:
            self._empty_since_s.clear()
        self._looked_s = now_s
        self._empty_since_s = {k: since_s for k, since_s in self._empty_since_s.items() if k in silent}
        left: dict[int, PeerReport] = {}
        for vehicle, sighting in silent.items():
            hides = any([math.dist(rel[:2], sighting.rel_ned_m[:2]) <= STRAY_M + NEIGHBOUR_M for rel in reported])
            if hides:
                self._empty_since_s.pop(vehicle, None)
            if hides or self._may_hover(sighting, seen, own_pos_ned_m, now_s, fresh_s=fresh_s):
                left[vehicle] = sighting
            elif sighting.elsewhere:  # by others' words: no place but the own one was looked at
                left[vehicle] = replace(
                    sighting, rel_ned_m=sighting.elsewhere[0], elsewhere=sighting.elsewhere[1:], received=True
                )
        return left

    def _may_hover(
        self, sighting: PeerReport, seen: ObstacleMap, own_pos_ned_m: Vec3, now_s: float, *, fresh_s: float
    ) -> bool:
        vehicle, heard_s = sighting.vehicle, now_s - sighting.age_s
        if heard_s <= self._cleared.get(vehicle, -math.inf):
            return False
        known = not (sighting.received or sighting.every_height)
        if known and _is_walled(sighting.rel_ned_m, seen, own_pos_ned_m):
            self._empty_since_s.pop(vehicle, None)
            return False
        # Another's word may be of a vehicle that is at every height.
        if not known or not _is_empty(sighting.rel_ned_m, seen, own_pos_ned_m, now_s, fresh_s=fresh_s):
            self._empty_since_s.pop(vehicle, None)
        elif now_s - self._empty_since_s.setdefault(vehicle, now_s) >= EMPTY_S:
            self._cleared[vehicle] = heard_s + SAME_WORD_S
            del self._empty_since_s[vehicle]
            return False
        return True


def _is_walled(rel_ned_m: Vec3, seen: ObstacleMap, own_pos_ned_m: Vec3) -> bool:
    """Trunks stand before the place and all about it, without a gap of three bearings: no way leads to it from here."""
    north, east, _ = rel_ned_m
    away_m = math.hypot(north, east)
    if away_m <= STRAY_M:
        return False
    norths, easts = seen.find_near(own_pos_ned_m, away_m - BODY_M)
    hits = [_bearing(math.atan2(e, n)) for n, e in zip(norths, easts, strict=True)]
    hidden = {(hit + k) % BEARINGS for hit in hits for k in (-1, 0, 1)}
    middle, half = _bearing(math.atan2(east, north)), math.ceil(math.asin(STRAY_M / away_m) / math.tau * BEARINGS)
    return all([(middle + k) % BEARINGS in hidden for k in range(-half, half + 1)])


def _bearing(rad: float) -> int:
    return round(rad / math.tau * BEARINGS) % BEARINGS


def _is_empty(rel_ned_m: Vec3, seen: ObstacleMap, own_pos_ned_m: Vec3, now_s: float, *, fresh_s: float) -> bool:
    """The place, and all before it, is in sight, and nothing is there."""
    north, east, down = rel_ned_m
    away_m = math.hypot(north, east)
    if not STRAY_M < away_m <= seen.max_m - SHORT_M:
        return False
    bearing, half = math.atan2(east, north), math.asin(BODY_M / away_m)
    if any([abs(down - away_m * seen.ray_fall(bearing + turn)) > LEVEL_M for turn in (-half, 0.0, half)]):
        return False
    blind = seen.find_blind(now_s, fresh_s=fresh_s)
    if any([blind[round((bearing + turn) / math.tau * BEARINGS) % BEARINGS] for turn in (-half, 0.0, half)]):
        return False
    north, east = north / away_m, east / away_m
    norths, easts = seen.find_near(own_pos_ned_m, away_m + STRAY_M)
    for n, e in zip(norths, easts, strict=True):
        ahead_m, aside_m = n * north + e * east, abs(e * north - n * east)
        if math.hypot(ahead_m - away_m, aside_m) <= STRAY_M or (0.0 < ahead_m < away_m and aside_m <= BODY_M):
            return False
    return True
