"""Memory of obstacles: points of the map, kept for longer than the map itself, to search for a way by.

Not for safety: planner and filter verify by the map alone, and a way that is not there is not flown. Bounded, oldest
out first; what is seen through is gone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from mission.common.frames import Vec3

CELL_M: Final = 0.5
CELLS_MAX: Final = 4096
KEPT_S: Final = 180.0
NOTED_S: Final = 0.5  # so often
BINS: Final = 72
HIDES_M: Final = 0.5  # a point so much nearer in the same bearing hides what is behind it
SEEN_SHARE: Final = 0.9  # of the sensor's range: as far it would be seen
LOOKS: Final = 3  # in a row without it, until it is gone


@final
class SeenBefore:
    """Points, metres from a vehicle: as of one tick."""

    __slots__ = ("_easts", "_here_e", "_here_n", "_norths", "clear_m")

    def __init__(
        self, norths: Sequence[float], easts: Sequence[float], here: tuple[float, float], clear_m: float
    ) -> None:
        """`norths`, `easts`: in the frame of `here`; neither is changed any more. `clear_m`: to be kept from each."""
        self._norths, self._easts = norths, easts
        self.clear_m: Final = clear_m
        self._here_n, self._here_e = here

    def find_offset(self, cell_m: float) -> tuple[float, float]:
        """Offset of the vehicle from the middle of its cell, in a grid that stands still: metres north and east."""
        return (
            self._here_n - cell_m * math.floor(self._here_n / cell_m + 0.5),
            self._here_e - cell_m * math.floor(self._here_e / cell_m + 0.5),
        )

    def find_near(self, within_m: float) -> tuple[list[float], list[float]]:
        """Points within a square of that half side about the vehicle."""
        norths: list[float] = []
        easts: list[float] = []
        for k in range(len(self._norths)):
            n, e = self._norths[k] - self._here_n, self._easts[k] - self._here_e
            if abs(n) <= within_m and abs(e) <= within_m:
                norths.append(n)
                easts.append(e)
        return norths, easts


@final
class _Cell:
    __slots__ = ("east_m", "misses", "north_m", "seen_s")

    def __init__(self, north_m: float, east_m: float, seen_s: float) -> None:
        self.north_m, self.east_m, self.seen_s, self.misses = north_m, east_m, seen_s, 0


@final
class ObstacleMemory:
    """One vehicle's, in the frame in which its scans are placed."""

    __slots__ = ("_cells", "_easts", "_norths", "_noted_s")

    def __init__(self) -> None:
        self._cells: dict[int, _Cell] = {}  # the longest unseen first
        self._noted_s = -math.inf
        self._norths: list[float] = []
        self._easts: list[float] = []

    def note_points(
        self,
        norths: Sequence[float],
        easts: Sequence[float],
        placed_ned_m: Vec3,
        blind: Sequence[bool],
        max_m: float,
        now_s: float,
    ) -> None:
        """Takes in the map's points, metres from the vehicle, every NOTED_S; `blind`: bearings that are not seen."""
        if now_s - self._noted_s < NOTED_S - 1e-6:
            return
        self._noted_s = now_s
        nearest_m = [math.inf] * BINS
        for k in range(len(norths)):
            n, e = norths[k], easts[k]
            away_m, at = math.sqrt(n * n + e * e), _bin(e, n)
            nearest_m[at] = min(nearest_m[at], away_m)
            self._note_point(placed_ned_m[0] + n, placed_ned_m[1] + e, now_s)
        self._drop_gone(placed_ned_m, nearest_m, blind, SEEN_SHARE * max_m, now_s)
        self._norths = [cell.north_m for cell in self._cells.values()]
        self._easts = [cell.east_m for cell in self._cells.values()]

    def seen_before(self, placed_ned_m: Vec3, clear_m: float) -> SeenBefore:
        """All that is remembered, from there; `clear_m`: to be kept from each."""
        return SeenBefore(self._norths, self._easts, (placed_ned_m[0], placed_ned_m[1]), clear_m)

    def _note_point(self, north_m: float, east_m: float, now_s: float) -> None:
        key = (math.floor(north_m / CELL_M) << 24) + math.floor(east_m / CELL_M)
        cell = self._cells.pop(key, None)
        if cell is None:
            if len(self._cells) >= CELLS_MAX:
                del self._cells[next(iter(self._cells))]
            cell = _Cell(north_m, east_m, now_s)
        cell.north_m, cell.east_m, cell.seen_s, cell.misses = north_m, east_m, now_s, 0
        self._cells[key] = cell

    def _drop_gone(
        self,
        placed_ned_m: Vec3,
        nearest_m: Sequence[float],
        blind: Sequence[bool],
        seen_m: float,
        now_s: float,
    ) -> None:
        """Drops points that are too old, or would be seen and are not."""
        gone: list[int] = []
        for key, cell in self._cells.items():
            if now_s - cell.seen_s > KEPT_S:
                gone.append(key)
                continue
            n, e = cell.north_m - placed_ned_m[0], cell.east_m - placed_ned_m[1]
            away_m = math.sqrt(n * n + e * e)
            if cell.seen_s == now_s or away_m > seen_m:
                continue
            at = _bin(e, n)
            hides_m = min(nearest_m[at - 1], nearest_m[at], nearest_m[(at + 1) % BINS])
            if hides_m < away_m - HIDES_M or blind[at * len(blind) // BINS]:
                continue
            cell.misses += 1
            if cell.misses >= LOOKS:
                gone.append(key)
        for key in gone:
            del self._cells[key]


def _bin(east_m: float, north_m: float) -> int:
    return math.floor(math.atan2(east_m, north_m) / math.tau * BINS + 0.5) % BINS
