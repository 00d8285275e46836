"""Base of all airframes: a body that follows a velocity and a heading."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mission.common.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.state import AirframeState


class AirframeError(RuntimeError):
    """An airframe cannot be built or flown on this machine."""


class Airframe(Protocol):
    """One body in the air or on the ground. `step` advances it; nothing else does."""

    @property
    def state(self) -> AirframeState:
        """As it is now."""

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors. Stopped, the body obeys gravity."""

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Sets what to follow while armed: velocity (NED m/s), heading (rad, north to east)."""

    def set_ground(self, down_m: float) -> None:
        """Sets how far below the mission's origin the ground under it lies; flat where nobody says."""

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """Sets how the air about it moves, but for turbulence (NED m/s, where to); as made where nobody says."""

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`, a whole number of physics steps."""


AirframeFactory = Callable[[LocalFrame, Vec3, int], Airframe]  # frame, place on the ground (NED m), seed
