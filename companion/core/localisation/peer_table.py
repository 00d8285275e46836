"""The neighbour table: Neigh(v) of the paper (Algorithm 1, line 3). Which vehicles are heard, which fell silent in the
air, and where they are by now.

A vehicle that falls silent in the air stays there: its autopilot holds by its own failsafe. It is an obstacle until it
is heard again. A vehicle that notices tells the others (`sighting` in the beacon, one at a time, in turn); one that
hears it after all, or was told so later, answers with a newer sighting. Of two the newer counts, so a wrong alarm ends
where a neighbour knows better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.localisation.predicted_corridors import FROM_S, UNTIL_S, PredictedCorridor, lane
from companion.core.localisation.velocity_bias import VelocityBias
from companion.core.model.beacon import Beacon, PeerReport
from companion.core.model.events import HeardBeacon
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import CLIMBING, DESCENDING, FlightState, SwarmPhase
from companion.core.model.vectors import add, limit, norm, sub
from mission.common.frames import Vec3

STALE_S: Final = 0.5  # five beacons
STALE_PERIODS: Final = 3.0  # where beacons are rarer
# before the end of the range: one last heard there has left it and flies on; five beacons at 3 m/s
LEAVING_M: Final = 1.5
COAST_S: Final = 1.0  # a silent vehicle's autopilot needs about this long to notice and stop
TELL_AFTER_S: Final = 1.5  # of silence: by then the vehicle hangs still, and a burst of losses is over
READY_COUNTS_S: Final = 5.0  # how long one that was ready counts as about to take off: a beacon or two may be lost
CLAIM_COUNTS_S: Final = 2.0  # how long a neighbour's word that a vehicle is silent is answered
RANGE_SLACK: Final = 1.2  # of the range: one that claims to be farther off than that takes no part in movement


@dataclass(slots=True, init=False, unsafe_hash=True)
class PeerContact:
    """The last beacon of a vehicle, and what it meant when it came."""

    beacon: Final[Beacon]
    rel_ned_m: Final[Vec3]
    at_s: Final[float]
    own_pos_ned_m: Final[Vec3]  # odometry reading then: only ever differenced
    vel_ned_mps: Final[Vec3]

    def __init__(self, beacon: Beacon, rel_ned_m: Vec3, at_s: float, own_pos_ned_m: Vec3, vel_ned_mps: Vec3) -> None:
        self.beacon = beacon
        self.rel_ned_m = rel_ned_m
        self.at_s = at_s
        self.own_pos_ned_m = own_pos_ned_m
        self.vel_ned_mps = vel_ned_mps


@dataclass(slots=True, init=False, unsafe_hash=True)
class PeerContacts:
    """The last contact with each vehicle that was ever heard, by ascending id."""

    all: Final[tuple[PeerContact, ...]]

    def __init__(self, all: tuple[PeerContact, ...] = ()) -> None:
        self.all = all

    def beacons(self, now_s: float, *, within_s: float) -> list[Beacon]:
        """The last of each sender heard within that time, by ascending id."""
        return [heard.beacon for heard in self.all if now_s - heard.at_s <= within_s]

    def heard_last(self, among: int) -> Vec3 | None:
        """Last position of the one of `among` (bit k-1: vehicle k) that was heard last, in own odometry; or None."""
        last: PeerContact | None = None
        for heard in self.all:
            if among >> (heard.beacon.sender - 1) & 1 and (last is None or heard.at_s > last.at_s):
                last = heard
        return None if last is None else add(last.own_pos_ned_m, last.rel_ned_m)

    def grounded(self) -> int:
        """Bit k-1: vehicle k was last heard on the ground, after its flight or when the swarm had left without it."""
        bits = 0
        for heard in self.all:
            beacon = heard.beacon
            stays = beacon.state is FlightState.LANDED or beacon.phase >= SwarmPhase.TRANSIT
            if not beacon.airborne and stays:
                bits |= 1 << (heard.beacon.sender - 1)
        return bits

    def ready(self, now_s: float) -> int:
        """Bit k-1: vehicle k was about to take off, or in the air, when it was last heard, not long ago."""
        bits = 0
        for heard in self.all:
            if now_s - heard.at_s <= READY_COUNTS_S and (heard.beacon.airborne or heard.beacon.state in CLIMBING):
                bits |= 1 << (heard.beacon.sender - 1)
        return bits


@dataclass(slots=True, init=False, unsafe_hash=True)
class _Reported:
    """The position of a vehicle by a neighbour's word."""

    rel_ned_m: Final[Vec3]
    own_pos_ned_m: Final[Vec3]
    heard_s: Final[float]  # when it was heard, by the local clock
    silent: Final[bool]  # none heard it any more

    def __init__(self, rel_ned_m: Vec3, own_pos_ned_m: Vec3, heard_s: float, silent: bool) -> None:
        self.rel_ned_m = rel_ned_m
        self.own_pos_ned_m = own_pos_ned_m
        self.heard_s = heard_s
        self.silent = silent


class PeerTable:
    """One entry for each vehicle at most. Own positions serve as odometry: only their differences are used."""

    __slots__ = (
        "_claimed_s",
        "_corrects_velocity",
        "_drifts",
        "_heard",
        "_next",
        "_reports",
        "speed_max_mps",
        "stale_s",
    )

    def __init__(
        self, *, beacon_period_s: float = 0.1, speed_max_mps: float = 100.0, corrects_velocity: bool = True
    ) -> None:
        """`speed_max_mps`: no neighbour is faster, whatever it claims. `corrects_velocity`: see `velocity_bias`."""
        self._corrects_velocity = corrects_velocity
        self.stale_s = max(STALE_S, STALE_PERIODS * beacon_period_s)
        self.speed_max_mps = speed_max_mps
        self._heard: dict[int, PeerContact] = {}  # by ascending id
        self._reports: dict[int, _Reported] = {}
        self._drifts: dict[int, VelocityBias] = {}
        self._claimed_s: dict[int, float] = {}  # when a neighbour last said that this one is silent
        self._next = 0  # id from which the turn to be told goes on

    def store_beacon(self, heard: HeardBeacon, own_pos_ned_m: Vec3, now_s: float) -> bool:
        """Store a beacon; False for a repeated or overtaken one."""
        beacon = heard.said
        last = self._heard.get(beacon.sender)
        # A silent sender may have restarted with its clock at zero.
        if last is not None and beacon.time_ms <= last.beacon.time_ms and now_s - last.at_s <= self.stale_s:
            return False
        drift = self._drifts.get(beacon.sender)
        if drift is None:
            drift = self._drifts[beacon.sender] = VelocityBias()
        claimed = limit(beacon.vel_ned_mps, self.speed_max_mps)
        if self._corrects_velocity:
            drift.update(add(own_pos_ned_m, heard.rel_ned_m), claimed, beacon.time_ms / 1000.0)
        velocity = limit(add(claimed, drift.ned_mps), self.speed_max_mps)
        self._heard[beacon.sender] = PeerContact(beacon, heard.rel_ned_m, now_s, own_pos_ned_m, velocity)
        if last is None:
            self._heard = dict(sorted(self._heard.items()))
        return True

    def store_report(self, sighting: PeerReport, own_pos_ned_m: Vec3, now_s: float) -> None:
        """A neighbour's word of where a third vehicle was last heard."""
        heard_s = now_s - sighting.age_s
        if sighting.silent:
            self._claimed_s[sighting.vehicle] = now_s
        before = self._reports.get(sighting.vehicle)
        # A true alarm is about as old as the last time that any heard it; of a false one a neighbour knows better.
        newer_by_s = -self.stale_s if sighting.silent else 0.0
        if before is None or heard_s > before.heard_s + newer_by_s:
            self._reports[sighting.vehicle] = _Reported(sighting.rel_ned_m, own_pos_ned_m, heard_s, sighting.silent)

    def neighbours(self, own_pos_ned_m: Vec3, now_s: float, *, within_m: float = math.inf) -> list[Neighbour]:
        """The peers heard within `stale_s` that are within `within_m`, by ascending id."""
        found: list[Neighbour] = []
        for heard in self._heard.values():
            if now_s - heard.at_s <= self.stale_s:
                neighbour = self._extrapolate(heard, own_pos_ned_m, now_s)
                if neighbour.distance_m <= within_m:
                    found.append(neighbour)
        return found

    def contacts(self) -> PeerContacts:
        """The last of each vehicle, as a value."""
        return PeerContacts(tuple(self._heard.values()))

    def silent_airborne(
        self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float, launched: bool = False
    ) -> dict[int, PeerReport]:
        """The peers that fell silent in the air, by ascending id: where they hang, and how long ago they were heard.

        `range_m`: this vehicle's radio range. One that was last heard near its end has only left it, as in a wide
        swarm some always do: unless a neighbour that was nearer says otherwise. `launched`: the swarm takes off, so one
        that was ready may be in the air by now. One on its way up or down is at every height.
        """
        silent: dict[int, PeerReport] = {}
        late = [sender for sender, heard in self._heard.items() if not now_s - heard.at_s <= self.stale_s]
        if not late and not self._reports:
            return silent
        for vehicle in sorted({*late, *self._reports}):
            heard, told = self._heard.get(vehicle), self._reports.get(vehicle)
            heard_s = -1e9 if heard is None else heard.at_s
            if now_s - heard_s <= self.stale_s:
                continue
            if told is not None and not told.silent and told.heard_s > heard_s + self.stale_s:
                continue
            if heard is not None and self._fell_silent_in_range(heard, range_m, launched=launched):
                rel = self._extrapolate(heard, own_pos_ned_m, now_s).rel_ned_m
                every_height = heard.beacon.state in CLIMBING | DESCENDING
                if every_height:
                    rel = (rel[0], rel[1], 0.0)
                silent[vehicle] = PeerReport(vehicle, rel, now_s - heard_s, silent=True, every_height=every_height)
            elif told is not None and told.silent and told.heard_s >= heard_s - self.stale_s:
                silent[vehicle] = self._recall_report(vehicle, told, own_pos_ned_m, now_s)
        return silent

    def predict_corridors(self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float) -> list[PredictedCorridor]:
        """Of those in the air that this vehicle heard near by, and does not hear any more: see `predict_corridors`."""
        found: list[PredictedCorridor] = []
        for heard in self._heard.values():
            if FROM_S < now_s - heard.at_s <= UNTIL_S and self._fell_silent_in_range(heard, range_m, launched=False):
                course = lane(sub(heard.rel_ned_m, sub(own_pos_ned_m, heard.own_pos_ned_m)), heard.vel_ned_mps)
                if course is not None:
                    found.append(course)
        return found

    def select_report(
        self, silent: dict[int, PeerReport], neighbours: list[Neighbour], own_pos_ned_m: Vec3, now_s: float
    ) -> PeerReport | None:
        """The sighting for the next beacon: in turn, the silent, and those that are heard though called silent."""
        worth = {k: sighting for k, sighting in silent.items() if sighting.age_s >= TELL_AFTER_S}
        for neighbour in neighbours:
            if now_s - self._claimed_s.get(neighbour.id, -1e9) <= CLAIM_COUNTS_S:
                worth[neighbour.id] = PeerReport(neighbour.id, neighbour.rel_ned_m, neighbour.age_s, silent=False)
        for vehicle, claimed_s in self._claimed_s.items():
            told = self._reports.get(vehicle)
            called = now_s - claimed_s <= CLAIM_COUNTS_S
            if called and told is not None and not told.silent and now_s - told.heard_s <= CLAIM_COUNTS_S:
                worth.setdefault(vehicle, self._recall_report(vehicle, told, own_pos_ned_m, now_s))
        if not worth:
            return None
        chosen = min((k for k in worth if k >= self._next), default=min(worth))
        self._next = chosen + 1
        return worth[chosen]

    def _fell_silent_in_range(self, heard: PeerContact, range_m: float, *, launched: bool) -> bool:
        reach_m = min(range_m, heard.beacon.range_m) - LEAVING_M
        flies = heard.beacon.airborne or (launched and heard.beacon.state in CLIMBING)
        return flies and norm(heard.rel_ned_m) <= reach_m

    def _recall_report(self, vehicle: int, told: _Reported, own_pos_ned_m: Vec3, now_s: float) -> PeerReport:
        rel = sub(told.rel_ned_m, sub(own_pos_ned_m, told.own_pos_ned_m))
        return PeerReport(vehicle, rel, now_s - told.heard_s, told.silent, received=True)

    def _extrapolate(self, heard: PeerContact, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        # Written out: this runs for every neighbour in every tick.
        age_s = now_s - heard.at_s
        coast_s = age_s if age_s < COAST_S else COAST_S
        beacon, then = heard.beacon, heard.own_pos_ned_m
        rel, vel = heard.rel_ned_m, heard.vel_ned_mps
        x, y, z = own_pos_ned_m[0] - then[0], own_pos_ned_m[1] - then[1], own_pos_ned_m[2] - then[2]
        dest = beacon.dest_ned_m
        if dest is not None:
            dest = (rel[0] + dest[0] - x, rel[1] + dest[1] - y, rel[2] + dest[2] - z)
        x, y, z = rel[0] + vel[0] * coast_s - x, rel[1] + vel[1] * coast_s - y, rel[2] + vel[2] * coast_s - z
        return Neighbour(beacon, (x, y, z), dest, age_s, vel, math.sqrt(x * x + y * y + z * z))
