"""What is PX4's own: its flight modes, and which command asks for what."""

from __future__ import annotations

import math

from companion.core.types import CLIMBS_IN_TAKEOFF, FlightMode, Request
from companion.mavlink import dialect
from companion.mavlink.personality import Altitude, Command, Personality

MAIN_AUTO = 4
OFFBOARD = 6 << 16
TAKEOFF = MAIN_AUTO << 16 | 2 << 24
HOLD = MAIN_AUTO << 16 | 3 << 24
RETURN = MAIN_AUTO << 16 | 5 << 24
LAND = MAIN_AUTO << 16 | 6 << 24

FLIGHT_MODES = {
    OFFBOARD: FlightMode.OFFBOARD,
    TAKEOFF: FlightMode.TAKEOFF,
    HOLD: FlightMode.HOLD,
    RETURN: FlightMode.RETURN,
    LAND: FlightMode.LAND,
}
NAMES = {
    1 << 16: "MANUAL",
    2 << 16: "ALTCTL",
    3 << 16: "POSCTL",
    5 << 16: "ACRO",
    6 << 16: "OFFBOARD",
    7 << 16: "STABILIZED",
    TAKEOFF: "AUTO.TAKEOFF",
    HOLD: "AUTO.HOLD",
    RETURN: "AUTO.RTL",
    LAND: "AUTO.LAND",
}
NAN = math.nan


def command(request: Request, altitude: Altitude) -> Command:
    """MAV_CMD and its parameters; a takeoff's altitude is above mean sea level."""
    match request:
        case Request.ARM:
            return dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1,)
        case Request.OFFBOARD:
            return dialect.MAV_CMD_DO_SET_MODE, (1, OFFBOARD >> 16 & 0xFF)
        case Request.TAKEOFF:
            return dialect.MAV_CMD_NAV_TAKEOFF, (NAN, NAN, NAN, NAN, NAN, NAN, altitude.amsl_m)
        case Request.LAND:
            return dialect.MAV_CMD_NAV_LAND, (NAN, NAN, NAN, NAN, NAN, NAN, NAN)


PX4 = Personality("PX4", CLIMBS_IN_TAKEOFF, FLIGHT_MODES, NAMES, command, streams_hz={}, ready_ekf_flags=0)
