"""The ranges that a vehicle's own radio measures: the newest to each neighbour, and those to be passed on."""

from __future__ import annotations

import math
from typing import Final, final

from mission.common.frames import Vec3

FRESH_S: Final = 0.3  # a range that is older says nothing of how near a neighbour is now
TELLS_MAX: Final = 16  # ranges in a beacon
MEASURED_S: Final = 5.0  # nobody takes off whose radio has not measured for longer: five ranges of the slowest radio


@final
class OwnRanges:
    """One vehicle's: `add` each as it is measured. Ids are the mission's."""

    __slots__ = ("_me", "_newest", "_unsent")

    def __init__(self, me: int) -> None:
        self._me = me
        self._newest: dict[int, tuple[float, float]] = {}  # metres, measured at
        self._unsent: list[tuple[int, float, float]] = []  # vehicle, metres, measured at

    def add(self, vehicle: int, metres: float, measured_s: float) -> None:
        """Of two vehicles one tells the others: the lower if the sum of their ids is even."""
        self._newest[vehicle] = (metres, measured_s)
        if (self._me < vehicle) == ((self._me + vehicle) % 2 == 0):
            self._unsent.append((vehicle, metres, measured_s))
            del self._unsent[:-TELLS_MAX]

    def take_unsent(self, now_s: float) -> tuple[tuple[int, float, float], ...]:
        """The ranges for the next beacon: vehicle, metres, age in seconds."""
        ranges = tuple([(vehicle, metres, now_s - at_s) for vehicle, metres, at_s in self._unsent])
        self._unsent.clear()
        return ranges

    def level_m(self, vehicle: int, down_m: float, now_s: float, within_s: float = FRESH_S) -> float:
        """The level distance to a neighbour `down_m` below; infinite: it was not measured within that time."""
        metres, measured_s = self._newest.get(vehicle, (0.0, -1e9))
        fresh = now_s - measured_s <= within_s and metres > abs(down_m)
        return math.sqrt(metres * metres - down_m * down_m) if fresh else math.inf

    def bring_near(self, vehicle: int, rel_ned_m: Vec3, now_s: float, slack_m: float = 0.0) -> Vec3:
        """A vehicle's position, in its direction at most `slack_m` farther off, level, than was measured lately.

        A range makes none farther: the same object comes back where it would.
        """
        north, east, down = rel_ned_m
        told_m, most_m = math.hypot(north, east), self.level_m(vehicle, down, now_s) + slack_m
        if most_m >= told_m:
            return rel_ned_m
        share = most_m / told_m
        return (share * north, share * east, down)

    def has_measured(self, now_s: float) -> bool:
        """It has measured a range lately, to whomever."""
        last_s = max([at_s for _, at_s in self._newest.values()], default=-math.inf)
        return now_s - last_s <= MEASURED_S
