"""A vehicle's company: contact with others, the majority of its part of the swarm, and what follows without them.

Only the part with the majority of those that took off goes on with the mission (see `roster`), when it has waited for
those that it lost. The others hold; where the mission has `[sensing]` they look for one another (`rejoin`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, final

from companion.core.model.beacon import Lease
from companion.core.model.neighbour import find_hover_places
from companion.core.model.peer_contacts import PeerContacts
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.swarm.partition_recovery import (
    BEYOND,
    FAR_BEYOND,
    OTHERS_LOST,
    LostPeerTimer,
    PartitionRecovery,
    Stage,
    stay_outside_m,
)
from companion.core.swarm.picture import Picture
from companion.core.swarm.roster import Roster, ids, list_vehicles
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause, Finding, Readings, Source
from mission.common.frames import Vec3
from mission.document.height_layers import APART_M, list_layers
from mission.document.model import Mission

UNDER_WAY = (SwarmPhase.TRANSIT, SwarmPhase.RETURN)
CLAIMS = (Role.CLAIMANT, Role.LEADER)
LED = (FlightState.TRANSIT, FlightState.RETURNING, FlightState.SEEKING)
LAYER_AFTER_S: Final = 1.0  # without the majority, until it changes its height: not for moments
REJOINED_S: Final = 3.0  # with it again, until it comes back
LEAVES_S: Final = 10.0  # so long it waits to come back: one that hovers above may bar the way for good
# For each that is lost on the way the majority waits longer where the others stand, too: all hear one another as soon
# as the radio lets them. Under the open sky, where who sees nobody must not look for others: half a minute, and the
# time in which they become one again. In layers a minute: whom it has left behind may have to go round many trees.
WAIT_OPEN_S: Final = 40.0
WAIT_IN_LAYERS_S: Final = 60.0
# Without the majority, where there are layers, until a part looks for the others. Several parts may share a layer, and
# those with the majority come back to where it is: who stands is where the others take it to be. Shorter than the
# majority waits: it is found where it was heard last. By its leader's id one part has its turn later than another:
# where a cut leaves no majority all lose it at once, and would set out towards one another.
STANDS_S: Final = 50.0
TURN_S: Final = 12.0  # to come to where the others were heard last
TURNS: Final = 3
NO_NEIGHBOUR: Final = failsafe_engine.row(Cause.NO_NEIGHBOUR)
NO_MAJORITY_LONG: Final = failsafe_engine.row(Cause.NO_MAJORITY_LONG)


class NetworkPartition:
    """One vehicle's. Base, and the make without an obstacle sensor, which waits and looks for nobody.

    `update_peer_contact` each tick, `update_quorum` and `search_lost_peers` each beacon period.
    """

    def __init__(self, mission: Mission) -> None:
        self.recovery = PartitionRecovery()
        self.waits_for: list[int] = []  # a leader's with the majority: which of the others, see `LostPeerTimer`
        self._alone_is_company = mission.swarm.size == 1
        self._alone_beacons_s = NO_NEIGHBOUR.delay_periods / mission.radio.beacon_rate_hz
        self._partitioned_s: float | None = None  # since when this part has not held the majority
        self._whole_s: float | None = None  # and since when it does
        self._contact_s: float | None = None  # when this vehicle was last in company
        self._layers: Final = list_layers(mission)
        has_layers = mission.sensing is not None and len(self._layers) > 1
        wait_s = WAIT_OPEN_S if mission.sensing is None else WAIT_IN_LAYERS_S if has_layers else OTHERS_LOST.limit_s
        self._timer = LostPeerTimer(wait_s)
        self._held_m: Final = self._layers[0] if has_layers else None  # else a formation's heights wander
        self._layer_m: float | None = None
        self._clear_m: Final = mission.separation.hard_m

    def update_peer_contact(self, picture: Picture, *, led: bool) -> None:
        """In company: on the ground, hearing the swarm fly, or a swarm of one. `led`: it knows a leader."""
        steered = picture.is_steered
        heard = bool(picture.neighbours) and picture.is_localised
        flies_alone = self._alone_is_company and steered
        guided = steered or led
        if self._contact_s is None or not picture.airborne or flies_alone or (heard and guided):
            self._contact_s = picture.now_s

    def no_contact_s(self, now_s: float) -> float:
        """The time that this vehicle has been in the air without company."""
        return 0.0 if self._contact_s is None else now_s - self._contact_s

    def update_quorum(self, picture: Picture, lease: Lease | None) -> None:
        """This part holds the majority, as its leader says with the lease."""
        now_s = picture.now_s
        if not picture.is_steered:
            self._partitioned_s = self._whole_s = None
        elif lease is None or not lease.quorum:
            self._whole_s = None
            if lease is not None and self._partitioned_s is None:
                self._partitioned_s = now_s
        elif self._whole_s is None:
            self._whole_s = now_s
        elif now_s - self._whole_s > NO_MAJORITY_LONG.lingers_s:
            self._partitioned_s = None

    def partitioned_s(self, now_s: float) -> float:
        """For how long it has not, but for moments."""
        return 0.0 if self._partitioned_s is None else now_s - self._partitioned_s

    def partitioned_long(self, now_s: float) -> bool:
        """The others have not been heard again."""
        return self.partitioned_s(now_s) > NO_MAJORITY_LONG.delay_s

    def update_layer(self, picture: Picture, lease: Lease | None) -> float | None:
        """Each tick: the height (m above the origin) to fly at; None: as the formation goes.

        A part without the majority has another than the mission's. It comes back when it has been with the others for a
        while and none of them is above or below it. Who has not been steered for a while is where it was, or where a
        pilot or a companion that was started again has brought it: past the mission's height it goes from nowhere.
        """
        now_s = picture.now_s
        if len(self._layers) == 1:
            return None
        if not picture.is_steered:
            if picture.state is not FlightState.WAITING:
                self._layer_m = None
            return None
        if self._whole_s is None:
            from_m = self._find_height_apart(picture) if self._layer_m is None else self._layer_m
            if lease is not None and not lease.quorum and self.partitioned_s(now_s) >= LAYER_AFTER_S:
                self._layer_m = choose_layer(self._layers, lease.leader, from_m)
            elif (lease is None or not lease.quorum) and from_m is not None:
                return from_m
        elif now_s - self._whole_s >= REJOINED_S and self._is_way_free(picture):
            self._layer_m = None
        return self._held_m if self._layer_m is None else self._layer_m

    def _find_height_apart(self, picture: Picture) -> float | None:
        """The own height, m above the origin, where that is another layer's; None: it is at the mission's."""
        height_m = self._layers[0] if picture.own is None else -picture.own.pos_ned_m[2]
        return height_m if abs(height_m - self._layers[0]) > APART_M / 2.0 else None

    def leaves_layer(self, now_s: float) -> bool:
        """With the majority again, and about to come back to the mission's height: others may stand where it is."""
        return self._layer_m is not None and self._whole_s is not None and now_s - self._whole_s <= LEAVES_S

    def makes_wait(self, now_s: float) -> bool:
        """A leader's: it waits for others that are lost, or to come back to the mission's height."""
        return bool(self.waits_for) or self.leaves_layer(now_s)

    def _is_way_free(self, picture: Picture) -> bool:
        others = [n.rel_ned_m for n in picture.neighbours] + find_hover_places(picture.silent.values())
        return all([math.hypot(rel[0], rel[1]) >= self._clear_m for rel in others])

    # --- to find one another again ---

    def search_lost_peers(
        self,
        picture: Picture,
        roster: Roster,
        lease: Lease | None,
        *,
        linked: int,  # noqa: ARG002
        role: Role,
        to_goal_mps: float,  # noqa: ARG002
        ahead: list[Vec3],  # noqa: ARG002
        phase: SwarmPhase,
    ) -> None:
        """One period: as its leader look for the others, or wait for them. `ahead`: as `Phases.stops_ahead`.

        `linked`: which others are known to be in this partition, by whatever way; bit k-1 for vehicle k.
        `to_goal_mps`: how fast the course that it is led on comes nearer to where the swarm is bound.
        """
        missing = self._find_missing(picture, roster, role)
        self.waits_for = []
        if not missing or lease is None:
            self._timer.end()
            return
        waits_for = self._timer.update(missing, picture.now_s, self.recovery)
        if lease.quorum and phase in UNDER_WAY:
            self.waits_for = waits_for

    @property
    def waits_until_s(self) -> float:
        """The time until which those of `waits_for` are waited for, at most."""
        return self._timer.until_s

    def _find_missing(self, picture: Picture, roster: Roster, role: Role) -> int:
        """A leader's: which of those that took off are not in its part; bit k-1 for vehicle k."""
        leads = role is Role.LEADER and picture.is_steered
        return roster.missing_peers(picture.contacts.grounded()) if leads else 0

    def _describe_search(self, lease: Lease | None, now_s: float, *, role: Role) -> str:  # noqa: ARG002
        """Words for the search for others that are lost; empty: it looks for nobody."""
        return ""

    # --- what follows ---

    def hold_findings(
        self, roster: Roster, contacts: PeerContacts, lease: Lease | None, now_s: float, *, role: Role
    ) -> list[Finding]:
        """Find why it must neither follow the phase nor, as leader, decide for the swarm."""
        without = ""
        if lease is not None and not lease.quorum:
            missing = ids(roster.missing_peers(contacts.grounded())) if role in CLAIMS else []
            without = f", without {list_vehicles(missing)}" if missing else ""
        readings = Readings(
            alone_s=self.no_contact_s(now_s),
            alone_beacons_s=self._alone_beacons_s,
            led=lease is not None,
            quorum=lease is not None and lease.quorum,
            missing=without,
            search=self._describe_search(lease, now_s, role=role),
        )
        return failsafe_engine.detect(Source.PARTITION, readings)


@final
class SearchingPartition(NetworkPartition):
    """With an obstacle sensor: those that it does not hear it can still see, so it looks for them."""

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self._outside_m = stay_outside_m(mission.coverage.radius_m, mission.separation.soft_m)

    def search_lost_peers(
        self,
        picture: Picture,
        roster: Roster,
        lease: Lease | None,
        *,
        linked: int,
        role: Role,
        to_goal_mps: float,
        ahead: list[Vec3],
        phase: SwarmPhase,
    ) -> None:
        """As the base says."""
        own, now_s, contacts = picture.own, picture.now_s, picture.contacts
        if own is None:
            return
        search, pos = self.recovery, self._at_mission_height(own.pos_ned_m)
        if search.stage is not Stage.RETRACE:
            search.trail.record_links(
                pos, linked | _bits([n.id for n in picture.neighbours]) if picture.is_steered else 0
            )
        if picture.state in LED:
            search.note_course(to_goal_mps, now_s)
        self.waits_for = []
        missing = self._find_missing(picture, roster, role)
        # Around the tree each knows its position, and those of the others stay taken.
        heard_at, outside = None, list[tuple[Vec3, float]]()
        if not missing or lease is None:
            self._timer.end()
            search.end(now_s)
            return
        waits_for = self._timer.update(missing, now_s, search)
        if lease.quorum:
            self.waits_for = waits_for if phase in UNDER_WAY else []
            if not self.waits_for:
                search.end(now_s)
                return
            missing, lost_s = _bits(self.waits_for), self._timer.waited_s(now_s)
        else:
            lost_s = self.partitioned_s(now_s)
            if lost_s < self._hold_s(lease.leader):
                search.end(now_s)
                return
            if phase is not SwarmPhase.COVERAGE:
                heard_at = contacts.heard_last(missing)
                outside = [(position, self._outside_m) for position in ahead]
        beyond = 0 if phase is SwarmPhase.COVERAGE else BEYOND if lease.quorum else FAR_BEYOND
        search.update(now_s, pos, lost_s=lost_s, lost=missing, heard_at=heard_at, ahead=outside, beyond=beyond)

    def _hold_s(self, leader: int) -> float:
        """For how long a part without the majority, which `leader` leads, stands before it looks for the others."""
        if len(self._layers) == 1:
            return self.recovery.hold_s
        return STANDS_S + TURN_S * choose_turn(self._layers, leader)

    def _at_mission_height(self, pos_ned_m: Vec3) -> Vec3:
        """Positions of a search are those of the mission's height: its layer is not on the way to anything."""
        return pos_ned_m if self._layer_m is None else (pos_ned_m[0], pos_ned_m[1], -self._layers[0])

    def _describe_search(self, lease: Lease | None, now_s: float, *, role: Role) -> str:
        led = role not in CLAIMS and lease is not None and lease.established and not lease.quorum
        if lease is not None and led and self.partitioned_s(now_s) >= self._hold_s(lease.leader):
            return f", following {lease.leader}"
        return "" if self.recovery.goal is None else f": {self.recovery.stage.value}"


def choose_layer(layers: Sequence[float], leader: int, now_m: float | None = None) -> float:
    """The layer of a part without the majority, which `leader` leads: any but the mission's own, `layers[0]`.

    From a height that it has, `now_m`, none on the other side of the mission's own: others that it does not hear are
    there. Where a mission has no layer on that side there is no such choice.
    """
    own_m = layers[0]
    beside = [one for one in layers[1:] if now_m is None or (one > own_m) is (now_m > own_m)]
    others = beside or layers[1:]
    return others[leader % len(others)]


def choose_turn(layers: Sequence[float], leader: int) -> int:
    """The turn, 0 to TURNS - 1, in which it looks for the others: in one layer the next leader has another."""
    return leader // (len(layers) - 1) % TURNS


def build_partition(mission: Mission) -> NetworkPartition:
    """The make that a mission's vehicles have."""
    return NetworkPartition(mission) if mission.sensing is None else SearchingPartition(mission)


def _bits(vehicles: Iterable[int]) -> int:
    """Bit k-1 for vehicle k."""
    bits = 0
    for vehicle in vehicles:
        bits |= 1 << (vehicle - 1)
    return bits
