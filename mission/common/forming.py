"""End of the coverage of a tree: its time is up, and the ring or sphere has formed.

The leader ends coverage by this, of the vehicles that it hears. The judge ends a flight that holds by it, of where all
vehicles truly are, and its verdict has the same limits.
"""

from __future__ import annotations

import math
from typing import Final

# On the ring or sphere: a real autopilot's hover wanders by up to 0.9 m, gusts and neighbours push
TOLERANCE_M: Final = 2.0
TOLERANCE_SHARE: Final = 0.1
FORMED_RATIO: Final = 1.5  # of gap to ideal: no vehicle is missing on a ring, and none half a place off
GAP_WINDOW_S: Final = 5.0  # long enough to average the hunting of the last metre
FORMING_LIMIT_S: Final = 60.0  # one that fell silent keeps its rank for 10 s, and 11 s is what a ring of 15 m takes
INSTANT_S: Final = 0.01  # less than any tick, more than times are rounded by


def ring_tolerance_m(radius_m: float) -> float:
    """Greatest distance from a ring or sphere of this radius of a vehicle that counts as on it; m."""
    return max(TOLERANCE_M, TOLERANCE_SHARE * radius_m)


class FormingTime:
    """The time at one tree. It counts as formed where nobody has noted that it is not."""

    __slots__ = ("_duration_s", "_since_s", "_unformed_s")

    def __init__(self, duration_s: float, since_s: float) -> None:
        self._duration_s, self._since_s = duration_s, since_s
        self._unformed_s = -math.inf  # when it was not formed last

    def is_near_end(self, now_s: float) -> bool:
        """From now on it counts whether it is formed."""
        return now_s - self._since_s >= self._duration_s - GAP_WINDOW_S

    def note_unformed(self, now_s: float) -> None:
        """It is not formed now."""
        self._unformed_s = now_s

    def has_formed(self, now_s: float) -> bool:
        """It has been formed for the last GAP_WINDOW_S, as far as was noted."""
        return now_s - self._unformed_s > GAP_WINDOW_S + INSTANT_S

    def is_over(self, now_s: float, *, changed_s: float = -math.inf) -> bool:
        """True when the time is up and it has been formed for the last GAP_WINDOW_S, or FORMING_LIMIT_S later.

        `changed_s`: where given, the limit counts from then, if that is later: a vehicle was lost, or came back.
        """
        over_s = now_s - self._since_s - self._duration_s
        if over_s < 0.0 or self._duration_s == 0.0:
            return over_s >= 0.0
        window_s = min(GAP_WINDOW_S, self._duration_s) + INSTANT_S  # the window's first tick, too
        return now_s - self._unformed_s > window_s or min(over_s, now_s - changed_s) >= FORMING_LIMIT_S
