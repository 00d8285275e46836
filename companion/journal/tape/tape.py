"""Answers of one tick in their order, and those of a recorded one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, Final

Answer = list[Any]  # of what CBOR holds; the first value is its name
YES, NO = 1, 0
CODES: Final = 2  # verdicts from here on: refused, and why


class TapeError(Exception):
    """A replay asks what the recorded endpoint did not, or has another record."""


class Tape:
    """Answers of one tick: verdicts (a byte each), and lists, each in their order."""

    def __init__(self) -> None:
        self._verdicts = bytearray()
        self._lists: list[Answer] = []

    def put_verdict(self, verdict: int) -> None:
        """One more."""
        self._verdicts.append(verdict)

    def put_list(self, answer: Answer) -> None:
        """One more."""
        self._lists.append(answer)

    def count_verdicts(self) -> int:
        """The number of verdicts since last asked for them."""
        return len(self._verdicts)

    def cut_verdicts(self, count: int) -> bytes:
        """The verdicts behind the first `count`, which are taken off: to be put later."""
        verdicts = bytes(self._verdicts[count:])
        del self._verdicts[count:]
        return verdicts

    def put_verdicts(self, verdicts: bytes) -> None:
        """Verdicts that were cut off."""
        self._verdicts += verdicts

    def take_verdicts(self) -> bytes:
        """The verdicts since last asked."""
        verdicts = bytes(self._verdicts)
        self._verdicts.clear()
        return verdicts

    def take_lists(self) -> list[Answer]:
        """The lists since last asked."""
        answers, self._lists = self._lists, []
        return answers


class PlayedTape(Tape):
    """Answers that were recorded, in their order."""

    def __init__(self) -> None:
        super().__init__()
        self._verdicts_left: deque[int] = deque()
        self._lists_left: deque[Answer] = deque()

    def load_answers(self, verdicts: bytes, lists: Iterable[Answer]) -> None:
        """The answers of the next tick. TapeError: the last one has asked for fewer."""
        left = len(self._verdicts_left) + len(self._lists_left)
        if left:
            raise TapeError(f"{left} answers were asked for in the tick before then, and are not now")
        self._verdicts_left.extend(verdicts)
        self._lists_left.extend(lists)

    def next_verdict(self) -> int:
        """The next one. TapeError: there is none."""
        if not self._verdicts_left:
            raise TapeError("a verdict more is asked for than then")
        return self._verdicts_left.popleft()

    def next_list(self, name: str) -> list[Any]:
        """The next list, of this name. TapeError: there is none, or another."""
        if not self._lists_left:
            raise TapeError(f"{name}: is asked for, and was not then")
        answer = self._lists_left.popleft()
        if answer[:1] != [name]:
            raise TapeError(f"{name}: is asked for; then it was {answer!r:.40}")
        return answer[1:]
