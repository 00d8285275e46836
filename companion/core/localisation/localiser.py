"""Estimates where the neighbours are, and where this vehicle is in the mission: the base of both makes.

Everything about neighbours is relative to this vehicle. Which make a mission's vehicles have is chosen once, when the
agent is built: where all receive GNSS, `gnss_localiser`; where not all do, `gnss_denied`. Agent, swarm and guidance
know this class alone; what a make does not know or need it answers with neutral values.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from companion.core.localisation.beacon_age import BeaconAges
from companion.core.localisation.destination import Destination
from companion.core.localisation.link_reports import LinkReports
from companion.core.localisation.peer_table import RANGE_SLACK, PeerTable
from companion.core.localisation.silence_reports import SAY_AFTER_S, SilenceReports
from companion.core.model.actions import Say, SendBeacon
from companion.core.model.beacon import Beacon, PeerReport, RelativeReport, TrunkReport
from companion.core.model.displaced import Displaced
from companion.core.model.events import HeardBeacon, Position, Ranges, Satellites
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, LandedState, Reception, Role
from companion.core.model.vectors import add, norm
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks
from companion.core.perception.obstacle_perception import ObstaclePerception
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from mission.document.model import Mission

STALL_S: Final = failsafe_engine.row(Cause.COMPANION_STALLED).delay_s
BACKLOG_S: Final = 0.2  # after a stall: what waited in the sockets meanwhile, the oldest first, has been read by then


class Localiser(ABC):
    """One vehicle's. `update_peers` once a tick; `neighbours` and `silent` hold until the next."""

    def __init__(self, mission: Mission, me: int, *, corrects_velocity: bool) -> None:
        """`corrects_velocity`: the velocities that peers broadcast are corrected by how their positions change."""
        self._me, self._size = me, mission.swarm.size
        # A vehicle that claims to be farther off takes no part in movement.
        self._reach_m = RANGE_SLACK * mission.radio.full_range_m
        self.peers = PeerTable(
            size=self._size,
            beacon_period_s=1.0 / mission.radio.beacon_rate_hz,
            speed_max_mps=mission.limits.speed_max_mps,
            corrects_velocity=corrects_velocity,
        )
        self.ages: Final = BeaconAges(me)
        self.destination = Destination(mission)
        self.neighbours: list[Neighbour] = []  # heard, and within reach
        self.silent: dict[int, PeerReport] = {}  # those that fell silent in the air, by id
        # Where others hear those in the air that this one does not, relative, and how old that is.
        self.relayed: list[tuple[Vec3, float]] = []
        self.misses = False  # somebody fell silent in the air, wherever it is
        self.uncertain_peer = 0  # a neighbour in the air whose position is too uncertain to fly beside it; 0: none
        self.unconfirmed_peers: list[int] = []  # neighbours in the air that may not know where they are
        self.reception = Reception.GOOD
        self.is_position_lost = False  # an acting leader's: it may be off by more than the mission allows
        self.said: list[Say] = []  # for the operator, since it was taken last
        self._silences: Final = SilenceReports()
        self._links: Final = LinkReports()
        self._reports_silent_from_s = -1e9
        self._updated_s: float | None = None  # the last tick
        self._backlog_until_s = -1e9

    # --- what a make answers ---

    @property
    @abstractmethod
    def may_lose_position(self) -> bool:
        """True where its position may get uncertain in flight: such a vehicle keeps a trail to come back by."""

    @property
    @abstractmethod
    def is_initialised(self) -> bool:
        """Its position among the others is known; till then it is not steered."""

    @property
    @abstractmethod
    def is_start_uncertain(self) -> bool:
        """In the air: it must see by a motion that the mission's start positions are no mirror image."""

    @property
    @abstractmethod
    def velocity_bias_ned_mps(self) -> Vec3:
        """The own velocity's error: the true one less the reported one, NED m/s."""

    @property
    @abstractmethod
    def offset_ned_m(self) -> Vec3:
        """The own position in the mission's frame less the reported one, as of the last `update_destination`."""

    def split_jumps(self, reported: Position, now_s: float, *, airborne: bool) -> Position:  # noqa: ARG002
        """The reported position without what fixes make it jump, before what is seen corrects it."""
        return reported

    @abstractmethod
    def receive_position(self, position: Position, now_s: float) -> Position:
        """Take in the autopilot's position and velocity; returns the position that the flight goes by."""

    @abstractmethod
    def receive_satellites(self, event: Satellites, now_s: float) -> None:
        """Take in what the autopilot says of its GNSS receiver."""

    @abstractmethod
    def gnss_lost_s(self, now_s: float) -> float:
        """For how long its position has gone on without the GNSS fix that it goes by; 0: it has one, or needs none."""

    @abstractmethod
    def position_error_m(self, now_s: float) -> float:
        """Level error that such a position may have by now."""

    @property
    def is_fix_lost(self) -> bool:
        """The fix that its position goes by is lost: what trunks tell of the way since counts more."""
        return False

    @property
    def displaced(self) -> Displaced | None:
        """The reported position is not where ranges to the neighbours have this vehicle."""
        return None

    @abstractmethod
    def note_odometry(self, off_ned_mps: Vec3, now_s: float) -> None:
        """The autopilot is told of the own motion by trunks: `off_ned_mps` is that less what it has reported."""

    @abstractmethod
    def receive_ranging(self, event: Ranges | RelativeReport | TrunkReport, now_s: float) -> None:
        """Take in own ranges, what goes with a member's next beacon, or trunks about a member."""

    def is_due_for_trunks(self, now_s: float) -> bool:  # noqa: ARG002
        """Own trunks in sight are to be noted: only where they are shared."""
        return False

    def note_trunks(self, seen: SolitaryTrunks, now_s: float) -> None:  # noqa: B027 - of no use where none are shared
        """Take in own trunks in sight, after `receive_position`."""

    @abstractmethod
    def update_landed_state(self, landed: LandedState, *, waits: bool) -> None:
        """Take in what the autopilot says of being in the air. `waits`: this vehicle is not to fly yet."""

    @abstractmethod
    def update_position_quality(self, now_s: float, *, role: Role) -> None:
        """Sets `reception` and `is_position_lost`. `role`: in the swarm."""

    @abstractmethod
    def update_destination(
        self, pos_ned_m: Vec3, upstream: Sequence[Neighbour], now_s: float, *, role: Role, stop: int, leader: int
    ) -> None:
        """Sets `destination`: once a tick, after the route is known. `upstream`: those nearer to the `leader`."""

    @abstractmethod
    def missing(self, now_s: float) -> str:
        """The reason for which this vehicle's position among the others is not known; empty: it is."""

    @abstractmethod
    def confirm_start(self, leader: int, *, gathers: bool) -> None:
        """After each decision: a leader that has set out has seen all find their positions about it."""

    @abstractmethod
    def excite(self, state: FlightState, cause: Cause | None, now_s: float) -> Vec3:
        """Velocity of an excitation manoeuvre (NED m/s), by which a formation's rotation becomes observable."""

    @abstractmethod
    def make_broadcast(self, beacon: Beacon, pos_ned_m: Vec3, now_s: float, *, leader: int, role: Role) -> SendBeacon:
        """The beacon, with what else this make broadcasts."""

    @abstractmethod
    def _locate_sender(self, heard: HeardBeacon, own_pos_ned_m: Vec3, age_s: float, now_s: float) -> HeardBeacon | None:
        """The beacon with the sender's position of then as this make has it, from here; None: it is not known.

        `age_s`: for how long the beacon has been on its way.
        """

    @abstractmethod
    def _advance(self, now_s: float) -> None:
        """Bring all estimates up to now."""

    @abstractmethod
    def _correct_silent(self, silent: dict[int, PeerReport], now_s: float) -> dict[int, PeerReport]:
        """The peers that fell silent, where this make has them."""

    @abstractmethod
    def _correct_neighbours(self, own_pos_ned_m: Vec3, now_s: float) -> None:
        """Neighbours, where this make has them; and which of them are uncertain."""

    # --- what both do ---

    def receive_beacon(self, heard: HeardBeacon, own_pos_ned_m: Vec3, now_s: float) -> bool:
        """Store where a member is, and which third vehicle it reports; False for a beacon that says nothing new."""
        if self.is_backlog(now_s):
            return False
        age_s = self.ages.receive(heard.said, now_s)
        located = self._locate_sender(heard, own_pos_ned_m, age_s, now_s)
        if located is None or not self.peers.store_beacon(located, own_pos_ned_m, now_s, age_s):
            return False
        seen, sender = located.said.sighting, located.said.sender
        if seen is not None and 1 <= seen.vehicle <= self._size and seen.vehicle not in (self._me, sender):
            rel = add(located.rel_ned_m, seen.rel_ned_m)
            if not seen.silent or norm(rel) <= self._reach_m:
                self.peers.store_report(sender, replace(seen, rel_ned_m=rel), own_pos_ned_m, now_s)
        return True

    def update_peers(self, own_pos_ned_m: Vec3, now_s: float, *, range_m: float, launched: bool) -> None:
        """Bring all up to now. `range_m`: of the radio; `launched`: the swarm takes off, or has."""
        self._updated_s = now_s
        self._advance(now_s)
        silent = self.peers.silent_airborne(own_pos_ned_m, now_s, range_m=range_m, launched=launched)
        self.silent = self._correct_silent(silent, now_s)
        self.misses = bool(self.silent)
        self.said += self._silences.update(
            self.silent,
            now_s,
            may_begin=now_s >= self._reports_silent_from_s,
            heard_elsewhere=[k for k in self.silent if self.peers.is_heard_elsewhere(k, own_pos_ned_m, now_s)],
            on_ground=[k for k, seen in self.silent.items() if not seen.received and self.peers.was_on_ground(k)],
        )
        self.neighbours = self.peers.neighbours(own_pos_ned_m, now_s, within_m=self._reach_m)
        self.relayed = self.peers.relayed(own_pos_ned_m, now_s)
        self._correct_neighbours(own_pos_ned_m, now_s)
        self.said += self._links.update(self.neighbours, now_s)

    @property
    def unheard(self) -> int:
        """Number of vehicles that this one heard in the air, and does not hear any more; others' words do not count."""
        return sum([not seen.received for seen in self.silent.values()])

    def clear_ghosts(self, perception: ObstaclePerception, own_pos_ned_m: Vec3, now_s: float) -> None:
        """After `update_peers`: one whose position the own sensor sees, and nobody there, is no obstacle any more."""
        if self.silent:
            reported = [neighbour.rel_ned_m for neighbour in self.neighbours]
            self.silent = perception.clear_ghosts(self.silent, own_pos_ned_m, now_s, reported)

    def select_report(self, own_pos_ned_m: Vec3, now_s: float) -> PeerReport | None:
        """The sighting of a third vehicle that the next beacon passes on, relative to this one."""
        return self.peers.select_report(self.silent, self.neighbours, own_pos_ned_m, now_s)

    def handle_stall(self, now_s: float) -> None:
        """This companion has heard nothing for a while, whatever was said: it calls none silent before it listened."""
        self._reports_silent_from_s = now_s + SAY_AFTER_S
        self._backlog_until_s = now_s + BACKLOG_S

    def is_backlog(self, now_s: float) -> bool:
        """True while what arrives has waited through a stall of this companion: nobody knows for how long."""
        stalled = self._updated_s is not None and now_s - self._updated_s > STALL_S
        return stalled or now_s < self._backlog_until_s
