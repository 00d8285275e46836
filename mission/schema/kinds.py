"""Words of mission files that command lines offer, too: without the model, which takes long to load."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

MAX_VEHICLES = 250  # MAVLink's system ids


class Estimates(StrEnum):
    """Estimates that a simulated autopilot has of its vehicle's position, velocity and yaw."""

    EXACT = "exact"
    RECORDED = "recorded"
    RECORDED_2026_11 = "2026-11"


class Personality(StrEnum):
    """Make of autopilot that a simulated vehicle has."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class FaultKind(StrEnum):
    """Kind of a simulated fault."""

    KILL = "kill"  # the companion is killed (SIGKILL); its autopilot is left alone
    RESTART = "restart"  # the same, and another one is started later
    STOP = "stop"  # the companion is suspended (SIGSTOP); what comes meanwhile waits in its sockets
    PARTITION = "partition"  # the vehicles named and all others do not hear one another
    BASE_LOST = "base-lost"  # the vehicles named and the base station do not hear one another
    LATE = "late"  # what the autopilot reports to its companion comes late, in order
    BLIND = "blind"  # the obstacle sensor sends its companion nothing
    WIND = "wind"  # the air about these vehicles moves otherwise than sim.wind_mps says
    GNSS_OUTAGE = "gnss-outage"  # the receiver has no fix
    GNSS_DRIFT = "gnss-drift"  # the receiver is led astray, slowly: spoofed, or drifting
    POSITION_JUMP = "position-jump"  # the position reported is elsewhere at once
    POSITION_FREEZE = "position-freeze"  # it stays where it was, whatever the velocity says
    POSITION_DRIFT = "position-drift"  # it leaves the true one, while the velocity is right
    HEIGHT_ERROR = "height-error"  # the height reported is wrong at once
    MOTOR = "motor"  # one motor fails for good
    SCAN_ERRORS = "scan-errors"  # scans of the obstacle sensor are noisier, and later
    RANGE_ERRORS = "range-errors"  # ranges of the radio are off, and noisier
    PILOT = "pilot"  # a pilot takes the vehicle over, and keeps it
    DISK_FULL = "disk-full"  # the companion's computer can write nothing more
    INSIDER = "insider"  # a member with all its own keys says in its own beacons what is not so
    OUTSIDER = "outsider"  # a radio without keys repeats, changes and makes up frames


class Lie(StrEnum):
    """Lie of an insider's beacons; its numbers are drawn (`sim_bridge/drive/links/insider.py`)."""

    PUSH = "push"  # it is close to another, and flies at it
    OFFSET = "offset"  # its position is off, by ever more
    FLOOR = "floor"  # it is lower than it is, or higher, and others are to level with it
    GHOST = "ghost"  # others hover silent, where nobody is
    USURPER = "usurper"  # it leads as well as it may claim, accuses who does, and hands down a course of its own
    SINKHOLE = "sinkhole"  # it is the way to the leader, with a false course and a false way to d2
    PHASE = "phase"  # the leader has announced what it has not: a return, a landing, the next tree
    LEASE = "lease"  # the leader's count is far ahead, it hands over, and others could lead
    STALL = "stall"  # it and all behind it can keep up with nothing, and have done nothing
    ROSTER = "roster"  # all have taken off, are there and have done it; or nobody has
    CLOCK = "clock"  # its clock jumps, and its echoes are wrong
    RANGES = "ranges"  # ranges, odometry and the way to the leader (SWARM_RELATIVE)
    ORDERS = "orders"  # an operator has ordered the start, or that all land
    TRUNKS = "trunks"  # trunks about it (SWARM_TRUNKS): it is elsewhere among them, or turned, or they are made up


class FaultPhase(StrEnum):
    """A phase of the swarm, by its name in SWARM_BEACON."""

    ASSEMBLE = "assemble"
    GATHER = "gather"
    TRANSIT = "transit"
    COVERAGE = "coverage"
    RETURN = "return"
    LAND = "land"


class SensorClass(StrEnum):
    """Class of obstacle sensor that every vehicle carries."""

    SECTORS = "sectors"
    SCAN_1DEG = "scan-1deg"
    SCAN_HALF_DEG = "scan-0.5deg"
    MULTI_LAYER = "multi-layer"


@dataclass(frozen=True, slots=True)
class RawLidar:
    """A class of lidar whose rays are sent as they are measured. Angles in the vehicle's own level plane."""

    step_deg: float  # from ray to ray, around
    elevations_deg: tuple[float, ...]  # of its layers, mounted upright
    range_max_m: float
    range_sd_m: float  # standard deviation of a range
    beam_deg: float  # width of a ray: it tells the nearest within


SECTORS_SD_M = 0.05  # of a sector's range

# The makers' figures of an LD19, an RPLIDAR A3 or S2, and a Livox Mid-360, whose points, 200,000 a second, are the
# nearest of each cell of 1 degree around by 4.2 degrees: a hull of 0.5 m is higher than that within 6.8 m.
RAW_LIDARS = {
    SensorClass.SCAN_1DEG: RawLidar(1.0, (0.0,), 12.0, 0.03, 0.3),
    SensorClass.SCAN_HALF_DEG: RawLidar(0.5, (0.0,), 20.0, 0.02, 0.2),
    SensorClass.MULTI_LAYER: RawLidar(1.0, tuple(-7.0 + 59.0 / 14.0 * k for k in range(15)), 40.0, 0.02, 0.2),
}
