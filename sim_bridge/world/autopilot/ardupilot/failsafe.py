"""Failsafes of ArduCopter: a lost ground station or position, a low battery, a fence that is breached."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mission.common.frames import Vec3
from sim_bridge.world.autopilot.ardupilot import tables
from sim_bridge.world.autopilot.ardupilot.tables import CopterAction, CopterMode
from sim_bridge.world.autopilot.battery import Battery
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.types import BatteryLevel, Failsafe

LOW_S: Final = 10.0  # the battery must be below for so long


@dataclass(frozen=True, slots=True)
class Trip:
    """A condition that begins: its cause, its STATUSTEXT, and the action that its parameter asks for."""

    cause: Failsafe
    text: str
    action: CopterAction


class Conditions:
    """Each condition trips once, and again only after it has cleared. `now_s`: seconds since boot."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self.fence_breached = False
        self._gcs_heard_s: float | None = None
        self._gcs_lost = False
        self._position_lost = False
        self._battery_acted = BatteryLevel.OK
        self._battery_low_s = 0.0

    def hear_gcs(self, now_s: float) -> bool:
        """The ground station's heartbeat has come; True when it was lost before."""
        self._gcs_heard_s = now_s
        cleared, self._gcs_lost = self._gcs_lost, False
        return cleared

    def gcs(self, now_s: float, mode: CopterMode) -> Trip | None:
        """The ground station has been silent for FS_GCS_TIMEOUT, after it was heard once."""
        value = self._parameters
        action = tables.GCS_ACTIONS.get(int(value["FS_GCS_ENABLE"]))
        heard_s = self._gcs_heard_s
        if action is None or heard_s is None or self._gcs_lost or now_s - heard_s < value["FS_GCS_TIMEOUT"]:
            return None
        self._gcs_lost = True
        options = int(value["FS_OPTIONS"])
        landing = mode is CopterMode.LAND and options & tables.GCS_FAILSAFE_SPARES_LANDING
        spared = mode in tables.STICK_MODES and options & tables.GCS_FAILSAFE_SPARES_STICKS
        return Trip(Failsafe.GCS_LOSS, "GCS Failsafe", CopterAction.NONE if landing or spared else action)

    def battery(self, now_s: float, level: BatteryLevel, battery: Battery) -> Trip | None:
        """The battery has been worse for LOW_S than it was when this tripped last."""
        if level <= self._battery_acted:
            self._battery_low_s = now_s
            return None
        if now_s - self._battery_low_s < LOW_S:
            return None
        self._battery_acted = level
        word, name = ("critical", "BATT_FS_CRT_ACT") if level is BatteryLevel.CRITICAL else ("low", "BATT_FS_LOW_ACT")
        used = f"{battery.voltage_v:.2f}V used {battery.consumed_mah:.0f} mAh"
        action = tables.BATTERY_ACTIONS.get(int(self._parameters[name]), CopterAction.NONE)
        return Trip(Failsafe.BATTERY, f"Battery 1 is {word} {used}", action)

    def position(self, *, has_position: bool) -> Trip | None:
        """The EKF has lost its position: it lands, level and without control of where (FS_EKF_ACTION 1)."""
        before, self._position_lost = self._position_lost, not has_position
        if before or has_position:
            return None
        return Trip(Failsafe.POSITION_LOSS, "EKF Failsafe: changed to LAND Mode", CopterAction.LAND)

    def fence(self, breach: str) -> Trip | None:
        """`breach`: which fence the vehicle is outside of, "" for none; `fence_breached` is that of the last call."""
        before, self.fence_breached = self.fence_breached, bool(breach)
        if before or not breach:
            return None
        action = tables.FENCE_ACTIONS.get(int(self._parameters["FENCE_ACTION"]), CopterAction.NONE)
        return Trip(Failsafe.GEOFENCE, f"{breach} fence breached", action)


def fence_breach(parameters: ParameterTable, fence: Fence, home_ned_m: Vec3 | None, pos_ned_m: Vec3) -> str:
    """The fence that the vehicle has left, in ArduCopter's words; empty: none. NED m about the mission's origin."""
    if home_ned_m is None:
        return ""
    kinds = int(parameters["FENCE_TYPE"])
    height_m = home_ned_m[2] - pos_ned_m[2]
    away_m = math.hypot(pos_ned_m[0] - home_ned_m[0], pos_ned_m[1] - home_ned_m[1])
    if kinds & tables.FENCE_ALT_MAX and height_m > parameters["FENCE_ALT_MAX"]:
        return "Max Alt"
    if kinds & tables.FENCE_CIRCLE and away_m > parameters["FENCE_RADIUS"]:
        return "Circle"
    if kinds & tables.FENCE_POLYGON and fence.breached(pos_ned_m, within_all=True):
        return "Polygon"
    return ""
