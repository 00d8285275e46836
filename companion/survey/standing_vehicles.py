"""Places at which vehicles stand in the air: to a level lidar a hull is a stem of 74 cm, and none is to be recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

APART_M: Final = 1.5  # of a stem's axis from such a place: a hull, and the errors of two positions
SAME_M: Final = 0.5  # a place so near to one that is held is that one, which has moved
HELD_S: Final = 60.0  # after it was told last: longer than a stem stays in sight (`rays.LONGEST_S`) and waits
PLACES_MAX: Final = 32  # the oldest go
Place = tuple[float, float]


@final
class StandingVehicles:
    """One vehicle's knowledge of them, level: north and east in the frame of the own odometry."""

    def __init__(self) -> None:
        self._held: list[tuple[Place, float]] = []  # and when it was told last, the oldest first

    def note(self, places: Sequence[Place], now_s: float) -> None:
        """Places that are known in this tick."""
        if not places and not self._held:
            return
        held = [
            (place, told_s)
            for place, told_s in self._held
            if now_s - told_s <= HELD_S and not any([_is_within(place, new, SAME_M) for new in places])
        ]
        self._held = [*held, *((place, now_s) for place in places)][-PLACES_MAX:]

    def is_near(self, north_m: float, east_m: float) -> bool:
        """True if one stands so near to an axis, or did while that was in sight, that it may be its hull."""
        return any([_is_within(place, (north_m, east_m), APART_M) for place, _ in self._held])


def _is_within(one: Place, other: Place, within_m: float) -> bool:
    n, e = one[0] - other[0], one[1] - other[1]
    return n * n + e * e <= within_m * within_m
