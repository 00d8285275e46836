"""The values of the relative filter: one vehicle's mean state, and one neighbour's relative position as it is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Level


@dataclass(slots=True, init=False)
class Relative:
    """One neighbour. North is what the swarm's compasses together take for it."""

    ne_m: Final[Level]  # from this vehicle to the neighbour
    var_nn_m2: Final[float]
    var_ne_m2: Final[float]
    var_ee_m2: Final[float]

    def __init__(self, ne_m: Level, var_nn_m2: float, var_ne_m2: float, var_ee_m2: float) -> None:
        self.ne_m = ne_m
        self.var_nn_m2 = var_nn_m2
        self.var_ne_m2 = var_ne_m2
        self.var_ee_m2 = var_ee_m2

    @property
    def sd_m(self) -> float:
        """Along the direction in which it is most uncertain."""
        mean = (self.var_nn_m2 + self.var_ee_m2) / 2.0
        return math.sqrt(mean + math.hypot((self.var_nn_m2 - self.var_ee_m2) / 2.0, self.var_ne_m2))


@final
class VehicleMean:
    """One vehicle's mean state. `n_m`, `e_m`: relative to this vehicle; 0 of itself."""

    __slots__ = (
        "bias_e",
        "bias_n",
        "e_m",
        "heard_s",
        "lost",
        "n_m",
        "odo_e",
        "odo_n",
        "shut_out_s",
        "told_s",
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
        self.told_s = -1.0  # < 0: never
        self.lost = False  # it has told nothing for longer than it is taken to fly on
        self.heard_s = 0.0  # the time up to which odo_n, odo_e are brought
        self.shut_out_s = -1.0  # when its ranges began to be no good; < 0: they are
