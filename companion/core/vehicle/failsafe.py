"""What can go wrong in flight, what then follows, and until when: one table, highest precedence first.

Each tick the vehicle, its flight and its swarm find causes; `decide` picks the one that stands highest, and the flight
does what its row says. In the climb, while the vehicle is steered, and while it listens in the air, nothing beside this
table decides. The table does not cover the beginning and the end of a flight (see `flight`). On the ground a vehicle
waits for what it lacks, as a position or a battery above the critical charge, and does not take off while a row would
land it. A landing ends when the vehicle is disarmed; of the table, only stalls, silence and a mode that another chose
count in it.

What a row demands besides counts also when another decides: a vehicle that lands without a position sends zero velocity
until its autopilot lands it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final, NamedTuple

from companion.core.model.states import Severity

STALLED_S: Final = 0.4  # just before the autopilot's offboard-loss timeout under a canopy, 0.5 s
ALONE_HOLD_S: Final = 1.0  # without any neighbour a vehicle of a swarm holds ...
ALONE_LAND_S: Final = 90.0  # ... and at last lands where it is; it never climbs
# a part without the majority of those that took off holds so long for the others, then lands
NO_QUORUM_LAND_S: Final = 120.0
# two standard deviations of where a neighbour is, as shares of its distance: within the first the vehicle sees in which
# direction to 30 degrees, and keeps from it by all that it is unsure of (`ranging`); below the second it flies on
UNSURE_FROM: Final = 0.5
UNSURE_UNTIL: Final = 0.4
BLIND_LAND_S: Final = 60.0  # a vehicle whose obstacle sensor stays away stands in the way of all; it lands by then
LOW_BATTERY_PERCENT: Final = 20  # no leadership below
CRITICAL_BATTERY_PERCENT: Final = 10  # down here it lands where it is


class Response(Enum):
    """What a vehicle does; the value says so in words."""

    LISTEN = "sends no setpoints and asks for nothing; joins again once it hears its autopilot and a leader that flies"
    END = "is done: its motors are off"
    RELEASE = "sends no setpoints and asks for nothing, until an operator hands it back"
    LAND = "asks its autopilot to land it where it is"
    STREAM = "streams setpoints and asks for nothing"
    REST = "zero velocity; it does not even make room"
    HOLD = "zero velocity, but for making room for others"
    SEEK = "looks for the others as its part's leader does, or follows that leader"
    RESIGN = "flies on, but neither takes nor keeps the lead"


class Cause(IntEnum):
    """Ascending by precedence: the first is the highest."""

    COMPANION_STALLED = 0
    AUTOPILOT_SILENT = 1
    DISARMED_IN_AIR = 2
    DISARMED = 3
    PILOT_MODE = 4
    FAILSAFE_MODE = 5
    DISARMED_BEFORE_TAKEOFF = 6
    DISARMED_IN_TAKEOFF = 7
    LAND_ALL = 8
    BATTERY_CRITICAL = 9
    ALONE_LONG = 10
    NO_MAJORITY_LONG = 11
    OBSTACLES_LOST = 12
    SWARM_LANDS = 13
    SETPOINTS_CUT = 14
    SETPOINTS_RETURN = 15
    FAILSAFE_HOLD = 16
    REFUSED = 17
    NO_POSITION = 18
    TELEMETRY_LATE = 19
    OBSTACLES_STALE = 20
    NO_HEARTBEAT = 21
    PLACE_UNSURE = 22
    OTHERS_LOST = 23
    NO_NEIGHBOUR = 24
    NO_LEADER = 25
    NO_MAJORITY = 26
    PLACE_LOST = 27
    BATTERY_LOW = 28


class Finding(NamedTuple):
    """A cause that is there now. `detail` fills the gap in its row's text."""

    cause: Cause
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    cause: Cause
    when: str  # it is found
    response: Response
    clears: str
    severity: Severity
    text: str  # STATUSTEXT when it begins to decide; {}: a finding's detail; empty: nothing is said
    resigns: bool = False  # it also costs the vehicle the lead, whatever decides


HANDED_BACK = "an operator hands it back (`MISSION_START`)"
JOINED = "a HEARTBEAT has come since, and a leader that flies is heard"
RESTARTED = "the companion is started again"

TABLE: tuple[Row, ...] = (
    Row(
        Cause.COMPANION_STALLED,
        f"no tick for more than {STALLED_S} s: the autopilot may have acted by itself",
        Response.LISTEN,
        JOINED,
        Severity.WARNING,
        "companion stalled; resynchronising",
    ),
    Row(
        Cause.AUTOPILOT_SILENT,
        "no message of the autopilot for more than 1 s, in flight",
        Response.LISTEN,
        JOINED,
        Severity.CRITICAL,
        "autopilot silent for {}",
    ),
    Row(
        Cause.DISARMED_IN_AIR,
        "its HEARTBEAT says disarmed, while the companion steers, and its autopilot called it airborne a moment ago",
        Response.END,
        RESTARTED,
        Severity.CRITICAL,
        "disarmed in the air",
    ),
    Row(
        Cause.DISARMED,
        "its HEARTBEAT says disarmed, while the companion steers, on the ground",
        Response.END,
        RESTARTED,
        Severity.NOTICE,
        "disarmed: on the ground",
    ),
    Row(
        Cause.PILOT_MODE,
        "a flight mode that this companion did not ask for",
        Response.RELEASE,
        HANDED_BACK,
        Severity.WARNING,
        "released to the pilot: mode {}",
    ),
    Row(
        Cause.FAILSAFE_MODE,
        "a flight mode that the autopilot's own failsafe chose, but HOLD",
        Response.RELEASE,
        HANDED_BACK,
        Severity.WARNING,
        "released: failsafe, mode {}",
    ),
    Row(
        Cause.DISARMED_BEFORE_TAKEOFF,
        "disarmed on the ground, before the climb has shown",
        Response.RELEASE,
        HANDED_BACK,
        Severity.ERROR,
        "released: disarmed before takeoff",
    ),
    Row(
        Cause.DISARMED_IN_TAKEOFF,
        "disarmed in the climb",
        Response.END,
        RESTARTED,
        Severity.ERROR,
        "disarmed during takeoff",
    ),
    Row(
        Cause.LAND_ALL,
        "an operator has ordered all to land; latched, and spread by the beacons",
        Response.LAND,
        RESTARTED,
        Severity.WARNING,
        "landing: ordered from the ground",
    ),
    Row(
        Cause.BATTERY_CRITICAL,
        f"battery at {CRITICAL_BATTERY_PERCENT} % or below",
        Response.LAND,
        "not in the air: the landing goes on",
        Severity.WARNING,
        "landing: battery at {} %",
        resigns=True,
    ),
    Row(
        Cause.ALONE_LONG,
        f"no neighbour heard in the air for {ALONE_LAND_S:.0f} s; or, by ranges, its place among them not found",
        Response.LAND,
        "not in the air: the landing goes on",
        Severity.WARNING,
        "landing: alone for too long",
    ),
    Row(
        Cause.NO_MAJORITY_LONG,
        f"in a part without the majority of those that took off for {NO_QUORUM_LAND_S:.0f} s, and no vehicle above or "
        "below",
        Response.LAND,
        "not in the air: the landing goes on",
        Severity.WARNING,
        "landing: no majority for too long",
    ),
    Row(
        Cause.OBSTACLES_LOST,
        f"`obstacles_stale` for {BLIND_LAND_S:.0f} s, in the air",
        Response.LAND,
        "not in the air: the landing goes on",
        Severity.WARNING,
        "landing: no obstacle scan for too long",
    ),
    Row(
        Cause.SWARM_LANDS,
        "the leader lands the swarm (at the mission's end, stuck, or too few at d1), and no vehicle above or below",
        Response.LAND,
        "never: the swarm has landed",
        Severity.NOTICE,
        "landing with the swarm",
    ),
    Row(
        Cause.SETPOINTS_CUT,
        "the autopilot holds by its failsafe, and its link was down within the last 3 s: setpoints stopped",
        Response.LISTEN,
        JOINED,
        Severity.WARNING,
        "autopilot holds by its failsafe; resynchronising",
    ),
    Row(
        Cause.SETPOINTS_RETURN,
        "the autopilot holds by its failsafe while the companion, after listening, begins to steer again: the first "
        "3 s of setpoints show whether the autopilot goes back to OFFBOARD by itself",
        Response.STREAM,
        "the autopilot shows OFFBOARD, or the 3 s are over",
        Severity.INFO,
        "",
    ),
    Row(
        Cause.FAILSAFE_HOLD,
        "the autopilot holds by its failsafe though setpoints come",
        Response.RELEASE,
        HANDED_BACK,
        Severity.WARNING,
        "released: failsafe, mode {}",
    ),
    Row(
        Cause.REFUSED,
        "the autopilot answers DENIED or UNSUPPORTED to what is asked, but for a landing",
        Response.RELEASE,
        HANDED_BACK,
        Severity.ERROR,
        "released: {} refused for good",
    ),
    Row(
        Cause.NO_POSITION,
        "no position for 0.5 s",
        Response.REST,
        "a position comes",
        Severity.CRITICAL,
        "holding: no position",
        resigns=True,
    ),
    Row(
        Cause.TELEMETRY_LATE,
        "positions are more than 0.4 s under way",
        Response.REST,
        "they are less than 0.2 s under way",
        Severity.CRITICAL,
        "telemetry {} s late",
        resigns=True,
    ),
    Row(
        Cause.OBSTACLES_STALE,
        "with [sensing]: no scan of one of its obstacle sensors that is younger than `sensing.stale_s`, or none that "
        "can be placed by its attitude",
        Response.REST,
        "such a scan comes",
        Severity.CRITICAL,
        "holding: no obstacle scan",
        resigns=True,
    ),
    Row(
        Cause.NO_HEARTBEAT,
        "no HEARTBEAT of the autopilot for 3 s: its mode is not known",
        Response.HOLD,
        "a HEARTBEAT comes",
        Severity.CRITICAL,
        "holding: no autopilot heartbeat",
    ),
    Row(
        Cause.PLACE_UNSURE,
        "without satellites on all: two standard deviations of a near neighbour's place are more than "
        f"{UNSURE_FROM:g} of its distance; or no motion has shown yet that the start places are no mirror image, here "
        "or, while the swarm gathers, with a neighbour",
        Response.HOLD,
        f"they are less than {UNSURE_UNTIL:g} of it, and the motion has; meanwhile the vehicle circles slowly; "
        "a leader that comes no nearer to its goal by that lands the swarm after two minutes",
        Severity.WARNING,
        "holding: unsure where vehicle {} is",
    ),
    Row(
        Cause.OTHERS_LOST,
        "others that took off are not heard, in a mission with `[sensing]`: the part's leader goes back its own way to "
        "the last link; without the majority then to where they were heard last, then on, to stay outside the tree",
        Response.SEEK,
        "they are heard again; with the majority, 10 s are over; without it, the leader has been everywhere and holds",
        Severity.WARNING,
        "looking for the others{}",
    ),
    Row(
        Cause.NO_NEIGHBOUR,
        f"no neighbour heard for {ALONE_HOLD_S:.0f} s, or for 5 beacon periods where that is longer",
        Response.HOLD,
        "a neighbour is heard",
        Severity.WARNING,
        "holding: no neighbour heard",
    ),
    Row(
        Cause.NO_LEADER,
        "no lease: the leader was lost, or none leads yet",
        Response.HOLD,
        "a leader is heard, or this vehicle claims the lead",
        Severity.WARNING,
        "holding: no leader",
    ),
    Row(
        Cause.NO_MAJORITY,
        "this part of the swarm does not have the majority of those that took off",
        Response.HOLD,
        "the majority is heard again",
        Severity.WARNING,
        "holding: no majority{}",
    ),
    Row(
        Cause.PLACE_LOST,
        'with `swarm.place_lost` "hold", on the way to d2 or around it: it leads, hears no satellites, and may be off '
        'by more than `swarm.place_budget_m` (with "return" the swarm goes back along this leader\'s own way instead)',
        Response.HOLD,
        "it hears satellites, or another leads; after two minutes on the way the swarm lands",
        Severity.WARNING,
        "holding: place lost",
    ),
    Row(
        Cause.BATTERY_LOW,
        f"battery below {LOW_BATTERY_PERCENT} %",
        Response.RESIGN,
        f"battery at {LOW_BATTERY_PERCENT} % or above",
        Severity.INFO,
        "",
        resigns=True,
    ),
)


def row(cause: Cause) -> Row:
    """The table's row of a cause."""
    return TABLE[cause]


def decide(findings: Sequence[Finding]) -> Finding | None:
    """Of all that is found, what stands highest in the table; None: nothing is found."""
    return min(findings) if findings else None


def demands(found: Finding | None, response: Response) -> bool:
    """What decides demands this response."""
    return found is not None and TABLE[found.cause].response is response


def rests(findings: Sequence[Finding]) -> bool:
    """A cause is there for which every setpoint is zero, whatever decides."""
    return any([TABLE[found.cause].response is Response.REST for found in findings])


def resigns(findings: Sequence[Finding]) -> bool:
    """A cause is there that costs the lead, whatever decides."""
    return any([TABLE[found.cause].resigns for found in findings])


def text(found: Finding) -> str:
    """What the operator hears of it; empty: nothing."""
    return TABLE[found.cause].text.replace("{}", found.detail)
