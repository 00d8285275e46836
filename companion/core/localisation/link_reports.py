"""The news of a bad radio for an operator: that many of the others' beacons are lost, and the end of that.

Of all that are heard, over a minute, so that a trunk's shadow is none; and with hysteresis.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.actions import Say
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import Severity

LOOK_S: Final = 1.0
LOOKS: Final = 60  # those of a minute
POOR: Final = 2.0 / 3.0  # share that arrives; below, silences are noticed later, and layers and waits become likely
GOOD: Final = 3.0 / 4.0


@final
class LinkReports:
    """One vehicle's. `update` each tick."""

    def __init__(self) -> None:
        self._shares: deque[float] = deque(maxlen=LOOKS)  # the mean over those heard, at each look
        self._due_s = -1e9
        self._is_poor = False  # as it was said last

    def update(self, neighbours: Sequence[Neighbour], now_s: float) -> list[Say]:
        """The news of this tick. With nobody heard there is none: that is said elsewhere."""
        if now_s < self._due_s or not neighbours:
            return []
        self._due_s = now_s + LOOK_S
        self._shares.append(sum([neighbour.share for neighbour in neighbours]) / len(neighbours))
        mean = sum(self._shares) / len(self._shares)
        if len(self._shares) < LOOKS or not (mean > GOOD if self._is_poor else mean < POOR):
            return []
        self._is_poor = not self._is_poor
        if self._is_poor:
            return [Say(Severity.WARNING, "radio poor: over a third of beacons lost")]
        return [Say(Severity.NOTICE, "radio good again: under a quarter lost")]
