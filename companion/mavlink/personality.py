"""What differs between autopilots, as data: one `Personality` each in `px4` and `ardupilot`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from companion.core.types import FlightMode, Request, Takeoff
from companion.mavlink import dialect

Command = tuple[int, tuple[float, ...]]  # MAV_CMD and its parameters, as many as matter


@dataclass(frozen=True, slots=True)
class Altitude:
    """Where a takeoff ends."""

    amsl_m: float
    above_home_m: float


@dataclass(frozen=True, slots=True)
class Personality:
    """One make of autopilot."""

    name: str
    takeoff: Takeoff
    modes: Mapping[int, FlightMode]  # by HEARTBEAT.custom_mode; others are the pilot's
    names: Mapping[int, str]  # by the same, as an operator knows them
    command: Callable[[Request, Altitude], Command]
    streams_hz: Mapping[int, float]  # beside those that every autopilot is asked for
    ready_ekf_flags: int  # EKF_STATUS_REPORT flags that readiness needs beside SYS_STATUS' prearm bit; 0: none


# The same on both makes, so an answer tells its request.
REQUESTS = {
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: Request.ARM,
    dialect.MAV_CMD_DO_SET_MODE: Request.OFFBOARD,
    dialect.MAV_CMD_NAV_TAKEOFF: Request.TAKEOFF,
    dialect.MAV_CMD_NAV_LAND: Request.LAND,
}
