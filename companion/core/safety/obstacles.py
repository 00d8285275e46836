"""What stands in the way: the mission's own trunks, and vehicles that hang in the air and do not give way.

What an obstacle sensor sees is in `scan_map`.

d2 is a goal and no obstacle: the trunk beside which the swarm gathers stands there because the mission says so, and is
one obstacle among others. Positions are relative to this vehicle, NED metres, unless a name says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from companion.core.model.beacon import PeerReport
from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import sub
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import CoverageShape, Mission

PAUSE_S: Final = 2.5  # after the last word of one that falls silent: it may fly on without a word until it has stopped
SPREAD_DONE_SHARE: Final = 0.8  # of the soft separation, level, before a descent


class Obstacle(NamedTuple):
    """What stands still: where from the vehicle (NED m), and how far from it one passes."""

    rel_ned_m: Vec3
    clear_m: float
    upright: bool = False  # a trunk: at every height


@dataclass(frozen=True, slots=True)
class Trunk:
    """A tree that the mission knows of."""

    pos_ned_m: Vec3  # about the mission's origin
    keep_out_m: float
    upright: bool  # it stands from the ground up: keep out level, not in three dimensions

    def seen_from(self, pos_ned_m: Vec3) -> Vec3:
        """Vector from a position (NED m about the mission's origin) to it."""
        return sub(self.pos_ned_m, pos_ned_m)


def trunks(mission: Mission) -> tuple[Trunk, ...]:
    """Those of a mission: the one at d2, and those at the stops before it."""
    upright = mission.coverage.shape is CoverageShape.RING
    keep_out_m = mission.coverage.keep_out_m
    return tuple([Trunk(enu_to_ned(visit.pos_enu_m), keep_out_m, upright) for visit in mission.visits])


def standing(silent: Mapping[int, PeerReport], neighbours: Sequence[Neighbour]) -> dict[int, PeerReport]:
    """By id, vehicles in the air that no companion steers: those that fell silent, and those that are heard there."""
    found = dict(silent)
    for n in neighbours:
        if n.stands:
            found[n.id] = PeerReport(n.id, n.rel_ned_m, n.age_s, silent=False)
    return found


def pauses(standing: Mapping[int, PeerReport]) -> bool:
    """A vehicle that was heard here has just fallen silent: it may not have stopped yet, nor be where it is reckoned.

    No vehicle moves on until it has. What others tell does not count: a false word would hold the swarm for ever.
    """
    return any(s.silent and not s.told and s.age_s < PAUSE_S for s in standing.values())


def is_clear_below(
    neighbours: Sequence[Neighbour], silent: Mapping[int, PeerReport], *, soft_m: float, hard_m: float
) -> bool:
    """No vehicle flies or hangs above or below. `soft_m`, `hard_m`: the mission's separation."""
    clear_m = SPREAD_DONE_SHARE * soft_m
    flies = all(math.hypot(n.rel_ned_m[0], n.rel_ned_m[1]) >= clear_m for n in neighbours)
    return flies and all(math.hypot(s.rel_ned_m[0], s.rel_ned_m[1]) >= hard_m for s in silent.values())
