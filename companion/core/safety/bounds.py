"""Bounds on a velocity, each along one direction: of the velocities that keep them, the one nearest to another.

And the polygon of a fence, of whose sides some of the bounds are made. Level, (north, east) metres in order round it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from companion.core.model.vectors import ZERO, add, dot, limit, scale, sub
from mission.common.frames import Vec3

PASSES: Final = 8  # over the bounds: one cut may break another
TOLERANCE_MPS: Final = 0.01  # to which bounds are kept
RELAXATIONS: Final = 5  # halvings, in search of the least that bounds which contradict one another must give


@final
class Bound:
    """The most speed (m/s) along a direction (unit vector). No dataclass, as `Neighbour`."""

    __slots__ = ("along", "most_mps")

    def __init__(self, along: Vec3, most_mps: float) -> None:
        self.along: Final = along
        self.most_mps: Final = most_mps


def to_commanded(bounds: list[Bound], drift_ned_mps: Vec3) -> list[Bound]:
    """Bounds of the true velocity as bounds of the commanded one."""
    if drift_ned_mps == ZERO:
        return bounds
    return [Bound(bound.along, bound.most_mps - dot(bound.along, drift_ned_mps)) for bound in bounds]


def find_nearest(desired: Vec3, limits: Sequence[Bound], separations: Sequence[Bound]) -> Vec3:
    """Near `desired`, within all bounds; where they contradict one another, near rest and within `limits` at least."""
    v = keep_within(desired, [*separations, *limits])
    if holds(v, separations) and holds(v, limits):
        return v
    v = keep_within(ZERO, limits)
    if not holds(v, limits):
        return ZERO
    # Who is to be got away from gives first: its word, which may be false, moves nobody at a third vehicle.
    found = _relax(separations, limits, gives_all=False)
    if found is None:
        found = _relax(separations, limits, gives_all=True)
    return v if found is None else found


def _relax(separations: Sequence[Bound], limits: Sequence[Bound], *, gives_all: bool) -> Vec3 | None:
    """Near rest, within all bounds when those of `separations` give as little as can be; None: there is no such.

    `gives_all`: else those that ask to get away, and no further than to rest.
    """
    found: Vec3 | None = None
    low, high = 0.0, max((-bound.most_mps for bound in separations), default=0.0)
    give_mps = high
    for _ in range(RELAXATIONS + 1 if high > 0.0 else 0):
        relaxed = [
            Bound(bound.along, bound.most_mps + give_mps if gives_all else min(bound.most_mps + give_mps, 0.0))
            if gives_all or bound.most_mps < 0.0
            else bound
            for bound in separations
        ]
        tried = keep_within(ZERO, [*relaxed, *limits])
        if holds(tried, relaxed) and holds(tried, limits):
            found, high = tried, give_mps
        elif give_mps == high:
            return None
        else:
            low = give_mps
        give_mps = (low + high) / 2.0
    return found


def step_towards(v: Vec3, last: Vec3, bounds: Sequence[Bound], step_mps: float) -> Vec3:
    """As far towards `v` as one tick goes: from `last`, shortened as far as the bounds demand."""
    share = 1.0
    for bound in bounds:
        # A bound that others have overruled asks for no more than `v` has of it.
        along_mps, most_mps = dot(last, bound.along), max(max(bound.most_mps, 0.0), dot(v, bound.along))
        if along_mps > most_mps:
            share = min(share, most_mps / along_mps)
    start = scale(last, share)
    return add(start, limit(sub(v, start), step_mps))


def holds(v: Vec3, bounds: Sequence[Bound]) -> bool:
    """`v` keeps them, to TOLERANCE_MPS."""
    return all(dot(v, bound.along) <= bound.most_mps + TOLERANCE_MPS for bound in bounds)


def keep_within(v: Vec3, bounds: Sequence[Bound]) -> Vec3:
    """`v` with each component along a bound's direction cut to its most, in turn; the later bounds win."""
    x, y, z = v
    for _ in range(PASSES):  # the hottest loop of a tick: `dot`, `sub` and `scale` written out
        within = True
        for bound in bounds:
            along_x, along_y, along_z = bound.along
            excess_mps = x * along_x + y * along_y + z * along_z - bound.most_mps
            if excess_mps > 0.0:
                x, y, z = x - along_x * excess_mps, y - along_y * excess_mps, z - along_z * excess_mps
                within = within and excess_mps <= TOLERANCE_MPS / 4.0
        if within:
            break
    return (x, y, z)


def to_edges(pos_ned_m: Vec3, polygon: Sequence[tuple[float, float]]) -> list[Vec3]:
    """As `to_edge`, of each of its sides in order."""
    return [to_edge(pos_ned_m, polygon[k], polygon[(k + 1) % len(polygon)]) for k in range(len(polygon))]


def to_edge(pos_ned_m: Vec3, a: tuple[float, float], b: tuple[float, float]) -> Vec3:
    """Level vector from a position to the nearest point of side a-b."""
    along = (b[0] - a[0], b[1] - a[1])
    t = ((pos_ned_m[0] - a[0]) * along[0] + (pos_ned_m[1] - a[1]) * along[1]) / (along[0] ** 2 + along[1] ** 2)
    t = max(0.0, min(1.0, t))
    return (a[0] + t * along[0] - pos_ned_m[0], a[1] + t * along[1] - pos_ned_m[1], 0.0)


def is_inside(north_m: float, east_m: float, polygon: Sequence[tuple[float, float]]) -> bool:
    """Even-odd rule."""
    inside = False
    for k in range(len(polygon)):  # this runs in every tick
        (n0, e0), (n1, e1) = polygon[k - 1], polygon[k]
        if (e0 > east_m) != (e1 > east_m) and north_m < (n1 - n0) * (east_m - e0) / (e1 - e0) + n0:
            inside = not inside
    return inside
