"""Vehicles seen: what moves among the stems of level scans, and no heard neighbour is.

A stem that is no good trunk begins a candidate, which moves by a filter of its own. It is a vehicle when it has gone
farther than its scatter, at a speed that no standing thing shows, for some scans, and into a place that was seen empty
when it began, or out of one that is seen empty now: from trunk to trunk nothing moves so. One that comes from behind
trunks is, too, when it is seen whole and as wide as a hull. One that a neighbour's report fits, in place and motion, is
that neighbour, and is kept from where it is seen, too; every other is, whatever anybody reports. What a level scan
shows of a hull is in docs/explanation/own-motion.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.neighbour import Neighbour
from companion.core.perception.landmarks.trunk_tracks import Sighting
from companion.core.perception.level_scan import LevelScan
from mission.common.frames import Vec3

MOVES_MPS: Final = 0.6  # trunks placed by a corrected pose seem to move by less
GONE_M: Final = 0.35  # from where it was first seen
GONE_SIGMAS: Final = 5.0
PROVEN_SIGHTINGS: Final = 3  # of two that near each other at 3 m/s each, 1.2 m after the first
WIDE_M: Final = 0.2  # radius of a hull at least: what is glimpsed between trunks, and seems to go along, is thinner
WIDE_SIGHTINGS: Final = 2  # in a row, whole and as wide: then nobody need have seen its way empty, which trunks hid
COARSE_M: Final = 0.1  # a bearing's error, of sectors: trunks seem to hop from one to the next
COARSE_SIGHTINGS: Final = 5
SURFACE_SD_M: Final = 0.04  # of a hull's nearest side, and of what the pose has moved
GATE_M: Final = 0.3  # and two sigmas from where it is expected
EMPTY_M: Final = 0.4  # beyond a place: so far at least rays went on that saw nobody there
PUSHED_MPS2: Final = 2.0  # rms, by which a vehicle changes its velocity
SPEED_SD_MPS: Final = 3.0  # before it was seen twice
STANDS_MPS: Final = 0.3  # slower it stands
STANDS_S: Final = 2.0  # so long: what it is now is an obstacle, as a trunk is
UNSEEN_S: Final = 0.35  # until a candidate is dropped
UNSEEN_VEHICLE_S: Final = 1.5  # until a vehicle is: trunks hide it, or it leans out of the scan's plane
TRACKS_MAX: Final = 24
HEARD_M: Final = 1.5  # a heard neighbour is within this of where it is seen
HOVERS_M: Final = 0.7  # from a place at which a hull hovers
HEARD_MPS: Final = 1.0  # and moves so alike, but for what the track's own velocity is uncertain


@final
class SeenVehicle:
    """A vehicle by scans alone, level: relative to this one (NED m), its velocity, and how uncertain it is."""

    __slots__ = ("age_s", "gives_way", "heard", "hovers", "rel_ned_m", "sd_m", "vel_ned_mps")

    def __init__(
        self,
        rel_ned_m: Vec3,
        vel_ned_mps: Vec3,
        sd_m: float,
        age_s: float,
        *,
        hovers: bool = False,
        heard: bool = False,
        gives_way: bool = False,
    ) -> None:
        self.rel_ned_m: Final = rel_ned_m  # now
        self.vel_ned_mps: Final = vel_ned_mps
        self.sd_m: Final = sd_m
        self.age_s: Final = age_s  # since it was seen last
        self.hovers: Final = hovers  # it is no trunk, whether it moves or not: see `HoveringHulls`
        self.heard: Final = heard  # a neighbour says that it is here, and moves so: it is where it is seen
        self.gives_way: Final = gives_way  # and its companion steers it

    @property
    def rests(self) -> bool:
        """It hovers in one place, and nobody hears it."""
        return self.hovers and not self.heard and math.hypot(self.vel_ned_mps[0], self.vel_ned_mps[1]) < MOVES_MPS


@final
class _Axis:
    """Variances of a position and a velocity along one axis, and their covariance."""

    __slots__ = ("pp", "pv", "vv")

    def __init__(self, variance_m2: float) -> None:
        self.pp, self.pv, self.vv = variance_m2, 0.0, SPEED_SD_MPS * SPEED_SD_MPS

    def advance(self, dt_s: float) -> None:
        """On by a time, pushed at random."""
        push = PUSHED_MPS2 * PUSHED_MPS2 * dt_s
        self.pp += (2.0 * self.pv + self.vv * dt_s + push * dt_s * dt_s / 3.0) * dt_s
        self.pv += (self.vv + push * dt_s / 2.0) * dt_s
        self.vv += push

    def take_sighting(self, variance_m2: float) -> tuple[float, float]:
        """Gains of position and velocity."""
        total = self.pp + variance_m2
        gain_p, gain_v = self.pp / total, self.pv / total
        self.vv -= gain_v * self.pv
        self.pp, self.pv = (1.0 - gain_p) * self.pp, (1.0 - gain_p) * self.pv
        return gain_p, gain_v


@final
class _Track:
    """Position and velocity, filtered along the line of sight and across it, which turns slowly: ranges are exact."""

    __slots__ = (
        "_across",
        "_along",
        "_born_sds_m",
        "born",
        "born_east_m",
        "born_north_m",
        "born_s",
        "east_m",
        "east_mps",
        "gone_sigmas",
        "hovers",
        "is_free",
        "is_vehicle",
        "moved_s",
        "north_m",
        "north_mps",
        "seen_s",
        "sightings",
        "time_s",
        "wide_sightings",
    )

    def __init__(self, sighting: Sighting, born: LevelScan, now_s: float) -> None:
        """`born`: the scan in which it was seen first."""
        self.born: Final = born
        self.is_free = False  # it has moved through what is seen to be free
        self.north_m = self.born_north_m = sighting.north_m
        self.east_m = self.born_east_m = sighting.east_m
        self.north_mps = self.east_mps = 0.0
        along_m2, across_m2 = _variances_m2(sighting)
        self._along: Final = _Axis(along_m2)
        self._across: Final = _Axis(across_m2)
        self._born_sds_m: Final = (math.sqrt(along_m2), math.sqrt(across_m2))
        self.time_s = self.seen_s = self.born_s = now_s
        self.is_vehicle = self.hovers = False
        self.moved_s = now_s
        self.sightings = 1
        self.wide_sightings = 0  # whole and as wide as a hull, in a row until now
        self.gone_sigmas = 0.0  # from where it was first seen to where it was last

    def _has_moved(self) -> bool:
        """It moves as no trunk does."""
        across_sd_m = self._born_sds_m[1]
        is_whole = self.wide_sightings >= WIDE_SIGHTINGS
        least = PROVEN_SIGHTINGS if is_whole or across_sd_m < COARSE_M else COARSE_SIGHTINGS
        if not (self.is_free or is_whole) or self.sightings < least or self.gone_sigmas < GONE_SIGMAS:
            return False
        gone_m = math.hypot(self.north_m - self.born_north_m, self.east_m - self.born_east_m)
        least_m = GONE_M + (0.0 if is_whole else 2.0 * across_sd_m)
        return gone_m > least_m and self.speed_mps > MOVES_MPS + self.sd_mps

    def note_motion(self, now_s: float, hovering: Sequence[Vec3], heard: Sequence[Vec3]) -> None:
        """After each sighting: one that has moved is a vehicle, and stays one when it stops; not for ever.

        One that hovers is a vehicle as long as it does, and one that moved and stands where a neighbour is `heard`.
        """
        self.hovers = self._is_near(hovering, HOVERS_M)
        if self.hovers or self._has_moved():
            self.is_vehicle = True
            self.moved_s = now_s
        elif self.speed_mps > STANDS_MPS + self.sd_mps or self._is_near(heard, HEARD_M):
            self.moved_s = now_s
        elif now_s - self.moved_s > STANDS_S:
            self.is_vehicle = self.is_free = False

    def _is_near(self, places: Sequence[Vec3], within_m: float) -> bool:
        return any([math.hypot(at[0] - self.north_m, at[1] - self.east_m) <= within_m for at in places])

    @property
    def speed_mps(self) -> float:
        """Level."""
        return math.hypot(self.north_mps, self.east_mps)

    @property
    def kept_s(self) -> float:
        """For how long it is kept unseen: one that brakes leans out of the scan's plane."""
        return UNSEEN_VEHICLE_S if self.is_vehicle else UNSEEN_S

    @property
    def sd_m(self) -> float:
        """Of its position, the less certain way."""
        return math.sqrt(max(self._along.pp, self._across.pp))

    @property
    def sd_mps(self) -> float:
        """Of its velocity, the less certain way."""
        return math.sqrt(max(self._along.vv, self._across.vv))

    def advance(self, now_s: float) -> None:
        """On, by its velocity."""
        dt_s = now_s - self.time_s
        self.time_s = now_s
        if dt_s <= 0.0:
            return
        self.north_m += self.north_mps * dt_s
        self.east_m += self.east_mps * dt_s
        self._along.advance(dt_s)
        self._across.advance(dt_s)

    def take_sighting(self, sighting: Sighting, now_s: float) -> None:
        """Seen there, now."""
        along_m2, across_m2 = _variances_m2(sighting)
        stem = sighting.stem
        is_wide = stem.radius_m >= WIDE_M and not stem.is_hidden and stem.across_sd_m < COARSE_M
        self.wide_sightings = self.wide_sightings + 1 if is_wide else 0
        ahead, right = math.cos(sighting.stem.bearing_rad), math.sin(sighting.stem.bearing_rad)
        off_n, off_e = sighting.north_m - self.north_m, sighting.east_m - self.east_m
        off_along, off_across = off_n * ahead + off_e * right, off_e * ahead - off_n * right
        along_p, along_v = self._along.take_sighting(along_m2)
        across_p, across_v = self._across.take_sighting(across_m2)
        by_along, by_across = along_p * off_along, across_p * off_across
        self.north_m += by_along * ahead - by_across * right
        self.east_m += by_along * right + by_across * ahead
        by_along, by_across = along_v * off_along, across_v * off_across
        self.north_mps += by_along * ahead - by_across * right
        self.east_mps += by_along * right + by_across * ahead
        n, e = sighting.north_m - self.born_north_m, sighting.east_m - self.born_east_m
        sds_m = self._born_sds_m
        self.gone_sigmas = math.hypot(
            (n * ahead + e * right) / math.sqrt(along_m2 + sds_m[0] * sds_m[0]),
            (e * ahead - n * right) / math.sqrt(across_m2 + sds_m[1] * sds_m[1]),
        )
        self.seen_s = now_s
        self.sightings += 1

    def check_free(self, scan: LevelScan) -> None:
        """After a sighting in that scan: was nobody here when it began, or is nobody where it began?"""
        gone_m = math.hypot(self.north_m - self.born_north_m, self.east_m - self.born_east_m)
        if not self.is_free and gone_m > GONE_M:
            came = self.born.sees_beyond(self.north_m, self.east_m, EMPTY_M)
            self.is_free = came or scan.sees_beyond(self.born_north_m, self.born_east_m, EMPTY_M)


def _surface_m_of(sighting: Sighting) -> float:
    return sighting.stem.surface_m


def _variances_m2(sighting: Sighting) -> tuple[float, float]:
    """Variances of a stem's place along its bearing, and across it."""
    along_m, across_m = sighting.stem.along_sd_m, sighting.stem.across_sd_m
    more_m2 = SURFACE_SD_M * SURFACE_SD_M
    return along_m * along_m + more_m2, across_m * across_m + more_m2


@final
class VehicleTracks:
    """One vehicle's, in the frame in which its scans are placed."""

    __slots__ = ("_tracks",)

    def __init__(self) -> None:
        self._tracks: list[_Track] = []

    def integrate_sightings(
        self,
        sightings: Sequence[Sighting],
        scan: LevelScan,
        now_s: float,
        hovering: Sequence[Vec3],
        heard: Sequence[Vec3],
    ) -> None:
        """Stems of a whole turn that are no good trunks. Places at which hulls hover, and neighbours are heard."""
        self._tracks = [track for track in self._tracks if now_s - track.seen_s <= track.kept_s]
        for track in self._tracks:
            track.advance(now_s)
        taken: list[_Track] = []
        new: list[Sighting] = []
        for sighting in sightings:
            nearest = self._find_nearest(sighting, taken)
            if nearest is not None:
                nearest.take_sighting(sighting, now_s)
                nearest.check_free(scan)
                nearest.note_motion(now_s, hovering, heard)
                taken.append(nearest)
            else:
                new.append(sighting)
        room = TRACKS_MAX - len(self._tracks)
        if len(new) > room:
            new.sort(key=_surface_m_of)
        self._tracks += [_Track(sighting, scan, now_s) for sighting in new[:room]]

    def places(self) -> list[Vec3]:
        """Positions of the vehicles as of the last scan, in the tracks' frame: no trunks are there."""
        return [(track.north_m, track.east_m, 0.0) for track in self._tracks if track.is_vehicle]

    def find_vehicles(self, placed_ned_m: Vec3, heard: Sequence[Neighbour], now_s: float) -> list[SeenVehicle]:
        """Vehicles, and which are `heard`; `placed_ned_m`: this vehicle, in the tracks' frame."""
        found: list[SeenVehicle] = []
        for track in self._tracks:
            age_s = now_s - track.seen_s
            if not track.is_vehicle or age_s > track.kept_s:
                continue
            ahead_s = now_s - track.time_s
            rel = (
                track.north_m + track.north_mps * ahead_s - placed_ned_m[0],
                track.east_m + track.east_mps * ahead_s - placed_ned_m[1],
                0.0,
            )
            vel = (track.north_mps, track.east_mps, 0.0)
            sd_m = math.hypot(track.sd_m, track.sd_mps * ahead_s)
            fits = [neighbour for neighbour in heard if _is_heard(rel, vel, neighbour, track.sd_mps)]
            give_way = len(fits) > 0 and all([neighbour.gives_way for neighbour in fits])
            found.append(
                SeenVehicle(rel, vel, sd_m, age_s, hovers=track.hovers, heard=len(fits) > 0, gives_way=give_way)
            )
        return found

    def _find_nearest(self, sighting: Sighting, taken: Sequence[_Track]) -> _Track | None:
        nearest: _Track | None = None
        least_m = math.inf
        own_m2 = max(_variances_m2(sighting))
        for track in self._tracks:
            if track in taken:
                continue
            off_m = math.hypot(track.north_m - sighting.north_m, track.east_m - sighting.east_m)
            if off_m < least_m and off_m <= GATE_M + 2.0 * math.sqrt(min(track.sd_m * track.sd_m, 0.25) + own_m2):
                nearest, least_m = track, off_m
        return nearest


def _is_heard(rel_ned_m: Vec3, vel_ned_mps: Vec3, neighbour: Neighbour, sd_mps: float) -> bool:
    """True where a neighbour reports to be and moves as it says: what it says alone hides nothing."""
    there, claimed = neighbour.rel_ned_m, neighbour.vel_ned_mps
    off_m = math.hypot(there[0] - rel_ned_m[0], there[1] - rel_ned_m[1])
    off_mps = math.hypot(claimed[0] - vel_ned_mps[0], claimed[1] - vel_ned_mps[1])
    return off_m <= HEARD_M and off_mps <= HEARD_MPS + min(HEARD_MPS, sd_mps)
