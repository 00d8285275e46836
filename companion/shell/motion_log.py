"""Whether trunks correct the own motion, for people: once, and then where that changes for long."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.states import Severity

UNSEEN_S: Final = 10.0  # nothing tells it for so long, though there is something to see: the operator is told
AGAIN_S: Final = 5.0  # and it is told for so long, until that is said
LOOKS_S: Final = 1.0  # so often it is asked whether there is something to see
CORRECTED: Final = "own motion: corrected by trunks in sight"
UNSEEN: Final = Say(Severity.WARNING, "own motion as reported: too few trunks in sight")


class MotionLog:
    """One vehicle's: `update` with each tick."""

    __slots__ = ("_line", "_looked_s", "_report", "_seen_since_s", "_told", "_unseen_s")

    def __init__(self, line: Callable[[float, str], None], report: Callable[[Say], None]) -> None:
        """`line`: takes what goes into the log; `report`: what the operator is told."""
        self._line: Final = line
        self._report: Final = report
        self._told: bool | None = None  # that it is corrected; None: nothing yet
        self._seen_since_s: float | None = None
        self._unseen_s = 0.0  # with something to see
        self._looked_s = -math.inf

    def update(
        self, now_s: float, *, is_corrected: bool, is_airborne: bool, sees_something: Callable[[], bool]
    ) -> None:
        """`sees_something`: something is within the sensor's range; not asked in each tick."""
        if is_corrected:
            self._unseen_s = 0.0
            if self._seen_since_s is None:
                self._seen_since_s = now_s
            if self._told is None or (self._told is False and now_s - self._seen_since_s >= AGAIN_S):
                self._told = True
                self._line(now_s, CORRECTED)
            return
        self._seen_since_s = None
        if not is_airborne:
            self._unseen_s = 0.0
        elif now_s - self._looked_s >= LOOKS_S:
            self._looked_s = now_s
            self._unseen_s += LOOKS_S if sees_something() else 0.0
            if self._unseen_s >= UNSEEN_S and self._told is not False:
                self._told = False
                self._report(UNSEEN)
