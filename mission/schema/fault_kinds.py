"""The kinds of simulated faults, one row each: what happens, which numbers it has, how long it lasts, where it can be.

The mission's model, its check, the command line, the simulator and the run folder read these rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from mission.schema.kinds import FaultKind


class Lasts(Enum):
    """Rule for a fault's `for_s`."""

    NEVER = "has none"
    ALWAYS = "needs one"
    OPTIONAL = "may; without, to the end"


class Needs(Enum):
    """Requirement on a mission for a kind of fault to be possible."""

    NOTHING = ""
    SENSING = "needs [sensing]: without it no vehicle has an obstacle sensor"
    RANGING = "needs [ranging]: without it no vehicle has a range radio"
    RECORDS = "needs [survey] or [payload]: without records there is no base station"
    SATELLITES = "is of satellites, which by swarm.gnss it does not have"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a fault, or one for the east and one for the north."""

    least: float
    most: float
    what: str
    level: bool = False  # east and north
    above: bool = False  # `least` itself is not allowed

    @property
    def count(self) -> int:
        """Number of its values."""
        return 2 if self.level else 1

    def allows(self, value: float) -> bool:
        """Of one number; false for NaN."""
        return self.least <= value <= self.most and not (self.above and value == self.least)


@dataclass(frozen=True, slots=True)
class FaultForm:
    """One kind of fault."""

    what: str
    parameters: tuple[str, ...] = ()  # of PARAMETERS, in the order of the option
    lasts: Lasts = Lasts.OPTIONAL
    needs: Needs = Needs.NOTHING
    of_vehicle: bool = False  # it happens to a simulated vehicle: not over external autopilots
    lies: bool = False  # it has a `lie`


PARAMETERS: Final = {  # their names are the keys of [[sim.faults]]
    "late_s": Parameter(0.0, 10.0, "Of `late`: the delay.", above=True),
    "wind_mps": Parameter(-30.0, 30.0, "Of `wind`: east, north, where the air moves to.", level=True),
    "drift_mps": Parameter(
        -5.0,
        5.0,
        "Of `gnss-drift` and `position-drift`: east, north, how fast the position reported leaves the true one.",
        level=True,
    ),
    "jump_m": Parameter(-50.0, 50.0, "Of `position-jump`: east, north, how far the position jumps.", level=True),
    "height_m": Parameter(-50.0, 50.0, "Of `height-error`: by how much the height reported is too large."),
    "bias_m": Parameter(-5.0, 5.0, "Of `range-errors`: by how much ranges are too long."),
    "noise_m": Parameter(
        0.0, 5.0, "Of `scan-errors` and `range-errors`: standard deviation of a noise besides the usual."
    ),
    "delay_s": Parameter(0.0, 1.0, "Of `scan-errors`: how much later scans come."),
}

FORMS: Final = {
    FaultKind.KILL: FaultForm("the companion is killed (SIGKILL)", lasts=Lasts.NEVER),
    FaultKind.RESTART: FaultForm("the same, and another one is started for_s later", lasts=Lasts.ALWAYS),
    FaultKind.STOP: FaultForm(
        "the companion is suspended (SIGSTOP); what comes meanwhile waits in its sockets", lasts=Lasts.ALWAYS
    ),
    FaultKind.PARTITION: FaultForm("these vehicles and the others do not hear one another", lasts=Lasts.ALWAYS),
    FaultKind.BASE_LOST: FaultForm("these vehicles and the base station do not hear one another", needs=Needs.RECORDS),
    FaultKind.LATE: FaultForm("what the autopilot reports to its companion comes late_s later, in order", ("late_s",)),
    FaultKind.BLIND: FaultForm("the obstacle sensor sends its companion nothing", needs=Needs.SENSING),
    FaultKind.WIND: FaultForm(
        "the air about these vehicles moves with wind_mps, instead of as sim.wind_mps says",
        ("wind_mps",),
        of_vehicle=True,
    ),
    FaultKind.GNSS_OUTAGE: FaultForm(
        "the receiver has no fix; after 5 s its autopilot uses odometry where not all vehicles have GNSS, and "
        "elsewhere has no position and lands",
        needs=Needs.SATELLITES,
        of_vehicle=True,
    ),
    FaultKind.GNSS_DRIFT: FaultForm(
        "the receiver is spoofed, or drifts: position and velocity reported, and flown by, depart from the true ones "
        "with drift_mps; when it is over they jump back",
        ("drift_mps",),
        needs=Needs.SATELLITES,
        of_vehicle=True,
    ),
    FaultKind.POSITION_JUMP: FaultForm(
        "the position reported, and flown by, is off by jump_m at once; when it is over it jumps back",
        ("jump_m",),
        of_vehicle=True,
    ),
    FaultKind.POSITION_FREEZE: FaultForm(
        "the position reported, and flown by, stays as it was, to the bit; velocities are right", of_vehicle=True
    ),
    FaultKind.POSITION_DRIFT: FaultForm(
        "the position reported, and flown by, departs from the true one with drift_mps, and velocities are right; when "
        "it is over it jumps back",
        ("drift_mps",),
        of_vehicle=True,
    ),
    FaultKind.HEIGHT_ERROR: FaultForm(
        "the height reported, and flown by, is height_m too large at once; when it is over it jumps back",
        ("height_m",),
        of_vehicle=True,
    ),
    FaultKind.MOTOR: FaultForm(
        "one motor fails for good, and the vehicle comes down where it is", lasts=Lasts.NEVER, of_vehicle=True
    ),
    FaultKind.SCAN_ERRORS: FaultForm(
        "scans of the obstacle sensor have noise_m more noise and come delay_s later",
        ("noise_m", "delay_s"),
        needs=Needs.SENSING,
    ),
    FaultKind.RANGE_ERRORS: FaultForm(
        "ranges between these vehicles and others are off by bias_m and have noise_m more noise",
        ("bias_m", "noise_m"),
        needs=Needs.RANGING,
        of_vehicle=True,
    ),
    FaultKind.PILOT: FaultForm(
        "a pilot takes the vehicle over by the mode switch, and keeps it", lasts=Lasts.NEVER, of_vehicle=True
    ),
    FaultKind.DISK_FULL: FaultForm(
        "the companion's computer can write nothing more: no log, of companions that are processes, and no records"
    ),
    FaultKind.INSIDER: FaultForm(
        "beacons leave the vehicle's radio rewritten, as a member would that has all its keys and tells the `lie`; its"
        " companion flies on as before",
        of_vehicle=True,
        lies=True,
    ),
    FaultKind.OUTSIDER: FaultForm(
        "a radio without keys, beside the first of these vehicles, sends frames that it has heard again, changed, or"
        " made up in others' names; nothing but signed frames (`--signed`) stands against it",
        of_vehicle=True,
    ),
}
