"""Words of mission files that command lines offer, too: without the model, which takes long to load."""

from __future__ import annotations

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
    LATE = "late"  # what the autopilot reports to its companion comes late, in order
    BLIND = "blind"  # the obstacle sensor sends its companion nothing
    WIND = "wind"  # the air about these vehicles moves otherwise than sim.wind_mps says
    GNSS_OUTAGE = "gnss-outage"  # the receiver has no fix
    GNSS_DRIFT = "gnss-drift"  # the receiver is led astray, slowly: spoofed, or drifting
    MOTOR = "motor"  # one motor fails for good
    SCAN_ERRORS = "scan-errors"  # scans of the obstacle sensor are noisier, and later
    RANGE_ERRORS = "range-errors"  # ranges of the radio are off, and noisier
    PILOT = "pilot"  # a pilot takes the vehicle over, and keeps it
    DISK_FULL = "disk-full"  # the companion's computer can write nothing more


class FaultPhase(StrEnum):
    """A phase of the swarm, by its name in SWARM_BEACON."""

    ASSEMBLE = "assemble"
    GATHER = "gather"
    TRANSIT = "transit"
    COVERAGE = "coverage"
    RETURN = "return"
    LAND = "land"
