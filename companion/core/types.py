"""The nouns of the flight software, and their units and frames.

| quantity | unit, frame |
|---|---|
| time | seconds of the local monotonic clock; no two vehicles' clocks need to agree |
| position | NED metres about the mission's origin (down = 0 is the ground there) |
| relative position | NED metres, from the vehicle itself to the other |
| velocity | NED metres per second over ground |
| yaw | radians from north towards the east |
| altitude | metres above the origin's ground |
| vehicle id | the MAVLink system id, 1..250 |
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final

from mission.frames import Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
NO_ROUTE: Final = 1e6  # route cost of a vehicle that knows no way to the leader


class SwarmPhase(IntEnum):
    """What the swarm does, announced by its leader (SWARM_PHASE on the wire). Ordered: a swarm only goes on."""

    ASSEMBLE = 0
    GATHER = 1
    TRANSIT = 2
    COVERAGE = 3
    RETURN = 4
    LAND = 5


class FlightState(IntEnum):
    """Where one vehicle's own flight is (SWARM_BEACON.flight_state)."""

    WAITING = 0  # for the autopilot, its position or its readiness to arm
    READY = 1
    TAKING_OFF = 2
    GATHERING = 3
    TRANSIT = 4
    COVERAGE = 5
    RETURNING = 6
    LANDING = 7
    LANDED = 8
    HOLD = 9  # zero velocity, separation still active
    RELEASED = 10  # to the pilot: no setpoints, no mode requests
    SEEKING = 11  # in a part without the majority, looking for the others


# Steered by its companion, which keeps its distance; the others do not give way.
STEERED = frozenset(
    {
        FlightState.GATHERING,
        FlightState.TRANSIT,
        FlightState.COVERAGE,
        FlightState.RETURNING,
        FlightState.HOLD,
        FlightState.SEEKING,
    }
)
# On the way up or down by its autopilot, which goes on without the companion.
CLIMBING = frozenset({FlightState.READY, FlightState.TAKING_OFF})
DESCENDING = frozenset({FlightState.LANDING})


class FlightMode(Enum):
    """The autopilot's flight mode, as far as the companion must tell modes apart."""

    OFFBOARD = "offboard"  # PX4 OFFBOARD, ArduPilot GUIDED: follows our setpoints
    TAKEOFF = "takeoff"
    HOLD = "hold"  # PX4 HOLD, ArduPilot BRAKE
    LAND = "land"
    RETURN = "return"
    OTHER = "other"


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


class Severity(IntEnum):
    """MAV_SEVERITY, those we use."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


class Order(Enum):
    """What an operator may tell a companion."""

    START = "start"  # MAV_CMD_MISSION_START: fly the mission; also hands control back after a pilot took it
    LAND_ALL = "land all"  # MAV_CMD_NAV_LAND: every vehicle lands where it is; cannot be taken back


class Request(Enum):
    """What a companion may ask of its autopilot."""

    ARM = "arm"
    OFFBOARD = "offboard"
    TAKEOFF = "takeoff"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class Takeoff:
    """How an autopilot is made to take off: data, so that the flight need not know makes."""

    steps: tuple[Request, ...]  # in this order, each asked for once the one before shows
    climbs_in: FlightMode  # TAKEOFF: a mode of its own that ends in HOLD; OFFBOARD: the landed state shows the climb


CLIMBS_IN_TAKEOFF = Takeoff((Request.ARM, Request.TAKEOFF), FlightMode.TAKEOFF)
CLIMBS_IN_OFFBOARD = Takeoff((Request.OFFBOARD, Request.ARM, Request.TAKEOFF), FlightMode.OFFBOARD)


# --- values ---------------------------------------------------------------------------------------------------------


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

    def __init__(self, vehicle: int, priority: int, score: int) -> None:
        self.vehicle = vehicle
        self.priority = priority
        self.score = score


@dataclass(slots=True, init=False, unsafe_hash=True)
class Sighting:
    """Where a third vehicle was when it was last heard, as it travels with the beacons."""

    vehicle: Final[int]
    rel_ned_m: Final[Vec3]  # from the one that keeps it (in a beacon: from the sender) to that vehicle
    age_s: Final[float]  # since it was heard
    silent: Final[bool]  # none hears it any more: it hangs there
    told: Final[bool]  # by another's word, not heard here (not on the wire)
    every_height: Final[bool]  # it was on its way up or down (not on the wire)

    def __init__(
        self,
        vehicle: int,
        rel_ned_m: Vec3,
        age_s: float,
        silent: bool,
        told: bool = False,
        every_height: bool = False,
    ) -> None:
        self.vehicle = vehicle
        self.rel_ned_m = rel_ned_m
        self.age_s = age_s
        self.silent = silent
        self.told = told
        self.every_height = every_height


@dataclass(slots=True, init=False, unsafe_hash=True)
class Beacon:
    """SWARM_BEACON: what a vehicle says of itself at the mission's beacon rate; the codec adds where it is."""

    sender: Final[int]
    time_ms: Final[int]  # the sender's clock, only ever compared with the same sender's
    vel_ned_mps: Final[Vec3]
    ref_ned_mps: Final[Vec3]  # reference velocity handed down from the leader
    dest_ned_m: Final[Vec3 | None]  # from the sender to the destination
    route_cost: Final[float]
    governor: Final[float]
    lease: Final[Lease | None]
    hop: Final[int]
    agreed: Final[bool]  # the sender, all that it hears and all behind it follow that leader
    candidate: Final[Candidate | None]  # the best of the sender and those behind it to succeed that leader
    parent: Final[int]  # 0: none
    phase: Final[SwarmPhase]
    state: Final[FlightState]
    airborne: Final[bool]
    start: Final[bool]  # an operator has allowed the flight
    abort: Final[bool]  # an operator has ordered all to land
    done: Final[int]  # bit k-1: vehicle k of the sender's branch has done what the phase asks
    range_m: Final[float]
    present: Final[int]  # bit k-1: vehicle k is in the sender's branch
    flown: Final[int]  # bit k-1: vehicle k has taken off, as far as the sender knows
    sighting: Final[Sighting | None]  # of one that fell silent, or is heard though a neighbour calls it silent
    stop: Final[int]  # which of the mission's visits the phase is about

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
        hop: int,
        agreed: bool,
        candidate: Candidate | None,
        parent: int,
        phase: SwarmPhase,
        state: FlightState,
        airborne: bool,
        start: bool,
        abort: bool,
        done: int,
        range_m: float,
        present: int = 0,
        flown: int = 0,
        sighting: Sighting | None = None,
        stop: int = 0,
    ) -> None:
        self.sender = sender
        self.time_ms = time_ms
        self.vel_ned_mps = vel_ned_mps
        self.ref_ned_mps = ref_ned_mps
        self.dest_ned_m = dest_ned_m
        self.route_cost = route_cost
        self.governor = governor
        self.lease = lease
        self.hop = hop
        self.agreed = agreed
        self.candidate = candidate
        self.parent = parent
        self.phase = phase
        self.state = state
        self.airborne = airborne
        self.start = start
        self.abort = abort
        self.done = done
        self.range_m = range_m
        self.present = present
        self.flown = flown
        self.sighting = sighting
        self.stop = stop


RangeTo = tuple[int, float, float]  # a vehicle, the distance to it in metres, and how many seconds ago it was measured


@dataclass(slots=True, init=False, unsafe_hash=True)
class Word:
    """SWARM_RELATIVE: what goes with each beacon in a swarm that flies by ranges. North: of the sender's compass."""

    sender: Final[int]
    time_ms: Final[int]  # of its beacon
    odo_ne_m: Final[tuple[float, float]]  # how far its odometer has come from where the mission has it start
    to_leader_ne_m: Final[tuple[float, float] | None]  # where it has the leader, of the swarm's north
    leader_sd_m: Final[float]  # how sure of that
    ranges: Final[tuple[RangeTo, ...]]  # that it measured since its last beacon
    place_sd_m: Final[float | None]  # how far its way to d2 may be off, level; None: it does not know

    def __init__(
        self,
        sender: int,
        time_ms: int,
        odo_ne_m: tuple[float, float],
        to_leader_ne_m: tuple[float, float] | None = None,
        leader_sd_m: float = 0.0,
        ranges: tuple[RangeTo, ...] = (),
        place_sd_m: float | None = None,
    ) -> None:
        self.sender = sender
        self.time_ms = time_ms
        self.odo_ne_m = odo_ne_m
        self.to_leader_ne_m = to_leader_ne_m
        self.leader_sd_m = leader_sd_m
        self.ranges = ranges
        self.place_sd_m = place_sd_m


# --- events: what an agent receives ---------------------------------------------------------------------------------


@dataclass(slots=True, init=False, unsafe_hash=True)
class HeardBeacon:
    """A neighbour's beacon as it arrives: what was said, and where the sender is, which the codec makes relative."""

    said: Final[Beacon]
    rel_ned_m: Final[Vec3]  # from the receiver's position when it was decoded to the sender

    def __init__(self, said: Beacon, rel_ned_m: Vec3) -> None:
        self.said = said
        self.rel_ned_m = rel_ned_m


@dataclass(slots=True, init=False, unsafe_hash=True)
class Ranges:
    """SWARM_RANGES: distances that the own range radio has measured, slant."""

    ranges: Final[tuple[RangeTo, ...]]

    def __init__(self, ranges: tuple[RangeTo, ...]) -> None:
        self.ranges = ranges


@dataclass(slots=True, init=False, unsafe_hash=True)
class Satellites:
    """GPS_RAW_INT, with what the estimator says: the own receiver, in a swarm that flies by ranges."""

    used: Final[bool]  # the autopilot's position goes by them
    sd_m: Final[float]  # how wrong a fix is, level

    def __init__(self, used: bool, sd_m: float) -> None:
        self.used = used
        self.sd_m = sd_m


@dataclass(slots=True, init=False, unsafe_hash=True)
class Position:
    """Own position and velocity (LOCAL_POSITION_NED, tied to the mission's frame by the codec)."""

    pos_ned_m: Final[Vec3]
    vel_ned_mps: Final[Vec3]
    boot_s: Final[float | None]  # the autopilot's time since boot, wrapping at 2^32 ms

    def __init__(self, pos_ned_m: Vec3, vel_ned_mps: Vec3, boot_s: float | None = None) -> None:
        self.pos_ned_m = pos_ned_m
        self.vel_ned_mps = vel_ned_mps
        self.boot_s = boot_s


@dataclass(slots=True, init=False, unsafe_hash=True)
class ObstacleScan:
    """OBSTACLE_DISTANCE: one sweep of an obstacle sensor, and how the vehicle stood when it came (ATTITUDE).

    Sector k looks at `start_rad + k * step_rad` in the vehicle's own level plane, clockwise from ahead, which stands
    tilted by roll and pitch (body axes: front, right, down) and turned by yaw.
    """

    sensor: Final[int]  # its MAVLink component; a vehicle may carry some
    ranges_m: Final[tuple[float, ...]]  # min_m..max_m; inf: nothing within max_m; nan: not measured
    start_rad: Final[float]
    step_rad: Final[float]  # > 0; all sectors within one turn
    min_m: Final[float]  # what is nearer counts as being there
    max_m: Final[float]
    roll_rad: Final[float]
    pitch_rad: Final[float]
    yaw_rad: Final[float]
    age_s: Final[float]  # since it was measured, as far as it can be known

    def __init__(
        self,
        sensor: int,
        ranges_m: tuple[float, ...],
        start_rad: float,
        step_rad: float,
        min_m: float,
        max_m: float,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        yaw_rad: float = 0.0,
        age_s: float = 0.0,
    ) -> None:
        self.sensor = sensor
        self.ranges_m = ranges_m
        self.start_rad = start_rad
        self.step_rad = step_rad
        self.min_m = min_m
        self.max_m = max_m
        self.roll_rad = roll_rad
        self.pitch_rad = pitch_rad
        self.yaw_rad = yaw_rad
        self.age_s = age_s


@dataclass(slots=True, init=False, unsafe_hash=True)
class BootTime:
    """The autopilot's time since boot when it answered a TIMESYNC request of ours."""

    boot_s: Final[float]
    round_trip_s: Final[float]

    def __init__(self, boot_s: float, round_trip_s: float) -> None:
        self.boot_s = boot_s
        self.round_trip_s = round_trip_s


@dataclass(frozen=True, slots=True)
class AutopilotMode:
    """HEARTBEAT of the vehicle's own autopilot."""

    mode: FlightMode
    armed: bool
    name: str  # as an operator knows it
    failsafe: bool = False  # the autopilot acts by itself, and chose this mode
    takeoff: Takeoff | None = CLIMBS_IN_TAKEOFF  # None: an unknown autopilot, never armed; `name` says what it is


@dataclass(frozen=True, slots=True)
class AutopilotHealth:
    """SYS_STATUS: ready to arm, and the battery's charge (0..100 %, None: unknown)."""

    ready_to_arm: bool
    battery_percent: int | None


@dataclass(frozen=True, slots=True)
class Landed:
    """EXTENDED_SYS_STATE."""

    state: LandedState


@dataclass(frozen=True, slots=True)
class Answer:
    """COMMAND_ACK to a request."""

    request: Request
    result: Result


@dataclass(frozen=True, slots=True)
class AutopilotText:
    """STATUSTEXT of the vehicle's own autopilot."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class OperatorOrder:
    """A command to this companion from a ground station."""

    order: Order


AutopilotEvent = Position | BootTime | AutopilotMode | AutopilotHealth | Landed | Answer | AutopilotText
Event = AutopilotEvent | OperatorOrder | HeardBeacon | ObstacleScan | Ranges | Satellites | Word


# --- actions: what an agent wants done ------------------------------------------------------------------------------


@dataclass(slots=True, init=False, unsafe_hash=True)
class VelocitySetpoint:
    """SET_POSITION_TARGET_LOCAL_NED with the velocity + yaw mask."""

    vel_ned_mps: Final[Vec3]
    yaw_rad: Final[float]

    def __init__(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        self.vel_ned_mps = vel_ned_mps
        self.yaw_rad = yaw_rad


@dataclass(slots=True, init=False, unsafe_hash=True)
class SendBeacon:
    """Broadcast to the neighbours; the codec adds the vehicle's position."""

    beacon: Final[Beacon]
    word: Final[Word | None]  # where the swarm flies by ranges
    place_ned_m: Final[Vec3 | None]  # there: where an acting leader is, about the mission's origin; others do not tell

    def __init__(self, beacon: Beacon, word: Word | None = None, place_ned_m: Vec3 | None = None) -> None:
        self.beacon = beacon
        self.word = word
        self.place_ned_m = place_ned_m


@dataclass(frozen=True, slots=True)
class Ask:
    """A request to the autopilot; `altitude_m` for a takeoff."""

    request: Request
    altitude_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Say:
    """STATUSTEXT: what an operator must know."""

    severity: Severity
    text: str


Action = VelocitySetpoint | SendBeacon | Ask | Say
