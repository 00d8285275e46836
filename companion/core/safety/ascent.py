"""Room to climb: a takeoff is its autopilot's, which flies straight up, as it believes, and gives way to nobody.

A vehicle that is steered gives way to one that climbs from below it (`safety_filter`), unless it is so near above that
it cannot in time. One that hovers without its companion, or lands, does not: it is waited for until it is gone. So is a
place at which others alone say that one hovers, but for no longer than `TOLD_LIMIT_S`: else one member's word would
keep a vehicle on the ground for good.

Two that rise beside each other drift: an autopilot leaves the ground by a velocity that is wrong, or by an odometer. So
one that is up high enough to be steered has room only as far from the others as the safety filter keeps them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, final

from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import CLIMBING
from companion.core.perception.obstacle_cloud import ObstacleKind
from companion.core.safety.clearance import MARGIN_M, Use, clearance_m
from mission.common.frames import Vec3
from mission.document.model import Mission

TOLD_LIMIT_S: Final = 60.0
# Of the hard separation, level: over a climb to 4 m one gave way from 2 m to 3.4 m, from 2.6 m to 4.2 m
STEERED_SHARE: Final = 0.5
AGAIN_S: Final = 1.0  # not asked for so long: another takeoff


@final
class ClimbRoom:
    """One vehicle's, while it is to take off: asked each tick."""

    __slots__ = ("_asked_s", "_heard_m", "_silent_m", "_since_s", "_steerable_up_m", "_steered_m")

    def __init__(self, mission: Mission) -> None:
        self._heard_m: Final = clearance_m(ObstacleKind.NEIGHBOUR, Use.FILTER, mission.separation.hard_m)
        self._steered_m: Final = STEERED_SHARE * mission.separation.hard_m
        self._silent_m: Final = clearance_m(ObstacleKind.SILENT, Use.FILTER, mission.separation.hard_m)
        self._steerable_up_m: Final = mission.fence.altitude_min_m + MARGIN_M
        self._since_s = self._asked_s = -math.inf

    def is_clear(
        self, neighbours: Sequence[Neighbour], silent: Mapping[int, PeerReport], own: Position | None, now_s: float
    ) -> bool:
        """Nobody is in the air above, or what others alone tell has been waited for. `own`: of one in the air.

        There it is clear where nobody that flies is nearer than the filter keeps, or it is too low to be steered.
        """
        if own is not None:
            is_low = -own.pos_ned_m[2] < self._steerable_up_m
            return is_low or all([n.distance_m >= self._heard_m for n in neighbours if n.beacon.airborne])
        if now_s - self._asked_s > AGAIN_S:
            self._since_s = now_s
        self._asked_s = now_s
        for n in neighbours:
            within_m = self._steered_m if n.gives_way else self._heard_m
            is_beside = n.beacon.state in CLIMBING or not n.beacon.airborne
            if not is_beside and _is_above(n.rel_ned_m, within_m):
                return False
        minds_told = now_s - self._since_s < TOLD_LIMIT_S
        for report in silent.values():
            if (minds_told or not report.received) and _is_above(report.rel_ned_m, self._silent_m):
                return False
            if minds_told and any([_is_above(rel, self._silent_m) for rel in report.elsewhere]):
                return False
        return True


def _is_above(rel_ned_m: Vec3, within_m: float) -> bool:
    return rel_ned_m[2] < 0.0 and math.hypot(rel_ned_m[0], rel_ned_m[1]) < within_m
