"""The reason for which a vehicle waits on the ground or in the air, and since when."""

from __future__ import annotations

from typing import Final, final

WAIT_SAID_S: Final = 3.0  # an autopilot boots for longer than it is worth a word; its readiness may take 40 s


@final
class Waiting:
    """One vehicle's. `reason` in words; empty: it waits for nothing."""

    __slots__ = ("_announced", "_since_s", "reason")

    def __init__(self) -> None:
        self.reason = ""
        self._since_s = 0.0
        self._announced = False

    def clear(self) -> None:
        """It waits for nothing any more."""
        self.reason = ""

    def update(self, reason: str, now_s: float) -> bool:
        """Record why it waits now; True once for each reason, when it has lasted for WAIT_SAID_S."""
        if reason != self.reason:
            self.reason, self._since_s, self._announced = reason, now_s, False
        if self._announced or now_s - self._since_s < WAIT_SAID_S:
            return False
        self._announced = True
        return True

    def lasts_s(self, reason: str, now_s: float) -> float:
        """Time for which it has waited for that reason; 0 while it is another."""
        return now_s - self._since_s if self.reason == reason else 0.0
