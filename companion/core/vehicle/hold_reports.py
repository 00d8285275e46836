"""Reports of why a steered vehicle holds: each cause once each time that it begins to decide."""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.vehicle.failsafe import Cause, Finding

SETTLES_S: Final = 1.0  # one cut takes vehicles one after the other: words that name them would follow each


@final
class HoldReports:
    """One vehicle's. `update` each tick in which it is steered."""

    __slots__ = ("_due_s", "_said")

    def __init__(self) -> None:
        self._said: Finding | None = None
        self._due_s = math.inf  # when other words for the same cause are said

    def reset(self) -> None:
        """A new flight begins."""
        self._said, self._due_s = None, math.inf

    def update(self, found: Finding | None, now_s: float) -> Finding | None:
        """The finding to tell of now; late telemetry is told of in every state, by others."""
        if found == self._said:
            self._due_s = math.inf
            return None
        if found is not None and self._said is not None and found.cause is self._said.cause:
            self._due_s = min(self._due_s, now_s + SETTLES_S)
            if now_s < self._due_s:
                return None
        self._said, self._due_s = found, math.inf
        return None if found is None or found.cause is Cause.TELEMETRY_LATE else found
