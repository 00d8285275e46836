"""Localisation where not all vehicles receive GNSS: neighbours by inter-vehicle ranging and odometry.

It puts together the relative localisation (`ranging`), the global localisation of a vehicle with a receiver and its
dead-reckoning uncertainty (`global_localisation`), and the excitation manoeuvre. No velocity that peers broadcast is
corrected: their positions have errors of their own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, final

from companion.core.localisation.gnss_denied.excitation import EXCITED, ExcitationManoeuvre
from companion.core.localisation.gnss_denied.global_localisation import GlobalLocalisation
from companion.core.localisation.gnss_denied.ranging import RangingLocaliser
from companion.core.localisation.gnss_denied.shared_trunks import SharedTrunks
from companion.core.localisation.localiser import Localiser
from companion.core.model.actions import Say, SendBeacon
from companion.core.model.beacon import Beacon, PeerReport, RelativeReport, TrunkReport
from companion.core.model.events import HeardBeacon, Position, Ranges, Satellites
from companion.core.model.neighbour import Neighbour, find_hover_places
from companion.core.model.states import FlightState, LandedState, Role, Severity
from companion.core.model.vectors import ZERO, add, limit, scale, sub, turned_level
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from mission.document.model import Mission

REPORTS_MAX: Final = 8  # of one sender, that wait for their beacons: as many may come in one tick
ASTRAY: Final = "position doubted: GNSS led astray"
LOST: Final = "relative localisation not initialised"
UNCONFIRMED: Final = "start not confirmed: no trunks in common"
UNCONFIRMED_S: Final = 30.0  # in the air, by trunks alone: where there are some it takes 5 to 20 s
MEASURED_S: Final = 1.0  # so old is the last range at most to one that counts as measured
SETTLES_S: Final = 5.0  # since it knows its position among the others: that still moves by metres
ANCHOR_MPS: Final = 0.5  # a leader goes over to what GNSS says this fast: no setpoint jumps, 10 m take 20 s


@final
class GnssDeniedLocaliser(Localiser):
    """One vehicle's."""

    def __init__(self, mission: Mission, me: int) -> None:
        super().__init__(mission, me, corrects_velocity=False)
        self.ranging: Final = RangingLocaliser(mission, me)
        self.global_localisation: Final = GlobalLocalisation(receives=mission.has_satellites(me))
        self.trunks: Final = SharedTrunks() if mission.shares_trunks else None
        self.reception = self.global_localisation.reception
        self._receives = mission.has_satellites(me)
        self._budget_m = mission.swarm.position_error_max_m
        self._excitation = ExcitationManoeuvre(me)
        self._reports: dict[int, list[RelativeReport]] = {}  # by sender: those whose beacons have not come yet
        self._anchored_s = 0.0
        self._offset_ned_m = ZERO
        self._settled_s = -math.inf  # when its relative positions have settled since it was initialised
        self._doubtful_s = math.inf  # since when it is, by trunks alone; -inf: that is said

    @property
    def may_lose_position(self) -> bool:
        """Always: GNSS comes and goes."""
        return True

    @property
    def is_initialised(self) -> bool:
        """Not, while it must find first where it is among the others."""
        return not self.ranging.is_lost

    @property
    def is_start_uncertain(self) -> bool:
        """Until a motion has shown that they are no mirror image, or all have found their positions about it."""
        return self.ranging.is_doubtful

    @property
    def velocity_bias_ned_mps(self) -> Vec3:
        """As the relative filter has it."""
        return self.ranging.drift_ned_mps

    @property
    def offset_ned_m(self) -> Vec3:
        """By the vector to d2, which comes from the leader, hop by hop."""
        return self._offset_ned_m

    # --- what comes in ---

    def split_jumps(self, reported: Position, now_s: float, *, airborne: bool) -> Position:
        """The odometer, which never jumps."""
        return self.global_localisation.split_position(reported, now_s, airborne=airborne)

    def receive_position(self, position: Position, now_s: float) -> Position:
        """By the odometer, as what is seen corrects it."""
        was_astray = self.global_localisation.is_astray
        self.global_localisation.note_flown(position, now_s)
        if self.global_localisation.is_astray and not was_astray:
            self.said.append(Say(Severity.CRITICAL, ASTRAY))
        self.ranging.update_odometry(position, now_s)
        return position

    def receive_satellites(self, event: Satellites, now_s: float) -> None:
        """For the global localisation."""
        self.global_localisation.receive_satellites(event, now_s)

    def note_odometry(self, off_ned_mps: Vec3, now_s: float) -> None:
        """Of no account: none is sent."""

    def gnss_lost_s(self, now_s: float) -> float:  # noqa: ARG002
        """Never: it goes on by odometry, whose uncertainty is kept elsewhere."""
        return 0.0

    def position_error_m(self, now_s: float) -> float:  # noqa: ARG002
        """None but what is kept as uncertainty."""
        return 0.0

    def receive_ranging(self, event: Ranges | RelativeReport | TrunkReport, now_s: float) -> None:
        """A relative report waits for its beacon."""
        if self.is_backlog(now_s):
            return
        if isinstance(event, Ranges):
            self.ranging.receive_ranges(event.ranges, now_s)
        elif isinstance(event, TrunkReport):
            if self.trunks is not None:
                self._note_corrected(event.sender, now_s)
                self.trunks.receive_report(event, self.ranging, now_s)
        else:
            waiting = self._reports.setdefault(event.sender, [])
            waiting.append(event)
            del waiting[:-REPORTS_MAX]

    def is_due_for_trunks(self, now_s: float) -> bool:
        """In missions in which they are shared."""
        return self.trunks is not None and self.trunks.is_due(now_s)

    def note_trunks(self, seen: SolitaryTrunks, now_s: float) -> None:
        """To be told, and to be compared with what others tell; while there are some the odometer drifts less."""
        self.global_localisation.note_trunks(now_s)
        if self.trunks is not None:
            self._note_corrected(None, now_s)
            self.trunks.note_trunks(seen, self.ranging.odo_ne_m, now_s)

    def _note_corrected(self, vehicle: int | None, now_s: float) -> None:
        """Trunks correct the odometer of that one; None: its own. Without radios no range shows how well: not then."""
        if self.ranging.has_radio:
            self.ranging.filter.note_trunks(vehicle, now_s)

    def update_landed_state(self, landed: LandedState, *, waits: bool) -> None:
        """For the start-placement check, and whether it is at its start at all."""
        self.ranging.update_landed_state(landed, waits=waits)

    def _locate_sender(self, heard: HeardBeacon, own_pos_ned_m: Vec3, age_s: float, now_s: float) -> HeardBeacon | None:
        """The beacon with where its sender was, and its vectors along the own north.

        None: it came without the report that says where that is by now, after a silence.
        """
        said, ranging = heard.said, self.ranging
        down_m = own_pos_ned_m[2] + heard.rel_ned_m[2]
        report = self._take_report(said)
        if report is not None:
            lease = said.lease
            leader = lease.leader if lease is not None and lease.established else 0
            ranging.receive_report(
                report, said.vel_ned_mps, down_m, now_s, age_s=age_s, leader=leader, flies=said.airborne
            )
        if ranging.has_lost(said.sender):
            return None
        turned = rotate_beacon(said, ranging.filter.compass_of(said.sender) - ranging.filter.compass[0])
        located = ranging.locate_peer(said.sender, own_pos_ned_m[2], now_s)
        rel = heard.rel_ned_m if located is None else sub(located[0], scale(turned.vel_ned_mps, age_s))
        return HeardBeacon(turned, rel, is_vouched=heard.is_vouched)

    def _take_report(self, said: Beacon) -> RelativeReport | None:
        """The report that came with this beacon; None: it is missing. Several may have come at once."""
        waiting = self._reports.get(said.sender, [])
        found = [report for report in waiting if report.time_ms == said.time_ms]
        if not found:
            return None
        waiting.remove(found[0])
        return found[0]

    # --- once a tick ---

    def _advance(self, now_s: float) -> None:
        found = self.ranging.advance(now_s)
        if found:
            self.said.append(Say(Severity.NOTICE, found))
        if self.ranging.has_radio or not self.ranging.is_doubtful:
            return
        self._doubtful_s = min(self._doubtful_s, now_s)
        if self._doubtful_s != -math.inf and now_s - self._doubtful_s >= UNCONFIRMED_S:
            self._doubtful_s = -math.inf
            self.said.append(Say(Severity.WARNING, UNCONFIRMED))

    def _correct_silent(self, silent: dict[int, PeerReport], now_s: float) -> dict[int, PeerReport]:
        return {k: self._correct_report(seen, now_s) for k, seen in silent.items()}

    def _correct_report(self, seen: PeerReport, now_s: float) -> PeerReport:
        rel, *others = [self.ranging.scale_to_range(seen.vehicle, rel, now_s) for rel in find_hover_places([seen])]
        return replace(seen, rel_ned_m=rel, elsewhere=tuple(others))

    def _correct_neighbours(self, own_pos_ned_m: Vec3, now_s: float) -> None:
        self.neighbours = [self._locate_neighbour(n, own_pos_ned_m, now_s) for n in self.neighbours]
        uncertain = [n.id for n in self.neighbours if n.beacon.airborne and n.id in self.ranging.uncertain_peers]
        self.uncertain_peer = uncertain[0] if uncertain else 0
        self.unconfirmed_peers = [n.id for n in self.neighbours if n.beacon.airborne and not self.ranging.agrees(n.id)]

    def _locate_neighbour(self, heard: Neighbour, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        """A neighbour where ranges have it now, as near as it may be."""
        located = self.ranging.locate_peer(heard.id, own_pos_ned_m[2], now_s)
        if located is None:
            return heard
        there, near = located
        dest = heard.beacon.dest_ned_m
        if dest is not None:  # it has come nearer to it since
            dest = add(there, sub(dest, scale(heard.vel_ned_mps, heard.age_s + heard.late_s)))
        return heard.at(near, dest)

    def update_position_quality(self, now_s: float, *, role: Role) -> None:
        """By the receiver, and by how far dead reckoning may be off."""
        self.global_localisation.update_reception(now_s, leads=role is Role.LEADER)
        self.reception = self.global_localisation.reception
        self.is_position_lost = role is Role.LEADER and self.global_localisation.is_lost(now_s, self._budget_m)

    def update_destination(
        self, pos_ned_m: Vec3, upstream: Sequence[Neighbour], now_s: float, *, role: Role, stop: int, leader: int
    ) -> None:
        """A leader goes on by odometry, and over to what GNSS says where it receives it."""
        flown = pos_ned_m if self._receives else sub(pos_ned_m, self.ranging.strayed_ned_m)
        fix, most_m = self.global_localisation.fix_ned_m(now_s), ANCHOR_MPS * (now_s - self._anchored_s)
        self._anchored_s = now_s
        if role is Role.LEADER:
            self.destination.update_anchored_leader(flown, stop, fix, most_m)
        else:
            if not self.is_initialised:
                self._settled_s = now_s + SETTLES_S
            if now_s < self._settled_s:
                self.destination.forget_odometry()
            self.destination.update_follower(flown, stop, upstream, now_s, leader=leader)
        sd_m = self.ranging.position_sd_m([n.id for n in upstream])
        self.global_localisation.update_destination_sd(
            sd_m, now_s, lag_m=self.destination.lag_m if role is Role.LEADER else None
        )
        # A leader whose odometry may be off by more goes back: a word that has this one farther off is false.
        self._offset_ned_m = limit(self.destination.offset_ned_m(pos_ned_m), self._budget_m)

    # --- what comes out ---

    def missing(self, now_s: float) -> str:
        """A start position that is wrong, a position that is not found, a radio that measures nobody."""
        return self.ranging.start_mismatch or (LOST if self.ranging.is_lost else "") or self.ranging.unmeasured(now_s)

    def confirm_start(self, leader: int, *, gathers: bool) -> None:
        """The start positions are right."""
        if leader == self._me and not gathers:
            self.ranging.has_led()

    def excite(self, state: FlightState, cause: Cause | None, now_s: float) -> Vec3:
        """While the formation's rotation is uncertain, or the direction of one that it measures is in its shape, or it
        must be seen that start positions are no mirror image.
        """
        seeks = math.inf if self.ranging.is_doubtful else 0.0
        turn_rad, shape_m = max(seeks, self.ranging.filter.rotation_sd_rad), self._shape_sd_m(now_s)
        velocity = self._excitation.velocity(turn_rad, now_s, shape_sd_m=shape_m)
        return velocity if state in EXCITED or cause is Cause.PEER_UNCERTAIN else ZERO

    def _shape_sd_m(self, now_s: float) -> float:
        """Of those that the own radio measures, the one whose position in the formation's shape is the least certain.

        Of no other: the own motion would show nothing of it.
        """
        ranging, most_m2 = self.ranging, 0.0
        for neighbour in self.neighbours:
            found = ranging.filter.relative(neighbour.id)
            is_measured = ranging.measured_m(neighbour.id, now_s, MEASURED_S) < math.inf
            if found is not None and is_measured and not ranging.has_lost(neighbour.id):
                most_m2 = max(most_m2, found.shape_m2)
        return math.sqrt(most_m2)

    def make_broadcast(self, beacon: Beacon, pos_ned_m: Vec3, now_s: float, *, leader: int, role: Role) -> SendBeacon:
        """The beacon, its relative report, and an acting leader's position in the mission's frame."""
        position = add(pos_ned_m, self._offset_ned_m) if role is Role.LEADER else None
        position_sd_m = None if beacon.dest_ned_m is None else self.global_localisation.sd_m
        report = self.ranging.make_report(leader, beacon.time_ms, now_s, position_sd_m)
        trunks = None if self.trunks is None else self.trunks.make_report(self._me, beacon.time_ms, now_s)
        return SendBeacon(beacon, report, position, trunks=trunks)


def rotate_beacon(said: Beacon, by_rad: float) -> Beacon:
    """With its vectors turned: those of a neighbour along the own north."""
    dest, seen = said.dest_ned_m, said.sighting
    return replace(
        said,
        vel_ned_mps=turned_level(said.vel_ned_mps, by_rad),
        ref_ned_mps=turned_level(said.ref_ned_mps, by_rad),
        dest_ned_m=None if dest is None else turned_level(dest, by_rad),
        sighting=None if seen is None else replace(seen, rel_ned_m=turned_level(seen.rel_ned_m, by_rad)),
    )
