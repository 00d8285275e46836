"""An airframe that flies until it touches something, and then falls."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mission.common.frames import Vec3
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState

GRAVITY_MPS2: Final = 9.80665
ON_ITS_SIDE_RAD: Final = math.pi / 2.0


class Fragile:
    """An Airframe: another one until `fall`, from then on a thing that drops to the ground below and stays there.

    Its propellers are broken: what is commanded does not matter any more. It falls straight down, on its side.
    """

    def __init__(self, body: Airframe, ground_up_m: Callable[[float, float], float]) -> None:
        """`ground_up_m`: of a place (east, north; m), its height."""
        self._body = body
        self._ground_up_m = ground_up_m
        self._fallen: AirframeState | None = None

    @property
    def state(self) -> AirframeState:
        """As it is now."""
        return self._fallen or self._body.state

    def fall(self) -> None:
        """It has touched something. Once is enough."""
        if self._fallen is None:
            state = self._body.state
            self._fallen = _lying(state.pos_ned_m, 0.0, state.attitude_rad[2], on_ground=state.on_ground)

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors, while there are any."""
        if self._fallen is None:
            self._body.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Sets what to follow."""
        if self._fallen is None:
            self._body.command(vel_ned_mps, yaw_rad)

    def set_ground(self, down_m: float) -> None:
        """The ground below it."""
        if self._fallen is None:
            self._body.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air about it, while it flies."""
        if self._fallen is None:
            self._body.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`."""
        before = self._fallen
        if before is None:
            self._body.step(dt_s)
        elif not before.on_ground:
            north_m, east_m, down_m = before.pos_ned_m
            ground_m = -self._ground_up_m(east_m, north_m)
            sinks_mps = before.vel_ned_mps[2] + GRAVITY_MPS2 * dt_s
            down_m += 0.5 * (before.vel_ned_mps[2] + sinks_mps) * dt_s
            there = down_m >= ground_m
            fallen_ned_m = (north_m, east_m, ground_m if there else down_m)
            self._fallen = _lying(fallen_ned_m, 0.0 if there else sinks_mps, before.attitude_rad[2], on_ground=there)


def _lying(pos_ned_m: Vec3, sinks_mps: float, yaw_rad: float, *, on_ground: bool) -> AirframeState:
    return AirframeState(
        pos_ned_m=pos_ned_m,
        vel_ned_mps=(0.0, 0.0, sinks_mps),
        attitude_rad=(ON_ITS_SIDE_RAD, 0.0, yaw_rad),
        rates_radps=(0.0, 0.0, 0.0),
        on_ground=on_ground,
        throttle=0.0,
    )
