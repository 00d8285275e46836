"""Positions that all report, held against the distances that the own range radio measures.

One that GNSS leads astray is not where it tells its neighbours, nor are they where it thinks: ranges to several of them
are wrong at once, in the way in which they would be from another place. That place is found by robust least squares
(each neighbour counts TRUNCATED at most, so one that lies about its own place moves nobody else), and explains what the
reported one does not: ALARM squared sigmas more, of at least two neighbours. So three must be measured, and of three
two may be at the right distance by chance; five and more tell soon. On which side it is may stay open, as where all
others fly in one line: then no place is told, only by how much it may be off. A place rests on others' words: of these
one may be false, two that lie alike may not. Whoever goes by it leads no more, and holds.

Whatever is wrong, and with whom: a range brings a neighbour nearer than it reports, and none farther.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, final

from companion.core.localisation.integrity.own_ranges import OwnRanges
from companion.core.model.beacon import RangeTo
from companion.core.model.displaced import Displaced
from companion.core.model.neighbour import Neighbour
from mission.common.frames import Vec3

Level = tuple[float, float]  # north, east
Pair = tuple[float, float, float]  # a neighbour as it is told to be, north and east, and its measured level distance

NEAR_M: Final = 0.5  # a range is shorter by less: the positions' own errors, and no reason to move
CHECK_S: Final = 0.5
MEASURED_S: Final = 1.0  # a range that is older is held against nothing: neighbours move by metres a second
SIGMA_M: Final = 0.7  # of a range less the distance of two reported positions, both with their own errors
TRUNCATED: Final = 16.0  # squared sigmas of one neighbour
ALARM: Final = 24.0  # squared sigmas: more than one neighbour can make
LEAST: Final = 3  # neighbours that must be measured
LEAST_M: Final = 3.0  # a walk of 1 or 2 m is GNSS's own
CHECKS: Final = 3  # in a row
STEPS: Final = 12  # of a fit
STARTS: Final = 8  # fits, from so many sides
RATE_S: Final = 10.0  # over which the drift is told
SIDES: Final = TRUNCATED + 6.0  # squared sigmas by which one side must explain more than another: one liar makes 16
SIDES_M: Final = 2.0  # so far apart
FOUND_M: Final = 1.0  # error of a place that was found
STEEP: Final = 0.7  # a range tells of a place where so much of it is level


@final
class RangeCheck:
    """One vehicle's: `receive` ranges, `update` once a tick, `bring_near` each neighbour."""

    __slots__ = ("_checked_s", "_found", "_me", "_ranges", "_size", "displaced")

    def __init__(self, me: int, size: int) -> None:
        self._me, self._size = me, size
        self._ranges: Final = OwnRanges(me)
        self._checked_s = -math.inf
        self._found: deque[tuple[float, Level]] = deque(maxlen=round(RATE_S / CHECK_S))  # in a row
        self.displaced: Displaced | None = None  # as of the last check

    def receive(self, ranges: tuple[RangeTo, ...], now_s: float) -> None:
        """The ranges that the own radio has measured."""
        for vehicle, metres, age_s in ranges:
            if 1 <= vehicle <= self._size and vehicle != self._me:
                self._ranges.add(vehicle, metres, now_s - age_s)

    def bring_near(self, neighbour: Neighbour, now_s: float) -> Neighbour:
        """A neighbour as near as it may be."""
        rel = self.near_ned_m(neighbour.id, neighbour.rel_ned_m, now_s)
        return neighbour if rel is neighbour.rel_ned_m else neighbour.at(rel, neighbour.dest_ned_m)

    def near_ned_m(self, vehicle: int, rel_ned_m: Vec3, now_s: float) -> Vec3:
        """The place where a vehicle is told to be, at most NEAR_M farther off than it was measured lately."""
        return self._ranges.bring_near(vehicle, rel_ned_m, now_s, NEAR_M)

    def update(self, neighbours: Sequence[Neighbour], now_s: float) -> None:
        """Sets `displaced`. `neighbours`: as they are told to be."""
        if now_s - self._checked_s < CHECK_S - 1e-6:
            return
        self._checked_s = now_s
        pairs = self._measured(neighbours, now_s)
        found = [] if len(pairs) < LEAST else _find_places(pairs)
        if not found:
            self._found.clear()
            self.displaced = None
            return
        off = found[0]
        self._found.append((now_s, off))
        if len(self._found) < CHECKS:
            return
        if len(found) > 1:
            self.displaced = Displaced((0.0, 0.0), (0.0, 0.0), max(math.hypot(*place) for place in found))
        else:
            self.displaced = Displaced(off, self._drift_ne_mps(), FOUND_M)

    def _measured(self, neighbours: Sequence[Neighbour], now_s: float) -> list[Pair]:
        pairs = []
        for neighbour in neighbours:
            north, east, down = neighbour.rel_ned_m
            level_m = self._ranges.level_m(neighbour.id, down, now_s, within_s=MEASURED_S)
            if level_m < math.inf and level_m >= STEEP * math.hypot(level_m, down):
                pairs.append((north, east, level_m))
        return pairs

    def _drift_ne_mps(self) -> Level:
        """By least squares over the checks in a row."""
        count = len(self._found)
        mean_s = sum(at_s for at_s, _ in self._found) / count
        square = sum((at_s - mean_s) ** 2 for at_s, _ in self._found)
        north = sum((at_s - mean_s) * off[0] for at_s, off in self._found)
        east = sum((at_s - mean_s) * off[1] for at_s, off in self._found)
        return (north / square, east / square)


def _find_places(pairs: Sequence[Pair]) -> list[Level]:
    """By how much the own position is off, the likeliest first, and others as likely; empty: it explains the ranges."""
    told = _misfit(pairs, (0.0, 0.0))
    if told <= ALARM:
        return []
    fits = sorted((_misfit(pairs, off), off) for off in (_fit(pairs, start) for start in _starts(pairs)))
    least, best = fits[0]
    if told - least <= ALARM:
        return []
    mirrored = _fit(pairs, _mirrored(pairs, best))
    fits.append((_misfit(pairs, mirrored), mirrored))
    places = [best, *(off for misfit, off in fits if misfit - least < SIDES and math.dist(off, best) > SIDES_M)]
    return places if min(math.hypot(*off) for off in places) >= LEAST_M else []


def _misfit(pairs: Sequence[Pair], off: Level) -> float:
    """Squared sigmas by which ranges differ from distances, if the own position is off by so much."""
    return sum(
        [
            min(TRUNCATED, ((math.hypot(north + off[0], east + off[1]) - level_m) / SIGMA_M) ** 2)
            for north, east, level_m in pairs
        ]
    )


def _starts(pairs: Sequence[Pair]) -> list[Level]:
    """Offsets to begin a fit at: as far each way as the range that is most wrong."""
    most_m = max(abs(level_m - math.hypot(north, east)) for north, east, level_m in pairs)
    angles = [2.0 * math.pi * k / STARTS for k in range(STARTS)]
    return [(0.0, 0.0), *((most_m * math.cos(angle), most_m * math.sin(angle)) for angle in angles)]


def _mirrored(pairs: Sequence[Pair], off: Level) -> Level:
    """The offset on the other side of the line along which the neighbours spread most."""
    count = len(pairs)
    north, east = sum(pair[0] for pair in pairs) / count, sum(pair[1] for pair in pairs) / count
    nn = sum((pair[0] - north) ** 2 for pair in pairs)
    ee = sum((pair[1] - east) ** 2 for pair in pairs)
    ne = sum((pair[0] - north) * (pair[1] - east) for pair in pairs)
    angle = 0.5 * math.atan2(2.0 * ne, nn - ee)
    across = (-math.sin(angle), math.cos(angle))
    # The own place, from the told one, is -off.
    away_m = (north + off[0]) * across[0] + (east + off[1]) * across[1]
    return (off[0] - 2.0 * away_m * across[0], off[1] - 2.0 * away_m * across[1])


def _fit(pairs: Sequence[Pair], start: Level) -> Level:
    """Gauss-Newton with a little damping; what is beyond its truncation counts less (Geman-McClure's weights)."""
    north_m, east_m = start
    for _ in range(STEPS):
        a = b = c = 0.0
        d = e = 0.0
        for north, east, level_m in pairs:
            x, y = north + north_m, east + east_m
            away_m = max(1e-3, math.hypot(x, y))
            rest_m = level_m - away_m
            weight = 1.0 / (1.0 + (rest_m / SIGMA_M) ** 2 / TRUNCATED) ** 2
            u, v = x / away_m, y / away_m
            a += weight * u * u
            b += weight * u * v
            c += weight * v * v
            d += weight * u * rest_m
            e += weight * v * rest_m
        a, c = a + 1e-3, c + 1e-3
        det = a * c - b * b
        north_m += (c * d - b * e) / det
        east_m += (a * e - b * d) / det
    return north_m, east_m
