"""What is PX4's own: its flight modes, and which command asks for what."""

from __future__ import annotations

import math

from companion.core.types import FlightMode, Request
from companion.mavlink import dialect

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
Command = tuple[int, tuple[float, float, float, float, float, float, float]]


def command(request: Request, altitude_amsl_m: float) -> Command:
    """MAV_CMD and its seven parameters; a takeoff's altitude is above mean sea level."""
    match request:
        case Request.ARM:
            return dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1, 0, 0, 0, 0, 0, 0)
        case Request.OFFBOARD:
            return dialect.MAV_CMD_DO_SET_MODE, (1, OFFBOARD >> 16 & 0xFF, 0, 0, 0, 0, 0)
        case Request.TAKEOFF:
            return dialect.MAV_CMD_NAV_TAKEOFF, (NAN, NAN, NAN, NAN, NAN, NAN, altitude_amsl_m)
        case Request.LAND:
            return dialect.MAV_CMD_NAV_LAND, (NAN, NAN, NAN, NAN, NAN, NAN, NAN)


REQUESTS = {command(request, 0.0)[0]: request for request in Request}
