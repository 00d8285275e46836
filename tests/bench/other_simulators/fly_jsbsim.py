"""Our airframes alone: JSBSim's rigid body, rotors, legs and air, and velocity loops inside JSBSim."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

from course import STEER_HZ, Vec, fly_course, starts

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned, ned_to_enu
from sim_bridge.world.airframe.jsbsim_quad import RATES_HZ, JsbsimQuad

FRAME = LocalFrame(Wgs84(45.0, 9.0, 0.0))


class Airframes:
    """Eight of them, one after the other, as the bridge's World steps them."""

    def __init__(self) -> None:
        self._quads = [JsbsimQuad(FRAME, enu_to_ned(place), 0.0) for place in starts()]
        for quad in self._quads:
            quad.set_armed(True)

    def positions(self) -> list[Vec]:
        """ENU m."""
        return [ned_to_enu(quad.state.pos_ned_m) for quad in self._quads]

    def step(self, velocities_mps: Sequence[Vec]) -> None:
        """The physics' steps between two setpoints."""
        for quad, wanted in zip(self._quads, velocities_mps, strict=True):
            quad.command(enu_to_ned(wanted), 0.0)
            quad.step(1.0 / STEER_HZ)


if __name__ == "__main__":
    fly_course(Airframes(), version=version("jsbsim"), rates=f"physics and control {RATES_HZ[0]} Hz")
