"""The neighbour table: Neigh(v) of the paper (Algorithm 1, line 3). Which vehicles are heard, which fell silent in the
air, and where they are by now.

A vehicle that falls silent in the air stays there: its autopilot holds by its own failsafe. It is an obstacle until it
is heard again, here or by a majority of the others. A vehicle that notices tells the others (`sighting` in the beacon,
one place at a time, in turn); one that hears it after all answers, and one that was wrong takes its word back: what
that ends, `peer_reports` says.

Beacons for which their sender does not vouch say where somebody may be, and free nothing: a vehicle may still hover
where it was when it last did.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from companion.core.localisation.link_share import LinkShare
from companion.core.localisation.peer_reports import PASSED_ON_MAX, PLACES_MAX, SAME_PLACE_M, TAKEN_BACK, PeerReports
from companion.core.localisation.predicted_corridors import FROM_S, UNTIL_S, PredictedCorridor, lane
from companion.core.model.beacon import PeerReport
from companion.core.model.events import HeardBeacon
from companion.core.model.neighbour import Neighbour
from companion.core.model.peer_contacts import PeerContact, PeerContacts
from companion.core.model.states import CLIMBING, DESCENDING
from companion.core.model.vectors import ZERO, add, limit, norm, scale, sub
from companion.core.model.velocity_bias import VelocityBias
from mission.common.frames import Vec3

STALE_S: Final = 0.5  # five beacons, of a good radio: see `link_share`
STALE_PERIODS: Final = 3.0  # where beacons are rarer
# before the end of the range: one last heard there has left it and flies on; five beacons at 3 m/s
LEAVING_M: Final = 1.5
COAST_S: Final = 1.0  # a silent vehicle's autopilot needs about this long to notice and stop
# Its autopilot follows the last setpoint for half a second, and brakes, each make in its own way. Where it rests is by
# so much times its last velocity, and acceleration, from where it was (36 killed in transit, both makes: 0.4 m off on
# average, 1.0 m at most; 2.0 m by COAST_S alone). It is taken to be there only in time: most that fall silent fly on,
# and parts that are hidden from one another come back to one another later for places farther on.
REST_S: Final = 1.2
REST_S2: Final = 0.75
REST_FROM_S: Final = 10.0  # of silence
REST_BY_S: Final = 20.0
ACCELERATION_MAX_MPS2: Final = 4.0  # of which anything is believed
ACCELERATION_S: Final = 0.3  # over which it is smoothed
TELL_AFTER_S: Final = 1.5  # of silence: by then the vehicle hangs still, and a burst of losses is over
CLAIM_COUNTS_S: Final = 2.0  # how long a neighbour's word that a vehicle is silent is answered
RANGE_SLACK: Final = 1.2  # of the range: one that claims to be farther off than that takes no part in movement


class PeerTable:
    """One entry for each vehicle at most. Own positions serve as odometry: only their differences are used."""

    __slots__ = (
        "_corrects_velocity",
        "_doubted",
        "_drifts",
        "_heard",
        "_links",
        "_next",
        "_period_s",
        "_reports",
        "_told_s",
        "speed_max_mps",
        "stale_s",
    )

    def __init__(
        self,
        *,
        size: int,
        beacon_period_s: float = 0.1,
        speed_max_mps: float = 100.0,
        corrects_velocity: bool = True,
    ) -> None:
        """`size`: of the swarm. `speed_max_mps`: no neighbour is faster, whatever it claims.

        `corrects_velocity`: see `velocity_bias`.
        """
        self._corrects_velocity = corrects_velocity
        self.stale_s = max(STALE_S, STALE_PERIODS * beacon_period_s)
        self.speed_max_mps = speed_max_mps
        self._period_s = beacon_period_s
        self._heard: dict[int, PeerContact] = {}  # by ascending id
        # Of those of whom nobody vouches for what is heard now: the last contact for which somebody did.
        self._doubted: dict[int, PeerContact] = {}
        self._links: dict[int, LinkShare] = {}
        self._reports = PeerReports(size, self.stale_s)
        self._drifts: dict[int, VelocityBias] = {}
        self._told_s: dict[int, float] = {}  # when this vehicle last told the others that one is silent
        self._next = (0, 0)  # vehicle and place from which the turn to be told goes on

    def store_beacon(self, heard: HeardBeacon, own_pos_ned_m: Vec3, now_s: float, age_s: float = 0.0) -> bool:
        """Store a beacon, which tells of `age_s` ago; False for a repeated or overtaken one."""
        beacon = heard.said
        last, link = self._heard.get(beacon.sender), self._links.get(beacon.sender)
        if link is None:
            link = self._links[beacon.sender] = LinkShare(self._period_s, self.stale_s)
        link.record(beacon.time_ms / 1000.0, age_s, now_s)
        # A silent sender may have restarted with its clock at zero.
        if last is not None and beacon.time_ms <= last.beacon.time_ms and now_s - last.at_s <= last.stale_s:
            return False
        drift = self._drifts.get(beacon.sender)
        if drift is None:
            drift = self._drifts[beacon.sender] = VelocityBias()
        claimed = limit(beacon.vel_ned_mps, self.speed_max_mps)
        if self._corrects_velocity:
            drift.update(add(own_pos_ned_m, heard.rel_ned_m), claimed, beacon.time_ms / 1000.0)
        velocity = limit(add(claimed, drift.ned_mps), self.speed_max_mps)
        self._heard[beacon.sender] = PeerContact(
            beacon,
            heard.rel_ned_m,
            now_s,
            now_s - age_s,
            own_pos_ned_m,
            velocity,
            _find_acceleration(last, velocity, beacon.time_ms),
            share=link.share,
            stale_s=link.stale_s,
            is_vouched=heard.is_vouched,
        )
        if heard.is_vouched:
            self._doubted.pop(beacon.sender, None)
        elif last is not None and last.is_vouched:
            self._doubted[beacon.sender] = last
        if last is None:
            self._heard = dict(sorted(self._heard.items()))
        return True

    def store_report(self, sender: int, sighting: PeerReport, own_pos_ned_m: Vec3, now_s: float) -> None:
        """A member's word of where a third vehicle was last heard; `sighting.rel_ned_m` is from this vehicle."""
        self._reports.store(sender, sighting, own_pos_ned_m, now_s)

    def neighbours(self, own_pos_ned_m: Vec3, now_s: float, *, within_m: float = math.inf) -> list[Neighbour]:
        """The peers that are heard, and within `within_m`, by ascending id."""
        found: list[Neighbour] = []
        for heard in self._heard.values():
            if now_s - heard.at_s <= heard.stale_s:
                neighbour = self._extrapolate(heard, own_pos_ned_m, now_s)
                if neighbour.distance_m <= within_m:
                    found.append(neighbour)
        return found

    def contacts(self) -> PeerContacts:
        """The last of each vehicle, as a value."""
        return PeerContacts(tuple(self._heard.values()), tuple(self._doubted.values()))

    def silent_airborne(
        self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float, launched: bool = False
    ) -> dict[int, PeerReport]:
        """The peers that fell silent in the air, by ascending id: where they hang, and how long ago they were heard.

        `range_m`: this vehicle's radio range. One that was last heard near its end has only left it, as in a wide
        swarm some always do: unless a neighbour that was nearer says otherwise. `launched`: the swarm takes off, so one
        that was ready may be in the air by now. One on its way up or down is at every height.
        """
        silent: dict[int, PeerReport] = {}
        vouched = self._vouched()
        late = [sender for sender, heard in vouched.items() if not now_s - heard.at_s <= heard.stale_s]
        reported = self._reports.vehicles()
        if not late and not reported:
            return silent
        for vehicle in sorted({*late, *reported}):
            heard = vouched.get(vehicle)
            if heard is not None and now_s - heard.at_s <= heard.stale_s:
                continue
            places = self._find_reported_places(vehicle, own_pos_ned_m, now_s)
            own = self._find_own_place(vehicle, heard, own_pos_ned_m, now_s, range_m=range_m, launched=launched)
            if own is not None:
                places = [own, *leave_out(places, own)]
            if places:
                elsewhere = tuple([k.rel_ned_m for k in places[1:]])
                silent[vehicle] = replace(places[0], elsewhere=elsewhere) if elsewhere else places[0]
        return silent

    def predict_corridors(self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float) -> list[PredictedCorridor]:
        """Of those in the air that this vehicle heard near by, and does not hear any more: see `predict_corridors`."""
        found: list[PredictedCorridor] = []
        for heard in self._vouched().values():
            if FROM_S < now_s - heard.at_s <= UNTIL_S and self._fell_silent_in_range(heard, range_m, launched=False):
                course = lane(sub(heard.rel_ned_m, sub(own_pos_ned_m, heard.own_pos_ned_m)), heard.vel_ned_mps)
                if course is not None:
                    found.append(course)
        return found

    def select_report(
        self, silent: dict[int, PeerReport], neighbours: list[Neighbour], own_pos_ned_m: Vec3, now_s: float
    ) -> PeerReport | None:
        """The sighting for the next beacon, in turn: places of the silent, and answers about those called silent."""
        called = {*self._reports.alarmed(now_s, within_s=CLAIM_COUNTS_S)}
        called |= {k for k, told_s in self._told_s.items() if now_s - told_s <= CLAIM_COUNTS_S}
        asked = self._reports.asked(now_s, within_s=CLAIM_COUNTS_S)
        hidden = self._find_hidden(now_s)
        if not silent and not called and not asked and not hidden:
            return None
        worth: dict[tuple[int, int], PeerReport] = {}
        for vehicle, sighting in silent.items():
            if sighting.age_s >= TELL_AFTER_S:
                for k, place in enumerate(self._find_told(vehicle, sighting, own_pos_ned_m, now_s)):
                    worth[vehicle, k] = place
                    self._told_s[vehicle] = now_s
        # Votes may end an alarm: one that is overdue may be silent.
        heard = {n.id: n for n in neighbours if not n.is_overdue and n.id not in self._doubted}
        for vehicle in sorted(called):
            if (vehicle, 0) not in worth:
                answer = self._find_answer(vehicle, heard.get(vehicle), own_pos_ned_m, now_s)
                if answer is not None:
                    worth[vehicle, 0] = answer
        for vehicle in asked:
            if (vehicle, 0) not in worth and vehicle in heard:
                worth[vehicle, 0] = PeerReport(vehicle, heard[vehicle].rel_ned_m, heard[vehicle].age_s, silent=False)
        for vehicle in [k for k in hidden if k not in silent]:
            worth[vehicle, 0] = PeerReport(vehicle, ZERO, 0.0, silent=False, relays=TAKEN_BACK)
        if not worth:
            return None
        chosen = min((k for k in worth if k >= self._next), default=min(worth))
        self._next = (chosen[0], chosen[1] + 1)
        return worth[chosen]

    def relayed(self, own_pos_ned_m: Vec3, now_s: float) -> list[tuple[Vec3, float]]:
        """Places, relative, at which others hear vehicles that this one lost in the air; and how old each is."""
        found: list[tuple[Vec3, float]] = []
        for vehicle, heard in self._vouched().items():
            if now_s - heard.at_s > heard.stale_s and heard.beacon.airborne:
                found += self._reports.heard_places(vehicle, own_pos_ned_m, now_s)
        return found

    def is_heard_elsewhere(self, vehicle: int, own_pos_ned_m: Vec3, now_s: float) -> bool:
        """A member says that it hears that one."""
        return bool(self._reports.heard_places(vehicle, own_pos_ned_m, now_s))

    def was_on_ground(self, vehicle: int) -> bool:
        """By its last beacon that was heard here."""
        heard = self._vouched().get(vehicle)
        return heard is not None and not heard.beacon.airborne

    def _vouched(self) -> Mapping[int, PeerContact]:
        """By ascending id, the last contact with each vehicle for which its sender vouches, or the only one."""
        return {k: self._doubted.get(k, heard) for k, heard in self._heard.items()} if self._doubted else self._heard

    def _find_hidden(self, now_s: float) -> list[int]:
        """Vehicles in the air that this one does not hear, and a majority does: it asks on where they are."""
        return [
            vehicle
            for vehicle, heard in self._vouched().items()
            if now_s - heard.at_s > TELL_AFTER_S
            and heard.beacon.airborne
            and self._reports.is_refuted(vehicle, heard.at_s)
        ]

    def _find_told(self, vehicle: int, sighting: PeerReport, own_pos_ned_m: Vec3, now_s: float) -> list[PeerReport]:
        """Places of a silent vehicle that the others are to know of, the own one first; PLACES_MAX at most."""
        own = [] if sighting.received else [sighting]
        places = self._find_reported_places(vehicle, own_pos_ned_m, now_s)
        passed_on = [replace(k, relays=k.relays + 1) for k in places if k.relays < PASSED_ON_MAX]
        return [*own, *(leave_out(passed_on, sighting) if own else passed_on)][:PLACES_MAX]

    def _find_reported_places(self, vehicle: int, own_pos_ned_m: Vec3, now_s: float) -> list[PeerReport]:
        """Places by others' words, but of what they heard before it was last heard here."""
        heard = self._vouched().get(vehicle)
        since_s = -math.inf if heard is None else heard.at_s - self.stale_s
        return self._reports.places(vehicle, own_pos_ned_m, now_s, since_s=since_s)

    def _find_answer(
        self, vehicle: int, heard: Neighbour | None, own_pos_ned_m: Vec3, now_s: float
    ) -> PeerReport | None:
        """For one that is called silent: it is heard here, or by a majority; or what was told of it is taken back."""
        if heard is not None:
            return PeerReport(vehicle, heard.rel_ned_m, heard.age_s, silent=False)
        refutation = self._reports.refutation(vehicle, own_pos_ned_m, now_s)
        if refutation is None and vehicle in self._told_s:
            return PeerReport(vehicle, ZERO, 0.0, silent=False, relays=TAKEN_BACK)
        return refutation

    def _find_own_place(
        self,
        vehicle: int,
        heard: PeerContact | None,
        own_pos_ned_m: Vec3,
        now_s: float,
        *,
        range_m: float,
        launched: bool,
    ) -> PeerReport | None:
        """Place of one that was heard here; None: it only left the range, or a majority has heard it since."""
        if heard is None or not self._fell_silent_in_range(heard, range_m, launched=launched):
            return None
        if self._reports.is_refuted(vehicle, heard.at_s):
            return None
        rel = self._extrapolate(heard, own_pos_ned_m, now_s).rel_ned_m
        rested = min((now_s - heard.at_s - REST_FROM_S) / (REST_BY_S - REST_FROM_S), 1.0)
        if rested > 0.0:
            way = add(scale(heard.vel_ned_mps, REST_S - COAST_S), scale(heard.acc_ned_mps2, REST_S2))
            rel = add(rel, scale(way, rested))
        every_height = heard.beacon.state in CLIMBING | DESCENDING
        if every_height:
            rel = (rel[0], rel[1], 0.0)
        return PeerReport(vehicle, rel, now_s - heard.at_s, silent=True, every_height=every_height)

    def _fell_silent_in_range(self, heard: PeerContact, range_m: float, *, launched: bool) -> bool:
        reach_m = min(range_m, heard.beacon.range_m) - LEAVING_M
        flies = heard.beacon.airborne or (launched and heard.beacon.state in CLIMBING)
        return flies and norm(heard.rel_ned_m) <= reach_m

    def _extrapolate(self, heard: PeerContact, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        # Written out: this runs for every neighbour in every tick.
        age_s, coast_s = now_s - heard.at_s, now_s - heard.told_s
        if coast_s > COAST_S:
            coast_s = COAST_S
        beacon, then = heard.beacon, heard.own_pos_ned_m
        rel, vel = heard.rel_ned_m, heard.vel_ned_mps
        x, y, z = own_pos_ned_m[0] - then[0], own_pos_ned_m[1] - then[1], own_pos_ned_m[2] - then[2]
        dest = beacon.dest_ned_m
        if dest is not None:
            dest = (rel[0] + dest[0] - x, rel[1] + dest[1] - y, rel[2] + dest[2] - z)
        x, y, z = rel[0] + vel[0] * coast_s - x, rel[1] + vel[1] * coast_s - y, rel[2] + vel[2] * coast_s - z
        late_s = heard.at_s - heard.told_s
        is_overdue = age_s > self.stale_s
        return Neighbour(
            beacon, (x, y, z), dest, age_s, vel, math.sqrt(x * x + y * y + z * z), late_s, heard.share, is_overdue
        )


def _find_acceleration(last: PeerContact | None, vel_ned_mps: Vec3, time_ms: int) -> Vec3:
    """Of a neighbour; none by its first beacon, or after a silence."""
    period_s = 0.0 if last is None else (time_ms - last.beacon.time_ms) / 1000.0
    if last is None or not 0.0 < period_s <= STALE_S:
        return ZERO
    seen = scale(sub(vel_ned_mps, last.vel_ned_mps), 1.0 / period_s)
    new = min(1.0, period_s / ACCELERATION_S)
    return limit(add(scale(last.acc_ned_mps2, 1.0 - new), scale(seen, new)), ACCELERATION_MAX_MPS2)


def leave_out(places: list[PeerReport], one: PeerReport) -> list[PeerReport]:
    """The other places, without those that are the same as that one's."""
    return [k for k in places if math.dist(k.rel_ned_m, one.rel_ned_m) > SAME_PLACE_M]
