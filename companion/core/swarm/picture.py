"""The picture: all that the swarm's decisions go by in one tick. Frozen: own state, peers, and how good both are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.peer_contacts import PeerContacts
from companion.core.model.states import STEERED, FlightState, Reception
from companion.core.vehicle.failsafe import Finding
from mission.common.frames import Vec3


@dataclass(slots=True, init=False, unsafe_hash=True)
class Picture:
    """One vehicle's, of one tick, before anything is decided in it."""

    now_s: Final[float]
    own: Final[Position | None]  # with its true velocity; None: not known yet
    state: Final[FlightState]
    airborne: Final[bool]
    can_lead: Final[bool]  # its position is known, and its autopilot obeys this companion
    settled: Final[bool]  # steered, and nearly at rest
    listens_s: Final[float]  # for how long it has been in the air, ready to join a swarm
    battery_percent: Final[int | None]
    lacks: Final[Sequence[Finding]]  # of its own autopilot and sensors, by the table of failsafes
    neighbours: Final[Sequence[Neighbour]]
    silent: Final[Mapping[int, PeerReport]]  # by id: fell silent in the air
    misses: Final[bool]  # some fell silent, also where the own sensor has seen nobody
    hovering: Final[Mapping[int, PeerReport]]  # by id: in the air, and steered by no companion; silent ones among them
    contacts: Final[PeerContacts]  # last beacons, of those too that are not heard any more
    to_d2_mps: Final[float]  # how fast the course that it is led on comes nearer to d2
    dest_ned_m: Final[Vec3 | None]  # the vector to d2, or to the visit before it, as of the last tick; None: not known
    # Quality of its localisation.
    is_localised: Final[bool]  # it knows its position among the others
    not_localised: Final[str]  # why it must not take off; empty: it may
    reception: Final[Reception]
    may_lose_position: Final[bool]  # in flight: it keeps a trail to come back by
    is_position_lost: Final[bool]  # it leads, and may be off by more than the mission allows
    offset_ned_m: Final[Vec3]  # its position in the mission's frame less the reported one
    uncertain_peer: Final[int]  # a neighbour whose position is too uncertain to fly beside it; 0: none
    is_start_uncertain: Final[bool]  # start positions may be wrong
    unconfirmed_peers: Final[Sequence[int]]  # neighbours in the air that may not know where they are

    def __init__(
        self,
        *,
        now_s: float,
        own: Position | None,
        state: FlightState,
        airborne: bool,
        can_lead: bool,
        settled: bool,
        listens_s: float,
        battery_percent: int | None,
        lacks: Sequence[Finding],
        neighbours: Sequence[Neighbour],
        silent: Mapping[int, PeerReport],
        misses: bool,
        hovering: Mapping[int, PeerReport],
        contacts: PeerContacts,
        to_d2_mps: float,
        dest_ned_m: Vec3 | None,
        is_localised: bool,
        not_localised: str,
        reception: Reception,
        may_lose_position: bool,
        is_position_lost: bool,
        offset_ned_m: Vec3,
        uncertain_peer: int,
        is_start_uncertain: bool,
        unconfirmed_peers: Sequence[int],
    ) -> None:
        self.now_s = now_s
        self.own = own
        self.state = state
        self.airborne = airborne
        self.can_lead = can_lead
        self.settled = settled
        self.listens_s = listens_s
        self.battery_percent = battery_percent
        self.lacks = lacks
        self.neighbours = neighbours
        self.silent = silent
        self.misses = misses
        self.hovering = hovering
        self.contacts = contacts
        self.to_d2_mps = to_d2_mps
        self.dest_ned_m = dest_ned_m
        self.is_localised = is_localised
        self.not_localised = not_localised
        self.reception = reception
        self.may_lose_position = may_lose_position
        self.is_position_lost = is_position_lost
        self.offset_ned_m = offset_ned_m
        self.uncertain_peer = uncertain_peer
        self.is_start_uncertain = is_start_uncertain
        self.unconfirmed_peers = unconfirmed_peers

    @property
    def is_steered(self) -> bool:
        """Its companion steers it."""
        return self.state in STEERED

    def find_silent_here(self) -> int:
        """Bit k-1: vehicle k was heard here in the air, and fell silent; 0 where one is heard: all goes by its word."""
        bits = 0
        if len(self.neighbours) > 1:
            for vehicle, seen in self.silent.items():
                if not seen.received:
                    bits |= 1 << (vehicle - 1)
        return bits

    def find_uncertain_peer(self, me: int, leader: int, *, gathers: bool) -> int:
        """A vehicle that may be elsewhere, or has others elsewhere; 0: none. `gathers`: the swarm waits for all."""
        if self.is_start_uncertain and leader != me and self.neighbours:
            return leader or self.neighbours[0].id
        if gathers:  # nobody leaves its place while another does not know its own
            for vehicle in self.unconfirmed_peers:
                if vehicle != leader:
                    return vehicle
        return self.uncertain_peer
