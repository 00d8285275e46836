"""Vehicles seen: what moves among the stems of level scans, and no heard neighbour is.

A stem that is no good trunk begins a candidate, which moves by a filter of its own. It is a vehicle when it has gone
farther than its scatter, at a speed that no standing thing shows, for some scans. A vehicle that is heard, where it is
seen to be and moving as it says, is that neighbour; every other is kept from, whatever anybody reports. What a level
scan shows of a hull, and how far, is in docs/explanation/own-motion.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.neighbour import Neighbour
from companion.core.perception.trunk_tracks import Sighting
from mission.common.frames import Vec3

MOVES_MPS: Final = 0.6  # trunks placed by a corrected pose seem to move by less
GONE_M: Final = 0.5  # and two sigmas from where it was first seen
PROVEN_SIGHTINGS: Final = 4
PROVEN_S: Final = 0.3
GATE_M: Final = 0.5  # and three sigmas from where it is expected
PUSHED_MPS2: Final = 2.0  # rms, by which a vehicle changes its velocity
SPEED_SD_MPS: Final = 3.0  # before it was seen twice
UNSEEN_S: Final = 0.35  # until a candidate is dropped
UNSEEN_VEHICLE_S: Final = 1.5  # until a vehicle is: trunks hide it, or it leans out of the scan's plane
TRACKS_MAX: Final = 24
HEARD_M: Final = 1.5  # a heard neighbour is within this of where it is seen
HEARD_MPS: Final = 1.0  # and moves so alike, but for what the track's own velocity is uncertain


@final
class SeenVehicle:
    """A vehicle by scans alone, level: relative to this one (NED m), its velocity, and how uncertain it is."""

    __slots__ = ("age_s", "rel_ned_m", "sd_m", "vel_ned_mps")

    def __init__(self, rel_ned_m: Vec3, vel_ned_mps: Vec3, sd_m: float, age_s: float) -> None:
        self.rel_ned_m: Final = rel_ned_m  # now
        self.vel_ned_mps: Final = vel_ned_mps
        self.sd_m: Final = sd_m
        self.age_s: Final = age_s  # since it was seen last


@final
class _Track:
    """Position and velocity on both axes, with one variance of each and their covariance for both."""

    __slots__ = (
        "born_east_m",
        "born_north_m",
        "born_s",
        "born_sd_m",
        "east_m",
        "east_mps",
        "north_m",
        "north_mps",
        "pp",
        "pv",
        "seen_s",
        "sightings",
        "time_s",
        "vv",
    )

    def __init__(self, north_m: float, east_m: float, variance_m2: float, now_s: float) -> None:
        self.north_m = self.born_north_m = north_m
        self.east_m = self.born_east_m = east_m
        self.north_mps = self.east_mps = 0.0
        self.pp, self.pv, self.vv = variance_m2, 0.0, SPEED_SD_MPS * SPEED_SD_MPS
        self.time_s = self.seen_s = self.born_s = now_s
        self.born_sd_m = math.sqrt(variance_m2)
        self.sightings = 1

    @property
    def is_vehicle(self) -> bool:
        """It moves, as no trunk does."""
        if self.sightings < PROVEN_SIGHTINGS or self.seen_s - self.born_s < PROVEN_S - 1e-6:
            return False
        gone_m = math.hypot(self.north_m - self.born_north_m, self.east_m - self.born_east_m)
        return gone_m > GONE_M + 2.0 * self.born_sd_m and math.hypot(self.north_mps, self.east_mps) > MOVES_MPS

    def advance(self, now_s: float) -> None:
        """On, by its velocity."""
        dt_s = now_s - self.time_s
        self.time_s = now_s
        if dt_s <= 0.0:
            return
        self.north_m += self.north_mps * dt_s
        self.east_m += self.east_mps * dt_s
        push = PUSHED_MPS2 * PUSHED_MPS2 * dt_s
        self.pp += (2.0 * self.pv + self.vv * dt_s + push * dt_s * dt_s / 3.0) * dt_s
        self.pv += (self.vv + push * dt_s / 2.0) * dt_s
        self.vv += push

    def take_sighting(self, north_m: float, east_m: float, variance_m2: float, now_s: float) -> None:
        """Seen there, now."""
        s = self.pp + variance_m2
        gain_p, gain_v = self.pp / s, self.pv / s
        off_n, off_e = north_m - self.north_m, east_m - self.east_m
        self.north_m, self.east_m = self.north_m + gain_p * off_n, self.east_m + gain_p * off_e
        self.north_mps, self.east_mps = self.north_mps + gain_v * off_n, self.east_mps + gain_v * off_e
        self.vv -= gain_v * self.pv
        self.pp, self.pv = (1.0 - gain_p) * self.pp, (1.0 - gain_p) * self.pv
        self.seen_s = now_s
        self.sightings += 1


@final
class VehicleTracks:
    """One vehicle's, in the frame in which its scans are placed."""

    __slots__ = ("_tracks",)

    def __init__(self) -> None:
        self._tracks: list[_Track] = []

    def integrate_sightings(self, sightings: Sequence[Sighting], now_s: float) -> None:
        """Stems of a whole turn that are no good trunks."""
        self._tracks = [
            track
            for track in self._tracks
            if now_s - track.seen_s <= (UNSEEN_VEHICLE_S if track.is_vehicle else UNSEEN_S)
        ]
        for track in self._tracks:
            track.advance(now_s)
        taken: list[_Track] = []
        for sighting in sightings:
            nn, _, ee = sighting.covariance
            variance_m2 = nn if nn > ee else ee
            nearest = self._find_nearest(sighting, variance_m2, taken)
            if nearest is not None:
                nearest.take_sighting(sighting.north_m, sighting.east_m, variance_m2, now_s)
                taken.append(nearest)
            elif len(self._tracks) < TRACKS_MAX:
                track = _Track(sighting.north_m, sighting.east_m, variance_m2, now_s)
                self._tracks.append(track)
                taken.append(track)

    def find_vehicles(self, placed_ned_m: Vec3, heard: Sequence[Neighbour], now_s: float) -> list[SeenVehicle]:
        """Vehicles that are not heard; `placed_ned_m`: this vehicle, in the tracks' frame."""
        found: list[SeenVehicle] = []
        for track in self._tracks:
            age_s = now_s - track.seen_s
            if not track.is_vehicle or age_s > UNSEEN_VEHICLE_S:
                continue
            ahead_s = now_s - track.time_s
            rel = (
                track.north_m + track.north_mps * ahead_s - placed_ned_m[0],
                track.east_m + track.east_mps * ahead_s - placed_ned_m[1],
                0.0,
            )
            vel = (track.north_mps, track.east_mps, 0.0)
            if not any([_is_heard(rel, vel, neighbour, math.sqrt(track.vv)) for neighbour in heard]):
                found.append(SeenVehicle(rel, vel, math.sqrt(track.pp + track.vv * ahead_s * ahead_s), age_s))
        return found

    def _find_nearest(self, sighting: Sighting, variance_m2: float, taken: Sequence[_Track]) -> _Track | None:
        nearest: _Track | None = None
        least_m = math.inf
        for track in self._tracks:
            if track in taken:
                continue
            off_m = math.hypot(track.north_m - sighting.north_m, track.east_m - sighting.east_m)
            if off_m < least_m and off_m <= GATE_M + 3.0 * math.sqrt(min(track.pp, 0.25) + variance_m2):
                nearest, least_m = track, off_m
        return nearest


def _is_heard(rel_ned_m: Vec3, vel_ned_mps: Vec3, neighbour: Neighbour, sd_mps: float) -> bool:
    """True where a neighbour reports to be and moves as it says: what it says alone hides nothing."""
    there, claimed = neighbour.rel_ned_m, neighbour.vel_ned_mps
    off_m = math.hypot(there[0] - rel_ned_m[0], there[1] - rel_ned_m[1])
    off_mps = math.hypot(claimed[0] - vel_ned_mps[0], claimed[1] - vel_ned_mps[1])
    return off_m <= HEARD_M and off_mps <= HEARD_MPS + sd_mps
