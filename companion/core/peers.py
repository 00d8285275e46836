"""The neighbour table: Neigh(v) of the paper. Who is heard, how long ago, and where they are by now."""

from __future__ import annotations

from dataclasses import dataclass

from companion.core.types import Beacon
from companion.core.vec import add, scale, sub
from mission.frames import Vec3

STALE_S = 0.5  # five beacons
FALLEN_S = 60.0  # a vehicle that fell silent in the air is kept clear of this long
COAST_S = 1.0  # its autopilot needs about this long to notice and stop


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A vehicle in radio range, with its relative position and destination vector brought up to now."""

    beacon: Beacon
    rel_ned_m: Vec3  # from this vehicle to the neighbour
    dest_ned_m: Vec3 | None  # from this vehicle to the destination, as the neighbour sees it
    age_s: float

    @property
    def id(self) -> int:
        """System id."""
        return self.beacon.sender


@dataclass(frozen=True, slots=True)
class _Heard:
    beacon: Beacon
    at_s: float
    own_pos_ned_m: Vec3  # odometry reading then: only ever differenced


class PeerTable:
    """Beacons by sender, at most one each. Own positions serve as odometry: only their differences are used."""

    __slots__ = ("_heard",)

    def __init__(self) -> None:
        self._heard: dict[int, _Heard] = {}

    def hear(self, beacon: Beacon, own_pos_ned_m: Vec3, now_s: float) -> bool:
        """Store a beacon; False for a repeated or overtaken one."""
        last = self._heard.get(beacon.sender)
        # A silent sender may have restarted with its clock at zero.
        if last is not None and beacon.time_ms <= last.beacon.time_ms and now_s - last.at_s <= STALE_S:
            return False
        self._heard[beacon.sender] = _Heard(beacon, now_s, own_pos_ned_m)
        return True

    def neighbours(self, own_pos_ned_m: Vec3, now_s: float) -> list[Neighbour]:
        """Those heard within STALE_S, by ascending id."""
        found = [
            self._now(heard, own_pos_ned_m, now_s) for heard in self._heard.values() if now_s - heard.at_s <= STALE_S
        ]
        found.sort(key=lambda neighbour: neighbour.id)
        return found

    def fallen(self, own_pos_ned_m: Vec3, now_s: float) -> list[Vec3]:
        """Relative positions (NED m) of those that fell silent in the air: they hover there by their own failsafe."""
        return [
            self._now(heard, own_pos_ned_m, now_s).rel_ned_m
            for _, heard in sorted(self._heard.items())
            if now_s - heard.at_s > STALE_S and heard.beacon.airborne
        ]

    def forget(self, now_s: float) -> None:
        """Drop whoever has been silent for longer than FALLEN_S."""
        for sender in [s for s, heard in self._heard.items() if now_s - heard.at_s > FALLEN_S]:
            del self._heard[sender]

    def _now(self, heard: _Heard, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        moved = sub(own_pos_ned_m, heard.own_pos_ned_m)
        age_s = now_s - heard.at_s
        beacon = heard.beacon
        drift = scale(beacon.vel_ned_mps, min(age_s, COAST_S))
        dest = None if beacon.dest_ned_m is None else sub(add(beacon.rel_ned_m, beacon.dest_ned_m), moved)
        return Neighbour(beacon, sub(add(beacon.rel_ned_m, drift), moved), dest, age_s)
