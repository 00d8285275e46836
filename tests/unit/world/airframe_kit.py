"""A JSBSim quadrotor in hover, and what it recorded."""

from __future__ import annotations

from mission.common.frames import LocalFrame, Vec3, Wgs84
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.airframe.wind import CALM, Wind

FRAME = LocalFrame(Wgs84(-35.363, 149.165, 584.0))
SAMPLE_S = 0.02
STILL: Vec3 = (0.0, 0.0, 0.0)
GUSTY = Wind((3.0, 4.0, 0.0), turbulence_mps=5.0)


def record(airframe: Airframe, seconds: float) -> list[AirframeState]:
    states = []
    for _ in range(round(seconds / SAMPLE_S)):
        airframe.step(SAMPLE_S)
        states.append(airframe.state)
    return states


def hovering(*, rate_hz: int = 200, wind: Wind = CALM, seed: int = 0, height_m: float = 40.0) -> JsbsimQuad:
    quad = JsbsimQuad(FRAME, (0.0, 0.0, -height_m), 0.0, rate_hz=rate_hz, wind=wind, seed=seed)
    quad.set_armed(True)
    quad.step(8.0)
    return quad


def gusty_flight(seed: int) -> list[AirframeState]:
    quad = JsbsimQuad(FRAME, (1.0, 2.0, 0.0), 0.5, wind=GUSTY, seed=seed)
    quad.set_armed(True)
    quad.command((1.0, -1.0, -1.0), 2.0)
    return record(quad, 3.0)


if __name__ == "__main__":  # what another process makes of it
    print(repr(gusty_flight(7)))
