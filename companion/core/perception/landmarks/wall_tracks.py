"""Tracked walls: straight lines that stand still, each known along its normal alone.

As trunks (`trunk_tracks`), a wall is good, and corrects the pose, after GOOD_SIGHTINGS over GOOD_S that agree. Along
itself it tells nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.perception.landmarks.wall_segments import WallSegment

GATE_CHI2: Final = 12.0
NEAR_M: Final = 0.8  # off its line no segment is compared with a wall
TURNED_RAD: Final = 0.2  # nor one that is turned so far from it
BESIDE_M: Final = 1.0  # nor one that begins so far behind where the wall ended
GOOD_SIGHTINGS: Final = 4
GOOD_S: Final = 0.5
GOOD_CHI2: Final = 4.0
CHI2_FOLLOW: Final = 0.2
WANDERS_M2_PER_S: Final = 0.02 * 0.02
WANDERS_RAD2_PER_S: Final = math.radians(0.1) ** 2
UNSEEN_S: Final = 6.0
UNPROVEN_S: Final = 0.5
TRACKS_MAX: Final = 24
ON_LINE_M: Final = 0.6  # off a wall's line: a piece of it, though no segment of its own
CROSSED: Final = 0.5  # sine: two walls so far from one direction tell a whole place
GOES_ON_M: Final = 8.0  # so far beyond what has been seen of it


@final
class Wall:
    """One track, in the frame of the own odometry: a place on it, its normal towards where it was seen from."""

    __slots__ = (
        "born_s",
        "chi2",
        "east_m",
        "from_m",
        "normal_rad",
        "normal_rad2",
        "north_m",
        "offset_m2",
        "seen_s",
        "sightings",
        "to_m",
    )

    def __init__(self, segment: WallSegment, now_s: float) -> None:
        self.north_m = segment.north_m
        self.east_m = segment.east_m
        self.normal_rad = segment.normal_rad
        self.offset_m2 = segment.offset_sd_m * segment.offset_sd_m
        self.normal_rad2 = segment.normal_sd_rad * segment.normal_sd_rad
        self.from_m, self.to_m = -segment.half_m, segment.half_m  # along it, clockwise of the normal
        self.born_s = self.seen_s = now_s
        self.sightings = 1
        self.chi2 = 0.0

    @property
    def is_good(self) -> bool:
        """It stands still, as far as its sightings tell."""
        is_proven = self.sightings >= GOOD_SIGHTINGS and self.seen_s - self.born_s >= GOOD_S - 1e-6
        return is_proven and self.chi2 < GOOD_CHI2

    def offset_of(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Distance of a place before the wall, along its normal; and along it."""
        n, e = north_m - self.north_m, east_m - self.east_m
        cos, sin = math.cos(self.normal_rad), math.sin(self.normal_rad)
        return n * cos + e * sin, e * cos - n * sin

    def variance_m2(self, along_m: float) -> float:
        """Of the wall's offset there."""
        return self.offset_m2 + along_m * along_m * self.normal_rad2

    def take_sighting(self, sighting: WallSighting, now_s: float) -> None:
        """It is where it was, and where it is seen now."""
        segment = sighting.segment
        off_m, along_m = self.offset_of(sighting.north_m, sighting.east_m)
        turned_rad = math.remainder(sighting.normal_rad - self.normal_rad, math.tau)
        gain = self.normal_rad2 / (self.normal_rad2 + segment.normal_sd_rad * segment.normal_sd_rad)
        self.normal_rad += gain * turned_rad
        self.normal_rad2 *= 1.0 - gain
        gain = self.offset_m2 / (self.offset_m2 + segment.offset_sd_m * segment.offset_sd_m)
        # Its place moves to below the middle of what is seen: there the line is known
        cos, sin = math.cos(self.normal_rad), math.sin(self.normal_rad)
        self.north_m += gain * off_m * cos - along_m * sin
        self.east_m += gain * off_m * sin + along_m * cos
        self.offset_m2 *= 1.0 - gain
        self.from_m = min(self.from_m - along_m, -segment.half_m)
        self.to_m = max(self.to_m - along_m, segment.half_m)
        self.seen_s = now_s
        self.sightings += 1
        self.chi2 += max(CHI2_FOLLOW, 1.0 / self.sightings) * (sighting.chi2 - self.chi2)


@final
class WallSighting:
    """A segment as the pose places it now, and the wall that it is taken for; None: a new one."""

    __slots__ = ("chi2", "east_m", "normal_rad", "north_m", "segment", "wall")

    def __init__(self, segment: WallSegment) -> None:
        self.segment: Final = segment
        self.wall: Wall | None = None
        self.chi2 = 0.0
        self.north_m = self.east_m = self.normal_rad = 0.0
        self.place(0.0, (0.0, 0.0))

    def place(self, turned_rad: float, shift: tuple[float, float]) -> None:
        """As of a pose turned and moved by so much since the scan."""
        segment = self.segment
        cos, sin = math.cos(turned_rad), math.sin(turned_rad)
        n, e = segment.north_m - segment.eye_north_m, segment.east_m - segment.eye_east_m
        self.north_m = segment.eye_north_m + shift[0] + cos * n - sin * e
        self.east_m = segment.eye_east_m + shift[1] + sin * n + cos * e
        self.normal_rad = segment.normal_rad + turned_rad

    def moves_m_per_rad(self) -> tuple[float, float]:
        """Motion of its middle when the pose turns clockwise."""
        segment = self.segment
        return -(segment.east_m - segment.eye_east_m), segment.north_m - segment.eye_north_m


@final
class WallTracks:
    """One vehicle's."""

    __slots__ = ("_tracked_s", "walls")

    def __init__(self) -> None:
        self.walls: list[Wall] = []
        self._tracked_s = 0.0

    def match_segment(self, sighting: WallSighting, pose_m2: tuple[float, float]) -> None:
        """Finds the wall of a segment. `pose_m2`: variances of its offset and direction by the pose's errors."""
        least = GATE_CHI2
        segment = sighting.segment
        for wall in self.walls:
            off_m, along_m = wall.offset_of(sighting.north_m, sighting.east_m)
            turned_rad = math.remainder(sighting.normal_rad - wall.normal_rad, math.tau)
            if abs(off_m) > NEAR_M or abs(turned_rad) > TURNED_RAD:
                continue
            reach_m = segment.half_m + BESIDE_M
            if along_m + reach_m < wall.from_m or along_m - reach_m > wall.to_m:
                continue
            off_m2 = wall.variance_m2(along_m) + segment.offset_sd_m * segment.offset_sd_m + pose_m2[0]
            turned_rad2 = wall.normal_rad2 + segment.normal_sd_rad * segment.normal_sd_rad + pose_m2[1]
            chi2 = off_m * off_m / off_m2 + turned_rad * turned_rad / turned_rad2
            if chi2 < least:
                sighting.wall, sighting.chi2, least = wall, chi2, chi2

    def has_piece(self, north_m: float, east_m: float) -> bool:
        """A place is on a good wall, or where it would go on."""
        for wall in self.walls:
            off_m, along_m = wall.offset_of(north_m, east_m)
            is_along = wall.from_m - GOES_ON_M <= along_m <= wall.to_m + GOES_ON_M
            if wall.is_good and abs(off_m) < ON_LINE_M and is_along:
                return True
        return False

    def update_wall(self, sighting: WallSighting, now_s: float) -> None:
        """A wall is seen again; a segment that is no wall's begins one."""
        if sighting.wall is not None:
            sighting.wall.take_sighting(sighting, now_s)
        elif len(self.walls) < TRACKS_MAX:
            wall = Wall(sighting.segment, now_s)
            wall.north_m, wall.east_m, wall.normal_rad = sighting.north_m, sighting.east_m, sighting.normal_rad
            self.walls.append(wall)

    def forget(self, now_s: float) -> None:
        """Drops those unseen for UNSEEN_S; the others are known a little less well."""
        since_s = max(0.0, min(1.0, now_s - self._tracked_s))
        self._tracked_s = now_s
        self.walls = [wall for wall in self.walls if now_s - wall.seen_s <= (UNSEEN_S if wall.is_good else UNPROVEN_S)]
        for wall in self.walls:
            wall.offset_m2 += WANDERS_M2_PER_S * since_s
            wall.normal_rad2 += WANDERS_RAD2_PER_S * since_s

    def turn_about(self, north_m: float, east_m: float, turn_rad: float) -> None:
        """All of them, about a place; clockwise."""
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        for wall in self.walls:
            n, e = wall.north_m - north_m, wall.east_m - east_m
            wall.north_m, wall.east_m = north_m + cos * n - sin * e, east_m + sin * n + cos * e
            wall.normal_rad += turn_rad


def one_direction(walls: Sequence[WallSighting]) -> tuple[float, float] | None:
    """The normal of walls that are all of one direction; None: two of them are not."""
    first_rad = walls[0].normal_rad
    for wall in walls:
        if abs(math.sin(wall.normal_rad - first_rad)) > CROSSED:
            return None
    return math.cos(first_rad), math.sin(first_rad)
