"""What an operator hears of a hold."""

from __future__ import annotations

from companion.core.vehicle.failsafe import Cause, Finding
from companion.core.vehicle.hold_reports import HoldReports

ONE, FOUR = Finding(Cause.NO_MAJORITY, ", without 1"), Finding(Cause.NO_MAJORITY, ", without 1, 3, 4, 2 more")
TWO, ALONE = Finding(Cause.NO_MAJORITY, ", without 1, 3"), Finding(Cause.NO_NEIGHBOUR)


def told(*spells: tuple[float, Finding | None]) -> list[Finding]:
    """What is told while these decide, each for so many seconds."""
    reports, found, now_s = HoldReports(), list[Finding](), 50.0
    for seconds, decides in spells:
        for _ in range(round(20.0 * seconds)):
            now_s += 0.05
            news = reports.update(decides, now_s)
            found += [] if news is None else [news]
    return found


def test_a_hold_is_said_at_once_and_who_else_is_missed_once_that_has_settled() -> None:
    assert told((0.3, ONE), (0.4, TWO), (0.4, FOUR), (5.0, FOUR)) == [ONE, FOUR]
    assert told((0.3, ONE), (0.4, TWO), (5.0, ONE)) == [ONE]


def test_another_cause_is_said_at_once_and_the_same_again_after_it() -> None:
    assert told((0.1, ONE), (0.1, ALONE), (0.1, ONE), (0.1, None), (0.1, ONE)) == [ONE, ALONE, ONE, ONE]


def test_words_that_never_settle_are_said_no_more_than_once_a_second() -> None:
    assert 1 <= len(told((0.1, ONE), *[(0.1, TWO), (0.1, FOUR)] * 20)) <= 6
