"""The table of failsafes: how each cause is detected, after how long, what clears it, and what follows.

The table runs, highest precedence first. In each tick every source fills in its `Readings`, `failsafe_engine.detect`
goes through the rows of that source, and of all that is found the row decides that stands highest. In the climb, while
the vehicle is steered, and while it listens in the air, nothing beside this table decides. A new cause is a `Cause`,
its row, and its reading where that is new.

The table does not cover the beginning and the end of a flight (see `flight`). On the ground a vehicle waits for what it
lacks, as a position or a battery above the critical charge, and does not take off while a row would land it. A landing
ends when the vehicle is disarmed; of the table, only stalls, silence and a mode that another chose count in it.

What a row demands besides counts also when another decides: a vehicle that lands without a position sends zero velocity
until its autopilot lands it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, IntEnum, auto
from typing import Final, NamedTuple

from companion.core.model.states import Severity

# two standard deviations of where a neighbour is, as shares of its distance: within the first the vehicle sees in which
# direction to 30 degrees, and keeps from it by all that it is unsure of (`ranging`); below the second it flies on
UNSURE_FROM: Final = 0.5
UNSURE_UNTIL: Final = 0.4
LOW_BATTERY_PERCENT: Final = 20  # no leadership below
LOW_BATTERY_CLEARS_PERCENT: Final = 25  # of one that resigned by it: between two readings it leads not by turns
CRITICAL_BATTERY_PERCENT: Final = 10  # down here it lands where it is


class Source(IntEnum):
    """Source of the readings of a row."""

    TICK = 0  # the agent, of its own ticks
    LINK = 1  # the flight, of the link to its autopilot, while it asks something of it
    AUTOPILOT = 2  # what the autopilot and the obstacle sensors have reported
    MODE = 3  # arming and flight mode, while the companion steers, lands or listens in the air
    CLIMB = 4  # the same in the climb
    REQUEST = 5  # answers to what is asked of the autopilot
    SWARM = 6  # what the swarm does
    PARTITION = 7  # the network partition that this vehicle is in
    LOCALISATION = 8
    INTEGRITY = 9  # whether the own position can be true


class Response(Enum):
    """Response of a vehicle; the value says so in words."""

    LISTEN = "sends no setpoints and asks for nothing; joins again once it hears its autopilot and a leader that flies"
    END = "is done: its motors are off"
    RELEASE = "sends no setpoints and asks for nothing, until an operator hands it back"
    LAND = "asks its autopilot to land it where it is"
    STREAM = "streams setpoints and asks for nothing"
    REST = "brakes, and holds where it comes to rest if it knows its position: no separation moves it"
    HOLD = "zero velocity, but for keeping separation"
    SEEK = "searches for lost peers as the leader of its partition does, or follows that leader"
    RESIGN = "flies on, but neither takes nor keeps the lead"


class Cause(IntEnum):
    """Ascending by precedence: the first is the highest."""

    COMPANION_STALLED = 0
    AUTOPILOT_SILENT = auto()
    DISARMED_IN_AIR = auto()
    DISARMED = auto()
    PILOT_MODE = auto()
    FAILSAFE_MODE = auto()
    DISARMED_BEFORE_TAKEOFF = auto()
    DISARMED_IN_TAKEOFF = auto()
    LAND_ALL = auto()
    BATTERY_CRITICAL = auto()
    ALONE_LONG = auto()
    NO_MAJORITY_LONG = auto()
    OBSTACLES_LOST = auto()
    POSITION_DOUBTED_LONG = auto()
    HEIGHT_FALSE = auto()
    SWARM_LANDS = auto()
    SETPOINTS_CUT = auto()
    SETPOINTS_RETURN = auto()
    FAILSAFE_HOLD = auto()
    REFUSED = auto()
    NO_POSITION = auto()
    POSITION_FROZEN = auto()
    TELEMETRY_LATE = auto()
    OBSTACLES_STALE = auto()
    NO_HEARTBEAT = auto()
    GNSS_LOST = auto()
    POSITION_JUMPED = auto()
    GNSS_ASTRAY = auto()
    OPERATOR_HOLDS = auto()
    PEER_UNCERTAIN = auto()
    OTHERS_LOST = auto()
    NO_NEIGHBOUR = auto()
    NO_LEADER = auto()
    NO_MAJORITY = auto()
    POSITION_UNCERTAIN = auto()
    POSITION_DOUBTED = auto()
    BATTERY_UNKNOWN = auto()
    BATTERY_LOW = auto()


class Finding(NamedTuple):
    """A cause that is there now. `detail` fills the gap in its row's text."""

    cause: Cause
    detail: str = ""


class Readings(NamedTuple):
    """Readings of all sources in one tick. Each fills in its own; by default all is well."""

    tick_gap_s: float = 0.0  # TICK: since the tick before
    silence_s: float = 0.0  # LINK: since any message of the autopilot
    steers: bool = False  # setpoints are being sent
    position_age_s: float = 0.0  # AUTOPILOT
    heartbeat_age_s: float = 0.0
    telemetry_late: bool = False  # positions are too long under way
    telemetry_late_s: float = 0.0
    battery_percent: int | None = None
    battery_age_s: float = 0.0  # since it was told, where it ever was
    airborne: bool = False
    gnss_lost_s: float = 0.0  # without the fix that its position went by
    no_scan: bool = False  # of an obstacle sensor that the mission has it fly by
    no_scan_s: float = 0.0  # for how long
    disarmed: bool = False  # MODE, CLIMB
    was_airborne: bool = False  # a moment ago
    mode: str = ""  # as an operator knows it
    mode_taken: bool = False  # it is neither what this companion asked for nor what its step of the flight began in
    mode_failsafe: bool = False  # the autopilot says that it acts by itself
    failsafe_holds: bool = False  # in HOLD, and no operator has overruled that
    setpoints_cut: bool = False  # the link was down a moment ago: setpoints stopped
    setpoints_return: bool = False  # they have come again for less than it takes to end the failsafe
    climb_seen: bool = False  # CLIMB
    refused: str = ""  # REQUEST: what the autopilot will not do, whenever it is asked
    land_all: bool = False  # SWARM
    clear_below: bool = True  # no vehicle above or below
    swarm_lands: bool = False
    operator_holds: bool = False
    global_lost: bool = False  # it leads, and is off by more than the mission allows
    alone_s: float = 0.0  # SWARM, PARTITION: in the air without company
    parted_s: float = 0.0  # without the majority
    alone_beacons_s: float = 0.0  # PARTITION: its row's number of beacon periods
    led: bool = True  # there is a lease
    quorum: bool = True  # by that
    missing: str = ""  # which vehicles, in words
    search: str = ""  # for others that are lost, in words
    unsure_of: int = 0  # LOCALISATION: a vehicle; 0: none
    height_false: bool = False  # INTEGRITY: this companion began in the air, where none of the mission would have flown
    frozen_s: float = 0.0  # the position has been repeated while the vehicle moves
    since_jump_s: float = math.inf  # since the position jumped last
    is_off: bool = False  # it has not come back since
    is_astray: bool = False  # the fix left the way that trunks tell, or the own velocity, or the place that ranges tell
    is_off_velocity: bool = False  # it is the own velocity's
    unseen_s: float = 0.0  # then: for how long trunks have not told the own motion


def there(found: bool) -> float:
    """Of a row whose reading has no time of its own: it counts at once."""
    return math.inf if found else 0.0


def _name_doubt(r: Readings) -> str:
    if r.is_off_velocity:
        return "off its velocity"
    return "GNSS led astray" if r.is_astray else "jump taken off"


class Clear(Enum):
    """End of the response of a row; the value says so in words."""

    GONE = "it is not detected any more"
    JOINED = "a HEARTBEAT has come since, and a leader that flies is heard"
    HANDED_BACK = "an operator hands it back (`MISSION_START`)"
    LANDED = "not in the air: the landing goes on"
    RESTARTED = "the companion is started again"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table. It is found when its reading has lasted for longer than `delay_s`.

    All times of a cause stand here: whoever takes the reading has them from the row. In `when`, `text` and `until` the
    name of one in braces, as {delay_s}, is its value.
    """

    cause: Cause
    source: Source
    when: str  # the same in words
    detect: Callable[[Readings], float]  # for how long it has been there, s
    response: Response
    clear: Clear
    severity: Severity
    text: str  # STATUSTEXT when it begins to decide; {}: a finding's detail; empty: nothing is said
    until: str = ""  # what `Clear.GONE` comes by, in words
    delay_s: float = 0.0
    delay_periods: int = 0  # of beacons, where that is longer
    lingers_s: float = 0.0  # what it comes by counts for so long after it has gone
    clear_below_s: float = 0.0  # there, its reading must fall below this
    limit_s: float = 0.0  # the response is given up after so long
    detail: Callable[[Readings], str] | None = None  # fills the gap in `text`
    resigns: bool = False  # it also costs the vehicle the lead, whatever decides
    advice: str = ""  # for the operator, of a text that docs/how-to/read-the-messages.md does not explain


def fill_in(row: Row) -> Row:
    """The row with its own values in its texts."""
    values = {
        "{delay_s}": row.delay_s,
        "{delay_periods}": row.delay_periods,
        "{lingers_s}": row.lingers_s,
        "{clear_below_s}": row.clear_below_s,
        "{limit_s}": row.limit_s,
    }
    when, text, until = row.when, row.text, row.until
    for name, value in values.items():
        words = f"{value:.3g}"
        when, text, until = when.replace(name, words), text.replace(name, words), until.replace(name, words)
    return replace(row, when=when, text=text, until=until)


ROWS: tuple[Row, ...] = (
    Row(
        Cause.COMPANION_STALLED,
        Source.TICK,
        "no tick for more than {delay_s} s: the autopilot may have acted by itself",
        lambda r: r.tick_gap_s,
        Response.LISTEN,
        Clear.JOINED,
        Severity.WARNING,
        "companion stalled: resynchronising",
        delay_s=0.4,  # just before the autopilot's offboard-loss timeout under a canopy, 0.5 s
    ),
    Row(
        Cause.AUTOPILOT_SILENT,
        Source.LINK,
        "no message of the autopilot for more than {delay_s} s, in flight",
        lambda r: r.silence_s,
        Response.LISTEN,
        Clear.JOINED,
        Severity.CRITICAL,
        "autopilot link lost {}",
        delay_s=1.0,  # whatever is sent to it then is sent blindly
        detail=lambda r: f"{r.silence_s:.1f} s{': setpoints stopped' if r.steers else ''}",
    ),
    Row(
        Cause.DISARMED_IN_AIR,
        Source.MODE,
        "its HEARTBEAT says disarmed, while the companion steers, and its autopilot called it airborne within the last "
        "{lingers_s} s",
        lambda r: there(r.disarmed and r.was_airborne),
        Response.END,
        Clear.RESTARTED,
        Severity.CRITICAL,
        "disarmed in the air",
        lingers_s=1.5,  # it may say "landed" before its next HEARTBEAT shows that it is disarmed
    ),
    Row(
        Cause.DISARMED,
        Source.MODE,
        "its HEARTBEAT says disarmed, while the companion steers, on the ground",
        lambda r: there(r.disarmed and not r.was_airborne),
        Response.END,
        Clear.RESTARTED,
        Severity.NOTICE,
        "disarmed on the ground",
    ),
    Row(
        Cause.PILOT_MODE,
        Source.MODE,
        "a flight mode that this companion did not ask for",
        lambda r: there(r.mode_taken and not r.mode_failsafe),
        Response.RELEASE,
        Clear.HANDED_BACK,
        Severity.WARNING,
        "released: pilot, mode {}",
        detail=lambda r: r.mode,
    ),
    Row(
        Cause.FAILSAFE_MODE,
        Source.MODE,
        "a flight mode that the autopilot's own failsafe chose, but HOLD",
        lambda r: there(r.mode_taken and r.mode_failsafe),
        Response.RELEASE,
        Clear.HANDED_BACK,
        Severity.WARNING,
        "released: failsafe, mode {}",
        detail=lambda r: r.mode,
    ),
    Row(
        Cause.DISARMED_BEFORE_TAKEOFF,
        Source.CLIMB,
        "disarmed on the ground, before the climb has shown",
        lambda r: there(r.disarmed and not r.climb_seen),
        Response.RELEASE,
        Clear.HANDED_BACK,
        Severity.ERROR,
        "released: disarmed before takeoff",
    ),
    Row(
        Cause.DISARMED_IN_TAKEOFF,
        Source.CLIMB,
        "disarmed in the climb",
        lambda r: there(r.disarmed and r.climb_seen),
        Response.END,
        Clear.RESTARTED,
        Severity.ERROR,
        "disarmed in takeoff",
    ),
    Row(
        Cause.LAND_ALL,
        Source.SWARM,
        "an operator has ordered all to land where they are (ABORT); latched, and passed on by all",
        lambda r: there(r.land_all),
        Response.LAND,
        Clear.RESTARTED,
        Severity.WARNING,
        "land: ordered by the operator",
    ),
    Row(
        Cause.BATTERY_CRITICAL,
        Source.AUTOPILOT,
        f"battery at {CRITICAL_BATTERY_PERCENT} % or below",
        lambda r: there(r.battery_percent is not None and r.battery_percent <= CRITICAL_BATTERY_PERCENT),
        Response.LAND,
        Clear.LANDED,
        Severity.WARNING,
        "land: battery at {} %",
        detail=lambda r: str(r.battery_percent),
        resigns=True,
    ),
    Row(
        Cause.ALONE_LONG,
        Source.SWARM,
        "no neighbour heard in the air for {delay_s} s; or, by ranges, its position among them not found",
        lambda r: r.alone_s,
        Response.LAND,
        Clear.LANDED,
        Severity.WARNING,
        "land: no link to any peer for {delay_s} s",
        delay_s=90.0,  # it never climbs
    ),
    Row(
        Cause.NO_MAJORITY_LONG,
        Source.SWARM,
        "in a partition without the majority of those that took off for {delay_s} s, but for moments of up to "
        "{lingers_s} s, and no vehicle above or below",
        lambda r: r.parted_s if r.clear_below else 0.0,
        Response.LAND,
        Clear.LANDED,
        Severity.WARNING,
        "land: no quorum for {delay_s} s",
        delay_s=120.0,  # it holds so long for the others
        lingers_s=3.0,  # longer than links that come and go while parts draw near
    ),
    Row(
        Cause.OBSTACLES_LOST,
        Source.AUTOPILOT,
        "`obstacles_stale` for {delay_s} s, in the air",
        lambda r: r.no_scan_s if r.airborne else 0.0,
        Response.LAND,
        Clear.LANDED,
        Severity.WARNING,
        "land: no obstacle scan for {delay_s} s",
        delay_s=math.nextafter(60.0, 0.0),  # by then, and not just after it: it stands in the way of all
    ),
    Row(
        Cause.POSITION_DOUBTED_LONG,
        Source.INTEGRITY,
        "`gnss_astray` or `position_frozen` for {delay_s} s",
        lambda r: max(r.unseen_s, r.frozen_s),
        Response.LAND,
        Clear.LANDED,
        Severity.CRITICAL,
        "land: position doubted for {delay_s} s",
        delay_s=15.0,  # what it goes by meanwhile is a guess, that errs by 0.2 m/s
        resigns=True,
    ),
    Row(
        Cause.HEIGHT_FALSE,
        Source.INTEGRITY,
        "the companion started anew in the air, and the first height that it is told there is more than 1 m above or "
        "below all that its mission flies at (`fence`, `survey.rise_to_m`)",
        lambda r: there(r.height_false),
        Response.LAND,
        Clear.LANDED,
        Severity.CRITICAL,
        "land: height cannot be true",
        resigns=True,
    ),
    Row(
        Cause.SWARM_LANDS,
        Source.SWARM,
        "the leader lands the swarm (at the mission's end, stuck, or too few at d1), and no vehicle above or below",
        lambda r: there(r.swarm_lands and r.clear_below),
        Response.LAND,
        Clear.LANDED,
        Severity.NOTICE,
        "land: the swarm lands",
    ),
    Row(
        Cause.SETPOINTS_CUT,
        Source.MODE,
        "the autopilot holds by its failsafe, and its link was down within the last {lingers_s} s: setpoints stopped",
        lambda r: there(r.failsafe_holds and r.setpoints_cut),
        Response.LISTEN,
        Clear.JOINED,
        Severity.WARNING,
        "failsafe hold: resynchronising",
        lingers_s=3.0,  # within which a HEARTBEAT shows it: one a second, and one may be lost
    ),
    Row(
        Cause.SETPOINTS_RETURN,
        Source.MODE,
        "the autopilot holds by its failsafe while the companion, after listening, begins to steer again: setpoints "
        "show within the time of its make (`failsafe_ends_s`) whether it goes back to OFFBOARD by itself",
        lambda r: there(r.failsafe_holds and r.setpoints_return),
        Response.STREAM,
        Clear.GONE,
        Severity.INFO,
        "",
        until="the autopilot shows OFFBOARD, or that time is over",
    ),
    Row(
        Cause.FAILSAFE_HOLD,
        Source.MODE,
        "the autopilot holds by its failsafe though setpoints come",
        lambda r: there(r.failsafe_holds),
        Response.RELEASE,
        Clear.HANDED_BACK,
        Severity.WARNING,
        "released: failsafe, mode {}",
        detail=lambda r: r.mode,
    ),
    Row(
        Cause.REFUSED,
        Source.REQUEST,
        "the autopilot answers DENIED or UNSUPPORTED to what is asked, but for a landing",
        lambda r: there(r.refused != ""),
        Response.RELEASE,
        Clear.HANDED_BACK,
        Severity.ERROR,
        "released: {} denied",
        detail=lambda r: r.refused,
    ),
    Row(
        Cause.NO_POSITION,
        Source.AUTOPILOT,
        "no position for {delay_s} s",
        lambda r: r.position_age_s,
        Response.REST,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: position lost",
        until="a position comes",
        delay_s=0.5,
        resigns=True,
    ),
    Row(
        Cause.POSITION_FROZEN,
        Source.INTEGRITY,
        "the same position, to the bit, for {delay_s} s, while its velocity or its setpoint says that it moves",
        lambda r: r.frozen_s,
        Response.REST,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: position frozen",
        until="it changes",
        delay_s=0.5,
        resigns=True,
    ),
    Row(
        Cause.TELEMETRY_LATE,
        Source.AUTOPILOT,
        "positions are more than {delay_s} s under way",
        lambda r: there(r.telemetry_late),
        Response.REST,
        Clear.GONE,
        Severity.CRITICAL,
        "telemetry {} s late",
        until="they are less than {clear_below_s} s under way",
        delay_s=0.4,
        clear_below_s=0.2,  # on the edge it does not flutter
        detail=lambda r: f"{r.telemetry_late_s:.1f}",
        resigns=True,
    ),
    Row(
        Cause.OBSTACLES_STALE,
        Source.AUTOPILOT,
        "with [sensing]: no scan of one of its obstacle sensors that is younger than `sensing.stale_s`, or none that "
        "can be placed by its attitude",
        lambda r: there(r.no_scan),
        Response.REST,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: obstacle scan lost",
        until="such a scan comes",
        resigns=True,
    ),
    Row(
        Cause.NO_HEARTBEAT,
        Source.AUTOPILOT,
        "no HEARTBEAT of the autopilot for {delay_s} s: its mode is not known",
        lambda r: r.heartbeat_age_s,
        Response.HOLD,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: autopilot heartbeat lost",
        until="a HEARTBEAT comes",
        delay_s=3.0,  # it sends one a second
    ),
    Row(
        Cause.GNSS_LOST,
        Source.AUTOPILOT,
        "its receiver has had no fix for {delay_s} s, and its position goes on by inertial sensors alone",
        lambda r: r.gnss_lost_s if r.airborne else 0.0,
        Response.HOLD,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: GNSS fix lost",
        until="it has had one for {lingers_s} s, and, where it may be more than 1.5 m off, its position has jumped "
        "since or it has had one for ten times as long; meanwhile its beacons say how far it may be off, and the "
        "others keep so much further away",
        delay_s=0.5,
        lingers_s=1.0,  # an estimator takes its first fixes, and jumps to them
        resigns=True,
    ),
    Row(
        Cause.POSITION_JUMPED,
        Source.INTEGRITY,
        "its position has jumped within the last {lingers_s} s by more than 3 m against its velocity, or less that "
        "trunks, or that velocity, noticed: the jump is taken off, here and in what it broadcasts",
        lambda r: there(r.since_jump_s <= 2.0),
        Response.HOLD,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: position jumped",
        until="{lingers_s} s are over",
        lingers_s=2.0,
        resigns=True,
    ),
    Row(
        Cause.GNSS_ASTRAY,
        Source.INTEGRITY,
        "its fix has left the way that trunks, or its own velocity, tell, or is not where ranges have it, and for "
        "{delay_s} s no trunks tell its motion: it goes by the drift that was found, or that velocity",
        lambda r: r.unseen_s,
        Response.HOLD,
        Clear.GONE,
        Severity.CRITICAL,
        "hold: position astray, no trunk seen",
        until="trunks tell its motion again",
        delay_s=1.0,
        resigns=True,
    ),
    Row(
        Cause.OPERATOR_HOLDS,
        Source.SWARM,
        "an operator has ordered HOLD: no phase goes on meanwhile, and no time of one runs",
        lambda r: there(r.operator_holds),
        Response.HOLD,
        Clear.GONE,
        Severity.NOTICE,
        "hold: ordered by the operator",
        until="an operator orders START, LAND or ABORT",
    ),
    Row(
        Cause.PEER_UNCERTAIN,
        Source.LOCALISATION,
        "where not all have GNSS: two standard deviations of a near neighbour's position are more than "
        f"{UNSURE_FROM:g} of its distance; or no motion has shown yet that the start positions are no mirror image, "
        "here or, while the swarm gathers, with a neighbour",
        lambda r: there(r.unsure_of != 0),
        Response.HOLD,
        Clear.GONE,
        Severity.WARNING,
        "hold: vehicle {} position uncertain",
        until=(
            f"they are less than {UNSURE_UNTIL:g} of it, and the motion has; meanwhile the vehicle circles slowly; "
            "a leader that comes no nearer to its goal by that lands the swarm at last, as stuck"
        ),
        detail=lambda r: str(r.unsure_of),
    ),
    Row(
        Cause.OTHERS_LOST,
        Source.PARTITION,
        "others that took off are not heard for {delay_s} s, in a mission with `[sensing]`: the partition's leader "
        "goes back its own way to the last link; without the majority then to where they were heard last, then on, to "
        "stay outside the tree (in layers of height a part without the majority stands first, for most of a minute)",
        lambda r: there(r.search != ""),
        Response.SEEK,
        Clear.GONE,
        Severity.WARNING,
        "searching for lost peers{}",
        until="they are heard again; with the majority, {limit_s} s are over (a minute in layers of height); without "
        "it, the leader has been everywhere and holds",
        delay_s=1.0,  # a shadow that passes, and the election, take no longer
        limit_s=10.0,  # longer, one that is lost is dead or far behind
        detail=lambda r: r.search,
    ),
    Row(
        Cause.NO_NEIGHBOUR,
        Source.PARTITION,
        "no neighbour heard for {delay_s} s, or for {delay_periods} beacon periods where that is longer",
        lambda r: r.alone_s if r.alone_s > r.alone_beacons_s else 0.0,
        Response.HOLD,
        Clear.GONE,
        Severity.WARNING,
        "hold: no link to any peer",
        until="a neighbour is heard",
        delay_s=1.0,
        delay_periods=5,
    ),
    Row(
        Cause.NO_LEADER,
        Source.PARTITION,
        "no lease: the leader was lost, or none leads yet",
        lambda r: there(not r.led),
        Response.HOLD,
        Clear.GONE,
        Severity.WARNING,
        "hold: no leader",
        until="a leader is heard, or this vehicle claims the lead",
    ),
    Row(
        Cause.NO_MAJORITY,
        Source.PARTITION,
        "this partition has not had the majority of those that took off for {delay_s} s, as its leader says; in layers "
        "of height it then goes to one of its own",
        lambda r: there(r.led and not r.quorum),
        Response.HOLD,
        Clear.GONE,
        Severity.WARNING,
        "hold: no quorum{}",
        until="the majority is heard again",
        delay_s=1.0,  # one beacon lost on a long link cuts off a branch
        detail=lambda r: r.missing,
    ),
    Row(
        Cause.POSITION_UNCERTAIN,
        Source.SWARM,
        'with `swarm.position_uncertain` "hold", on the way to d2 or around it: it leads, has no GNSS fix, and may be '
        'off by more than `swarm.position_error_max_m` (with "return" the swarm backtracks along its own way instead)',
        lambda r: there(r.global_lost),
        Response.HOLD,
        Clear.GONE,
        Severity.WARNING,
        "hold: position uncertain",
        until="it has a GNSS fix, or another leads; on the way its leader lands the swarm at last, as stuck",
    ),
    Row(
        Cause.POSITION_DOUBTED,
        Source.INTEGRITY,
        "its fix has left the way that trunks, or its own velocity, tell, or is not where ranges have it: it flies by "
        "these for the rest of the flight; or a jump was taken off its position, which has not come back",
        lambda r: there(r.is_astray or r.is_off),
        Response.RESIGN,
        Clear.GONE,
        Severity.CRITICAL,
        "position doubted: {}",
        until="it has landed, or its position is back where it was; meanwhile its beacons say how far it may be off",
        detail=_name_doubt,
        resigns=True,
    ),
    Row(
        Cause.BATTERY_UNKNOWN,
        Source.AUTOPILOT,
        "its battery was told, and has not been for {delay_s} s, in the air, while other messages come",
        lambda r: r.battery_age_s if r.airborne else 0.0,
        Response.RESIGN,
        Clear.GONE,
        Severity.WARNING,
        "battery not told for {delay_s} s",
        until="it is told again",
        delay_s=10.0,  # SYS_STATUS comes once a second
        resigns=True,
        advice="land it in time: no charge ends this flight any more",
    ),
    Row(
        Cause.BATTERY_LOW,
        Source.AUTOPILOT,
        f"battery below {LOW_BATTERY_PERCENT} %",
        lambda r: there(r.battery_percent is not None and r.battery_percent < LOW_BATTERY_PERCENT),
        Response.RESIGN,
        Clear.GONE,
        Severity.INFO,
        "",
        until=f"battery at {LOW_BATTERY_PERCENT} % or above, of one that led at {LOW_BATTERY_CLEARS_PERCENT} %",
        resigns=True,
    ),
)
TABLE: tuple[Row, ...] = tuple(fill_in(row) for row in ROWS)
