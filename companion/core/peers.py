"""The neighbour table: Neigh(v) of the paper. Who is heard, how long ago, and where they are by now."""

from __future__ import annotations

from dataclasses import dataclass

from companion.core.types import Beacon
from companion.core.vec import norm
from mission.frames import Vec3

STALE_S = 0.5  # five beacons
FALLEN_S = 60.0  # a vehicle that fell silent in the air is kept clear of this long
FALLEN_SHARE = 0.9  # of the range: farther off, a silent vehicle has left the range and flies on
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

    def beacons(self, now_s: float, *, within_s: float) -> list[Beacon]:
        """The last of each sender heard within that time, as they came."""
        return [heard.beacon for heard in self._heard.values() if now_s - heard.at_s <= within_s]

    def fallen(self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float) -> list[Vec3]:
        """Relative positions (NED m) of those that fell silent in the air: they hover there by their own failsafe.

        `range_m`: this vehicle's radio range. Who was last heard near its end has only left it, as in a wide swarm
        somebody always does.
        """
        return [
            self._now(heard, own_pos_ned_m, now_s).rel_ned_m
            for _, heard in sorted(self._heard.items())
            if now_s - heard.at_s > STALE_S
            and heard.beacon.airborne
            and norm(heard.beacon.rel_ned_m) <= FALLEN_SHARE * min(range_m, heard.beacon.range_m)
        ]

    def forget(self, now_s: float) -> None:
        """Drop whoever has been silent for longer than FALLEN_S."""
        for sender in [s for s, heard in self._heard.items() if now_s - heard.at_s > FALLEN_S]:
            del self._heard[sender]

    def _now(self, heard: _Heard, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        # Written out: this runs for every neighbour in every tick.
        age_s = now_s - heard.at_s
        coast_s = age_s if age_s < COAST_S else COAST_S
        beacon, then = heard.beacon, heard.own_pos_ned_m
        rel, vel = beacon.rel_ned_m, beacon.vel_ned_mps
        x, y, z = own_pos_ned_m[0] - then[0], own_pos_ned_m[1] - then[1], own_pos_ned_m[2] - then[2]
        dest = beacon.dest_ned_m
        if dest is not None:
            dest = (rel[0] + dest[0] - x, rel[1] + dest[1] - y, rel[2] + dest[2] - z)
        now = (rel[0] + vel[0] * coast_s - x, rel[1] + vel[1] * coast_s - y, rel[2] + vel[2] * coast_s - z)
        return Neighbour(beacon, now, dest, age_s)
