"""An airframe as an autopilot knows it whose estimate of its position is wrong, for whatever reason.

Its velocity stays right, and so does its attitude: a position that jumps, one that stays as it was to the bit, one that
leaves the truth slowly, and a height that is wrong. The autopilot flies by them in its own modes, as it reports them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from mission.common.frames import Vec3
from mission.schema.kinds import FaultKind
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.state import AirframeState

STRIKES_POSITION: Final = frozenset(
    {FaultKind.POSITION_JUMP, FaultKind.POSITION_FREEZE, FaultKind.POSITION_DRIFT, FaultKind.HEIGHT_ERROR}
)


class FaultyPosition:
    """An Airframe whose state is another's, but for its position."""

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe
        self._jump_ne_m = (0.0, 0.0)
        self._drift_ne_mps: tuple[float, float] | None = None
        self._astray_ne_m = (0.0, 0.0)
        self._too_high_m = 0.0
        self._frozen_ned_m: Vec3 | None = None

    @property
    def state(self) -> AirframeState:
        """Position as reported, the rest as it is."""
        known = self._airframe.state
        if self._frozen_ned_m is not None:
            return replace(known, pos_ned_m=self._frozen_ned_m)
        north, east = self._jump_ne_m[0] + self._astray_ne_m[0], self._jump_ne_m[1] + self._astray_ne_m[1]
        if not (north or east or self._too_high_m):
            return known
        pos = known.pos_ned_m
        return replace(known, pos_ned_m=(pos[0] + north, pos[1] + east, pos[2] - self._too_high_m))

    def set_jump(self, jump_ne_m: tuple[float, float]) -> None:
        """Puts the position so far off, north and east."""
        self._jump_ne_m = jump_ne_m

    def set_drift(self, drift_ne_mps: tuple[float, float] | None) -> None:
        """Leads the position astray so fast, north and east; None: no more, and it is at once where it should be."""
        self._drift_ne_mps = drift_ne_mps
        if drift_ne_mps is None:
            self._astray_ne_m = (0.0, 0.0)

    def set_height_error(self, too_high_m: float) -> None:
        """Makes the height too large by so much."""
        self._too_high_m = too_high_m

    def freeze(self, is_frozen: bool) -> None:
        """Leaves the position as it is now, or lets it go on."""
        if is_frozen is (self._frozen_ned_m is None):
            self._frozen_ned_m = self.state.pos_ned_m if is_frozen else None

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors."""
        self._airframe.set_armed(armed)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Follow a velocity, which is known as it is."""
        self._airframe.command(vel_ned_mps, yaw_rad)

    def set_ground(self, down_m: float) -> None:
        """The ground is where it is."""
        self._airframe.set_ground(down_m)

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """The air is where it is."""
        self._airframe.set_wind(mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance the airframe by `dt_s`, and the drift with it."""
        self._airframe.step(dt_s)
        if self._drift_ne_mps is not None:
            north, east = self._astray_ne_m
            drift = self._drift_ne_mps
            self._astray_ne_m = (north + drift[0] * dt_s, east + drift[1] * dt_s)
