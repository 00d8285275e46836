"""The way round what bars the straight one, before a side is taken: by a search over all that was seen.

Courses alone look 8 m ahead: along a wall they take one side, turn, and take the other. Where a way round is longer
than the straight one the vehicle flies along it from as far away as it sees; elsewhere, in forests, as desired.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.guidance.search.known_places import KnownPlaces
from companion.core.guidance.search.path_search import find_way
from companion.core.perception.obstacle_memory import SeenBefore

SEARCH_S: Final = 0.5  # so often a way is searched, with what was seen meanwhile
LONGER_M: Final = 3.0  # than the straight way, from which it is a detour: round trunks it is less, and courses lead
TARGET_M: Final = 20.0  # along the desired, of one that follows
TARGET_MAX_M: Final = 60.0  # of one that leads: as far as it goes on
AHEAD_M: Final = 12.0  # along it, as far as it is straight
AIMED_M: Final = 0.7  # to the end of that: it is searched anew
DESIRED_LEAST_MPS: Final = 0.5


@final
class Detour:
    """One vehicle's. `lead` once in each plan."""

    __slots__ = ("_aim", "_side", "_since_s", "_wider_m")

    def __init__(self, wider_m: float) -> None:
        """`wider_m`: kept beyond each clearance: as much as free courses keep, or it leads to gaps that are none."""
        self._wider_m: Final = wider_m
        self.reset()

    def reset(self) -> None:
        """Forget the way, and its side."""
        self._aim: tuple[float, float] | None = None  # where it leads, in the frame of `pos`; None: no detour
        self._side = 0
        self._since_s = SEARCH_S  # since it was searched last

    def lead(
        self,
        desired: tuple[float, float],
        pos: tuple[float, float],
        reach_m: float,
        dt_s: float,
        seen: SeenBefore | None,
        known: KnownPlaces,
    ) -> tuple[float, float]:
        """The velocity (north, east, m/s) along the detour, as fast as desired; as desired where there is none.

        `pos`: own, level, of which only differences count; `reach_m`: how far it goes on, inf: it follows, below 0: it
        is there, and pushed; `seen`: all that was seen; `known`: what was not.
        """
        desired_mps = math.sqrt(desired[0] * desired[0] + desired[1] * desired[1])
        if seen is None or desired_mps < DESIRED_LEAST_MPS or reach_m <= 0.0:
            self.reset()
            return desired
        self._since_s += dt_s
        if self._since_s >= SEARCH_S:
            self._since_s = 0.0
            self._search(desired, desired_mps, pos, reach_m, seen, known)
        if self._aim is None:
            return desired
        n, e = self._aim[0] - pos[0], self._aim[1] - pos[1]
        away_m = math.sqrt(n * n + e * e)
        if away_m < AIMED_M:
            self._since_s = SEARCH_S
            return desired
        return desired_mps * n / away_m, desired_mps * e / away_m

    def _search(
        self,
        desired: tuple[float, float],
        desired_mps: float,
        pos: tuple[float, float],
        reach_m: float,
        seen: SeenBefore,
        known: KnownPlaces,
    ) -> None:
        share = (TARGET_M if math.isinf(reach_m) else min(reach_m, TARGET_MAX_M)) / desired_mps
        to_n, to_e = share * desired[0], share * desired[1]
        way = find_way(seen, (to_n, to_e), known, wider_m=self._wider_m, ahead_m=AHEAD_M, side=self._side)
        self._aim = None
        if way is None:  # courses, and the recovery from dead ends
            return
        if way.longer_m < LONGER_M:
            self._side = 0
            return
        self._aim = (pos[0] + way.aim[0], pos[1] + way.aim[1])
        self._side = 1 if to_n * way.aim[1] > to_e * way.aim[0] else -1
