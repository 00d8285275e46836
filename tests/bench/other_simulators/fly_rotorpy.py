"""RotorPy: rigid body, rotors and drag, integrated by scipy; its own velocity controller. In Python and numpy."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
from course import STEER_HZ, Vec, fly_course, starts
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

STEP_HZ = 100  # its simulator's own default


class RotorPy:
    """Eight of its quadrotors, one after the other: its batched ones want torch."""

    def __init__(self) -> None:
        self._vehicles = [Multirotor(quad_params, control_abstraction="cmd_vel") for _ in starts()]
        self._states = [
            vehicle.initial_state | {"x": np.array(place)}
            for vehicle, place in zip(self._vehicles, starts(), strict=True)
        ]

    def positions(self) -> list[list[float]]:
        """ENU m."""
        return [state["x"].tolist() for state in self._states]

    def step(self, velocities_mps: Sequence[Vec]) -> None:
        """The integrator's steps between two setpoints."""
        for k, (vehicle, wanted) in enumerate(zip(self._vehicles, velocities_mps, strict=True)):
            control = {"cmd_v": np.array(wanted)}
            for _ in range(STEP_HZ // STEER_HZ):
                self._states[k] = vehicle.step(self._states[k], control, 1.0 / STEP_HZ)


if __name__ == "__main__":
    fly_course(RotorPy(), version=version("rotorpy"), rates="steps of 100 Hz, RK45 inside")
