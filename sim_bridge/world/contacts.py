"""What vehicles touch in the stand: trunks, crowns, and the ground where they do not land."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from mission.frames import Vec3
from mission.stand import Stand, StandTree

REACH_M: Final = 0.35  # half the 0.70 m from propeller tip to propeller tip along an arm of the F450
HARD_LEVEL_MPS: Final = 1.0  # landing, a vehicle drifts less; faster its legs catch, and it turns over
HARD_DOWN_MPS: Final = 2.5  # autopilots come down to land at 1.5 at most


class Touched(StrEnum):
    """What a vehicle has run into."""

    TRUNK = "trunk"
    CROWN = "crown"
    GROUND = "ground"


@dataclass(frozen=True, slots=True)
class _Was:
    pos_ned_m: Vec3
    vel_ned_mps: Vec3
    on_ground: bool


class Contacts:
    """Looks at each vehicle at every step, along the way that it has come since.

    A trunk is touched by a vehicle nearer than REACH_M to its surface and not above its top. A crown, an upright
    cylinder, when its centre is inside: the propellers are among twigs then. The ground by one that comes down on it
    faster than a landing. Undergrowth is not: a propeller cuts through it, or the vehicle stands in it.
    """

    def __init__(self, stand: Stand, *, reach_m: float = REACH_M, ground: bool = True) -> None:
        """`ground`: whether a hard touch of the ground counts."""
        self._stand = stand
        self._reach_m = reach_m
        self._ground = ground
        self._widest_crown_m = max((t.crown_radius_m for t in stand.trees if t.crown_base_m < t.height_m), default=0.0)
        self._was: dict[int, _Was] = {}

    def look(self, vehicle_id: int, pos_ned_m: Vec3, vel_ned_mps: Vec3, *, on_ground: bool) -> Touched | None:
        """What this vehicle touches now, or has touched on its way here since the last look."""
        now = _Was(pos_ned_m, vel_ned_mps, on_ground)
        before = self._was.get(vehicle_id, now)
        self._was[vehicle_id] = now
        if on_ground:
            hard = math.hypot(*before.vel_ned_mps[:2]) > HARD_LEVEL_MPS or before.vel_ned_mps[2] > HARD_DOWN_MPS
            return Touched.GROUND if self._ground and hard and not before.on_ground else None
        return self._among_trees(before.pos_ned_m, pos_ned_m)

    def _among_trees(self, a_ned_m: Vec3, b_ned_m: Vec3) -> Touched | None:
        north_m, east_m, down_m = b_ned_m
        way_m = math.hypot(north_m - a_ned_m[0], east_m - a_ned_m[1])
        near = self._stand.near(east_m, north_m, max(self._reach_m, self._widest_crown_m) + way_m)
        crown = False
        for tree in near:
            above_m = -down_m - self._stand.ground_up_m(tree.east_m, tree.north_m)
            if above_m >= tree.height_m:
                continue
            axis_m = _beside_m(tree, a_ned_m, b_ned_m)
            if axis_m < tree.radius_m + self._reach_m:
                return Touched.TRUNK
            crown = crown or (above_m > tree.crown_base_m and axis_m < tree.crown_radius_m)
        return Touched.CROWN if crown else None


def _beside_m(tree: StandTree, a_ned_m: Vec3, b_ned_m: Vec3) -> float:
    """Least level distance between a trunk's axis and the straight way from a to b."""
    north_m, east_m = b_ned_m[0] - a_ned_m[0], b_ned_m[1] - a_ned_m[1]
    to_north_m, to_east_m = tree.north_m - a_ned_m[0], tree.east_m - a_ned_m[1]
    square = north_m * north_m + east_m * east_m
    share = 0.0 if square == 0.0 else min(max((to_north_m * north_m + to_east_m * east_m) / square, 0.0), 1.0)
    return math.hypot(to_north_m - share * north_m, to_east_m - share * east_m)
