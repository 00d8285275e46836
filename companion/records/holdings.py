"""The numbers of each log that a node has: up to where nothing is missing, and what lies beyond a gap."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from companion.records.record import BITMAP, NUMBER_MAX

AHEAD_MAX: Final = 8192  # numbers beyond the first gap: more than a vehicle makes in an hour; later ones are not taken
STALLED_VECTORS: Final = 2  # told in vain of one stretch: the next vector asks for the next stretch


class Holding:
    """The numbers of one log that are there."""

    __slots__ = ("_beyond", "_stalled", "_window", "_window_count", "given_up", "upto")

    def __init__(self, given_up: int = 0) -> None:
        """`given_up`: what is not there up to this number is not wanted any more."""
        self.given_up = given_up
        self.upto = given_up  # nothing is missing up to here
        self._beyond: set[int] = set()
        self._window = 0  # where the last vector's bitmap began,
        self._window_count = -1  # how much was there behind it,
        self._stalled = 0  # and for how many vectors nothing came of it

    @classmethod
    def of(cls, upto: int) -> Holding:
        """All up to this number, to be sent."""
        holding = cls()
        holding.upto = upto
        return holding

    def add(self, number: int) -> bool:
        """False: it is there already, or is too far ahead to be taken."""
        if not self.takes(number):
            return False
        self._beyond.add(number)
        self._advance()
        return True

    def takes(self, number: int) -> bool:
        """This number is not there, and may be added."""
        return number > self.upto and number not in self._beyond and number <= min(NUMBER_MAX, self.upto + AHEAD_MAX)

    def give_up(self, number: int) -> None:
        """Nothing up to `number` is wanted any more, or is there to be sent."""
        if number <= self.given_up:
            return
        self.given_up = number
        if number > self.upto:
            self.upto = number
            self._beyond = {ahead for ahead in self._beyond if ahead > number}
            self._advance()

    def _advance(self) -> None:
        while self.upto + 1 in self._beyond:
            self.upto += 1
            self._beyond.remove(self.upto)

    @property
    def last(self) -> int:
        """The highest number that was ever there."""
        return max(self._beyond, default=self.upto)

    def last_upto(self, most: int) -> int:
        """The highest number, `most` at most, that is there to be sent; 0: none."""
        number = max((ahead for ahead in self._beyond if ahead <= most), default=min(self.upto, most))
        return number if number > self.given_up else 0

    @property
    def count(self) -> int:
        """Count of those that are there, and of those that were given up."""
        return self.upto + len(self._beyond)

    def missing(self, last: int) -> Iterator[tuple[int, int]]:
        """Gaps up to the number `last`: the first and the last number of each."""
        first = self.upto + 1
        for number in sorted(self._beyond):
            if number > first:
                yield first, number - 1
            first = number + 1
        if first <= last:
            yield first, last

    def held(self, first: int, most: int) -> Iterator[int]:
        """The numbers that are there to be sent, from `first` on, at most `most` further."""
        for number in range(max(first, self.given_up + 1), min(first + most, self.last + 1)):
            if number <= self.upto or number in self._beyond:
                yield number

    def bits(self, window: int) -> int:
        """Bit k: number window + 1 + k is there."""
        found = 0
        for bit in range(BITMAP):
            number = window + 1 + bit
            if number <= self.upto or number in self._beyond:
                found |= 1 << bit
        return found

    def advance_window(self, known_last: int) -> int:
        """The number at which the bitmap of the next vector begins.

        At the first gap; where that is not filled (whoever had it is gone), stretch by stretch up to `known_last`, the
        highest number that anybody has told of, and again from the start: a gap that stays hides nothing behind it.
        """
        last = max(known_last, self.last)
        window = max(self._window, self.upto)
        count = self.bits(window).bit_count()
        has_moved = window != self._window or count != self._window_count
        self._stalled = 0 if has_moved else self._stalled + 1
        if count == BITMAP or self._stalled >= STALLED_VECTORS:
            window = self._gap_behind(window + BITMAP, last)
            self._stalled = 0
        self._window, self._window_count = window, self.bits(window).bit_count()
        return min(window, NUMBER_MAX - BITMAP)

    def _gap_behind(self, window: int, last: int) -> int:
        """The number before the first gap behind `window`; that before the first of all where there is none."""
        while window + 1 in self._beyond:
            window += 1
        return window if window < last else self.upto
