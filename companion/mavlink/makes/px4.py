"""PX4: its flight modes, the command of each request, and its parameters under a canopy.

Parameters and their meanings: PX4 1.14-1.16, whose own reference names them.
"""

from __future__ import annotations

import math

from companion.core.model.states import AutopilotTraits, FlightMode, Request, VelocityShaping
from companion.mavlink import dialect
from companion.mavlink.makes.make import Aid, Altitude, Command, Make, Rule
from mission.document.model import Mission

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
TRAITS = AutopilotTraits(
    takeoff=(Request.ARM, Request.TAKEOFF),
    climbs_in=FlightMode.TAKEOFF,
    climb_short_m=1.0,  # it stops 0.8 m short
    climb_shows_s=4.0,
    mode_shows_s=2.0,  # its HEARTBEAT, one a second, shows it late, and one may be lost on the way
    stream_first_s=0.3,  # it wants two or three setpoints
    failsafe_ends_s=3.0,  # at once; one HEARTBEAT that shows it may be lost
    # Mostly it follows with a lag alone. In turns of a flight in JSBSim this comes nearer at times.
    shaping=VelocityShaping(dead_s=0.25, acceleration_mps2=2.5, jerk_mps3=7.0, lag_s=0.25),
)


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


CANOPY_RULES = (
    Rule(
        "COM_OF_LOSS_T",
        {0.5: "seconds"},
        "A vehicle whose companion hangs flies on blindly for this long; the companion itself counts on 0.5 s.",
    ),
    Rule(
        "COM_OBL_RC_ACT",
        {5: "hold", 4: "land"},
        "What follows. The default, 0, wants a pilot's sticks; without them it descends and drifts sideways.",
    ),
    Rule(
        "NAV_RCL_ACT",
        {1: "hold", 3: "land"},
        "Under trees the pilot's radio will drop out. The default, 2, returns, and climbs for it.",
    ),
    Rule(
        "COM_RCL_EXCEPT",
        {4: "not in OFFBOARD", 0: "in every mode"},
        "Where the pilot's radio drops out the mission goes on. With 0 each loss takes the vehicle out of the swarm.",
    ),
    Rule(
        "NAV_DLL_ACT",
        {0: "none", 1: "hold", 3: "land"},
        "The ground station is out of reach by design. 2 returns, and refuses to arm beside a companion alone.",
    ),
    Rule(
        "COM_LOW_BAT_ACT",
        {2: "land when critical"},
        "The companion lands at 10 %; this is for when it cannot. The default only warns; 3 returns.",
    ),
    Rule(
        "COM_FLTT_LOW_ACT",
        {1: "warn", 0: "none"},
        "The default, 3, returns as soon as the battery is just enough for the way home.",
        optional=True,
    ),
    Rule(
        "COM_POS_LOW_ACT",
        {5: "land", 2: "hold", 1: "warn", 0: "none"},
        "A poor position is usual under a canopy. The default, 3, returns.",
        optional=True,
    ),
    Rule(
        "COM_RC_OVERRIDE",
        {3: "in auto modes and in OFFBOARD"},
        "A pilot who moves the sticks has the vehicle, whatever the companion does.",
    ),
    Rule(
        "GF_ACTION",
        {2: "hold", 5: "land"},
        "The second fence, behind the companion's own. 3 returns, 4 cuts the motors.",
    ),
)


def fence_rules(mission: Mission) -> tuple[Rule, ...]:
    """The mission's ceiling, which PX4 counts from home."""
    ceiling_m = mission.ceiling_m
    return (
        Rule(
            "GF_MAX_VER_DIST",
            {ceiling_m: "metres"},
            "The mission's ceiling, above home.",
        ),
    )


SATELLITE_RULES = (
    Rule(
        "EKF2_GPS_CTRL",
        {7: "position, height, velocity", 5: "position, velocity", 15: "with heading", 13: "with heading"},
        "It leads by GNSS, where it has a fix; under crowns by flow (EKF2_OF_CTRL) or vision (EKF2_EV_CTRL).",
    ),
)


def odometry_rules(mission: Mission) -> tuple[Rule, ...]:
    """By optical flow (EKF2_OF_CTRL) or visual-inertial odometry (EKF2_EV_CTRL), whichever it carries."""
    climb_m = mission.route.d1_enu_m[2]
    return (
        Rule("EKF2_GPS_CTRL", {0: "none"}, "GNSS fixes that come and go would make its position jump."),
        Rule("COM_ARM_WO_GPS", {1: "yes", 2: "yes, without a warning"}, "It is armed without GNSS."),
        Rule("MIS_TAKEOFF_ALT", {climb_m: "metres"}, "It knows no height above the sea, so it climbs to this one."),
    )


POSITION, VELOCITY = 1, 4  # bits of EKF2_EV_CTRL; 2 is height, 8 yaw
AIDS = (
    Aid("EKF2_OF_CTRL 1 (flow)", {"EKF2_OF_CTRL": 1}, {}),
    Aid("EKF2_EV_CTRL with 1 (position) or 4 (velocity)", {"EKF2_EV_CTRL": POSITION | VELOCITY}, {}),
)
# EKF2_RNG_CTRL 1 fuses ranges only below EKF2_RNG_A_VMAX (1 m/s) and EKF2_RNG_A_HMAX (5 m): not in transit
HEIGHT_AIDS = (
    Aid(
        "EKF2_HGT_REF 2 (range finder) and EKF2_RNG_CTRL 2 (1 stops at 1 m/s or 5 m: EKF2_RNG_A_VMAX, _HMAX)",
        {},
        {"EKF2_HGT_REF": 2, "EKF2_RNG_CTRL": 2},
    ),
)
ODOMETRY_AIDS = (Aid("EKF2_EV_CTRL with 4 (velocity)", {"EKF2_EV_CTRL": VELOCITY}, {}),)

PX4 = Make(
    key="px4",
    name="PX4",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    traits=TRAITS,
    modes=FLIGHT_MODES,
    mode_names=NAMES,
    command=command,
    streams_hz={},
    reception_hz={dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2, dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2},
    ready_ekf_flags=0,
    ready_state=dialect.MAV_STATE_STANDBY,
    ready_about="pre-arm checks passed and state STANDBY",
    id_parameter="MAV_SYS_ID",
    serial_parameters="MAV_1_CONFIG, SER_TEL2_BAUD",
    canopy_rules=CANOPY_RULES,
    fence_rules=fence_rules,
    satellite_rules=SATELLITE_RULES,
    odometry_rules=odometry_rules,
    aids=AIDS,
    height_aids=HEIGHT_AIDS,
    odometry_aids=ODOMETRY_AIDS,
    ground_hold=(dialect.MAV_CMD_DO_SET_MODE, (1, MAIN_AUTO, HOLD >> 24)),
)
