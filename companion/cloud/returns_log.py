"""A flight's returns of stems go to their file beside the loop: what waits is bounded, what is lost is said once."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, Protocol

from companion.cloud.returns_file import ReturnsFile

WAITING_MAX: Final = 256  # passes: 7 MB; minutes of a survey
SUFFIX: Final = ".returns"  # beside the file of the records


class Writer(Protocol):
    """Writes passes, one lot at a time."""

    def submit(self, piece: Sequence[bytes]) -> bool:
        """False while another lot is under way."""

    def take_outcome(self) -> str | None:
        """Once: why it could not, empty: it is written; None: there is none yet."""


class DirectReturns:
    """While the loop waits."""

    def __init__(self, file: ReturnsFile) -> None:
        self._file: Final = file
        self._outcome: str | None = None

    def submit(self, piece: Sequence[bytes]) -> bool:
        """At once."""
        self._outcome = self._file.write(piece)
        return True

    def take_outcome(self) -> str | None:
        """As `Writer` has it."""
        outcome, self._outcome = self._outcome, None
        return outcome


class ReturnsLog:
    """`append` what a survey tells, in every tick."""

    def __init__(self, writer: Writer) -> None:
        self._writer: Final = writer
        self._waiting: Final[deque[bytes]] = deque(maxlen=WAITING_MAX)  # the oldest go
        self._under_way = 0  # passes
        self._error = ""
        self._lines: list[str] = []

    def append(self, passes: Sequence[bytes]) -> None:
        """Passes of stems, as `companion.cloud.returns` encodes them."""
        self._waiting.extend(passes)
        outcome = self._writer.take_outcome()
        if outcome is not None:
            self._under_way = 0
            if outcome != self._error:
                self._error = outcome
                self._lines.append(f"returns: {outcome}: LOST" if outcome else "returns: the disk takes them again")
        if self._waiting and self._writer.submit(tuple(self._waiting)):
            self._under_way = len(self._waiting)
            self._waiting.clear()

    def finish(self) -> int:
        """At the end, again and again until it is 0: passes that wait for the disk yet."""
        self.append(())
        return self._under_way + len(self._waiting)

    def take_lines(self) -> list[str]:
        """Lines for the log, since last asked."""
        lines, self._lines = self._lines, []
        return lines
