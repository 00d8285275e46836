"""ArduCopter: its flight modes, the command of each request, and its parameters under a canopy.

Parameters and their meanings: ArduCopter 4.5-4.7, whose own reference names them.
"""

from __future__ import annotations

from companion.core.model.states import AutopilotTraits, FlightMode, Request, VelocityShaping
from companion.mavlink import dialect
from companion.mavlink.makes.make import Aid, Altitude, Command, Make, Rule
from mission.document.model import Mission

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
TRAITS = AutopilotTraits(
    takeoff=(Request.OFFBOARD, Request.ARM, Request.TAKEOFF),
    climbs_in=FlightMode.OFFBOARD,
    climb_short_m=1.0,
    climb_shows_s=4.0,  # the motors spool up: it shows 2.3 s later, and begins anew when asked again
    mode_shows_s=2.0,
    stream_first_s=0.3,
    failsafe_ends_s=3.0,  # it stays in GUIDED
    # WPNAV_ACCEL, and 1.4 of PSC_JERK_XY as recorded, both at their defaults.
    shaping=VelocityShaping(dead_s=0.25, acceleration_mps2=2.5, jerk_mps3=7.0, lag_s=0.25),
)


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


CANOPY_RULES = (
    Rule(
        "GUID_TIMEOUT",
        {0.5: "seconds"},
        "A vehicle whose companion hangs flies on blindly for this long (default 3 s), then brakes.",
    ),
    Rule(
        "FS_GCS_ENABLE",
        {0: "none", 5: "land", 7: "brake or land"},
        "The ground station is out of reach by design. 1, 3, 4 and 6 return or retrace.",
    ),
    Rule(
        "MAV_GCS_SYSID",
        {255: "the ground station"},
        "Heartbeats of this system id are the ground station's: never a vehicle's own, which its companion shares.",
        older_names=("SYSID_MYGCS",),
    ),
    Rule(
        "FS_THR_ENABLE",
        {3: "land", 7: "brake or land"},
        "Under trees the pilot's radio will drop out. The default, 1, returns, and climbs for it.",
    ),
    Rule(
        "FS_OPTIONS",
        {20: "GUIDED goes on", 4: "GUIDED goes on", 16: "in every mode", 0: "in every mode"},
        "Where the pilot's radio drops out the mission goes on; else each loss takes the vehicle out of the swarm.",
    ),
    Rule(
        "FS_EKF_ACTION",
        {1: "land", 3: "land, in every mode"},
        "Without a position the vehicle comes down where it is. 2 wants a pilot, 0 does nothing.",
    ),
    Rule(
        "FS_DR_ENABLE",
        {1: "land", 0: "none"},
        "While the position is only guessed: the default, 2, returns by guesswork.",
        optional=True,
    ),
    Rule(
        "BATT_FS_LOW_ACT",
        {1: "land", 0: "none", 7: "brake or land"},
        "Low: the companion gives up leadership and lands at 10 %. 2, 3, 4 and 6 return or retrace.",
    ),
    Rule(
        "BATT_FS_CRT_ACT",
        {1: "land", 7: "brake or land"},
        "Critical, when the companion has not landed: down, here.",
    ),
    Rule(
        "FENCE_ACTION",
        {4: "brake, or land", 2: "land"},
        "The second fence, behind the companion's own. 1, 3 and 5 return or retrace; 0 only reports.",
    ),
)
FENCE_TYPE_ALTITUDE, FENCE_TYPE_POLYGON = 1, 4  # bits of FENCE_TYPE


def fence_rules(mission: Mission) -> tuple[Rule, ...]:
    """The mission's ceiling, which ArduPilot counts from home, and what makes the fence work."""
    types, words = FENCE_TYPE_ALTITUDE, "ceiling"
    if mission.fence.polygon_enu_m is not None:
        types, words = FENCE_TYPE_ALTITUDE | FENCE_TYPE_POLYGON, "ceiling and polygon"
    ceiling_m = mission.ceiling_m
    return (
        Rule("FENCE_ENABLE", {1: "on"}, "The fence works only when it is on."),
        Rule("FENCE_TYPE", {types: words}, "What the mission's fence has; no circle about home (2), no floor (8)."),
        Rule(
            "FENCE_ALT_MAX",
            {ceiling_m: "metres"},
            "The mission's ceiling, above home.",
        ),
    )


SATELLITE_RULES = (
    Rule("EK3_SRC1_POSXY", {3: "GPS"}, "It leads by GNSS, where it has a fix; a second source set is for crowns."),
)


def odometry_rules(mission: Mission) -> tuple[Rule, ...]:
    """The EKF's sources. Its origin must be set besides, wherever: by a ground station (SET_GPS_GLOBAL_ORIGIN)."""
    del mission
    return (
        Rule("EK3_SRC1_POSXY", {0: "none", 6: "ExternalNav"}, "Flow gives velocities, external navigation both."),
        Rule("EK3_SRC1_VELXY", {5: "OpticalFlow", 6: "ExternalNav"}, "Not GPS, 3: there is no fix under crowns."),
        Rule("EK3_SRC1_VELZ", {0: "none", 6: "ExternalNav"}, "Not GPS, 3."),
        Rule("EK3_SRC1_POSZ", {1: "Baro", 2: "RangeFinder", 6: "ExternalNav"}, "Not GPS, 3."),
        Rule("EK3_SRC1_YAW", {1: "Compass", 6: "ExternalNav"}, "Not GPS, 2 or 3."),
    )


ANY = -1  # bit
AIDS = (
    Aid("EK3_SRC1_VELXY 5 and FLOW_TYPE not 0", {"FLOW_TYPE": ANY}, {"EK3_SRC1_VELXY": 5}),
    Aid("EK3_SRC1_VELXY 6 and VISO_TYPE not 0", {"VISO_TYPE": ANY}, {"EK3_SRC1_VELXY": 6}),
)
HEIGHT_AIDS = (
    Aid(
        "EK3_SRC1_POSZ 2 (range finder), RNGFND1_ORIENT 25 (down) and RNGFND1_TYPE not 0",
        {"RNGFND1_TYPE": ANY},
        {"EK3_SRC1_POSZ": 2, "RNGFND1_ORIENT": 25},
    ),
)
# The companion's velocity beside that of satellites: a second source, and all velocities fused. The other drivers turn
# it by a yaw that they have of poses
ODOMETRY_AIDS = (
    Aid(
        "EK3_SRC2_VELXY 6 (external), EK3_SRC_OPTIONS with 1 (fuse all velocities) and VISO_TYPE 1 (MAVLink)",
        {"EK3_SRC_OPTIONS": 1},
        {"EK3_SRC2_VELXY": 6, "VISO_TYPE": 1},
    ),
)

ARDUPILOT = Make(
    key="ardupilot",
    name="ArduPilot",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    traits=TRAITS,
    modes=FLIGHT_MODES,
    mode_names=NAMES,
    command=command,
    streams_hz={dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1},
    reception_hz={dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2, dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2},
    # The prearm bit alone is true long before arming is accepted (22.5 s and 40.4 s after boot, as recorded).
    ready_ekf_flags=dialect.EKF_POS_HORIZ_ABS,
    ready_state=None,
    ready_about="pre-arm checks passed and the estimator knows where it is (EKF_STATUS_REPORT), which comes later",
    id_parameter="MAV_SYSID",
    serial_parameters="SERIAL2_PROTOCOL 2, SERIAL2_BAUD",
    canopy_rules=CANOPY_RULES,
    fence_rules=fence_rules,
    satellite_rules=SATELLITE_RULES,
    odometry_rules=odometry_rules,
    aids=AIDS,
    height_aids=HEIGHT_AIDS,
    odometry_aids=ODOMETRY_AIDS,
    takes_odometry=False,  # only poses and body-frame velocities (LOCAL_FRD, BODY_FRD); all else it drops unsaid
)
