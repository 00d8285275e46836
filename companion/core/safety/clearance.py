"""Clearances: how far out an obstacle is kept from, in one function for planner, safety filter, choice of positions.

To what an obstacle has of its own (a trunk's keep-out, the vehicles' hard separation, the radius with its margin) comes
what a use adds. Who plans keeps more clear than the filter cuts at, else a planned course is cut, and stands.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from companion.core.perception.obstacle_cloud import ObstacleKind

MARGIN_M: Final = 0.3  # beyond each limit: for lag, and for what gusts push
SILENT_STRAY_M: Final = 0.5  # one that hovers silent is only reckoned to be where it is
PASSING_M: Final = 0.4  # more than the filter keeps, in passing: a course that is planned is not cut
STAY_MARGIN_M: Final = (
    1.0  # more than MARGIN_M for a position to stay: above what it takes to pass one that hovers there
)
GUSTS_M: Final = 0.5  # more than is kept from a scanned trunk in passing, for a position to stay: no wind drives it off
TREE_M: Final = 1.0  # from the tree at d2 for those that pass it before their leader comes to stand there
CORRIDOR_M: Final = 1.2  # from where one that is hidden may fly by now


class Use(IntEnum):
    """Use of a clearance."""

    FILTER = 0  # cuts what is desired
    PLAN = 1  # leads a course past
    STAY = 2  # picks a position to hover in
    PASS = 3  # is pushed aside on the way


# Added in this order, to the bit. A neighbour heard is bounded by its speed and the age of its beacon besides.
# HOVERING is planned round as SILENT is, though its own beacons tell where it is, and the filter keeps no stray of it:
# it may fall silent on the way past, and then the filter keeps that much from it, too.
ADDED_M: Final[dict[tuple[ObstacleKind, Use], tuple[float, ...]]] = {
    (ObstacleKind.FENCE, Use.FILTER): (MARGIN_M,),
    (ObstacleKind.FENCE, Use.PLAN): (MARGIN_M,),
    (ObstacleKind.TRUNK, Use.FILTER): (MARGIN_M,),
    (ObstacleKind.TRUNK, Use.PLAN): (MARGIN_M, PASSING_M),
    (ObstacleKind.TRUNK, Use.PASS): (TREE_M,),
    (ObstacleKind.NEIGHBOUR, Use.FILTER): (MARGIN_M,),
    (ObstacleKind.SILENT, Use.FILTER): (MARGIN_M, SILENT_STRAY_M),
    (ObstacleKind.SILENT, Use.PLAN): (MARGIN_M, SILENT_STRAY_M, PASSING_M),
    (ObstacleKind.SILENT, Use.STAY): (MARGIN_M, STAY_MARGIN_M),
    (ObstacleKind.HOVERING, Use.FILTER): (MARGIN_M,),
    (ObstacleKind.HOVERING, Use.PLAN): (MARGIN_M, SILENT_STRAY_M, PASSING_M),
    (ObstacleKind.HOVERING, Use.STAY): (MARGIN_M, STAY_MARGIN_M),
    (ObstacleKind.SCANNED, Use.FILTER): (),  # its margin is the mission's: sensing.margin_m
    (ObstacleKind.SCANNED, Use.PLAN): (),  # the planner verifies by the filter's own model, and widens in gusts
    (ObstacleKind.SCANNED, Use.STAY): (GUSTS_M,),
    (ObstacleKind.HIDDEN, Use.PASS): (CORRIDOR_M,),
}


def clearance_m(kind: ObstacleKind, use: Use, extent_m: float = 0.0) -> float:
    """From its middle; `extent_m`: what the obstacle has of its own. KeyError: nobody uses that."""
    for added_m in ADDED_M[kind, use]:
        extent_m += added_m
    return extent_m
