"""Runs the table of failsafes: what is found by the readings of a source, what decides, and what that demands."""

from __future__ import annotations

from collections.abc import Sequence

from companion.core.vehicle.failsafe import TABLE, Cause, Finding, Readings, Response, Row, Source

ROWS_OF: tuple[tuple[Row, ...], ...] = tuple(tuple(row for row in TABLE if row.source is source) for source in Source)


def row(cause: Cause) -> Row:
    """The table's row of a cause."""
    return TABLE[cause]


def detect(source: Source, readings: Readings) -> list[Finding]:
    """All that is there by what one source has read off, in the order of precedence."""
    found: list[Finding] = []
    for one in ROWS_OF[source]:
        if one.detect(readings) > one.delay_s:
            found.append(Finding(one.cause, "" if one.detail is None else one.detail(readings)))
    return found


def decide(findings: Sequence[Finding]) -> Finding | None:
    """Of all that is found, what stands highest in the table; None: nothing is found."""
    return min(findings) if findings else None


def demands(found: Finding | None, response: Response) -> bool:
    """True if the deciding row demands this response."""
    return found is not None and TABLE[found.cause].response is response


def rests(findings: Sequence[Finding]) -> bool:
    """A cause is there for which the vehicle brakes and rests, whatever decides."""
    return any([TABLE[found.cause].response is Response.REST for found in findings])


def knows_position(findings: Sequence[Finding]) -> bool:
    """No cause is there for which the own position is old."""
    return not any(
        [found.cause in (Cause.NO_POSITION, Cause.TELEMETRY_LATE, Cause.POSITION_FROZEN) for found in findings]
    )


def resigns(findings: Sequence[Finding]) -> bool:
    """A cause is there that costs the lead, whatever decides."""
    return any([TABLE[found.cause].resigns for found in findings])


def text(found: Finding) -> str:
    """The STATUSTEXT of it; empty: none."""
    return TABLE[found.cause].text.replace("{}", found.detail)
