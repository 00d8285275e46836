"""The values of the relative filter: one vehicle's mean state, and one neighbour's relative position as it is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Errors, Level
from companion.core.model.vectors import ZERO
from companion.core.perception.landmarks.constellation import Alignment, turned
from mission.common.frames import Vec3


@dataclass(slots=True, init=False)
class Relative:
    """One neighbour. North is what the swarm's compasses together take for it."""

    ne_m: Final[Level]  # from this vehicle to the neighbour
    var_nn_m2: Final[float]
    var_ne_m2: Final[float]
    var_ee_m2: Final[float]
    shape_m2: Final[float]  # of both axes' variances what no turn of the whole formation explains

    def __init__(self, ne_m: Level, var_nn_m2: float, var_ne_m2: float, var_ee_m2: float, shape_m2: float) -> None:
        self.ne_m = ne_m
        self.shape_m2 = shape_m2
        self.var_nn_m2 = var_nn_m2
        self.var_ne_m2 = var_ne_m2
        self.var_ee_m2 = var_ee_m2

    @property
    def sd_m(self) -> float:
        """Along the direction in which it is most uncertain."""
        mean = (self.var_nn_m2 + self.var_ee_m2) / 2.0
        return math.sqrt(mean + math.hypot((self.var_nn_m2 - self.var_ee_m2) / 2.0, self.var_ne_m2))


ACCELERATION_MPS2: Final = 1.0  # of a neighbour between two of its odometer readings, rms
COASTS_S: Final = 1.0  # a neighbour that tells nothing is taken to fly on for so long, then to fly as this one does
STRAYS_MPS: Final = 1.0  # against this vehicle, from then on, rms
BIAS_MAX_MPS: Final = 0.15  # of what is believed of it: three standard deviations
TURNED_LEAST: Final = 3  # alignments in a row: a north that scans correct is turned within seconds, and stays
KNOTS_MAX: Final = 24  # of an odometer that tells each tick more than a second
KNOT_S: Final = 0.045  # between two: a tick, nearly


@final
class VehicleMean:
    """One vehicle's mean state. `n_m`, `e_m`: relative to this vehicle; 0 of itself."""

    __slots__ = (
        "bias_e",
        "bias_n",
        "e_m",
        "heard_s",
        "knots",
        "lost",
        "n_m",
        "odo_e",
        "odo_n",
        "shut_out_s",
        "told_s",
        "trunks_s",
        "turned",
        "vel_e",
        "vel_n",
        "went_e",
        "went_n",
        "yaw",
    )

    def __init__(self, ne_m: Level) -> None:
        self.n_m, self.e_m = ne_m
        self.bias_n = self.bias_e = self.yaw = 0.0
        self.vel_n = self.vel_e = 0.0  # as its odometry told last, along its own north
        self.odo_n = self.odo_e = 0.0  # up to where its odometer is reckoned in
        self.went_n = self.went_e = 0.0  # since the epoch began
        self.told_s = -1.0  # of which time it told last; < 0: never
        self.knots: list[tuple[float, float, float]] = []  # what it told lately: time, odometer
        self.lost = False  # it has told nothing for longer than it is taken to fly on
        self.heard_s = 0.0  # the time up to which odo_n, odo_e are brought
        self.trunks_s = -math.inf  # when trunks corrected its odometer last
        self.shut_out_s = -1.0  # when its ranges began to be no good; < 0: they are
        self.turned = 0  # its last alignments that fit but for the turn

    def note_turned(self) -> bool:
        """An alignment fits but for the turn. True: it is the last of TURNED_LEAST in a row."""
        self.turned = (self.turned + 1) % TURNED_LEAST
        return self.turned == 0

    def add_knot(self, odo_n: float, odo_e: float, told_s: float) -> None:
        """Store what its odometer told of that time, later than all before."""
        if self.knots and told_s - self.knots[-1][0] < KNOT_S:
            return
        self.knots.append((told_s, odo_n, odo_e))
        del self.knots[:-KNOTS_MAX]

    def way_since(self, at_s: float) -> Level:
        """Its way from `at_s` to `heard_s`, as its odometer told it; along its own north, without its bias."""
        if not self.knots:
            return (0.0, 0.0)
        since_s = self.heard_s - at_s
        odo_n, odo_e = self._odometer(at_s)
        return (self.odo_n - odo_n - self.bias_n * since_s, self.odo_e - odo_e - self.bias_e * since_s)

    def coasted_m2(self, errors: Errors, at_s: float) -> float:
        """Variance by its flight since its last odometer reading, at that time; the next one takes it back."""
        if self.told_s < 0.0:
            return 0.0
        gap_s = max(0.0, at_s - self.told_s)
        noise_m, coast_s = errors.velocity_mps * gap_s, min(COASTS_S, gap_s)
        off_m = 0.5 * ACCELERATION_MPS2 * coast_s * coast_s + STRAYS_MPS * (gap_s - coast_s)
        return noise_m * noise_m + off_m * off_m

    def _odometer(self, at_s: float) -> Level:
        after = self.knots[-1]
        if at_s >= after[0]:
            since_s = at_s - after[0]
            return (after[1] + self.vel_n * since_s, after[2] + self.vel_e * since_s)
        for knot in reversed(self.knots):
            if knot[0] <= at_s:
                share = (at_s - knot[0]) / (after[0] - knot[0])
                return (knot[1] + share * (after[1] - knot[1]), knot[2] + share * (after[2] - knot[2]))
            after = knot
        since_s = at_s - after[0]
        return (after[1] + self.vel_n * since_s, after[2] + self.vel_e * since_s)


def drift_of(bias_ne_mps: Level) -> Vec3:
    """NED m/s, true less told, of an odometer with that bias (told less true)."""
    north, east = bias_ne_mps
    size = math.hypot(north, east)
    if not size > 0.0:
        return ZERO
    share = min(1.0, BIAS_MAX_MPS / size)
    return (-share * north, -share * east, 0.0)


def drifted_m(errors: Errors, start_sd_m: float, aged_s: float, way_m: float) -> float:
    """Error of the positions of two odometers after that time and way, sd on an axis, by what is believed of them."""
    bias_m2 = 2.0 * errors.bias_mps**2 * errors.bias_s * aged_s
    noise_m2 = errors.velocity_mps**2 * errors.velocity_s * aged_s
    turned_m = errors.yaw_rad * way_m
    return math.sqrt(2.0 * (start_sd_m**2 + bias_m2 + noise_m2 + turned_m**2))


def aligned_row(
    found: Alignment, me: VehicleMean, mover: VehicleMean, axis: int, states: tuple[int, int, int, int]
) -> tuple[list[tuple[int, float]], float, float]:
    """A neighbour's aligned place north (axis 0) or east (1), or its turn (2), as a measurement.

    The states by which it moves (`states`: `ErrorStateCovariance.indices`) with the factors; by how much it is more
    than thought; its variance.
    """
    north, turn, its_yaw, own_yaw = states
    if axis == 2:
        off_rad = math.remainder(found.turn_rad - mover.yaw + me.yaw, math.tau)
        return [(its_yaw, 1.0), (own_yaw, -1.0)], off_rad, found.turn_sd_rad * found.turn_sd_rad
    here = turned(me.yaw, found.here[0] - me.odo_n, found.here[1] - me.odo_e)
    there = turned(mover.yaw, found.there[0] - mover.odo_n, found.there[1] - mover.odo_e)
    thought = (mover.n_m, mover.e_m)
    # A radian clockwise moves what is north to the east, and what is east to the south
    sign, other = (-1.0, 1) if axis == 0 else (1.0, 0)
    seen = [(north + axis, 1.0), (turn, sign * thought[other]), (its_yaw, sign * there[other])]
    seen.append((own_yaw, -sign * here[other]))
    return seen, here[axis] - there[axis] - thought[axis], found.position_sd_m * found.position_sd_m
