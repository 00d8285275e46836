"""The table of what keeps a leader from rising, and of what has it come down: detect, and words for the operator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final, NamedTuple

from companion.core.vehicle.failsafe import LOW_BATTERY_PERCENT
from mission.rules.rise_rules import ALOFT_MAX_S, BEFORE_S

QUIET_S: Final = 10.0  # without one more record that the base station has acknowledged


class RiseReadings(NamedTuple):
    """Readings of one tick."""

    leads: bool  # it is the acting leader, with a majority
    covers: bool  # by its phase and its own flight: no order and no failsafe has it do otherwise
    covers_s: float  # for so long, as leader
    rests: bool  # now: gusts move it from time to time
    waiting: int  # records that it knows of, and that the base station has not acknowledged
    quiet_s: float  # since the base station has acknowledged one more
    battery_percent: int | None
    is_free: bool  # the column from its height on, by its own rays; at rest of no account
    is_alone: bool  # nobody else is above the height that holds all others
    since_s: float  # it began to rise


class Reason(Enum):
    """Reasons not to rise, or to come down; the value says it to an operator."""

    LEAD_LOST = "not leading a majority"
    ENDED = "coverage ended or held"
    BATTERY_LOW = f"battery below {LOW_BATTERY_PERCENT} %"
    DELIVERED = "all records delivered"
    BLOCKED = "column above not known free"
    NOT_ALONE = "another vehicle is up"
    TIME_UP = f"{ALOFT_MAX_S:.0f} s are up"
    UNREACHED = "column not reached"
    NOT_RESTING = "not at rest"
    HEARD = "base station acknowledges records"


Detect = Callable[[RiseReadings], bool]


def _is_low(r: RiseReadings) -> bool:
    return r.battery_percent is not None and r.battery_percent < LOW_BATTERY_PERCENT


ALWAYS: Final[list[tuple[Reason, Detect]]] = [
    (Reason.LEAD_LOST, lambda r: not r.leads),
    (Reason.ENDED, lambda r: not r.covers),
    (Reason.BATTERY_LOW, _is_low),
    (Reason.DELIVERED, lambda r: r.waiting == 0),
]
# The first that holds decides. On the way up, and there: come down.
DESCENDS: Final[list[tuple[Reason, Detect]]] = [
    *ALWAYS,
    (Reason.BLOCKED, lambda r: not r.is_free),
    (Reason.NOT_ALONE, lambda r: not r.is_alone),
    (Reason.TIME_UP, lambda r: r.since_s >= ALOFT_MAX_S),
]
# At rest: stay. Where none holds a column is looked for; BLOCKED: there is none.
STAYS: Final[list[tuple[Reason, Detect]]] = [
    *ALWAYS,
    (Reason.NOT_RESTING, lambda r: r.covers_s < BEFORE_S or not r.rests),
    (Reason.HEARD, lambda r: r.quiet_s < QUIET_S),
    (Reason.NOT_ALONE, lambda r: not r.is_alone),
]
SAID = frozenset({Reason.BLOCKED, Reason.NOT_ALONE, Reason.BATTERY_LOW})  # of those it stays by


def find_reason(table: Sequence[tuple[Reason, Detect]], readings: RiseReadings) -> Reason | None:
    """The first that holds; None: none does."""
    for reason, holds in table:
        if holds(readings):
            return reason
    return None
