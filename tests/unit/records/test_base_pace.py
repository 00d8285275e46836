"""Pace of records that arrive at the base station, in words."""

from __future__ import annotations

from companion.base.pace import Pace


def test_the_pace_is_that_of_the_last_minute() -> None:
    pace = Pace()
    assert pace.describe(0, 0, 100.0) == ""
    assert pace.describe(10, 40, 100.5) == ""  # too soon to say
    assert pace.describe(10, 40, 110.0) == ", 60 a minute, 30 s left"
    assert pace.describe(40, 40, 120.0) == ", 120 a minute"
    assert pace.describe(40, 400, 120.0) == ", 120 a minute, 3 min left"
    assert pace.describe(40, 400, 165.0) == ", 33 a minute, 11 min left"
    assert pace.describe(40, 400, 181.0) == ""  # nothing came in the last minute


def test_a_long_watch_keeps_a_minute_of_counts() -> None:
    pace = Pace()
    for k in range(10_000):
        told = pace.describe(k, 20_000, 0.05 * k)
    assert told == ", 1200 a minute, 8 min left"
    assert len(pace._counts) <= 61
