"""Room to land: nobody flies or hovers in the column of a descent, and nothing that was seen stands close beside it.

A place at which others alone say that one hovers delays a descent (`TOLD_LIMIT_S`): one member's word ends no battery.
An autopilot that lands holds its position by its estimate alone, and wanders by up to 0.9 m (recorded PX4): a vehicle
that has room beside it first moves there (`LANDING_ROOM_M`), for as long as `ROOM_LIMIT_S`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour, find_hover_places, find_told_places
from mission.common.frames import Vec3
from mission.document.model import Mission

SPREAD_DONE_SHARE: Final = 0.8  # of the soft separation, level, before a descent
LANDING_ROOM_M: Final = 1.7  # from what was seen to the middle: a hull, 0.9 m of wander, and what the map errs
ROOM_LIMIT_S: Final = 15.0  # then it lands where it is: a battery that ends is no better
# For so long a place that others tell bars a descent: it cannot push, so who waits for it would wait for good
TOLD_LIMIT_S: Final = 60.0
AGAIN_S: Final = 1.0  # not asked for so long: another landing


def is_clear_below(
    neighbours: Sequence[Neighbour], hover_ned_m: Sequence[Vec3], *, soft_m: float, hard_m: float
) -> bool:
    """No vehicle flies or hovers above or below. `hover_ned_m`: where some hover silent, relative.

    `soft_m`, `hard_m`: the mission's separation.
    """
    clear_m = SPREAD_DONE_SHARE * soft_m
    flies = all(math.hypot(n.rel_ned_m[0], n.rel_ned_m[1]) >= clear_m for n in neighbours)
    return flies and all(math.hypot(rel[0], rel[1]) >= hard_m for rel in hover_ned_m)


@final
class LandingRoom:
    """One vehicle's, while it is to land: asked each tick."""

    __slots__ = ("_asked_s", "_hard_m", "_since_s", "_soft_m")

    def __init__(self, mission: Mission) -> None:
        self._soft_m: Final = mission.separation.soft_m
        self._hard_m: Final = mission.separation.hard_m
        self._since_s = self._asked_s = -math.inf

    def is_clear(
        self, neighbours: Sequence[Neighbour], silent: Mapping[int, PeerReport], nearest_m: float, now_s: float
    ) -> bool:
        """Nobody is above or below, and nothing seen too near, or it has waited. `nearest_m`: to what was seen."""
        if now_s - self._asked_s > AGAIN_S:
            self._since_s = now_s
        self._asked_s = now_s
        waited_s = now_s - self._since_s
        has_room = nearest_m >= LANDING_ROOM_M or waited_s >= ROOM_LIMIT_S
        places = find_hover_places(silent.values())
        if waited_s >= TOLD_LIMIT_S:
            told = find_told_places(silent.values())
            places = [rel for rel in places if rel not in told]
        return has_room and is_clear_below(neighbours, places, soft_m=self._soft_m, hard_m=self._hard_m)
