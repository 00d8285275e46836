"""The local obstacle cloud: all that stands about a vehicle in one tick, built once (`obstacle_perception`).

Scans, vehicles that hover without a companion, and the mission's own trunks. The local planner, the safety filter and
the recovery from dead ends read it; none changes it. Level positions, (north, east) metres from the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import sub
from companion.core.perception.obstacle_memory import SeenBefore
from companion.core.perception.sight import Sight
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import CoverageShape, Mission

PUSH_PER_S: Final = 1.0
SLACK_M: Final = 0.01  # by which a way may come nearer to what is too near already: rounding, and the scan's noise
GIVES_M: Final = 0.05  # to so much below what it should be, or one verification after the other would give way
ROUNDING_M: Final = 1e-6  # further in


class ObstacleKind(IntEnum):
    """Kind of an obstacle."""

    FENCE = 0
    TRUNK = 1  # the mission's own
    NEIGHBOUR = 2  # heard, and steered by its companion
    HOVERING = 3  # heard, in the air, and steered by no companion
    SILENT = 4  # heard no more: hovers where its autopilot's failsafe holds it
    SCANNED = 5  # a point that the obstacle sensor saw
    HIDDEN = 6  # on its predicted corridor, behind trees


@final
class Obstacle:
    """Obstacle known by more than a scan: where from the vehicle (NED m), and how far out it is kept from."""

    __slots__ = ("keep_out_m", "kind", "rel_ned_m", "upright")

    def __init__(self, kind: ObstacleKind, rel_ned_m: Vec3, keep_out_m: float, *, upright: bool = False) -> None:
        self.kind: Final = kind
        self.rel_ned_m: Final = rel_ned_m
        self.keep_out_m: Final = keep_out_m
        self.upright: Final = upright  # a trunk from the ground up: keep out level, not in three dimensions


@final
class Trunk:
    """A tree that the mission knows of."""

    __slots__ = ("keep_out_m", "pos_ned_m", "upright")

    def __init__(self, pos_ned_m: Vec3, keep_out_m: float, *, upright: bool) -> None:
        self.pos_ned_m: Final = pos_ned_m  # about the mission's origin
        self.keep_out_m: Final = keep_out_m
        self.upright: Final = upright

    def seen_from(self, pos_ned_m: Vec3) -> Obstacle:
        """The same from a position, NED m about the mission's origin."""
        return Obstacle(ObstacleKind.TRUNK, sub(self.pos_ned_m, pos_ned_m), self.keep_out_m, upright=self.upright)


def trunks_of(mission: Mission) -> tuple[Trunk, ...]:
    """Trunks of a mission: the one at d2, and those at the stops before it.

    d2 is a goal and no obstacle: the trunk beside which the swarm gathers stands there because the mission says so.
    """
    upright = mission.coverage.shape is CoverageShape.RING
    keep_out_m = mission.coverage.keep_out_m
    return tuple([Trunk(enu_to_ned(visit.pos_enu_m), keep_out_m, upright=upright) for visit in mission.trees])


def find_hovering(silent: Mapping[int, PeerReport], neighbours: Sequence[Neighbour]) -> dict[int, PeerReport]:
    """By id, vehicles in the air that no companion steers: those that fell silent, and those that are heard there."""
    found = dict(silent)
    for n in neighbours:
        if n.stands and n.id not in found:  # what is heard of one that is silent is not its own word
            found[n.id] = PeerReport(n.id, n.rel_ned_m, n.age_s, silent=False)
    return found


@final
class LocalObstacleCloud:
    """Scanned points, how near to each a way may come, and what of the surroundings was seen at all; known obstacles.

    Filled by `add_points`, and not changed after that.
    """

    __slots__ = (
        "away_m",
        "blind",
        "clears_m",
        "easts",
        "hovering",
        "needs_m2",
        "norths",
        "reach_m",
        "seen_before",
        "sensor_m",
        "sight",
        "trunks",
    )

    def __init__(
        self,
        reach_m: float,
        blind: Sequence[bool],
        *,
        sensor_m: float = math.inf,
        trunks: Sequence[Obstacle] = (),
        hovering: Sequence[Obstacle] = (),
        seen_before: SeenBefore | None = None,
        sight: Sight | None = None,
    ) -> None:
        """`reach_m`: no way may lead further. `blind`: bearings, from north clockwise, that are not seen.

        `sensor_m`: range of the sensor; what was seen before may be further. `seen_before`: to search for a way by.
        `sight`: what was looked at lately; None: all.
        """
        self.reach_m: Final = reach_m
        self.blind: Final = blind
        self.sensor_m: Final = sensor_m
        self.trunks: Final = trunks
        self.hovering: Final = hovering
        self.seen_before: Final = seen_before
        self.sight: Final = sight
        self.norths: list[float] = []
        self.easts: list[float] = []
        self.away_m: list[float] = []
        self.clears_m: list[float] = []  # at which to pass
        self.needs_m2: list[float] = []  # squares of what a way must keep

    def _empty(self) -> LocalObstacleCloud:
        return LocalObstacleCloud(
            self.reach_m,
            self.blind,
            sensor_m=self.sensor_m,
            trunks=self.trunks,
            hovering=self.hovering,
            sight=self.sight,
        )

    def copy(self) -> LocalObstacleCloud:
        """A cloud that can be added to."""
        other = self._empty()
        other.norths += self.norths
        other.easts += self.easts
        other.away_m += self.away_m
        other.clears_m += self.clears_m
        other.needs_m2 += self.needs_m2
        return other

    def widened(self, by_m: float) -> LocalObstacleCloud:
        """The same cloud, of which every point has to be passed by so much more."""
        other = self._empty()
        other.norths, other.easts, other.away_m, other.clears_m = self.norths, self.easts, self.away_m, self.clears_m
        for k in range(len(self.away_m)):
            need_m = _need_m(self.away_m[k], self.clears_m[k] + by_m)
            other.needs_m2.append(need_m * need_m)
        return other

    def add_points(self, norths: Sequence[float], easts: Sequence[float], clear_m: float) -> None:
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

    def push_away(self, wider_m: float, most_mps: float) -> tuple[float, float]:
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

    def find_way_out(self) -> tuple[float, float, float]:
        """Direction (unit vector north, east) away from the point of which most clearance is lacking; and how much."""
        most_m, n, e = 0.0, 0.0, 0.0
        for k in range(len(self.norths)):
            away_m = self.away_m[k]
            if self.clears_m[k] - away_m > most_m and away_m > ROUNDING_M:
                most_m, n, e = self.clears_m[k] - away_m, -self.norths[k] / away_m, -self.easts[k] / away_m
        return n, e, most_m

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

    def is_way_clear(self, from_n: float, from_e: float, to_n: float, to_e: float) -> bool:
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
