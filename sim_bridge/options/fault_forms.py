"""Forms in which simulated faults are written on a command line."""

from __future__ import annotations

from typing import Final

from mission.schema.fault_kinds import FORMS, Lasts
from mission.schema.kinds import FaultKind, FaultPhase, Lie

LEADER = "leader"  # instead of ids: the vehicle that leads then
# Kind -> the numbers of its option, an example, and what it does
_ROWS = {
    FaultKind.KILL: ("", "leader@40", "a companion is killed"),
    FaultKind.RESTART: ("", "2@30:1", "a companion is killed, and started again after so long"),
    FaultKind.STOP: ("", "2@30:3", "a companion is stopped for so long"),
    FaultKind.PARTITION: ("", "1,2,3@60:100", "for so long, these and the others do not hear one another"),
    FaultKind.BASE_LOST: ("", "1,2,3@60:100", "these and the base station do not hear one another"),
    FaultKind.LATE: (":LATE", "2@40:1.5", "an autopilot's telemetry arrives LATE seconds later, in order"),
    FaultKind.BLIND: ("", "2@40:1.5", "an obstacle sensor sends nothing"),
    FaultKind.WIND: (":EAST:NORTH", "1,2,3@40:4:-3", "the air about vehicles moves to the east and north, m/s"),
    FaultKind.GNSS_OUTAGE: ("", "2@40:20", "a vehicle's receiver has no fix"),
    FaultKind.GNSS_DRIFT: (
        ":EAST:NORTH",
        "2@40:0.3:0",
        "a vehicle's receiver is spoofed: its position leaves the true one to the east and north, m/s",
    ),
    FaultKind.POSITION_JUMP: (
        ":EAST:NORTH",
        "2@40:6:0",
        "the position that an autopilot reports jumps to the east and north, m",
    ),
    FaultKind.POSITION_FREEZE: ("", "2@40:5", "the position that an autopilot reports stays as it was"),
    FaultKind.POSITION_DRIFT: (
        ":EAST:NORTH",
        "2@40:0.3:0",
        "the position that an autopilot reports leaves the true one, m/s, and its velocity does not show it",
    ),
    FaultKind.HEIGHT_ERROR: (":HEIGHT", "2@40:10", "the height that an autopilot reports is too large, m"),
    FaultKind.MOTOR: ("", "2@40", "a motor of a vehicle fails: it comes down"),
    FaultKind.SCAN_ERRORS: (
        ":NOISE:DELAY",
        "2@40:0.5:0.2",
        "scans of an obstacle sensor have so much more noise, m, and come so much later, s",
    ),
    FaultKind.RANGE_ERRORS: (
        ":BIAS:NOISE",
        "2@40:1:0.5",
        "ranges of a vehicle are too long by BIAS and have so much more noise, m",
    ),
    FaultKind.PILOT: ("", "2@40", "a pilot takes a vehicle over, and keeps it"),
    FaultKind.DISK_FULL: ("", "2@40", "a companion can write nothing more to its disk"),
    FaultKind.INSIDER: (":LIE", "2@transit:push", f"a member's beacons lie: {', '.join(Lie)}"),
    FaultKind.OUTSIDER: ("", "2@transit", "a radio without keys, beside a vehicle, repeats and forges frames"),
}


def _forms(kind: FaultKind, numbers: str) -> tuple[str, ...]:
    plain, timed = f"VEHICLES@WHEN{numbers}", f"VEHICLES@WHEN{numbers}:SECONDS"
    match FORMS[kind].lasts:
        case Lasts.NEVER:
            return (plain,)
        case Lasts.ALWAYS:
            return (timed,)
        case Lasts.OPTIONAL:
            return (plain, timed)


def _what(kind: FaultKind, what: str) -> str:
    return f"{what} (with :SECONDS, for so long)" if FORMS[kind].lasts is Lasts.OPTIONAL else what


# Kind -> forms of its option, an example, and what it does
OPTIONS: Final = {
    kind: (_forms(kind, numbers), example, _what(kind, what)) for kind, (numbers, example, what) in _ROWS.items()
}
GRAMMAR = (
    f"VEHICLES: {LEADER} (that acts as such then, or first after it), or ids as 1,2,3. WHEN: seconds, the phase that "
    f"begins ({', '.join(phase.value for phase in FaultPhase)}), or PHASE+SECONDS."
)
