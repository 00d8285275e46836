"""Simulated autopilots: what each does for its vehicle, and what its MAVLink clients see of it."""

from sim_bridge.world.autopilot.ardupilot.autopilot import ArduCopterAutopilot
from sim_bridge.world.autopilot.ardupilot.tables import CopterMode
from sim_bridge.world.autopilot.battery import BatterySpec
from sim_bridge.world.autopilot.personality import CANOPY_PARAMETERS, CAPACITY, make_autopilot
from sim_bridge.world.autopilot.protocols.links import Link, LinkCounts
from sim_bridge.world.autopilot.protocols.parameters import ParameterError
from sim_bridge.world.autopilot.px4.autopilot import Px4Autopilot
from sim_bridge.world.autopilot.px4.tables import Px4Mode
from sim_bridge.world.autopilot.types import Autopilot, Failsafe, LandedState, Snapshot, StreamProfile
from sim_bridge.world.autopilot.vehicle import PROFILES

__all__ = [
    "CANOPY_PARAMETERS",
    "CAPACITY",
    "PROFILES",
    "ArduCopterAutopilot",
    "Autopilot",
    "BatterySpec",
    "CopterMode",
    "Failsafe",
    "LandedState",
    "Link",
    "LinkCounts",
    "ParameterError",
    "Px4Autopilot",
    "Px4Mode",
    "Snapshot",
    "StreamProfile",
    "make_autopilot",
]
