"""What an autopilot does for its vehicle, and what its MAVLink clients see of it."""

from sim_bridge.autopilot.ardupilot import ArduCopterAutopilot
from sim_bridge.autopilot.ardupilot_tables import CopterMode
from sim_bridge.autopilot.battery import BatterySpec
from sim_bridge.autopilot.links import Link, LinkCounts
from sim_bridge.autopilot.parameters import ParameterError
from sim_bridge.autopilot.personality import CANOPY_PARAMETERS, CAPACITY, make_autopilot
from sim_bridge.autopilot.px4 import Px4Autopilot
from sim_bridge.autopilot.px4_tables import Px4Mode
from sim_bridge.autopilot.types import Autopilot, Failsafe, LandedState, Snapshot, StreamProfile
from sim_bridge.autopilot.vehicle import PROFILES

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
