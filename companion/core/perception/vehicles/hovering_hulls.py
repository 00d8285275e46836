"""Hulls that hover, by a lidar of several layers: wide, hit at one height, and rays go on close above and below.

A trunk stops rays at every height, a bush those below, a crown those above; a branch is thin. So one that hovers is
told from what stands though it never moves, from as near as layers look below it. What is unsure is neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.landmarks.trunk_tracks import Sighting
from mission.common.frames import Vec3

RADIUS_MIN_M: Final = 0.2  # of a hull, as its level scan shows it: few trunks are as thick, and no branch
WITHIN_M: Final = 10.0  # farther off two layers are more apart than a hull is high
MATCH_M: Final = 0.5  # from turn to turn
CORE_M: Final = 0.15  # beside its axis: a ray that goes on here went over it or under it
BESIDE_M: Final = 0.5  # beside its axis: what is hit here may be of it, as a trunk that leans is
DEEP_M: Final = 0.6  # before and behind its axis
HIGH_M: Final = 0.9  # what is hit over more height is no hull: 0.5 m, and a layer of rays
LEVELS: Final = 20  # of LEVEL_M each, about the sensor's own height
LEVEL_M: Final = 0.2
FREE_LEVELS: Final = 5  # above it and below it
FREE_RAYS: Final = 3  # that went on there, at least
PROVEN: Final = 4  # turns that say so, less three times those that say that it stands
STANDS: Final = -3
VOTES_MAX: Final = 8
UNSEEN_S: Final = 1.0  # until it is forgotten
BINS: Final = 180  # of bearings
MOVES_M: Final = 0.5  # between two turns, of the own place
CANDIDATES_MAX: Final = 16


@final
class _Candidate:
    """A wide stem, and what rays of this turn met there, by height."""

    __slots__ = ("away_m", "bearing_rad", "east_m", "north_m", "passed", "seen_s", "stopped", "votes")

    def __init__(self, sighting: Sighting, now_s: float) -> None:
        self.votes = 0
        self.stopped: list[int] = [0] * LEVELS
        self.passed: list[int] = [0] * LEVELS
        self.north_m = self.east_m = self.bearing_rad = self.away_m = 0.0
        self.seen_s = now_s
        self.take_sighting(sighting, now_s)

    def take_sighting(self, sighting: Sighting, now_s: float) -> None:
        """Seen again, there."""
        self.north_m, self.east_m, self.seen_s = sighting.north_m, sighting.east_m, now_s
        self.bearing_rad = sighting.stem.bearing_rad
        self.away_m = sighting.stem.surface_m + sighting.stem.radius_m

    def note_ray(self, eye_ne_m: tuple[float, float], way_ne: tuple[float, float], up: float, went_m: float) -> None:
        """A ray from an eye along a level unit vector, that rises by `up` a metre, and was stopped, level, at that."""
        n, e = self.north_m - eye_ne_m[0], self.east_m - eye_ne_m[1]
        along_m, aside_m = n * way_ne[0] + e * way_ne[1], abs(e * way_ne[0] - n * way_ne[1])
        level = math.floor(up * along_m / LEVEL_M) + LEVELS // 2
        if aside_m > BESIDE_M or along_m <= 0.0 or not 0 <= level < LEVELS:
            return
        if went_m > along_m + DEEP_M:
            if aside_m <= CORE_M:
                self.passed[level] += 1
        elif went_m >= along_m - DEEP_M:
            self.stopped[level] += 1

    def judge_turn(self) -> None:
        """Counts what the turn says, and begins the next."""
        hit = [k for k in range(LEVELS) if self.stopped[k] > 0]
        if hit:
            low, high = hit[0], hit[-1]
            if (high - low) * LEVEL_M >= HIGH_M:
                self.votes = max(-VOTES_MAX, self.votes + STANDS)
            elif (
                sum(self.passed[high + 1 : high + 1 + FREE_LEVELS]) >= FREE_RAYS
                and sum(self.passed[max(0, low - FREE_LEVELS) : low]) >= FREE_RAYS
            ):
                self.votes = min(VOTES_MAX, self.votes + 1)
        self.stopped = [0] * LEVELS
        self.passed = [0] * LEVELS


@final
class HoveringHulls:
    """One vehicle's. `note_ray` with each measured ray of a turn, then `end_turn` with its wide stems."""

    __slots__ = ("_bins", "_candidates", "_has_layers")

    def __init__(self) -> None:
        self._candidates: list[_Candidate] = []
        self._bins: list[list[_Candidate]] = []  # by bearing from north; empty: none
        self._has_layers = False

    def note_ray(
        self, bearing_rad: float, way_ned: Vec3, flat: float, went_m: float, eye_ne_m: tuple[float, float]
    ) -> None:
        """`way_ned`: unit vector, `flat` its level part, > 0; `went_m`: level metres to what stopped it, or inf."""
        self._has_layers = True
        if not self._bins:
            return
        found = self._bins[math.floor(bearing_rad / math.tau * BINS + 0.5) % BINS]
        for candidate in found:
            candidate.note_ray(eye_ne_m, (way_ned[0] / flat, way_ned[1] / flat), -way_ned[2] / flat, went_m)

    def end_turn(self, sightings: Sequence[Sighting], now_s: float) -> None:
        """A turn is whole: `sightings` are its stems, placed in the frame of the rays' eyes. One layer tells none."""
        if not self._has_layers:
            return
        for candidate in self._candidates:
            candidate.judge_turn()
        for sighting in sightings:
            away_m = sighting.stem.surface_m + sighting.stem.radius_m
            if sighting.stem.radius_m < RADIUS_MIN_M or away_m > WITHIN_M:
                continue
            known = self._find_candidate(sighting)
            if known is not None:
                known.take_sighting(sighting, now_s)
            elif len(self._candidates) < CANDIDATES_MAX:
                self._candidates.append(_Candidate(sighting, now_s))
        self._candidates = [one for one in self._candidates if now_s - one.seen_s <= UNSEEN_S]
        self._sort_by_bearing()

    def places(self) -> list[Vec3]:
        """Of those that hover, in the frame of the turns."""
        return [(one.north_m, one.east_m, 0.0) for one in self._candidates if one.votes >= PROVEN]

    def _find_candidate(self, sighting: Sighting) -> _Candidate | None:
        nearest: _Candidate | None = None
        least_m = MATCH_M
        for candidate in self._candidates:
            off_m = math.hypot(candidate.north_m - sighting.north_m, candidate.east_m - sighting.east_m)
            if off_m < least_m:
                nearest, least_m = candidate, off_m
        return nearest

    def _sort_by_bearing(self) -> None:
        self._bins = [list[_Candidate]() for _ in range(BINS)] if self._candidates else []
        for candidate in self._candidates:
            half_rad = math.atan2(BESIDE_M + MOVES_M, max(candidate.away_m - MOVES_M, 0.1))
            first = math.floor((candidate.bearing_rad - half_rad) / math.tau * BINS + 0.5)
            last = math.floor((candidate.bearing_rad + half_rad) / math.tau * BINS + 0.5)
            for k in range(first, last + 1):
                self._bins[k % BINS].append(candidate)
