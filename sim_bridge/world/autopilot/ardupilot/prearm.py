"""ArduCopter's checks before arming."""

from __future__ import annotations

from sim_bridge.world.autopilot.ardupilot import tables
from sim_bridge.world.autopilot.ardupilot.tables import CopterMode
from sim_bridge.world.autopilot.types import BatteryLevel


def prearm_refusals(
    now_s: float, mode: CopterMode, *, checks: bool, home_known: bool, level: BatteryLevel
) -> list[str]:
    """Reasons not to arm the vehicle now, in ArduCopter's words and order. `checks`: ARMING_CHECK is not 0."""
    if now_s < tables.INITIALISED_S:
        return ["System not initialised"]
    aligned = now_s >= tables.EKF_ALIGNED_S
    accels_ok = now_s >= tables.ACCELS_CONSISTENT_S
    blind = mode in tables.NEEDS_POSITION and now_s < tables.POSITION_S
    reasons = (
        (not aligned, "Need Alt Estimate"),
        (checks and not accels_ok, "Accels inconsistent"),
        (checks and accels_ok and now_s < tables.GYROS_CONSISTENT_S, "Gyros inconsistent"),
        (not aligned, "EKF attitude is bad"),
        (not home_known, "AHRS: waiting for home"),
        (home_known and blind, "Need Position Estimate"),
        (checks and level is not BatteryLevel.OK, "Battery 1 below minimum arming voltage"),
    )
    return [why for holds, why in reasons if holds]
