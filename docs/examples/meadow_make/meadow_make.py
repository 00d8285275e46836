"""A make of autopilot in a package of its own: Meadow, which nobody sells. Its modes, requests and parameters."""

from dataclasses import replace

from companion.core.model.states import FlightMode, Request
from companion.mavlink import dialect
from companion.mavlink.makes.make import Make, Rule
from companion.mavlink.makes.px4 import PX4

AUTOPILOT = 77  # in HEARTBEAT; no MAV_AUTOPILOT of anybody
STAY, STEERED, DOWN = 100, 200, 300  # custom_mode
NAMES = {0: "MANUAL", STAY: "STAY", STEERED: "STEERED", DOWN: "DOWN"}


def command(request, altitude):
    """MAV_CMD and its parameters; a take-off's altitude is above home."""
    match request:
        case Request.ARM:
            return dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1,)
        case Request.OFFBOARD:
            return dialect.MAV_CMD_DO_SET_MODE, (1, STEERED)
        case Request.TAKEOFF:
            return dialect.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, altitude.above_home_m)
        case Request.LAND:
            return dialect.MAV_CMD_NAV_LAND, ()


MEADOW = Make(
    key="meadow",
    name="Meadow",
    autopilot=AUTOPILOT,
    traits=replace(
        PX4.traits,
        takeoff=(Request.ARM, Request.OFFBOARD, Request.TAKEOFF),  # the order in which it takes them
        climbs_in=FlightMode.OFFBOARD,
    ),
    modes={STAY: FlightMode.HOLD, STEERED: FlightMode.OFFBOARD, DOWN: FlightMode.LAND},  # MANUAL is the pilot's
    mode_names=NAMES,
    command=command,
    streams_hz={},
    reception_hz={},
    ready_ekf_flags=0,
    ready_state=dialect.MAV_STATE_STANDBY,
    ready_about="its pre-arm checks have passed.",
    id_parameter="MDW_ID",
    serial_parameters="MDW_BAUD",
    canopy_rules=(Rule("MDW_LOST", {1: "stay"}, "0 would come home, through the crowns."),),
    fence_rules=lambda mission: (Rule("MDW_CEILING", {mission.fence.altitude_max_m: "metres"}, "The mission's."),),
    satellite_rules=(),
    odometry_rules=lambda _mission: (),
)
