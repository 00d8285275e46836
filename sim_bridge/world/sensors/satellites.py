"""A GNSS receiver under crowns: which satellites it tracks, what fix it makes of them, and how wrong that is.

Satellites stand still in the sky for a flight, spread by the seed. What is on the way to one through crowns costs it
`crown_db_per_m` for each metre: single trees in leaf were found to take about 1 dB/m at 870 MHz, and 1.3 times as much
at 1.6 GHz (Goldhirsh & Vogel 1998, "Handbook of Propagation Effects for Vehicular and Personal Mobile Satellite
Systems", chapter 2); crowns of this simulator are full upright cylinders, as wide as those of open-grown trees, so the
default is the lower. From 45 dB-Hz in the open a satellite is tracked down to 30. Of those tracked the ranges are
wrong by RANGE_M and, as noise and multipath of a weaker signal are larger, by the more the more its crowns cost: the
amplitude's share. Position errors follow by weighted least squares, wander as multipath does, and the receiver knows
how large they are. In the open that makes about 1 m, under closed crowns 3 to 10 m: as handheld receivers there
(Sigrist, Coppin & Hermy 1999, International Journal of Remote Sensing 20 (18), 3595-3610; Wing, Eklund & Kellogg 2005,
Journal of Forestry 103 (4), 169-173).

Trunks cost nothing here, and the ground, other vehicles and the sender's own body neither. Nothing is heard by
reflections alone, which in truth makes the worst errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.common.frames import Vec3
from mission.stand.stand import Stand

SATELLITES: Final = 16  # above the mask: GPS and Galileo
MASK_RAD: Final = math.radians(10.0)
GOLDEN: Final = 0.618034  # multiples of it, less their whole part, are spread evenly
HEARD_DB: Final = 15.0  # a signal that lost more is not heard
RANGE_M: Final = 1.3  # of a range in the open
EPOCH_S: Final = 0.2  # from one fix to the next
MEMORY_S: Final = 30.0  # of a fix's error: a vehicle at 1 to 2 m/s is under other branches by then
LEAST: Final = 4  # satellites that a fix takes
HDOP_MAX: Final = 20.0  # a worse one is no fix
TALLEST: Final = 1e-3  # of a vector: below it two are parallel
SALT: Final = 0x5A7E  # apart from the seeds of placement, wind, radio and the others


@dataclass(frozen=True, slots=True)
class Fix:
    """A GNSS receiver's fix. `sd_m`: of its error, level (root of north and east squared)."""

    satellites: int
    hdop: float
    sd_m: float
    off_ne_m: tuple[float, float]  # the fix less the truth

    @property
    def is_3d(self) -> bool:
        """There is one."""
        return self.satellites >= LEAST and self.hdop <= HDOP_MAX


NO_FIX = Fix(0, 99.0, 99.0, (0.0, 0.0))


class Crowns:
    """Crowns of a stand, shared by all vehicles of a world."""

    def __init__(self, stand: Stand) -> None:
        crowned = [tree for tree in stand.trees if tree.crown_base_m < tree.height_m]
        ground = [stand.ground_up_m(tree.east_m, tree.north_m) for tree in crowned]
        self._north = np.array([tree.north_m for tree in crowned])
        self._east = np.array([tree.east_m for tree in crowned])
        self._radius = np.array([tree.crown_radius_m for tree in crowned])
        self._base = np.array([up + tree.crown_base_m for up, tree in zip(ground, crowned, strict=True)])
        self._top = np.array([up + tree.height_m for up, tree in zip(ground, crowned, strict=True)])

    def metres(self, pos_ned_m: Vec3, towards: NDArray[np.float64]) -> NDArray[np.float64]:
        """Metres of crown on the ways from there in each of k directions (north, east, up > 0; unit)."""
        if not len(self._north):
            return np.zeros(len(towards))
        north, east = self._north - pos_ned_m[0], self._east - pos_ned_m[1]
        level = np.hypot(towards[:, 0], towards[:, 1])
        tan = towards[:, 2] / np.maximum(level, TALLEST)
        u_n, u_e = towards[:, 0] / np.maximum(level, TALLEST), towards[:, 1] / np.maximum(level, TALLEST)
        # Each crown, from each direction: the level stretch within its circle, and that within its heights.
        along = np.outer(u_n, north) + np.outer(u_e, east)
        beside2 = np.maximum(0.0, north**2 + east**2 - along**2)
        half = np.sqrt(np.maximum(0.0, self._radius**2 - beside2))
        up_m = -pos_ned_m[2]
        first = np.maximum.reduce([along - half, (self._base - up_m) / tan[:, None], np.zeros_like(along)])
        last = np.minimum(along + half, (self._top - up_m) / tan[:, None])
        stretch: NDArray[np.float64] = np.maximum(0.0, last - first).sum(axis=1) / np.maximum(level, TALLEST)
        return stretch


class Receiver:
    """One vehicle's. `is_covered`: its antenna hears nothing, whatever stands above it."""

    def __init__(self, crowns: Crowns, crown_db_per_m: float, *, seed: int, vehicle_id: int) -> None:
        self._crowns = crowns
        self._db_per_m = crown_db_per_m
        self._towards = sky(seed)
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._wander = (self._normal(), self._normal())  # of unit size
        self._next_s = 0.0
        self.is_covered = False
        self.fix = NO_FIX
        self._drift_ne_mps: tuple[float, float] | None = None
        self._astray_ne_m = (0.0, 0.0)  # by that

    def set_drift(self, drift_ne_mps: tuple[float, float] | None) -> None:
        """Leads it astray so fast, north and east; None: no more, and its fixes are at once as before."""
        self._drift_ne_mps = drift_ne_mps
        if drift_ne_mps is None:
            self._astray_ne_m = (0.0, 0.0)

    def step(self, pos_ned_m: Vec3, now_s: float) -> bool:
        """True: there is a new fix, or none where there was to be one. Draws by the time alone."""
        if now_s < self._next_s - 1e-9:
            return False
        self._next_s += EPOCH_S
        keep = math.exp(-EPOCH_S / MEMORY_S)
        fresh = math.sqrt(1.0 - keep * keep)
        north, east = self._wander
        self._wander = (keep * north + fresh * self._normal(), keep * east + fresh * self._normal())
        self.fix = NO_FIX if self.is_covered else self._solve(pos_ned_m)
        if self._drift_ne_mps is not None:
            (north, east), (north_mps, east_mps) = self._astray_ne_m, self._drift_ne_mps
            self._astray_ne_m = (north + north_mps * EPOCH_S, east + east_mps * EPOCH_S)
            off = self.fix.off_ne_m
            self.fix = replace(self.fix, off_ne_m=(off[0] + self._astray_ne_m[0], off[1] + self._astray_ne_m[1]))
        return True

    def _solve(self, pos_ned_m: Vec3) -> Fix:
        loss_db = self._db_per_m * self._crowns.metres(pos_ned_m, self._towards)
        heard = loss_db <= HEARD_DB
        count = int(heard.sum())
        if count < LEAST:
            return Fix(count, NO_FIX.hdop, NO_FIX.sd_m, (0.0, 0.0))
        rows = np.column_stack([self._towards[heard], np.ones(count)])
        weights = 10.0 ** (-loss_db[heard] / 10.0)
        plain, weighted = rows.T @ rows, (rows * weights[:, None]).T @ rows
        if np.linalg.cond(plain) > 1e8:
            return Fix(count, NO_FIX.hdop, NO_FIX.sd_m, (0.0, 0.0))
        dilution, cov = np.linalg.inv(plain), RANGE_M**2 * np.linalg.inv(weighted)
        hdop = math.sqrt(float(dilution[0, 0] + dilution[1, 1]))
        off = (self._wander[0] * math.sqrt(float(cov[0, 0])), self._wander[1] * math.sqrt(float(cov[1, 1])))
        return Fix(count, hdop, math.sqrt(float(cov[0, 0] + cov[1, 1])), off)

    def _normal(self) -> float:
        return float(self._rng.standard_normal())


def sky(seed: int) -> NDArray[np.float64]:
    """Directions of a flight's satellites: (SATELLITES, 3), north, east, up; unit. Even above the mask."""
    start = float(np.random.default_rng([seed, SALT]).random())
    k = np.arange(SATELLITES)
    up = math.sin(MASK_RAD) + (1.0 - math.sin(MASK_RAD)) * (k + 0.5) / SATELLITES
    turn = math.tau * (start + GOLDEN * k)
    level = np.sqrt(1.0 - up**2)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), up])
