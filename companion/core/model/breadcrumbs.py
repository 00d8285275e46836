"""The way that a vehicle has come, as places some metres apart: to go back along it.

Positions are NED m of the vehicle's own odometer. Crumbs are counted back from the newest, which is number 0.
"""

from __future__ import annotations

from typing import final

from companion.core.model.vectors import norm, sub
from mission.common.frames import Vec3


@final
class BreadcrumbTrail:
    """A bounded trail of crumbs, newest last; walked back by dropping the newest."""

    __slots__ = ("_crumbs", "_max_count", "_thins", "spacing_m")

    def __init__(self, spacing_m: float, max_count: int, *, thins: bool = False) -> None:
        """Of more than `max_count` crumbs the oldest is forgotten; `thins`: every second, and spacing doubles."""
        self.spacing_m = spacing_m  # a place nearer to the newest crumb leaves none
        self._max_count = max_count
        self._thins = thins
        self._crumbs: list[Vec3] = []

    @property
    def count(self) -> int:
        """Crumbs kept."""
        return len(self._crumbs)

    def crumb(self, number: int) -> Vec3:
        """The place of one crumb; IndexError where there is none."""
        return self._crumbs[-1 - number]

    def append(self, pos_ned_m: Vec3) -> bool:
        """Leave a crumb here; False: the newest is too near."""
        crumbs = self._crumbs
        if crumbs and norm(sub(pos_ned_m, crumbs[-1])) < self.spacing_m:
            return False
        crumbs.append(pos_ned_m)
        if len(crumbs) > self._max_count:
            if self._thins:
                del crumbs[1::2]
                self.spacing_m *= 2.0
            else:
                del crumbs[0]
        return True

    def drop(self, count: int) -> None:
        """Forget the newest `count`."""
        if count > 0:
            del self._crumbs[-count:]

    def drop_loops(self, pos_ned_m: Vec3, loop_m: float) -> None:
        """Forget all that follows the first crumb that is, but for `loop_m`, as near to here as any."""
        away_m = self._distances_m(pos_ned_m, len(self._crumbs))
        for index, metres in enumerate(away_m):
            if metres <= min(away_m) + loop_m:
                del self._crumbs[index + 1 :]
                return

    def nearest(self, pos_ned_m: Vec3, among: int) -> tuple[int, float] | None:
        """Of the newest `among` crumbs the number of the nearest, and how far it is in metres; None: no crumbs."""
        away_m = self._distances_m(pos_ned_m, among)
        if not away_m:
            return None
        least_m = min(away_m)
        return len(away_m) - 1 - away_m.index(least_m), least_m

    def reached(self, pos_ned_m: Vec3, within_m: float, among: int) -> int:
        """Number of the newest `among` crumbs that are passed: up to the oldest of them that is `within_m` of here."""
        away_m = self._distances_m(pos_ned_m, among)
        for index, metres in enumerate(away_m):
            if metres <= within_m:
                return len(away_m) - index
        return 0

    def count_within(self, pos_ned_m: Vec3, way_m: float) -> int:
        """Number of the newest crumbs that lie on the first `way_m` of the way back from here."""
        crumbs = self._crumbs
        gone_m, here = 0.0, pos_ned_m
        for number in range(len(crumbs)):
            crumb = crumbs[-1 - number]
            gone_m += norm(sub(here, crumb))
            if gone_m > way_m:
                return number
            here = crumb
        return len(crumbs)

    def length_m(self, pos_ned_m: Vec3) -> float:
        """The way back from here to the oldest crumb."""
        crumbs = self._crumbs
        total_m = norm(sub(pos_ned_m, crumbs[-1])) if crumbs else 0.0
        for k in range(1, len(crumbs)):
            total_m += norm(sub(crumbs[k], crumbs[k - 1]))
        return total_m

    def _distances_m(self, pos_ned_m: Vec3, among: int) -> list[float]:
        """From here to the newest `among` crumbs, older ones first."""
        crumbs = self._crumbs
        return [norm(sub(crumb, pos_ned_m)) for crumb in crumbs[max(0, len(crumbs) - among) :]]
