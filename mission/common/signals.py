"""SIGINT and SIGTERM as a wish to stop, for programs that end at the next turn of their loop."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any


class Stop:
    """While it is entered, both signals ask to stop, and no longer interrupt."""

    def __init__(self) -> None:
        self.asked = False
        self._before: list[tuple[signal.Signals, Any]] = []

    def __enter__(self) -> Stop:
        self._before = [(n, signal.signal(n, self._note_signal)) for n in (signal.SIGINT, signal.SIGTERM)]
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)

    def _note_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
