"""What is ArduCopter's own: its flight modes, and which command asks for what."""

from __future__ import annotations

from companion.core.types import CLIMBS_IN_OFFBOARD, FlightMode, Request
from companion.mavlink import dialect
from companion.mavlink.personality import Altitude, Command, Personality

GUIDED, RTL, LAND, BRAKE = 4, 6, 9, 17

FLIGHT_MODES = {
    GUIDED: FlightMode.OFFBOARD,
    BRAKE: FlightMode.HOLD,  # not LOITER: that one follows the pilot's sticks, and descends when they are low
    RTL: FlightMode.RETURN,
    LAND: FlightMode.LAND,
}
NAMES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    GUIDED: "GUIDED",
    5: "LOITER",
    RTL: "RTL",
    7: "CIRCLE",
    LAND: "LAND",
    11: "DRIFT",
    13: "SPORT",
    16: "POSHOLD",
    BRAKE: "BRAKE",
    21: "SMART_RTL",
    27: "AUTO_RTL",
}


def command(request: Request, altitude: Altitude) -> Command:
    """MAV_CMD and its parameters; a takeoff's altitude is above home."""
    match request:
        case Request.ARM:
            return dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1,)
        case Request.OFFBOARD:
            return dialect.MAV_CMD_DO_SET_MODE, (1, GUIDED)
        case Request.TAKEOFF:
            return dialect.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, altitude.above_home_m)
        case Request.LAND:
            return dialect.MAV_CMD_NAV_LAND, ()


# The prearm bit alone is true long before arming is accepted (22.5 s and 40.4 s after boot, as recorded).
ARDUPILOT = Personality(
    "ArduPilot",
    CLIMBS_IN_OFFBOARD,
    FLIGHT_MODES,
    NAMES,
    command,
    streams_hz={dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1},
    ready_ekf_flags=dialect.EKF_POS_HORIZ_ABS,
)
