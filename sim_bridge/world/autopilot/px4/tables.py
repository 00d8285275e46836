"""PX4's tables: modes, parameters, streams, failsafe actions. PX4 1.16, as recorded in flights."""

from __future__ import annotations

from enum import IntEnum

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.types import BatteryLevel, StreamProfile


class Px4Mode(IntEnum):
    """HEARTBEAT.custom_mode: main mode << 16 | sub mode << 24."""

    MANUAL = 0x0010000
    ALTCTL = 0x0020000
    POSCTL = 0x0030000
    TAKEOFF = 0x2040000
    HOLD = 0x3040000
    MISSION = 0x4040000
    RTL = 0x5040000
    LAND = 0x6040000
    ACRO = 0x0050000
    OFFBOARD = 0x0060000
    STABILIZED = 0x0070000


MAIN_AUTO = 4
EV_VELOCITY = 4  # bit of EKF2_EV_CTRL
STICK_MODES = frozenset({Px4Mode.MANUAL, Px4Mode.ALTCTL, Px4Mode.POSCTL, Px4Mode.ACRO, Px4Mode.STABILIZED})
NO_ARMING_MODES = STICK_MODES | {Px4Mode.LAND, Px4Mode.RTL}  # sticks: there is no RC here

_CUSTOM = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_AUTO = (
    _CUSTOM | mav.MAV_MODE_FLAG_AUTO_ENABLED | mav.MAV_MODE_FLAG_GUIDED_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
)
_STICKS = _CUSTOM | mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED


def base_mode(mode: Px4Mode, *, armed: bool) -> int:
    """HEARTBEAT.base_mode: 29 in the auto modes, 17 in OFFBOARD, 81 with sticks; +128 armed (as recorded)."""
    if mode is Px4Mode.OFFBOARD:
        flags = _CUSTOM | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
    elif mode in STICK_MODES:
        flags = _STICKS
    else:
        flags = _AUTO
    return int(flags | (mav.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0))


class Action(IntEnum):
    """Action of a failsafe, from mild to severe."""

    WARN = 1
    HOLD = 2
    RTL = 3
    LAND = 4
    DESCEND = 5  # no position control: down, drifting
    TERMINATE = 6


# Parameter's value -> what it does. Unlisted: nothing.
OFFBOARD_LOSS_ACTIONS = {  # COM_OBL_RC_ACT; 0-2 want sticks, and without RC they end in an emergency descent
    0: (Action.DESCEND, Px4Mode.POSCTL),
    1: (Action.DESCEND, Px4Mode.ALTCTL),
    2: (Action.DESCEND, Px4Mode.MANUAL),
    3: (Action.RTL, Px4Mode.RTL),
    4: (Action.LAND, Px4Mode.LAND),
    5: (Action.HOLD, Px4Mode.HOLD),
    6: (Action.TERMINATE, Px4Mode.OFFBOARD),
    7: (Action.TERMINATE, Px4Mode.OFFBOARD),
}
ACTION_MODES = {  # DESCEND shows as a landing
    Action.HOLD: Px4Mode.HOLD,
    Action.RTL: Px4Mode.RTL,
    Action.LAND: Px4Mode.LAND,
    Action.DESCEND: Px4Mode.LAND,
}
GCS_LOSS_ACTIONS = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.TERMINATE}
GEOFENCE_ACTIONS = {1: Action.WARN, 2: Action.HOLD, 3: Action.RTL, 4: Action.TERMINATE, 5: Action.LAND}
BATTERY_ACTIONS: dict[BatteryLevel, tuple[str, dict[int, Action]]] = {  # COM_LOW_BAT_ACT
    BatteryLevel.LOW: ("Low battery", {}),
    BatteryLevel.CRITICAL: ("Critical battery", {2: Action.LAND, 3: Action.RTL}),
    BatteryLevel.EMERGENCY: ("Dangerous battery level", {2: Action.LAND, 3: Action.LAND}),
}

# Name -> default; an int is INT32, a float REAL32 on the wire.
PARAMETERS: dict[str, int | float] = {
    "BAT1_CAPACITY": 5000.0,
    "BAT1_N_CELLS": 4,
    "BAT1_V_CHARGED": 4.05,
    "BAT1_V_EMPTY": 3.6,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "CBRK_SUPPLY_CHK": 0,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0,
    "COM_FLTT_LOW_ACT": 3,  # this and the next: kept, without effect here
    "COM_LOW_BAT_ACT": 0,
    "COM_OBC_LOSS_T": 5.0,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_POS_LOW_ACT": 3,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_IN_MODE": 1,
    "COM_RC_LOSS_T": 0.5,
    "COM_RC_OVERRIDE": 1,
    "COM_SPOOLUP_TIME": 1.0,
    "EKF2_EV_CTRL": 15,
    "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1,  # this and the next: kept, without effect here (sim.range_finder)
    "EKF2_RNG_CTRL": 1,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_PREDICT": 0,
    "GF_SOURCE": 0,
    "MAV_COMP_ID": 1,
    "MAV_SYS_ID": 1,
    "MAV_TYPE": 2,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_ACC_HOR": 3.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_ALT1": 10.0,
    "MPC_LAND_ALT2": 5.0,
    "MPC_LAND_ALT3": 1.0,
    "MPC_LAND_CRWL": 0.3,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TKO_RAMP_T": 3.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_P": 0.95,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_P_ACC": 4.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_DLL_ACT": 0,
    "NAV_MC_ALT_RAD": 0.8,
    "NAV_RCL_ACT": 2,
    "RTL_CONE_ANG": 45,
    "RTL_DESCEND_ALT": 30.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0,
    "SYS_AUTOSTART": 10040,
}


STREAM_RATES_HZ: dict[StreamProfile, dict[int, float]] = {
    StreamProfile.ONBOARD: {
        mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mav.MAVLINK_MSG_ID_ATTITUDE: 98.0,
        mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 49.0,
        mav.MAVLINK_MSG_ID_HIGHRES_IMU: 49.0,
        mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 49.0,
        mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 29.0,
        mav.MAVLINK_MSG_ID_ODOMETRY: 29.0,
        mav.MAVLINK_MSG_ID_ALTITUDE: 10.0,
        mav.MAVLINK_MSG_ID_VFR_HUD: 10.0,
        mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
        mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
        mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
        mav.MAVLINK_MSG_ID_TIMESYNC: 10.0,
        mav.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
        mav.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
        mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
        mav.MAVLINK_MSG_ID_PING: 1.0,
        mav.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
        mav.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        mav.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
        mav.MAVLINK_MSG_ID_VIBRATION: 0.5,
    },
    StreamProfile.GROUND: {
        mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mav.MAVLINK_MSG_ID_ATTITUDE: 49.0,
        mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 49.0,
        mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: 49.0,
        mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 49.0,
        mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 49.0,
        mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 49.0,
        mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 49.0,
        mav.MAVLINK_MSG_ID_VFR_HUD: 20.0,
        mav.MAVLINK_MSG_ID_ALTITUDE: 10.0,
        mav.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
        mav.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        mav.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
        mav.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        mav.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
        mav.MAVLINK_MSG_ID_VIBRATION: 0.1,
    },
    StreamProfile.MINIMAL: {
        mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mav.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    },
}

# PX4's streams that this autopilot has no data for: any interval is accepted (recorded: ack 0), and nothing comes.
ABSENT_STREAM_IDS = frozenset(
    {8, 26, 29, 42, 62, 65, 87, 116, 129, 132, 137, 140, 143, 231, 290, 291, 380, 411, 436, 12901, 12904}
)
