"""crazyflow: rigid bodies and the Crazyflie's control loops in JAX, compiled; eight vehicles in one world."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
from course import STEER_HZ, N, Vec, fly_course, starts
from crazyflow.control import Control
from crazyflow.sim import Sim

YAW = (0.0, 0.0, 0.0, 1.0)  # quaternion, x y z w


class Crazyflow:
    """Its Mellinger controller takes a place and a velocity: the place that the velocities so far lead to."""

    def __init__(self) -> None:
        self.sim = Sim(n_worlds=1, n_drones=N, control=Control.state)
        self._places = np.array([starts()], dtype=np.float32)
        states = self.sim.data.states
        self.sim.data = self.sim.data.replace(states=states.replace(pos=states.pos.at[...].set(self._places)))
        self._command = np.zeros((1, N, 16), dtype=np.float32)
        self._command[..., 9:13] = YAW

    def positions(self) -> list[list[float]]:
        """ENU m."""
        places: list[list[float]] = np.asarray(self.sim.data.states.pos)[0].tolist()
        return places

    def step(self, velocities_mps: Sequence[Vec]) -> None:
        """All of the physics' steps between two setpoints in one compiled call."""
        wanted = np.array([velocities_mps], dtype=np.float32)
        self._places += wanted / STEER_HZ
        self._command[..., :3], self._command[..., 3:6] = self._places, wanted
        self.sim.state_control(self._command)
        self.sim.step(self.sim.freq // STEER_HZ)


if __name__ == "__main__":
    flown = Crazyflow()
    fly_course(
        flown, version=version("crazyflow"), rates=f"physics and attitude {flown.sim.freq} Hz, velocity 100 Hz, float32"
    )
