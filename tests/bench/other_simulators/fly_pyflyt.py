"""PyFlyt: Bullet's rigid bodies, rotors and PID loops in Python (numba)."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
from course import STEER_HZ, Vec, fly_course, starts
from PyFlyt.core import Aviary

GROUND_VELOCITY = 6  # QuadX's flight mode: vx, vy, yaw rate, vz
CONTROL_HZ = 120  # QuadX's own; physics at 240 Hz, as Bullet wants it


class PyFlyt:
    """One aviary of eight."""

    def __init__(self) -> None:
        places = np.array(starts())
        self._aviary = Aviary(places, np.zeros_like(places), drone_type="quadx", seed=1)
        self._aviary.set_mode(GROUND_VELOCITY)

    def positions(self) -> list[list[float]]:
        """ENU m."""
        return [state[3].tolist() for state in self._aviary.all_states]

    def step(self, velocities_mps: Sequence[Vec]) -> None:
        """The control loop's steps between two setpoints."""
        self._aviary.set_all_setpoints(np.array([(x, y, 0.0, z) for x, y, z in velocities_mps]))
        for _ in range(CONTROL_HZ // STEER_HZ):
            self._aviary.step()


if __name__ == "__main__":
    fly_course(PyFlyt(), version=version("PyFlyt"), rates="physics 240 Hz, control 120 Hz")
