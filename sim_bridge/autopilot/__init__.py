"""What an autopilot does for its vehicle, and what its MAVLink clients see of it."""

from sim_bridge.autopilot.battery import BatterySpec
from sim_bridge.autopilot.links import Link, LinkCounts
from sim_bridge.autopilot.parameters import ParameterError
from sim_bridge.autopilot.px4 import PROFILES, Px4Autopilot, Snapshot
from sim_bridge.autopilot.px4_flight import LandedState
from sim_bridge.autopilot.px4_tables import Failsafe, Px4Mode, StreamProfile

__all__ = [
    "PROFILES",
    "BatterySpec",
    "Failsafe",
    "LandedState",
    "Link",
    "LinkCounts",
    "ParameterError",
    "Px4Autopilot",
    "Px4Mode",
    "Snapshot",
    "StreamProfile",
]
