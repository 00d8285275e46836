"""Contacts: the last beacon of each vehicle, and what it meant when it came."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import Beacon
from companion.core.model.states import CLIMBING, FlightState, SwarmPhase
from companion.core.model.vectors import add
from mission.common.frames import Vec3

READY_COUNTS_S: Final = 5.0  # how long one that was ready counts as about to take off: a beacon or two may be lost


@dataclass(slots=True, init=False, unsafe_hash=True)
class PeerContact:
    """The last beacon of a vehicle, and what it meant when it came."""

    beacon: Final[Beacon]
    rel_ned_m: Final[Vec3]
    at_s: Final[float]  # when it arrived
    told_s: Final[float]  # of what time it tells, by the local clock
    own_pos_ned_m: Final[Vec3]  # odometry reading then: only ever differenced
    vel_ned_mps: Final[Vec3]
    acc_ned_mps2: Final[Vec3]  # by its last velocities, smoothed
    share: Final[float]  # of its beacons that arrives, 0..1
    stale_s: Final[float]  # for how long it counts as heard
    is_vouched: Final[bool]  # its sender vouches for what it sends

    def __init__(
        self,
        beacon: Beacon,
        rel_ned_m: Vec3,
        at_s: float,
        told_s: float,
        own_pos_ned_m: Vec3,
        vel_ned_mps: Vec3,
        acc_ned_mps2: Vec3,
        *,
        share: float,
        stale_s: float,
        is_vouched: bool = True,
    ) -> None:
        self.beacon = beacon
        self.rel_ned_m = rel_ned_m
        self.at_s = at_s
        self.told_s = told_s
        self.own_pos_ned_m = own_pos_ned_m
        self.vel_ned_mps = vel_ned_mps
        self.acc_ned_mps2 = acc_ned_mps2
        self.share = share
        self.stale_s = stale_s
        self.is_vouched = is_vouched


@dataclass(slots=True, init=False, unsafe_hash=True)
class PeerContacts:
    """The last contact with each vehicle that was ever heard, by ascending id."""

    all: Final[tuple[PeerContact, ...]]
    doubted: Final[tuple[PeerContact, ...]]  # of those for whose last nobody vouches: the last for which somebody did

    def __init__(self, all: tuple[PeerContact, ...] = (), doubted: tuple[PeerContact, ...] = ()) -> None:
        self.all = all
        self.doubted = doubted

    def vouched(self) -> tuple[PeerContact, ...]:
        """The last contact with each vehicle for which its sender vouches, or the only one."""
        if not self.doubted:
            return self.all
        instead = {heard.beacon.sender: heard for heard in self.doubted}
        return tuple([instead.get(heard.beacon.sender, heard) for heard in self.all])

    def beacons(self, now_s: float, *, within_s: float) -> list[Beacon]:
        """The last of each sender heard within that time, by ascending id."""
        return [heard.beacon for heard in self.all if now_s - heard.at_s <= within_s]

    def heard_last(self, among: int) -> Vec3 | None:
        """Last position of the one of `among` (bit k-1: vehicle k) that was heard last, in own odometry; or None."""
        last: PeerContact | None = None
        for heard in self.vouched():
            if among >> (heard.beacon.sender - 1) & 1 and (last is None or heard.at_s > last.at_s):
                last = heard
        return None if last is None else add(last.own_pos_ned_m, last.rel_ned_m)

    def grounded(self) -> int:
        """Bit k-1: vehicle k was last heard on the ground, after its flight or when the swarm had left without it."""
        bits = 0
        for heard in self.vouched():
            beacon = heard.beacon
            stays = beacon.state is FlightState.LANDED or beacon.phase >= SwarmPhase.TRANSIT
            if not beacon.airborne and stays:
                bits |= 1 << (heard.beacon.sender - 1)
        return bits

    def ready(self, now_s: float) -> int:
        """Bit k-1: vehicle k was about to take off, or in the air, when it was last heard, not long ago."""
        bits = 0
        for heard in self.vouched():
            if now_s - heard.at_s <= READY_COUNTS_S and (heard.beacon.airborne or heard.beacon.state in CLIMBING):
                bits |= 1 << (heard.beacon.sender - 1)
        return bits
