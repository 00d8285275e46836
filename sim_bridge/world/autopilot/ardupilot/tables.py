"""ArduCopter's tables: modes, parameters, streams, texts of its boot. ArduCopter 4.7-dev, as recorded in flights."""

from __future__ import annotations

from enum import Enum, IntEnum

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.protocols.parameters import INT8, INT16
from sim_bridge.world.autopilot.types import StreamProfile


class CopterMode(IntEnum):
    """HEARTBEAT.custom_mode."""

    STABILIZE = 0
    ALT_HOLD = 2
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17


STICK_MODES = frozenset({CopterMode.STABILIZE, CopterMode.ALT_HOLD, CopterMode.LOITER, CopterMode.POSHOLD})
NEEDS_POSITION = frozenset({CopterMode.GUIDED, CopterMode.LOITER, CopterMode.RTL, CopterMode.POSHOLD, CopterMode.BRAKE})
ARMING_MODES = STICK_MODES | {CopterMode.GUIDED}

_CUSTOM = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_STICKS = _CUSTOM | mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED


def base_mode(mode: CopterMode, *, armed: bool, booting: bool) -> int:
    """HEARTBEAT.base_mode: 81 in STABILIZE, 89 in the rest and while booting; +128 armed (as recorded)."""
    manual = mode in (CopterMode.STABILIZE, CopterMode.ALT_HOLD) and not booting
    flags = _STICKS if manual else _STICKS | mav.MAV_MODE_FLAG_GUIDED_ENABLED
    return int(flags | (mav.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0))


# Times after boot in seconds. The recordings begin with the first heartbeat, 1.014 s after boot.
FIRST_HEARTBEAT_S = 1.014
INITIALISED_S = 2.45  # "ArduPilot Ready"; before it, arming is refused for one reason only
RC_SWITCH_S = 2.65  # the RC's mode switch is read, and takes back whatever mode a client has asked for
EKF_ALIGNED_S = 5.9
GPS_FIX_S = 9.8
ACCELS_CONSISTENT_S = 12.0
HOME_S = 20.02  # the EKF's origin is set, and home with it
GYROS_CONSISTENT_S = 22.1
PREARM_CHECKED_S = 23.5
POSITION_S = 41.42  # "EKF3 IMU0 is using GPS"
PREARM_TEXT_S = 30.45  # and every 30 s after it, while something is wrong
LOGGING_STOPS_S = 16.0  # disarmed

BOOT_TEXTS: tuple[tuple[float, str], ...] = (
    (1.92, "Barometer 1 calibration complete"),
    (1.92, "Barometer 2 calibration complete"),
    (INITIALISED_S, "ArduPilot Ready"),
    (INITIALISED_S, "AHRS: DCM active"),
    (2.745, "RC7: SaveWaypoint LOW"),
    (4.45, "EKF3 IMU0 initialised"),
    (4.45, "EKF3 IMU1 initialised"),
    (4.45, "AHRS: EKF3 active"),
    (5.8, "EKF3 IMU0 tilt alignment complete"),
    (5.8, "EKF3 IMU1 tilt alignment complete"),
    (EKF_ALIGNED_S, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (EKF_ALIGNED_S, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    (9.8, "GPS 1: probing for u-blox at 230400 baud"),
    (9.82, "GPS 1: detected u-blox"),
    (HOME_S, "EKF3 IMU0 origin set"),
    (20.05, "Field Elevation Set: {ground_m:.0f}m"),
    (20.22, "EKF3 IMU1 origin set"),
    (POSITION_S, "EKF3 IMU0 is using GPS"),
    (41.62, "EKF3 IMU1 is using GPS"),
)
IN_FLIGHT_TEXTS = ("EKF3 IMU0 MAG0 in-flight yaw alignment complete", "EKF3 IMU1 MAG0 in-flight yaw alignment complete")
IN_FLIGHT_TEXTS_HEIGHT_M = 2.6  # recorded: at 2.6-2.7 m, in the first climb


def ekf_flags(now_s: float) -> int:
    """EKF_STATUS_REPORT.flags: 167 means "constant position", 831 that a position is known."""
    if now_s < 5.1:
        return int(mav.EKF_UNINITIALIZED)
    if now_s < EKF_ALIGNED_S:
        return 0
    return 167 if now_s < POSITION_S else 831


# SYS_STATUS as recorded.
SENSORS_PRESENT = 0x5371FC0F
SENSORS_ENABLED = 0x52419C0F
HEALTH = 0x47519C0F
GPS_BIT = 0x20
POSITION_CONTROL_BITS = 0x6000  # in modes that control the position
AHRS_BIT = 0x200000  # once home is set
AHRS_S = 22.3
LOGGING_BIT = 0x1000000


class CopterAction(Enum):
    """Action of a failsafe."""

    NONE = 0
    RTL = 1
    LAND = 2
    BRAKE = 3
    TERMINATE = 4


# Parameter's value -> what it does; SmartRTL, which is not flown here, does what ArduCopter does without it.
GCS_ACTIONS = {
    1: CopterAction.RTL,
    2: CopterAction.RTL,
    3: CopterAction.RTL,
    4: CopterAction.LAND,
    5: CopterAction.LAND,
    6: CopterAction.RTL,
    7: CopterAction.BRAKE,
}
BATTERY_ACTIONS = {
    1: CopterAction.LAND,
    2: CopterAction.RTL,
    3: CopterAction.RTL,
    4: CopterAction.LAND,
    5: CopterAction.TERMINATE,
    6: CopterAction.RTL,
    7: CopterAction.BRAKE,
}
FENCE_ACTIONS = {
    1: CopterAction.RTL,
    2: CopterAction.LAND,
    3: CopterAction.RTL,
    4: CopterAction.BRAKE,
    5: CopterAction.LAND,
}
FENCE_ALT_MAX, FENCE_CIRCLE, FENCE_POLYGON, FENCE_ALT_MIN = 1, 2, 4, 8  # FENCE_TYPE
GCS_FAILSAFE_SPARES_STICKS = 16  # FS_OPTIONS
GCS_FAILSAFE_SPARES_LANDING = 8

# Name -> default; an int is INT32 unless PARAMETER_TYPES has another.
PARAMETERS: dict[str, int | float] = {
    "ANGLE_MAX": 3000,
    "ARMING_CHECK": 1,
    "BATT_ARM_VOLT": 0.0,
    "BATT_CAPACITY": 3300,
    "BATT_CRT_MAH": 0.0,
    "BATT_CRT_VOLT": 0.0,
    "BATT_FS_CRT_ACT": 0,
    "BATT_FS_LOW_ACT": 0,
    "BATT_LOW_MAH": 0.0,
    "BATT_LOW_TIMER": 10,
    "BATT_LOW_VOLT": 10.5,
    "BATT_MONITOR": 4,
    "DISARM_DELAY": 10,
    "EK3_SRC1_POSXY": 3,
    "EK3_SRC1_POSZ": 1,  # this and RNGFND1_*: kept, without effect here (sim.range_finder)
    "FENCE_ACTION": 1,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_ALT_MIN": -10.0,
    "FENCE_ENABLE": 0,
    "FENCE_MARGIN": 2.0,
    "FENCE_RADIUS": 300.0,
    "FENCE_TOTAL": 0,
    "FENCE_TYPE": 7,
    "FRAME_CLASS": 1,
    "FS_CRASH_CHECK": 1,
    "FS_DR_ENABLE": 2,  # kept, without effect here
    "FS_EKF_ACTION": 1,
    "FS_EKF_THRESH": 0.8,
    "FS_GCS_ENABLE": 0,
    "FS_GCS_TIMEOUT": 5.0,
    "FS_OPTIONS": 16,
    "FS_THR_ENABLE": 1,
    "FS_THR_VALUE": 975,
    "FS_VIBE_ENABLE": 1,
    "GUID_OPTIONS": 0,
    "GUID_TIMEOUT": 3.0,
    "LAND_ALT_LOW": 1000.0,
    "LAND_SPEED": 50,
    "LAND_SPEED_HIGH": 0,
    "LOIT_SPEED": 1250.0,
    "MAV_GCS_SYSID": 255,
    "MAV1_EXTRA1": 0,
    "MAV_OPTIONS": 0,
    "MAV_SYSID": 1,
    "MIS_TOTAL": 0,
    "PILOT_SPEED_DN": 0,
    "PILOT_SPEED_UP": 250,
    "PILOT_TKOFF_ALT": 0.0,
    "PILOT_TKOFF_DZ": 100,
    "PSC_JERK_XY": 5.0,
    "PSC_POSXY_P": 1.0,
    "PSC_POSZ_P": 1.0,
    "RNGFND1_ORIENT": 25,
    "RNGFND1_TYPE": 0,
    "RTL_ALT": 1500,
    "RTL_ALT_FINAL": 0,
    "RTL_CLIMB_MIN": 0,
    "RTL_CONE_SLOPE": 3.0,
    "RTL_LOIT_TIME": 5000,
    "RTL_SPEED": 0,
    "SCHED_LOOP_RATE": 400,
    "SIM_RATE_HZ": 1200,
    "SIM_SPEEDUP": 1.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_ACCEL_Z": 100.0,
    "WPNAV_JERK": 1.0,
    "WPNAV_RADIUS": 200.0,
    "WPNAV_SPEED": 1000.0,
    "WPNAV_SPEED_DN": 150.0,
    "WPNAV_SPEED_UP": 250.0,
    "WP_YAW_BEHAVIOR": 2,
}
_BYTES = (
    "BATT_FS_CRT_ACT BATT_FS_LOW_ACT BATT_LOW_TIMER BATT_MONITOR DISARM_DELAY EK3_SRC1_POSXY EK3_SRC1_POSZ FENCE_ACTION"
    " FENCE_ENABLE FENCE_TOTAL FENCE_TYPE FRAME_CLASS FS_CRASH_CHECK FS_EKF_ACTION FS_GCS_ENABLE FS_THR_ENABLE"
    " FS_VIBE_ENABLE RNGFND1_ORIENT RNGFND1_TYPE WP_YAW_BEHAVIOR"
)
_SHORTS = (
    "ANGLE_MAX FS_THR_VALUE LAND_SPEED LAND_SPEED_HIGH MAV_GCS_SYSID MAV_OPTIONS MAV_SYSID MIS_TOTAL PILOT_SPEED_DN"
    " PILOT_SPEED_UP PILOT_TKOFF_DZ RTL_ALT_FINAL RTL_CLIMB_MIN RTL_SPEED SCHED_LOOP_RATE SIM_RATE_HZ MAV1_EXTRA1"
)
PARAMETER_TYPES = {name: int(INT8) for name in _BYTES.split()} | {name: int(INT16) for name in _SHORTS.split()}

_UNASKED_HZ = {mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0, mav.MAVLINK_MSG_ID_TIMESYNC: 0.1}
STREAM_RATES_HZ: dict[StreamProfile, dict[int, float]] = {
    StreamProfile.ONBOARD: _UNASKED_HZ,
    StreamProfile.GROUND: _UNASKED_HZ,
    StreamProfile.MINIMAL: {mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0},
}
# Messages that this bridge makes and ArduCopter has not: asking for them is denied (TIMESYNC as recorded).
UNKNOWN_STREAM_IDS = frozenset(
    {
        mav.MAVLINK_MSG_ID_TIMESYNC,
        mav.MAVLINK_MSG_ID_ALTITUDE,
        mav.MAVLINK_MSG_ID_ODOMETRY,
        mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mav.MAVLINK_MSG_ID_PROTOCOL_VERSION,
    }
)
# ArduCopter's streams that this bridge has no data for: accepted, as recorded of 62 and 65, and silent.
ABSENT_STREAM_IDS = frozenset(
    {26, 27, 29, 34, 35, 42, 46, 62, 65, 87, 116, 124, 125, 127, 129, 132, 136, 137, 150, 152, 158, 162, 163, 164, 165}
    | {168, 173, 178, 182, 191, 192, 225, 226, 233, 263, 285, 290, 291}
)
# REQUEST_DATA_STREAM.req_stream_id -> the messages of that group.
DATA_STREAMS: dict[int, tuple[int, ...]] = {
    2: (mav.MAVLINK_MSG_ID_SYS_STATUS, mav.MAVLINK_MSG_ID_GPS_RAW_INT),
    3: (mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,),
    6: (mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    10: (mav.MAVLINK_MSG_ID_ATTITUDE,),
    11: (mav.MAVLINK_MSG_ID_VFR_HUD,),
    12: (
        mav.MAVLINK_MSG_ID_SYSTEM_TIME,
        mav.MAVLINK_MSG_ID_BATTERY_STATUS,
        mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mav.MAVLINK_MSG_ID_VIBRATION,
    ),
}
ALL_DATA_STREAMS = 0
DATA_STREAM_MAX_HZ = 50
