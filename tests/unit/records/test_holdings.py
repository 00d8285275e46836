"""The numbers of a log that are there, and the window that a vector tells of."""

from __future__ import annotations

from companion.records.holdings import AHEAD_MAX, Holding
from companion.records.record import BITMAP


def holding(*numbers: int) -> Holding:
    made = Holding()
    for number in numbers:
        assert made.add(number)
    return made


def test_a_gap_holds_the_number_back_until_it_is_filled() -> None:
    log = holding(1, 2, 4, 5)
    assert (log.upto, log.last, log.count) == (2, 5, 4)
    assert list(log.missing(7)) == [(3, 3), (6, 7)]
    assert log.add(3)
    assert log.upto == 5


def test_what_is_there_is_not_taken_twice() -> None:
    log = holding(1, 2, 4)
    assert not log.add(2)
    assert not log.add(4)


def test_a_number_far_ahead_is_not_taken() -> None:
    log = holding(1)
    assert not log.add(AHEAD_MAX + 2)
    assert log.add(AHEAD_MAX + 1)


def test_what_is_given_up_is_neither_missing_nor_sent() -> None:
    log = holding(1, 2, 5)
    log.give_up(4)
    assert log.upto == 5
    assert list(log.held(1, 10)) == [5]
    assert list(log.missing(6)) == [(6, 6)]


def test_the_window_begins_at_the_first_gap_while_it_is_being_filled() -> None:
    log = holding(1, 2, 4)
    assert log.advance_window(100) == 2
    assert log.bits(2) == 0b10
    log.add(3)
    assert log.advance_window(100) == 4


def test_a_gap_that_nobody_fills_hides_nothing_behind_it() -> None:
    log = holding(*range(1, 41))
    seen = {log.advance_window(40 + 3 * BITMAP) for _ in range(12)}
    assert seen == {40, 40 + BITMAP, 40 + 2 * BITMAP}


def test_the_window_passes_over_what_is_there() -> None:
    log = holding(*range(1, 41), *range(42, 42 + 2 * BITMAP))
    windows = {log.advance_window(200) for _ in range(8)}
    assert 40 in windows  # the gap at 41
    assert 41 + 2 * BITMAP in windows  # and what lies behind all that is there
