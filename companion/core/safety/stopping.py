"""Where a velocity leads until the vehicle is at rest again, and whether that way is clear of all that was seen.

The model of the vehicle, level: what is told takes `DEAD_S` to act; from then on the velocity follows it with a lag of
LAG_S, at most at the acceleration limit; told to rest, the vehicle goes straight on and stops within
`LAG_S * speed + speed^2 / (2 braking)`, with `braking` below that limit. docs/explanation/trees.md says what follows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

LAG_S: Final = 0.3
DEAD_S: Final = 0.1
STEP_S: Final = 0.05  # of the roll-out
PUSH_PER_S: Final = 1.0
CREEP_MPS: Final = 0.3  # where it sees nothing it goes no faster
ESCAPE_S: Final = 1.0  # over which ways out are compared when none is clear
SLACK_M: Final = 0.01  # by which a way may come nearer to what is too near already: rounding, and the scan's noise
GIVES_M: Final = 0.05  # to so much below what it should be, or one verification after the other would give way
ROUNDING_M: Final = 1e-6  # further in


@final
class LocalObstacleCloud:
    """What stands about the vehicle: north, east (m, from it), and how near to each its way may come."""

    __slots__ = ("away_m", "blind", "clears_m", "easts", "gust_mps", "needs_m2", "norths", "reach_m", "start")

    def __init__(
        self,
        reach_m: float,
        blind: Sequence[bool],
        gust_mps: float = 0.0,
        start: tuple[float, float, float, float] | None = None,
    ) -> None:
        """`reach_m`: no way may lead further. `blind`: bearings, from north clockwise, that are not seen.

        `gust_mps`: by how much a gust may push before a setpoint acts. `start`: where the vehicle will be, and how much
        faster (north, east, m and m/s), before DEAD_S begins, in spite of what it is told now; None: here.
        """
        self.start: Final = start
        self.gust_mps: Final = gust_mps
        self.reach_m: Final = reach_m
        self.blind: Final = blind
        self.norths: list[float] = []
        self.easts: list[float] = []
        self.away_m: list[float] = []
        self.clears_m: list[float] = []  # at which to pass
        self.needs_m2: list[float] = []  # squares of what a way must keep

    def copy(self) -> LocalObstacleCloud:
        """One that can be added to."""
        other = LocalObstacleCloud(self.reach_m, self.blind, self.gust_mps, self.start)
        other.norths += self.norths
        other.easts += self.easts
        other.away_m += self.away_m
        other.clears_m += self.clears_m
        other.needs_m2 += self.needs_m2
        return other

    def add(self, norths: Sequence[float], easts: Sequence[float], clear_m: float) -> None:
        """Points to pass at `clear_m`; of one that is nearer already, not to come nearer."""
        for k in range(len(norths)):
            n, e = norths[k], easts[k]
            away_m = math.sqrt(n * n + e * e)
            self.norths.append(n)
            self.easts.append(e)
            self.away_m.append(away_m)
            self.clears_m.append(clear_m)
            need_m = _need_m(away_m, clear_m)
            self.needs_m2.append(need_m * need_m)

    def widen(self, by_m: float) -> None:
        """Pass every point by so much more than was told (not than after the last widening)."""
        for k in range(len(self.away_m)):
            need_m = _need_m(self.away_m[k], self.clears_m[k] + by_m)
            self.needs_m2[k] = need_m * need_m

    def push(self, wider_m: float, most_mps: float) -> tuple[float, float]:
        """A velocity away from all that is nearer than it should be and `wider_m` more: PUSH_PER_S for each metre."""
        n = e = 0.0
        for k in range(len(self.norths)):
            away_m = self.away_m[k]
            short_m = self.clears_m[k] + wider_m - away_m
            if short_m > 0.0 and away_m > 1e-6:
                n -= PUSH_PER_S * short_m * self.norths[k] / away_m
                e -= PUSH_PER_S * short_m * self.easts[k] / away_m
        size = math.sqrt(n * n + e * e)
        if size > most_mps:
            n, e = n * most_mps / size, e * most_mps / size
        return n, e

    def nearest_m2(self, north_m: float, east_m: float) -> float:
        """Square of the distance of a place from the nearest of them."""
        least = math.inf
        for k in range(len(self.norths)):
            n, e = self.norths[k] - north_m, self.easts[k] - east_m
            away_m2 = n * n + e * e
            if away_m2 < least:
                least = away_m2
        return least

    def is_seen(self, north_m: float, east_m: float) -> bool:
        """A place within reach, where the sensor has looked lately."""
        if not north_m * north_m + east_m * east_m <= self.reach_m * self.reach_m:  # too far, or no number
            return False
        bearings = len(self.blind)
        return not self.blind[math.floor(math.atan2(east_m, north_m) / math.tau * bearings + 0.5) % bearings]

    def clear_of(self, from_n: float, from_e: float, to_n: float, to_e: float) -> bool:
        """The straight way from one place to another keeps from every point what it needs."""
        norths, easts, needs_m2 = self.norths, self.easts, self.needs_m2
        way_n, way_e = to_n - from_n, to_e - from_e
        length_m2 = way_n * way_n + way_e * way_e
        for k in range(len(norths)):
            n, e = norths[k] - from_n, easts[k] - from_e
            along = n * way_n + e * way_e
            if along >= length_m2:
                n, e = n - way_n, e - way_e
            elif along > 0.0:
                share = along / length_m2
                n, e = n - share * way_n, e - share * way_e
            if n * n + e * e < needs_m2[k]:
                return False
        return True


def _need_m(away_m: float, clear_m: float) -> float:
    if away_m > clear_m:
        return clear_m
    return max(0.0, away_m - SLACK_M, min(away_m - ROUNDING_M, clear_m - GIVES_M))


@final
class ResponseModel:
    """The model, with a vehicle's limits (m/s^2)."""

    __slots__ = ("acceleration_mps2", "braking_mps2")

    def __init__(self, acceleration_mps2: float, braking_mps2: float) -> None:
        self.acceleration_mps2: Final = acceleration_mps2
        self.braking_mps2: Final = braking_mps2

    def way_m(self, speed_mps: float) -> float:
        """How far the vehicle goes on once it brakes."""
        return LAG_S * speed_mps + speed_mps * speed_mps / (2.0 * self.braking_mps2)

    def speed_mps(self, way_m: float) -> float:
        """From which it stops within `way_m`; at least 0."""
        if way_m <= 0.0:
            return 0.0
        early = LAG_S * self.braking_mps2
        return math.sqrt(early * early + 2.0 * self.braking_mps2 * way_m) - early

    def is_clear(
        self,
        points: LocalObstacleCloud,
        vel: tuple[float, float],
        last: tuple[float, float],
        told: tuple[float, float],
        hold_s: float,
        *,
        slews: bool,
    ) -> bool:
        """From `vel`, `last` told before and `told` for `hold_s` from now on, then rest: nothing stands in the way.

        `slews`: the setpoint goes from `last` to `told` at the acceleration limit, else at once. All (north, east).
        """
        u_n, u_e = vel
        s_n, s_e = last
        c_n, c_e = told
        n = e = 0.0
        if points.start is not None:  # nothing told now changes the way there
            n, e = points.start[0], points.start[1]
            u_n, u_e = u_n + points.start[2], u_e + points.start[3]
        start_n, start_e = n, e
        most_mps = self.acceleration_mps2 * STEP_S
        dead = round(DEAD_S / STEP_S)
        steps = dead + round(hold_s / STEP_S)
        half = dead if hold_s <= 2.0 * STEP_S else (steps + 1) // 2  # a longer way bends: two chords
        for k in range(steps):
            if k >= dead:
                d_n, d_e = c_n - s_n, c_e - s_e
                if slews:
                    step_mps = math.sqrt(d_n * d_n + d_e * d_e)
                    if step_mps > most_mps:
                        d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
                s_n, s_e = s_n + d_n, s_e + d_e
            d_n, d_e = (s_n - u_n) * (STEP_S / LAG_S), (s_e - u_e) * (STEP_S / LAG_S)
            step_mps = math.sqrt(d_n * d_n + d_e * d_e)
            if step_mps > most_mps:
                d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
            n, e = n + (u_n + 0.5 * d_n) * STEP_S, e + (u_e + 0.5 * d_e) * STEP_S
            u_n, u_e = u_n + d_n, u_e + d_e
            if k + 1 == half and half < steps:
                if not points.clear_of(start_n, start_e, n, e):
                    return False
                start_n, start_e = n, e
        if not points.clear_of(start_n, start_e, n, e):
            return False
        speed_mps = math.sqrt(u_n * u_n + u_e * u_e)
        if speed_mps < 1e-6:
            return True
        gust_mps = points.gust_mps if speed_mps > CREEP_MPS else 0.0
        share = self.way_m(speed_mps + gust_mps) / speed_mps
        if speed_mps > CREEP_MPS and not points.is_seen(n + share * u_n, e + share * u_e):
            return False
        return points.clear_of(n, e, n + share * u_n, e + share * u_e)

    def nearest_m(
        self, points: LocalObstacleCloud, vel: tuple[float, float], last: tuple[float, float], told: tuple[float, float]
    ) -> float:
        """How near the vehicle comes to any point within ESCAPE_S when `told` from now on; as `is_clear`."""
        u_n, u_e = vel
        s_n, s_e = last
        n = e = 0.0
        if points.start is not None:
            n, e = points.start[0], points.start[1]
            u_n, u_e = u_n + points.start[2], u_e + points.start[3]
        least = math.inf
        most_mps = self.acceleration_mps2 * STEP_S
        dead = round(DEAD_S / STEP_S)
        for k in range(round(ESCAPE_S / STEP_S)):
            if k == dead:
                s_n, s_e = told
            d_n, d_e = (s_n - u_n) * (STEP_S / LAG_S), (s_e - u_e) * (STEP_S / LAG_S)
            step_mps = math.sqrt(d_n * d_n + d_e * d_e)
            if step_mps > most_mps:
                d_n, d_e = d_n * most_mps / step_mps, d_e * most_mps / step_mps
            n, e = n + (u_n + 0.5 * d_n) * STEP_S, e + (u_e + 0.5 * d_e) * STEP_S
            u_n, u_e = u_n + d_n, u_e + d_e
            least = min(least, points.nearest_m2(n, e))
        return math.sqrt(least)
