"""Values that vehicles broadcast to one another: SWARM_BEACON, SWARM_RELATIVE, SWARM_TRUNKS, parts."""

# Generated from companion/mavlink/schema by `make dialect`; do not edit.

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.model.states import FlightState, SwarmPhase
from mission.common.frames import Vec3

NO_ROUTE: Final = 1e6  # route cost of a vehicle that knows no way to the leader
RangeTo = tuple[int, float, float]  # a vehicle, the distance to it in metres, and how many seconds ago it was measured
ToldTrunk = tuple[float, float, float]  # its axis north and east of who tells it, and its diameter, metres


@dataclass(slots=True, init=False, unsafe_hash=True)
class Lease:
    """A leader's claim as it travels from neighbour to neighbour. Compared by `election.rank`."""

    leader: Final[int]
    seq: Final[int]  # the leader's count of periods: only an advancing one renews the lease
    priority: Final[int]  # static, from the mission; higher leads
    score: Final[int]  # resources when it claimed or was re-elected; higher leads
    established: Final[bool]  # held long enough to act
    heir: Final[int]  # which takes over when the count reaches `ends`; 0: none
    ends: Final[int]
    quorum: Final[bool]  # its part of the swarm is the majority of those that took off

    def __init__(
        self,
        leader: int,
        seq: int,
        priority: int,
        score: int,
        established: bool,
        heir: int = 0,
        ends: int = 0,
        quorum: bool = True,
    ) -> None:
        self.leader = leader
        self.seq = seq
        self.priority = priority
        self.score = score
        self.established = established
        self.heir = heir
        self.ends = ends
        self.quorum = quorum


@dataclass(slots=True, init=False, unsafe_hash=True)
class Candidate:
    """A vehicle that could lead: by priority, then score."""

    vehicle: Final[int]
    priority: Final[int]
    score: Final[int]

    def __init__(
        self,
        vehicle: int,
        priority: int,
        score: int,
    ) -> None:
        self.vehicle = vehicle
        self.priority = priority
        self.score = score


@dataclass(slots=True, init=False, unsafe_hash=True)
class PeerReport:
    """A third vehicle's position when it was last heard, as it travels with the beacons."""

    vehicle: Final[int]
    rel_ned_m: Final[Vec3]  # from the one that keeps it (in a beacon: from the sender) to that vehicle
    age_s: Final[float]  # since it was heard
    silent: Final[bool]  # none hears it any more: it hovers there, link lost
    relays: Final[int]  # members over which its sender was told; TAKEN_BACK: it takes its alarm back
    received: Final[bool]  # from another vehicle's beacon, not heard here (not on the wire)
    every_height: Final[bool]  # it was on its way up or down (not on the wire)
    elsewhere: Final[tuple[Vec3, ...]]  # other places at which it may hover, by others' words (not on the wire)

    def __init__(
        self,
        vehicle: int,
        rel_ned_m: Vec3,
        age_s: float,
        silent: bool,
        relays: int = 0,
        received: bool = False,
        every_height: bool = False,
        elsewhere: tuple[Vec3, ...] = (),
    ) -> None:
        self.vehicle = vehicle
        self.rel_ned_m = rel_ned_m
        self.age_s = age_s
        self.silent = silent
        self.relays = relays
        self.received = received
        self.every_height = every_height
        self.elsewhere = elsewhere


@dataclass(slots=True, init=False, unsafe_hash=True)
class BeaconEcho:
    """Receipt of a neighbour's beacon, by which that one measures how old this vehicle's beacons are."""

    vehicle: Final[int]
    time_ms: Final[int]  # the stamp of its beacon: the low 16 bits
    hold_s: Final[float]  # since that beacon was taken in

    def __init__(
        self,
        vehicle: int,
        time_ms: int,
        hold_s: float,
    ) -> None:
        self.vehicle = vehicle
        self.time_ms = time_ms
        self.hold_s = hold_s


@dataclass(slots=True, init=False, unsafe_hash=True)
class Beacon:
    """SWARM_BEACON: what a vehicle says of itself at the mission's beacon rate; the codec adds where it is."""

    sender: Final[int]
    time_ms: Final[int]  # the sender's clock, never compared with another's
    vel_ned_mps: Final[Vec3]
    ref_ned_mps: Final[Vec3]  # reference velocity handed down from the leader
    dest_ned_m: Final[Vec3 | None]  # from the sender to the destination
    route_cost: Final[float]
    governor: Final[float]
    lease: Final[Lease | None]
    range_m: Final[float]
    hop: Final[int]
    candidate: Final[Candidate | None]  # the best of the sender and those behind it to succeed that leader
    parent: Final[int]  # 0: none
    phase: Final[SwarmPhase]
    airborne: Final[bool]
    start: Final[bool]  # an operator has allowed the flight
    abort: Final[bool]  # an operator has ordered all to land
    agreed: Final[bool]  # the sender, all that it hears and all behind it follow that leader
    state: Final[FlightState]
    done: Final[int]  # bit k-1: vehicle k of the sender's branch has done what the phase asks
    sighting: Final[PeerReport | None]  # of one that fell silent, or is heard though a neighbour calls it silent
    echo: Final[BeaconEcho | None]  # of one neighbour's beacon, each neighbour in turn
    stop: Final[int]  # which of the mission's visits the phase is about
    present: Final[int]  # bit k-1: vehicle k is in the sender's branch
    flown: Final[int]  # bit k-1: vehicle k has taken off, as far as the sender knows
    position_error_m: Final[float]  # that it may be off, level, beyond what goes with GNSS: it has lost its fix
    accused: Final[int]  # a leader that the sender has given up by what it observes itself; 0: none

    def __init__(
        self,
        sender: int,
        time_ms: int,
        vel_ned_mps: Vec3,
        ref_ned_mps: Vec3,
        dest_ned_m: Vec3 | None,
        route_cost: float,
        governor: float,
        lease: Lease | None,
        range_m: float,
        hop: int,
        candidate: Candidate | None,
        parent: int,
        phase: SwarmPhase,
        airborne: bool,
        start: bool,
        abort: bool,
        agreed: bool,
        state: FlightState,
        done: int,
        sighting: PeerReport | None = None,
        echo: BeaconEcho | None = None,
        stop: int = 0,
        present: int = 0,
        flown: int = 0,
        position_error_m: float = 0.0,
        accused: int = 0,
    ) -> None:
        self.sender = sender
        self.time_ms = time_ms
        self.vel_ned_mps = vel_ned_mps
        self.ref_ned_mps = ref_ned_mps
        self.dest_ned_m = dest_ned_m
        self.route_cost = route_cost
        self.governor = governor
        self.lease = lease
        self.range_m = range_m
        self.hop = hop
        self.candidate = candidate
        self.parent = parent
        self.phase = phase
        self.airborne = airborne
        self.start = start
        self.abort = abort
        self.agreed = agreed
        self.state = state
        self.done = done
        self.sighting = sighting
        self.echo = echo
        self.stop = stop
        self.present = present
        self.flown = flown
        self.position_error_m = position_error_m
        self.accused = accused


@dataclass(slots=True, init=False, unsafe_hash=True)
class RelativeReport:
    """SWARM_RELATIVE: what goes with each beacon in a GNSS-denied swarm. North: of the sender's compass."""

    sender: Final[int]
    time_ms: Final[int]  # of its beacon
    odo_ne_m: Final[tuple[float, float]]  # how far its odometer has come from where the mission has it start
    to_leader_ne_m: Final[tuple[float, float] | None]  # where it has the leader, of the swarm's north
    leader_sd_m: Final[float]  # how sure of that
    ranges: Final[tuple[RangeTo, ...]]  # that it measured since its last beacon
    position_sd_m: Final[float | None]  # how far its way to d2 may be off, level; None: it does not know

    def __init__(
        self,
        sender: int,
        time_ms: int,
        odo_ne_m: tuple[float, float],
        to_leader_ne_m: tuple[float, float] | None = None,
        leader_sd_m: float = 0.0,
        ranges: tuple[RangeTo, ...] = (),
        position_sd_m: float | None = None,
    ) -> None:
        self.sender = sender
        self.time_ms = time_ms
        self.odo_ne_m = odo_ne_m
        self.to_leader_ne_m = to_leader_ne_m
        self.leader_sd_m = leader_sd_m
        self.ranges = ranges
        self.position_sd_m = position_sd_m


@dataclass(slots=True, init=False, unsafe_hash=True)
class TrunkReport:
    """SWARM_TRUNKS: solitary trunks about its sender. North: of the sender's odometry."""

    sender: Final[int]
    time_ms: Final[int]  # of its beacon
    odo_ne_m: Final[tuple[float, float]]  # as its odometer has come, when these were about it
    trunks: Final[tuple[ToldTrunk, ...]]  # the nearest first

    def __init__(
        self,
        sender: int,
        time_ms: int,
        odo_ne_m: tuple[float, float],
        trunks: tuple[ToldTrunk, ...],
    ) -> None:
        self.sender = sender
        self.time_ms = time_ms
        self.odo_ne_m = odo_ne_m
        self.trunks = trunks
