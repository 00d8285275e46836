"""Contacts of vehicles: with one another, trunks, crowns, boxes, and the ground where they do not land."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from mission.common.frames import Vec3
from mission.document.model import VEHICLE_RADIUS_M
from mission.stand.stand import Stand, StandBox

CELL_M: Final = 2.0
WAY_M: Final = 1.0  # of one step: 20 m/s
HARD_LEVEL_MPS: Final = 1.0  # landing, a vehicle drifts less; faster its legs catch, and it turns over
HARD_DOWN_MPS: Final = 2.5  # autopilots come down to land at 1.5 at most

# North and east of the axis, how near it a centre touches the trunk, the top (up); radius of the crown, its base (up)
Tree = tuple[float, float, float, float, float, float]


class Touched(StrEnum):
    """Obstacle that a vehicle has run into."""

    TRUNK = "trunk"
    CROWN = "crown"
    GROUND = "ground"
    VEHICLE = "vehicle"
    BOX = "box"


@dataclass(frozen=True, slots=True)
class _Was:
    pos_ned_m: Vec3
    vel_ned_mps: Vec3
    on_ground: bool


class Contacts:
    """Looks at each vehicle at every step, along the way that it has come since.

    A trunk or a box is touched by a vehicle nearer than `reach_m` to its surface and not above its top. A
    crown, an upright cylinder, when its centre is inside: the propellers are among twigs then. The ground by one that
    comes down on it faster than a landing. Undergrowth is not: propellers cut through it, or the vehicle stands in it.
    """

    def __init__(self, stand: Stand, *, reach_m: float = VEHICLE_RADIUS_M, ground: bool = True) -> None:
        """`ground`: whether a hard touch of the ground counts."""
        self._stand = stand
        self._reach_m = reach_m
        self._ground = ground
        self._widest_crown_m = max((t.crown_radius_m for t in stand.trees if t.crown_base_m < t.height_m), default=0.0)
        self._boxes: list[tuple[StandBox, float]] = [  # with their tops
            (box, stand.ground_up_m(box.east_m, box.north_m) + box.height_m) for box in stand.boxes
        ]
        self._cells: dict[tuple[int, int], list[Tree]] = {}  # what can be touched from each place visited
        self._was: dict[int, _Was] = {}

    def find_contact(
        self,
        vehicle_id: int,
        pos_ned_m: Vec3,
        vel_ned_mps: Vec3,
        *,
        on_ground: bool,
        hit_ned_mps: Vec3 | None = None,
    ) -> Touched | None:
        """Contact of this vehicle now, or has touched on its way here since the last look.

        `hit_ned_mps`: its velocity when it met the ground since then, where that is known: it may have bounced.
        """
        now = _Was(pos_ned_m, vel_ned_mps, on_ground)
        before = self._was.get(vehicle_id, now)
        self._was[vehicle_id] = now
        down_mps = 0.0 if hit_ned_mps is None else hit_ned_mps[2]
        if on_ground or down_mps > 0.0:
            level_mps = math.hypot(*before.vel_ned_mps[:2])
            hard = level_mps > HARD_LEVEL_MPS or max(before.vel_ned_mps[2], down_mps) > HARD_DOWN_MPS
            if self._ground and hard and not before.on_ground:
                return Touched.GROUND
        if on_ground:
            return None
        if self._boxes and self._meets_box(before.pos_ned_m, pos_ned_m):
            return Touched.BOX
        return self._among_trees(before.pos_ned_m, pos_ned_m)

    def _meets_box(self, a_ned_m: Vec3, b_ned_m: Vec3) -> bool:
        way_m = math.hypot(b_ned_m[0] - a_ned_m[0], b_ned_m[1] - a_ned_m[1])
        for box, top_m in self._boxes:
            near = box.clearance_m(b_ned_m[1], b_ned_m[0]) < self._reach_m + way_m and -b_ned_m[2] < top_m
            if near and box.beside_m((a_ned_m[1], a_ned_m[0]), (b_ned_m[1], b_ned_m[0])) < self._reach_m:
                return True
        return False

    def _among_trees(self, a_ned_m: Vec3, b_ned_m: Vec3) -> Touched | None:
        north_m, east_m, down_m = b_ned_m
        way_m = math.hypot(north_m - a_ned_m[0], east_m - a_ned_m[1])
        crown = False
        for axis_n, axis_e, trunk_m, top_m, crown_m, crown_up_m in self._near(north_m, east_m, way_m):
            wide_m = max(trunk_m, crown_m) if -down_m > crown_up_m else trunk_m
            to_n, to_e, limit_m = axis_n - north_m, axis_e - east_m, wide_m + way_m
            if to_n * to_n + to_e * to_e >= limit_m * limit_m or -down_m >= top_m:
                continue
            axis_m = _beside_m(axis_n, axis_e, a_ned_m, b_ned_m)
            if axis_m < trunk_m:
                return Touched.TRUNK
            crown = crown or (-down_m > crown_up_m and axis_m < crown_m)
        return Touched.CROWN if crown else None

    def _near(self, north_m: float, east_m: float, way_m: float) -> list[Tree]:
        """Obstacles that may be touched within a way of this length to there."""
        if way_m > WAY_M:
            return self._trees(north_m, east_m, way_m)
        cell = (math.floor(north_m / CELL_M), math.floor(east_m / CELL_M))
        found = self._cells.get(cell)
        if found is None:
            middle = ((cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M)
            found = self._cells[cell] = self._trees(*middle, WAY_M + CELL_M / math.sqrt(2.0))
        return found

    def _trees(self, north_m: float, east_m: float, within_m: float) -> list[Tree]:
        stand = self._stand
        found = []
        for tree in stand.near(east_m, north_m, max(self._reach_m, self._widest_crown_m) + within_m):
            ground_m = stand.ground_up_m(tree.east_m, tree.north_m)
            crowned = tree.crown_base_m < tree.height_m
            found.append(
                (
                    tree.north_m,
                    tree.east_m,
                    tree.radius_m + self._reach_m,
                    ground_m + tree.height_m,
                    tree.crown_radius_m if crowned else 0.0,
                    ground_m + tree.crown_base_m,
                )
            )
        return found


def _beside_m(axis_n: float, axis_e: float, a_ned_m: Vec3, b_ned_m: Vec3) -> float:
    """Least level distance between an upright axis and the straight way from a to b."""
    north_m, east_m = b_ned_m[0] - a_ned_m[0], b_ned_m[1] - a_ned_m[1]
    to_north_m, to_east_m = axis_n - a_ned_m[0], axis_e - a_ned_m[1]
    square = north_m * north_m + east_m * east_m
    share = 0.0 if square == 0.0 else min(max((to_north_m * north_m + to_east_m * east_m) / square, 0.0), 1.0)
    return math.hypot(to_north_m - share * north_m, to_east_m - share * east_m)


class Collisions:
    """Looks for vehicles that touch one another, along the straight ways that they have come since the last look."""

    def __init__(self, reach_m: float = VEHICLE_RADIUS_M) -> None:
        self._hulls_m = 2.0 * reach_m  # between the centres of two that touch
        self._was: dict[int, Vec3] = {}

    def find_touching(self, positions_ned_m: Mapping[int, Vec3]) -> set[int]:
        """Ids of those whose centres came closer than two `reach_m` to another's since they were last looked at."""
        ways = [(k, self._was.get(k, now), now) for k, now in positions_ned_m.items()]
        self._was = dict(positions_ned_m)
        found: set[int] = set()
        if len(ways) < 2:
            return found
        limit_m = self._hulls_m + 2.0 * max([math.dist(before, now) for _, before, now in ways])
        ways.sort(key=_northwards)
        for index, (first, first_was, first_now) in enumerate(ways):
            for other in range(index + 1, len(ways)):
                second, second_was, second_now = ways[other]
                if second_now[0] - first_now[0] > limit_m:
                    break
                if abs(second_now[1] - first_now[1]) > limit_m:
                    continue
                if least_distance_m(first_was, first_now, second_was, second_now) < self._hulls_m:
                    found.update((first, second))
        return found


def _northwards(way: tuple[int, Vec3, Vec3]) -> float:
    return way[2][0]


def least_distance_m(first_was: Vec3, first_now: Vec3, second_was: Vec3, second_now: Vec3) -> float:
    """Least distance between two that went straight and steadily from where they were to where they are."""
    was = (second_was[0] - first_was[0], second_was[1] - first_was[1], second_was[2] - first_was[2])
    now = (second_now[0] - first_now[0], second_now[1] - first_now[1], second_now[2] - first_now[2])
    way = (now[0] - was[0], now[1] - was[1], now[2] - was[2])
    square = way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
    along = -(was[0] * way[0] + was[1] * way[1] + was[2] * way[2])
    share = 0.0 if square == 0.0 else min(max(along / square, 0.0), 1.0)
    return math.hypot(was[0] + share * way[0], was[1] + share * way[1], was[2] + share * way[2])
