"""Where the neighbours are: as they tell, brought up to now, and doubted where what they tell does not agree.

Everything here is relative to this vehicle. A neighbour's place is the difference of two told positions; its velocity
is told too, and corrected by how its place changes (`drift`). The own velocity is corrected alike. In a swarm that
flies by ranges it is `ranging` that says where they are, and no velocity is corrected: places have errors of their own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from companion.core.localisation.peer_table import RANGE_SLACK, TELL_AFTER_S, PeerTable
from companion.core.localisation.ranging import AIR_S, RangingLocaliser
from companion.core.localisation.velocity_bias import VelocityBias
from companion.core.model.actions import Say
from companion.core.model.beacon import PeerReport, RelativeReport
from companion.core.model.events import HeardBeacon, Position, Ranges
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import LandedState, Severity
from companion.core.model.vectors import add, norm, scale, sub
from companion.core.perception.ghost_tracks import GhostTracks
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Finding, Readings, Source
from mission.common.frames import Vec3
from mission.document.model import Mission

LOST: Final = "relative localisation not initialised"
# Of silence, until an operator is told. Others are told first: where a trunk hides it from this vehicle alone, one of
# them answers in 0.2 to 0.4 s, with lost beacons later.
SAY_AFTER_S: Final = TELL_AFTER_S + 1.0


class Localiser:
    """One vehicle's view of where the others are. `look` once a tick; `neighbours` and `silent` hold until the next."""

    def __init__(self, mission: Mission, me: int) -> None:
        self._me, self._size = me, mission.swarm.size
        # A vehicle that claims to be farther off takes no part in movement.
        self._reach_m = RANGE_SLACK * mission.radio.full_range_m
        self.peers = PeerTable(
            beacon_period_s=1.0 / mission.radio.beacon_rate_hz,
            speed_max_mps=mission.limits.speed_max_mps,
            minds_drift=not mission.flies_by_ranges,
        )
        self.ranging = RangingLocaliser(mission, me) if mission.flies_by_ranges else None
        self._words: dict[int, RelativeReport] = {}  # that came just before their beacons
        self.neighbours: list[Neighbour] = []  # heard, and within reach
        self.silent: dict[int, PeerReport] = {}  # those that fell silent in the air, by id
        self.unsure_of = 0  # a neighbour in the air whose place is too uncertain to fly beside it; 0: none
        self.misses = False  # somebody fell silent in the air, wherever it is
        self.said: list[Say] = []  # for the operator, since it was taken last
        self._silent_said: set[int] = set()
        self._tells_silent_from_s = -1e9
        self._drift = VelocityBias()  # of the own velocity
        self._ghosts = GhostTracks()

    @property
    def drift_ned_mps(self) -> Vec3:
        """The own velocity's error: the true one less the told one, NED m/s."""
        return self._drift.ned_mps if self.ranging is None else self.ranging.drift_ned_mps

    def see_own(self, position: Position, now_s: float) -> None:
        """The autopilot has told this vehicle's own position and velocity."""
        # By the autopilot's own time, where it tells it: what comes in a burst was not measured in one.
        if self.ranging is not None:
            self.ranging.update_odometry(position, now_s)
            return
        measured_s = now_s if position.boot_s is None else position.boot_s
        self._drift.update(position.pos_ned_m, position.vel_ned_mps, measured_s)

    def read(self, event: Ranges | RelativeReport, now_s: float) -> None:
        """In a swarm that flies by ranges: own ranges, or what goes with a member's next beacon."""
        if self.ranging is None:
            return
        if isinstance(event, Ranges):
            self.ranging.receive_ranges(event.ranges, now_s)
        else:
            self._words[event.sender] = event

    def _place(self, heard: HeardBeacon, own_pos_ned_m: Vec3, now_s: float) -> HeardBeacon | None:
        """A beacon of a swarm that flies by ranges, with where its sender is, and its vectors along the own north.

        None: it came without the word that tells where that is by now, after a silence.
        """
        said, ranging = heard.said, self.ranging
        assert ranging is not None
        down_m = own_pos_ned_m[2] + heard.rel_ned_m[2]
        word = self._words.pop(said.sender, None)
        if word is not None and word.time_ms == said.time_ms:
            lease = said.lease
            leader = lease.leader if lease is not None and lease.established else 0
            ranging.receive_report(word, said.vel_ned_mps, down_m, now_s, leader=leader, flies=said.airborne)
        if ranging.has_lost(said.sender):
            return None
        place = ranging.locate_peer(said.sender, own_pos_ned_m[2], now_s)
        return HeardBeacon(ranging.rotate_beacon(said), heard.rel_ned_m if place is None else place[0])

    def hear(self, heard: HeardBeacon, own_pos_ned_m: Vec3, now_s: float) -> bool:
        """Store where a member is, and which third vehicle it tells of; False for a beacon that tells nothing new."""
        if self.ranging is not None:
            placed = self._place(heard, own_pos_ned_m, now_s)
            if placed is None:
                return False
            heard = placed
        if not self.peers.store_beacon(heard, own_pos_ned_m, now_s):
            return False
        seen = heard.said.sighting
        if seen is not None and 1 <= seen.vehicle <= self._size and seen.vehicle not in (self._me, heard.said.sender):
            rel = add(heard.rel_ned_m, seen.rel_ned_m)
            if norm(rel) <= self._reach_m:
                self.peers.store_report(replace(seen, rel_ned_m=rel), own_pos_ned_m, now_s)
        return True

    def settle(self, landed: LandedState, *, waits: bool) -> None:
        """What the autopilot says of being in the air; `waits`: this vehicle is not to fly yet."""
        if self.ranging is not None:
            self.ranging.update_landed_state(landed, waits=waits)

    @property
    def is_lost(self) -> bool:
        """By ranges it must find first where it is among the others: till then it is not steered."""
        return self.ranging is not None and self.ranging.is_lost

    def unplaced(self, now_s: float) -> str:
        """Why it is not known where this vehicle is among the others, in words; empty: it is."""
        if self.ranging is None:
            return ""
        return self.ranging.misplaced or (LOST if self.is_lost else "") or self.ranging.unmeasured(now_s)

    def look(self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float, launched: bool) -> None:
        """Bring all up to now. `range_m`: of the radio; `launched`: the swarm takes off, or has."""
        found = "" if self.ranging is None else self.ranging.advance(now_s)
        if found:
            self.said.append(Say(Severity.NOTICE, found))
        self.silent = self.peers.silent_airborne(own_pos_ned_m, now_s, range_m=range_m, launched=launched)
        if self.ranging is not None:
            self.silent = {k: self.ranging.correct_silent(seen, now_s) for k, seen in self.silent.items()}
        self.misses = bool(self.silent)
        self._tell_silent(now_s)
        self.neighbours = self.peers.neighbours(own_pos_ned_m, now_s, within_m=self._reach_m)
        if self.ranging is not None:
            self.neighbours = [self._now(n, self.ranging, own_pos_ned_m, now_s) for n in self.neighbours]
            unsure = [n.id for n in self.neighbours if n.beacon.airborne and n.id in self.ranging.uncertain_peers]
            self.unsure_of = unsure[0] if unsure else 0

    def _now(self, heard: Neighbour, ranging: RangingLocaliser, own_pos_ned_m: Vec3, now_s: float) -> Neighbour:
        """A neighbour where ranges have it now, as near as it may be."""
        place = ranging.locate_peer(heard.id, own_pos_ned_m[2], now_s)
        if place is None:
            return heard
        there, near = place
        dest = heard.beacon.dest_ned_m
        if dest is not None:  # it has come nearer to it since
            dest = add(there, sub(dest, scale(heard.vel_ned_mps, heard.age_s + AIR_S)))
        return Neighbour(heard.beacon, near, dest, heard.age_s, heard.vel_ned_mps, norm(near))

    @property
    def seeks_start(self) -> bool:
        """In the air: it must circle to see that the mission's start places are no mirror image."""
        return self.ranging is not None and self.ranging.is_doubtful

    def findings(self, *, leader: int, gathers: bool) -> list[Finding]:
        """What is too uncertain to fly on, by the table of failsafes. `gathers`: the swarm waits for all."""
        doubted = 0 if self.ranging is None else self._doubted(self.ranging, leader, gathers=gathers)
        unsure_of = doubted or self.unsure_of
        return failsafe_engine.detect(Source.LOCALISATION, Readings(unsure_of=unsure_of))

    def _doubted(self, ranging: RangingLocaliser, leader: int, *, gathers: bool) -> int:
        """A neighbour that may be elsewhere, or thinks that others are, while start places may be wrong; 0: none."""
        if leader == self._me and not gathers:
            ranging.has_led()
        if ranging.is_doubtful and leader != self._me and self.neighbours:
            return leader or self.neighbours[0].id
        if gathers:  # nobody leaves its place while another does not know its own
            for n in self.neighbours:
                if n.beacon.airborne and n.id != leader and not ranging.agrees(n.id):
                    return n.id
        return 0

    def look_for_silent(self, seen: ObstacleMap, own_pos_ned_m: Vec3, now_s: float, *, fresh_s: float) -> None:
        """After `look`: whose place the own sensor sees, and nobody there, is no obstacle any more."""
        if self.silent:
            self.silent = self._ghosts.clear(self.silent, seen, own_pos_ned_m, now_s, fresh_s=fresh_s)

    def to_tell(self, own_pos_ned_m: Vec3, now_s: float) -> PeerReport | None:
        """What the next beacon passes on of a third vehicle, relative to this one."""
        return self.peers.select_report(self.silent, self.neighbours, own_pos_ned_m, now_s)

    def stalled(self, now_s: float) -> None:
        """This companion has heard nothing for a while, whatever was said: it calls none silent before it listened."""
        self._tells_silent_from_s = now_s + SAY_AFTER_S

    def _tell_silent(self, now_s: float) -> None:
        """Once for each, when it is no burst of losses, and no neighbour has answered that it hears it."""
        if not self.silent and not self._silent_said:
            return
        lasting = {vehicle for vehicle, sighting in self.silent.items() if sighting.age_s >= SAY_AFTER_S}
        if now_s < self._tells_silent_from_s:
            lasting &= self._silent_said
        for vehicle in sorted(lasting - self._silent_said):
            self.said.append(Say(Severity.WARNING, f"vehicle {vehicle} link lost in the air: keeping clear"))
        for vehicle in sorted(self._silent_said - self.silent.keys()):
            self.said.append(Say(Severity.NOTICE, f"vehicle {vehicle} link regained"))
        self._silent_said = lasting | (self._silent_said & self.silent.keys())
