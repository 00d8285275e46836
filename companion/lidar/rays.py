"""Returns of a lidar -> its raw scan in pieces, each the payload of a SWARM_LIDAR_SCAN.

A lidar that turns is told arc by arc, each as soon as the next begins: its last ray is of now, and rays follow one
another as in the revolution before. One that has no revolutions (a Mid-360) is told frame by frame; when in the frame
each point was measured is not kept, and its rays are spread over it.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Final

from companion.lidar.driver import Return
from companion.lidar.mounting import Mounting, sector_at
from companion.lidar.sectors import SCAN_MAX_S, Limits
from companion.mavlink.lidar_scan import NOT_MEASURED_MM, NOTHING_MM, encode_lidar_scan
from mission.schema.kinds import RawLidar

PIECE_RAYS: Final = 90
UNSEEN: Final = -1.0
BLOCKED: Final = -2.0  # something nearer than the lidar measures: dirt, the airframe


class RayScan:
    """Collects returns: of each cell, a step around by a layer, the nearest valid one.

    Nothing there: pulses went there, and none came back from within max_m. Not measured: no pulse is known to have gone
    there, or some came back from closer than min_m, or the mounting masks it.
    """

    def __init__(self, limits: Limits, mounting: Mounting, lidar: RawLidar) -> None:
        """`lidar`: the class that the mission names, whose cells these are."""
        self._limits = limits
        self._count = round(360.0 / lidar.step_deg)
        self._side = -1.0 if mounting.upside_down else 1.0
        self._yaw_deg, self._step_deg = mounting.yaw_deg, lidar.step_deg
        self._elevations_deg = lidar.elevations_deg
        tangents = [math.tan(math.radians(deg)) for deg in lidar.elevations_deg]
        self._between = [(low + high) / 2.0 for low, high in pairwise(tangents)]
        self._cell = [int(cdeg / (100.0 * lidar.step_deg)) for cdeg in range(36000)]
        self._masked = [sector_at(self._bearing_deg(k)) in mounting.mask for k in range(self._count)]
        self._turn = 0
        self._began_s: float | None = None  # the turn, or the frame
        self._lasts_s: float | None = None  # the turn before
        self._arc = -1
        self._sampled = 0  # rays of the turn
        self._sampled_before = self._turns_before = 0  # in turns that were whole, and how many these were
        self._clear_cells()

    def take_rays_a_turn(self) -> tuple[int, int] | None:
        """Rays that were sampled in a turn, the mean since the last call, and all that a turn has; None: no turn was.

        Rays that the mounting masks count as any other.
        """
        sampled, turns = self._sampled_before, self._turns_before
        self._sampled_before = self._turns_before = 0
        return (round(sampled / turns), self._count) if turns else None

    def update(self, returns: Iterable[Return], now_s: float) -> list[bytes]:
        """Pieces that these complete. `now_s`: when they were read, monotonic."""
        found: list[bytes] = []
        if self._limits.period_s is None:
            for one in returns:
                self._take_turning(one, now_s, found)
            return found
        if self._began_s is not None and now_s - self._began_s >= self._limits.period_s:
            found += self._frame(now_s)
        for azimuth_cdeg, range_m, up_m, _ in returns:
            if self._began_s is None:
                self._began_s = now_s
            if range_m > 0.0:
                layer = bisect(self._between, up_m / range_m)
                self._note(self._nearest_m[layer], self._cell[azimuth_cdeg], math.hypot(range_m, up_m))
        return found

    def _take_turning(self, one: Return, now_s: float, found: list[bytes]) -> None:
        """A return of a lidar that turns: the first of an arc ends the one before."""
        azimuth_cdeg, range_m, _, starts = one
        cell = self._cell[azimuth_cdeg]
        arc = cell // PIECE_RAYS
        if arc != self._arc or starts:
            if self._arc >= 0 and self._lasts_s is not None:
                ray_time_s = self._lasts_s / self._count
                rays = min(PIECE_RAYS, self._count - self._arc * PIECE_RAYS)
                piece = self._piece(0, self._arc, now_s - (rays - 1) * ray_time_s, ray_time_s)
                found += [] if piece is None else [piece]
            self._sampled += self._count - self._nearest_m[0].count(UNSEEN)
            self._clear_cells()
            self._arc = arc
        if starts:
            lasted_s = math.inf if self._began_s is None else now_s - self._began_s
            self._lasts_s = lasted_s if lasted_s <= SCAN_MAX_S else None
            if self._lasts_s is not None:
                self._sampled_before += min(self._sampled, self._count)
                self._turns_before += 1
            self._sampled = 0
            self._began_s = now_s
            self._turn += 1
        self._note(self._nearest_m[0], cell, range_m)

    def _frame(self, now_s: float) -> Iterator[bytes]:
        """All pieces of a frame that ends now; the next begins."""
        assert self._began_s is not None
        lasted_s = now_s - self._began_s
        self._turn += 1
        if lasted_s <= SCAN_MAX_S:
            for arc in range(math.ceil(self._count / PIECE_RAYS)):
                for layer in range(len(self._elevations_deg)):
                    piece = self._piece(layer, arc, self._began_s, lasted_s / PIECE_RAYS)
                    if piece is not None:
                        yield piece
        self._began_s = None
        self._clear_cells()

    def _clear_cells(self) -> None:
        self._nearest_m = [[UNSEEN] * self._count for _ in self._elevations_deg]

    def _note(self, nearest_m: list[float], cell: int, range_m: float) -> None:
        before_m = nearest_m[cell]
        if range_m >= self._limits.min_m:
            if before_m < 0.0 or range_m < before_m:
                nearest_m[cell] = range_m
        elif range_m > 0.0:
            if before_m == UNSEEN or before_m == math.inf:
                nearest_m[cell] = BLOCKED
        elif before_m == UNSEEN:
            nearest_m[cell] = math.inf

    def _piece(self, layer: int, arc: int, first_s: float, ray_time_s: float) -> bytes | None:
        """One layer's rays of an arc; None: nothing was measured there."""
        first = arc * PIECE_RAYS
        ranges_mm = [self._mm(layer, cell) for cell in range(first, min(first + PIECE_RAYS, self._count))]
        if not any(ranges_mm):
            return None
        return encode_lidar_scan(
            time_us=max(0, round(first_s * 1e6)),
            ray_time_s=ray_time_s,
            first_bearing_deg=math.remainder(self._bearing_deg(first), 360.0),
            bearing_step_deg=self._side * self._step_deg,
            elevation_deg=self._side * self._elevations_deg[layer],
            min_m=self._limits.min_m,
            max_m=self._limits.max_m,
            turn=self._turn,
            ranges_mm=ranges_mm,
        )

    def _bearing_deg(self, cell: int) -> float:
        """Of its middle."""
        return self._yaw_deg + self._side * (cell + 0.5) * self._step_deg

    def _mm(self, layer: int, cell: int) -> int:
        range_m = self._nearest_m[layer][cell]
        if range_m < 0.0 or self._masked[cell]:
            return NOT_MEASURED_MM
        return NOTHING_MM if range_m > self._limits.max_m else round(range_m * 1000.0)
