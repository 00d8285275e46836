"""Obstacles for a lidar of the simulated world: the stand as upright cylinders, by place, its boxes and its ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.stand.stand import Stand, StandBox
from sim_bridge.world.sensors.scan import Cylinder, Plane
from sim_bridge.world.sensors.stems.shapes import StemShapes

CELL_M: Final = 2.0
ROOTS_M: Final = -1e4  # trunks and bushes reach far below the ground, which hides that part: no gap on a slope


class Scene:
    """A stand as its lidars see it. One for all vehicles: it remembers what stands around each place visited."""

    def __init__(self, stand: Stand, within_m: float, shapes: StemShapes | None = None) -> None:
        """`within_m`: how far the lidars see. `shapes`: of trunks, which are then no cylinders."""
        self._stand = stand
        self._within_m = within_m + CELL_M / math.sqrt(2.0)
        self._cells: dict[tuple[int, int], Sequence[Cylinder]] = {}
        self._arrays: dict[tuple[int, int], NDArray[np.float64]] = {}
        self.has_boxes: Final = bool(stand.boxes)
        self._shapes = shapes
        self._trunks: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._widest_crown_m = max((tree.crown_radius_m for tree in stand.trees), default=0.0)

    def around(self, pos_ned_m: Vec3) -> Sequence[Cylinder]:
        """All that stands within sight of a place, and a little more."""
        cell = (math.floor(pos_ned_m[0] / CELL_M), math.floor(pos_ned_m[1] / CELL_M))
        found = self._cells.get(cell)
        if found is None:
            found = self._cells[cell] = self._standing((cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M)
        return found

    def cylinders(self, pos_ned_m: Vec3) -> NDArray[np.float64]:
        """`around` as an array for `raw_scan.cast`: (k, 7), with a velocity of none."""
        cell = (math.floor(pos_ned_m[0] / CELL_M), math.floor(pos_ned_m[1] / CELL_M))
        found = self._arrays.get(cell)
        if found is None:
            standing = np.array(self.around(pos_ned_m)).reshape(-1, 5)
            found = self._arrays[cell] = np.hstack([standing, np.zeros((len(standing), 2))])
        return found

    def trunks(self, pos_ned_m: Vec3) -> NDArray[np.float64] | None:
        """Trunks with a shape about a place: rows of `stems.shapes`; None: trunks are cylinders, as all else."""
        if self._shapes is None:
            return None
        cell = (math.floor(pos_ned_m[0] / CELL_M), math.floor(pos_ned_m[1] / CELL_M))
        found = self._trunks.get(cell)
        if found is None:
            middle = ((cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M)
            found = self._trunks[cell] = self._shapes.trunks_near(*middle, self._within_m)
        return found

    def boxes_around(self, pos_ned_m: Vec3) -> Sequence[StandBox]:
        """Boxes within sight of a place, and a little more."""
        return self._stand.boxes_near(pos_ned_m[1], pos_ned_m[0], self._within_m)

    def top_up_m(self, box: StandBox) -> float:
        """Height of a box's top above the ground at the origin."""
        return self._stand.ground_up_m(box.east_m, box.north_m) + box.height_m

    def ground(self, pos_ned_m: Vec3) -> Plane:
        """The ground below a place."""
        rise_e, rise_n = self._stand.grade
        return self._stand.ground_up_m(pos_ned_m[1], pos_ned_m[0]), rise_n, rise_e

    def _standing(self, north_m: float, east_m: float) -> tuple[Cylinder, ...]:
        stand, within_m = self._stand, self._within_m
        found: list[Cylinder] = []
        for tree in stand.near(east_m, north_m, within_m + self._widest_crown_m):
            n_m, e_m, ground_m = tree.north_m, tree.east_m, stand.ground_up_m(tree.east_m, tree.north_m)
            top_m, away_m = ground_m + tree.height_m, math.hypot(n_m - north_m, e_m - east_m)
            if self._shapes is None and away_m < within_m + tree.radius_m:
                found.append((n_m, e_m, tree.radius_m, ROOTS_M, top_m))
            if tree.crown_base_m < tree.height_m and away_m < within_m + tree.crown_radius_m:
                found.append((n_m, e_m, tree.crown_radius_m, ground_m + tree.crown_base_m, top_m))
        for bush in stand.bushes_near(east_m, north_m, within_m):
            top_m = stand.ground_up_m(bush.east_m, bush.north_m) + bush.height_m
            found.append((bush.north_m, bush.east_m, bush.radius_m, ROOTS_M, top_m))
        if self._shapes is not None:
            found += self._shapes.bits_near(north_m, east_m, within_m)
        return tuple(found)
