"""The states that vehicle, autopilot and swarm can be in, and what may be asked of an autopilot."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum


class SwarmPhase(IntEnum):
    """Phase of the swarm, announced by its leader (SWARM_PHASE on the wire). Ordered: a swarm only goes on."""

    ASSEMBLE = 0
    GATHER = 1
    TRANSIT = 2
    COVERAGE = 3
    RETURN = 4
    LAND = 5


class Role(Enum):
    """One vehicle's in its swarm; the value says in words what it does. `swarm.role_table` has what changes it."""

    UNLED = "knows no leader, and claims no lead: it holds"
    FOLLOWER = "follows the lease of another, by the neighbours nearer to it"
    CLAIMANT = "claims the lead, and holds: not all that it hears have agreed yet"
    LEADER = "leads, and decides for its partition; with the majority (see the lease) it takes it on"


class FlightState(IntEnum):
    """State of one vehicle's flight (SWARM_BEACON.flight_state)."""

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


NOT_YET_FLYING = (FlightState.WAITING, FlightState.READY)
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

# In these a leader leads the formation, and the others follow: by its role each vehicle flies another way.
IN_FORMATION = frozenset({FlightState.GATHERING, FlightState.TRANSIT, FlightState.RETURNING, FlightState.SEEKING})

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
    """Commands of an operator to a companion."""

    START = "start"  # fly the mission, or go on with it after a HOLD
    HOLD = "hold"  # every vehicle holds where it is, until a START
    LAND = "land"  # the swarm spreads out level and lands, as at the mission's end; cannot be taken back
    ABORT = "abort"  # every vehicle lands where it is, now; cannot be taken back


class BeaconFate(Enum):
    """Fate of a neighbour's beacon that the gate admits, as the black box has it."""

    KEPT = "kept"
    VERSION = "of another version"
    INVALID = "a value out of bounds, or the own position unknown"
    UNPLACED = "own position unknown"
    NO_MEMBER = "of no other member"
    NO_NEWS = "nothing new"


class Request(Enum):
    """Requests of a companion to its autopilot."""

    ARM = "arm"
    OFFBOARD = "offboard"
    TAKEOFF = "takeoff"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class VelocityShaping:
    """Horizontal velocity response of a vehicle whose autopilot limits jerk."""

    dead_s: float  # until a setpoint begins to act; in whole ticks
    acceleration_mps2: float
    jerk_mps3: float
    lag_s: float  # of the end of a change


@dataclass(frozen=True, slots=True)
class AutopilotTraits:
    """Traits of one make of autopilot in flight: data, so that the flight need not know makes."""

    takeoff: tuple[Request, ...]  # in this order, each asked for once the one before shows
    climbs_in: FlightMode  # TAKEOFF: a mode of its own that ends in HOLD; OFFBOARD: the landed state shows the climb
    climb_short_m: float  # how far below the altitude its climb may end
    climb_shows_s: float  # after an accepted takeoff; only then it is asked for again
    mode_shows_s: float  # the same after any other request
    stream_first_s: float  # setpoints must come for so long before OFFBOARD is asked for
    failsafe_ends_s: float  # setpoints that come again end its offboard-loss failsafe within this time, or never
    shaping: VelocityShaping | None = None  # as it may fly; None: its velocity follows setpoints with a lag alone


class Reception(IntEnum):
    """Quality of GNSS reception, in ascending order."""

    NONE = 0  # it flies by odometry
    POOR = 1  # its autopilot goes by them, and is wrong by more than 3 m
    GOOD = 2
