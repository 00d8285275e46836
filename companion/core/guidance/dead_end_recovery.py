"""Out of a dead end: by a way over all that was seen; where there is none, to a side, then back and to the other.

Level and by odometry: of the own reported positions only differences count.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.guidance.search.known_places import NOTHING, KnownPlaces
from companion.core.guidance.search.path_search import find_way
from companion.core.model.breadcrumbs import BreadcrumbTrail
from companion.core.perception.obstacle_memory import SeenBefore

DESIRED_LEAST_MPS: Final = 0.5  # a vehicle that desires less is not stuck
BLOCKED_M: Final = 3.0  # nor is one that had so much free way ahead all the time: it gives way to others
PATIENCE_S: Final = 3.0
SEARCH_S: Final = 0.5  # a way is searched anew so often, with what was seen meanwhile
SEARCH_MAX_S: Final = 90.0
TARGET_M: Final = 20.0  # along the desired, to which a way is searched
WAY_MPS: Final = 1.5  # along it
WAY_GAINED_M: Final = 2.0  # more than when it was stuck, with free way ahead: it is out
PROGRESS_M: Final = 1.0  # in that time, along the desired: to and fro is none
FORGET_M: Final = 12.0  # after so much more of the desired way the next dead end is another one
ASIDE_RAD: Final = 1.2  # of the desired, while it is committed
ASIDE_S: Final = 4.0  # and as much again for each time before
BACK_M: Final = 5.0  # of the own way, the same
BACK_MPS: Final = 1.5
CRUMB_M: Final = 1.0
CRUMBS_MAX: Final = 60
REACHED_M: Final = 0.7


@final
class DeadEndRecovery:
    """One vehicle's. `redirect` once in each plan."""

    __slots__ = (
        "_aside_s",
        "_back_m",
        "_blocked",
        "_gained_m",
        "_here",
        "_most_m",
        "_searched_s",
        "_side",
        "_since_s",
        "_times",
        "_trail",
        "_waited_s",
        "_way",
    )

    def __init__(self) -> None:
        self.reset()
        self._trail = BreadcrumbTrail(CRUMB_M, CRUMBS_MAX)  # level: down is 0

    def reset(self) -> None:
        """Not steered: it begins anew, but knows the way it came."""
        self._times = 0  # how often it was stuck here
        self._side = 0
        self._aside_s = self._back_m = self._waited_s = 0.0
        self._gained_m = self._most_m = 0.0  # along what it desired since it was stuck last: now, and at most
        self._blocked = False  # by trunks, while it waits
        self._here: tuple[float, float] | None = None
        self._way: tuple[float, float] | None = None  # the direction of a way that is flown; None: none is
        self._searched_s = self._since_s = 0.0  # since it is flown, and since it was searched last

    @property
    def follows_way(self) -> bool:
        """It flies a way that was found."""
        return self._way is not None

    def redirect(
        self,
        desired: tuple[float, float],
        pos: tuple[float, float],
        side: int,
        ahead_m: float,
        dt_s: float,
        seen: SeenBefore | None = None,
        known: KnownPlaces = NOTHING,
    ) -> tuple[float, float]:
        """The velocity to fly instead, (north, east) m/s; the same while the vehicle gets on.

        `side`: -1 left, 1 right, on which it passes trunks, 0: none; `ahead_m`: free way along the desired; `seen`: all
        that was seen; `known`: what was not.
        """
        desired_mps = math.sqrt(desired[0] * desired[0] + desired[1] * desired[1])
        moved_m = self._move(pos, desired, desired_mps)
        if desired_mps < DESIRED_LEAST_MPS:
            self._waited_s, self._blocked = 0.0, False
            return desired
        if self._way is not None:
            along = self._follow_way(desired, side, ahead_m, dt_s, seen, known)
            if along is not None:
                return along
        if self._back_m > 0.0:
            back = self._retrace(pos, moved_m)
            if back is not None:
                return back
        if self._aside_s > 0.0:
            self._aside_s -= dt_s
            turn = self._side * ASIDE_RAD
            cos, sin = math.cos(turn), math.sin(turn)
            return (desired[0] * cos - desired[1] * sin, desired[0] * sin + desired[1] * cos)
        if self._is_stuck(ahead_m, dt_s) and not self._begin_way(desired, seen, known):
            self._commit(side)
        return desired

    def _begin_way(self, desired: tuple[float, float], seen: SeenBefore | None, known: KnownPlaces) -> bool:
        """Searches for a way; False: there is none."""
        self._searched_s = self._since_s = 0.0
        self._way = self._search(desired, seen, known)
        return self._way is not None

    def _search(
        self, desired: tuple[float, float], seen: SeenBefore | None, known: KnownPlaces
    ) -> tuple[float, float] | None:
        if seen is None:
            return None
        share = TARGET_M / math.sqrt(desired[0] * desired[0] + desired[1] * desired[1])
        way = find_way(seen, (share * desired[0], share * desired[1]), known)
        if way is None:
            return None
        away_m = math.hypot(way.aim[0], way.aim[1])
        return way.aim[0] / away_m, way.aim[1] / away_m

    def _follow_way(
        self,
        desired: tuple[float, float],
        side: int,
        ahead_m: float,
        dt_s: float,
        seen: SeenBefore | None,
        known: KnownPlaces,
    ) -> tuple[float, float] | None:
        """Along the way; None: it is out, or there is none any more."""
        self._searched_s += dt_s
        self._since_s += dt_s
        is_out = self._gained_m > self._most_m + WAY_GAINED_M and ahead_m >= BLOCKED_M
        if is_out or self._searched_s > SEARCH_MAX_S:
            self._way = None
            self._most_m = max(self._most_m, self._gained_m)
            if not is_out:  # what bars it is not among what was seen: another vehicle, a fence
                self._commit(side)
            return None
        if self._since_s >= SEARCH_S:
            self._since_s = 0.0
            self._way = self._search(desired, seen, known)
        if self._way is None:
            return None
        speed_mps = min(WAY_MPS, math.sqrt(desired[0] * desired[0] + desired[1] * desired[1]))
        return (speed_mps * self._way[0], speed_mps * self._way[1])

    def _move(self, pos: tuple[float, float], desired: tuple[float, float], desired_mps: float) -> float:
        """Returns the metres since the last plan; leaves crumbs, but not while it goes back."""
        here = self._here
        self._here = pos
        if here is None:
            return 0.0
        d_n, d_e = pos[0] - here[0], pos[1] - here[1]
        if desired_mps >= DESIRED_LEAST_MPS:
            self._gained_m += (d_n * desired[0] + d_e * desired[1]) / desired_mps
            if self._gained_m > FORGET_M:
                self._times, self._gained_m, self._most_m = 0, 0.0, 0.0
        if self._back_m <= 0.0:
            self._trail.append((pos[0], pos[1], 0.0))
        return math.sqrt(d_n * d_n + d_e * d_e)

    def _retrace(self, pos: tuple[float, float], moved_m: float) -> tuple[float, float] | None:
        self._back_m -= moved_m
        trail = self._trail
        while trail.reached((pos[0], pos[1], 0.0), REACHED_M, 1):
            trail.drop(1)
        if not trail.count or self._back_m <= 0.0:
            self._back_m = 0.0
            return None
        crumb = trail.crumb(0)
        to_n, to_e = crumb[0] - pos[0], crumb[1] - pos[1]
        share = BACK_MPS / math.sqrt(to_n * to_n + to_e * to_e)
        return (share * to_n, share * to_e)

    def _is_stuck(self, ahead_m: float, dt_s: float) -> bool:
        """It has gained nothing for PATIENCE_S, with trunks ahead."""
        if self._gained_m > self._most_m + PROGRESS_M:
            self._most_m, self._waited_s, self._blocked = self._gained_m, 0.0, False
            return False
        self._waited_s += dt_s
        self._blocked = self._blocked or ahead_m < BLOCKED_M
        if self._waited_s < PATIENCE_S or not self._blocked:
            return False
        self._waited_s, self._blocked = 0.0, False
        self._most_m = self._gained_m
        return True

    def _commit(self, side: int) -> None:
        """To the side it is on; the next time back, and to the other."""
        self._times += 1
        if self._times == 1:
            self._side = side or 1
        else:
            self._side, self._back_m = -self._side, BACK_M * (self._times - 1)
        self._aside_s = ASIDE_S * self._times
