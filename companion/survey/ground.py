"""Height of the ground about a vehicle, by rays that its lidar sends down: the lowest that hit in each cell, lately."""

from __future__ import annotations

import math
from typing import Final, final

CELL_M: Final = 1.0
CELLS_MAX: Final = 2048  # some 20 kB each thousand; beyond, all older than FRESH_S go, then all
FRESH_S: Final = 15.0  # the own height wanders meanwhile by some centimetres
LEAST_CELLS: Final = 4
WITHIN_M: Final = 3.0  # of a stem: on a slope of 70 % the ground is 2 m higher or lower there
LITTER_M: Final = 0.15  # above the plane through its neighbours a cell holds litter or a bush, no ground
GROUND_SD_M: Final = 0.06  # of a ray's height, litter and the plane


@final
class Ground:
    """One vehicle's. North and east in the frame of the own odometry, heights up; metres."""

    __slots__ = ("_cells",)

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], tuple[float, float, float, float]] = {}  # north, east, up, when

    def add(self, north_m: float, east_m: float, up_m: float, now_s: float) -> None:
        """A ray ended there: on the ground, or on what stands on it."""
        key = (math.floor(north_m / CELL_M), math.floor(east_m / CELL_M))
        known = self._cells.get(key)
        if known is not None and known[2] <= up_m and now_s - known[3] <= FRESH_S:
            return
        if known is None and len(self._cells) >= CELLS_MAX:
            fresh = {k: cell for k, cell in self._cells.items() if now_s - cell[3] <= FRESH_S}
            self._cells = fresh if len(fresh) < CELLS_MAX else {}
        self._cells[key] = (north_m, east_m, up_m, now_s)

    def height_up_m(self, north_m: float, east_m: float) -> float | None:
        """Height of the ground there, by a plane through the cells about it; None: too few are known."""
        near = self._near(north_m, east_m)
        for _ in range(3):
            if len(near) < LEAST_CELLS:
                return None
            plane = _fit_plane(near)
            if plane is None:
                return None
            level, by_n, by_e = plane
            left = [cell for cell in near if cell[2] - (level + by_n * cell[0] + by_e * cell[1]) <= LITTER_M]
            if len(left) == len(near) or len(left) < LEAST_CELLS:
                return level
            near = left
        return level

    def _near(self, north_m: float, east_m: float) -> list[tuple[float, float, float]]:
        """Cells about a place, relative to it."""
        found: list[tuple[float, float, float]] = []
        reach = math.ceil(WITHIN_M / CELL_M)
        row, column = math.floor(north_m / CELL_M), math.floor(east_m / CELL_M)
        for i in range(row - reach, row + reach + 1):
            for j in range(column - reach, column + reach + 1):
                cell = self._cells.get((i, j))
                if cell is not None:
                    n, e = cell[0] - north_m, cell[1] - east_m
                    if n * n + e * e <= WITHIN_M * WITHIN_M:
                        found.append((n, e, cell[2]))
        return found


def _fit_plane(points: list[tuple[float, float, float]]) -> tuple[float, float, float] | None:
    """Level at the origin, rise per metre north and east, by least squares; flat where the points do not tell."""
    count = float(len(points))
    mean_n = sum([p[0] for p in points]) / count
    mean_e = sum([p[1] for p in points]) / count
    mean_u = sum([p[2] for p in points]) / count
    nn = sum([(p[0] - mean_n) ** 2 for p in points]) + 0.5  # a weak belief in level ground
    ee = sum([(p[1] - mean_e) ** 2 for p in points]) + 0.5
    ne = sum([(p[0] - mean_n) * (p[1] - mean_e) for p in points])
    nu = sum([(p[0] - mean_n) * (p[2] - mean_u) for p in points])
    eu = sum([(p[1] - mean_e) * (p[2] - mean_u) for p in points])
    det = nn * ee - ne * ne
    if not det > 0.0:
        return None
    by_n, by_e = (nu * ee - eu * ne) / det, (eu * nn - nu * ne) / det
    return mean_u - by_n * mean_n - by_e * mean_e, by_n, by_e
