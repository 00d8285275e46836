"""Localisation where all vehicles receive GNSS: a neighbour is at the difference of two reported positions.

Its velocity is reported too, and corrected by how its position changes (`velocity_bias`). The own velocity is corrected
alike. Nothing here is uncertain, so what the other implementation has to say of that is neutral. Where vehicles have
range radios, positions are held against what these measure (`range_check`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import final

from companion.core.localisation.dead_reckoning import DeadReckoning
from companion.core.localisation.integrity.range_check import RangeCheck
from companion.core.localisation.localiser import Localiser
from companion.core.model.actions import SendBeacon
from companion.core.model.beacon import Beacon, PeerReport, RelativeReport, TrunkReport
from companion.core.model.displaced import Displaced
from companion.core.model.events import HeardBeacon, Position, Ranges, Satellites
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import FlightState, LandedState, Role
from companion.core.model.vectors import ZERO
from companion.core.model.velocity_bias import VelocityBias
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from mission.document.model import Mission


@final
class GnssLocaliser(Localiser):
    """One vehicle's."""

    def __init__(self, mission: Mission, me: int) -> None:
        super().__init__(mission, me, corrects_velocity=True)
        self._bias = VelocityBias()  # of the own velocity
        self._reckoning = DeadReckoning()
        self._check = None if mission.ranging is None else RangeCheck(me, mission.swarm.size)

    @property
    def may_lose_position(self) -> bool:
        """Never: without its position a vehicle is not steered."""
        return False

    @property
    def is_initialised(self) -> bool:
        """Always."""
        return True

    @property
    def is_start_uncertain(self) -> bool:
        """Never."""
        return False

    @property
    def velocity_bias_ned_mps(self) -> Vec3:
        """As observed."""
        return self._bias.ned_mps

    @property
    def offset_ned_m(self) -> Vec3:
        """None: the reported position is the mission's."""
        return ZERO

    def split_jumps(self, reported: Position, now_s: float, *, airborne: bool) -> Position:  # noqa: ARG002
        """As reported; a jump tells that a fix which was lost is gone by again."""
        self._reckoning.note_position(reported, now_s)
        return reported

    def receive_position(self, position: Position, now_s: float) -> Position:
        """Observes the velocity's bias, by the autopilot's own time: what comes in a burst was not measured in one."""
        measured_s = now_s if position.boot_s is None else position.boot_s
        self._bias.update(position.pos_ned_m, position.vel_ned_mps, measured_s)
        return position

    def receive_satellites(self, event: Satellites, now_s: float) -> None:
        """The fix counts, and that the autopilot goes by it: how good it is, its own gates say."""
        self._reckoning.receive_fix(now_s, has_fix=event.has_fix, is_used=event.used)

    @property
    def is_fix_lost(self) -> bool:
        """As the receiver says, until the position goes by it again."""
        return self._reckoning.is_lost

    def note_odometry(self, off_ned_mps: Vec3, now_s: float) -> None:
        """By it a position goes on without a fix."""
        self._reckoning.note_odometry(now_s, off_mps=math.hypot(off_ned_mps[0], off_ned_mps[1]))

    def gnss_lost_s(self, now_s: float) -> float:
        """As the receiver says, for as long as trunks do not stand in."""
        return self._reckoning.lasts_s(now_s)

    def position_error_m(self, now_s: float) -> float:
        """Grows for as long as there is no fix."""
        return self._reckoning.error_m(now_s)

    def receive_ranging(self, event: Ranges | RelativeReport | TrunkReport, now_s: float) -> None:
        """Ranges, to hold positions against; nobody reports odometry."""
        if self._check is not None and isinstance(event, Ranges) and not self.is_backlog(now_s):
            self._check.receive(event.ranges, now_s)

    @property
    def displaced(self) -> Displaced | None:
        """By ranges to three neighbours at least."""
        return None if self._check is None else self._check.displaced

    def update_landed_state(self, landed: LandedState, *, waits: bool) -> None:
        """Of no account."""

    def update_position_quality(self, now_s: float, *, role: Role) -> None:  # noqa: ARG002
        """Good, as from the start, but that a receiver may have fallen silent."""
        self._reckoning.note_silence(now_s)

    def handle_stall(self, now_s: float) -> None:
        """As any; of the receiver nothing was to be heard either."""
        super().handle_stall(now_s)
        self._reckoning.handle_stall(now_s)

    def update_destination(
        self,
        pos_ned_m: Vec3,
        upstream: Sequence[Neighbour],
        now_s: float,
        *,
        role: Role,
        stop: int,
        leader: int,
    ) -> None:
        """A leader's from its own position, a follower's from those nearer to the leader."""
        if role is Role.LEADER:
            self.destination.update_leader(pos_ned_m, stop)
        else:
            self.destination.update_follower(pos_ned_m, stop, upstream, now_s, leader=leader)

    def missing(self, now_s: float) -> str:  # noqa: ARG002
        """Nothing."""
        return ""

    def confirm_start(self, leader: int, *, gathers: bool) -> None:
        """Of no account."""

    def excite(self, state: FlightState, cause: Cause | None, now_s: float) -> Vec3:  # noqa: ARG002
        """Not needed."""
        return ZERO

    def make_broadcast(
        self,
        beacon: Beacon,
        pos_ned_m: Vec3,  # noqa: ARG002
        now_s: float,  # noqa: ARG002
        *,
        leader: int,  # noqa: ARG002
        role: Role,  # noqa: ARG002
    ) -> SendBeacon:
        """The beacon alone: the codec adds the position."""
        return SendBeacon(beacon)

    def _locate_sender(
        self,
        heard: HeardBeacon,
        own_pos_ned_m: Vec3,  # noqa: ARG002
        age_s: float,  # noqa: ARG002
        now_s: float,  # noqa: ARG002
    ) -> HeardBeacon | None:
        return heard

    def _advance(self, now_s: float) -> None:
        pass

    def _correct_silent(self, silent: dict[int, PeerReport], now_s: float) -> dict[int, PeerReport]:
        check = self._check
        if check is None:
            return silent
        return {k: self._bring_near(check, seen, now_s) for k, seen in silent.items()}

    def _bring_near(self, check: RangeCheck, seen: PeerReport, now_s: float) -> PeerReport:
        """A silent vehicle's place, and the nearer one that its range tells: neither makes the other free."""
        near = check.near_ned_m(seen.vehicle, seen.rel_ned_m, now_s)
        if near is seen.rel_ned_m:
            return seen
        return replace(seen, rel_ned_m=near, elsewhere=(seen.rel_ned_m, *seen.elsewhere))

    def _correct_neighbours(self, own_pos_ned_m: Vec3, now_s: float) -> None:  # noqa: ARG002
        check = self._check
        if check is not None:
            check.update(self.neighbours, now_s)
            self.neighbours = [check.bring_near(neighbour, now_s) for neighbour in self.neighbours]
