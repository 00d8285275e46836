"""ArduCopter's answers to MAV_CMD: one function a command, one table of all."""

from __future__ import annotations

import math

from companion.mavlink import dialect as mav
from mission.common.frames import Wgs84
from sim_bridge.world.autopilot import commands
from sim_bridge.world.autopilot.ardupilot import tables
from sim_bridge.world.autopilot.ardupilot.flight import CopterFlight
from sim_bridge.world.autopilot.ardupilot.tables import CopterMode
from sim_bridge.world.autopilot.commands import (
    ALT_MAX_M,
    Command,
    arm_disarm,
    change_speed,
    get_message_interval,
    prearm_checks,
    request_of,
    set_home,
    terminate,
    whole,
)
from sim_bridge.world.autopilot.types import Notice, Result

Context = commands.Context[CopterFlight]
Handler = commands.Handler[CopterFlight]


def _set_mode(context: Context, command: Command) -> Result:
    base, number = whole(command.p1), whole(command.p2)
    if base is None or number is None or not base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return Result.DENIED
    return context.flight.set_mode(number)


def _takeoff(context: Context, command: Command) -> Result:
    """Param7 is the height above home, in every frame that is heard here."""
    return context.flight.takeoff(command.alt_m, context.now_s)


def _mode(mode: CopterMode) -> Handler:
    """Commands that only change the mode."""

    def handler(context: Context, command: Command) -> Result:
        del command
        return context.flight.set_mode(mode)

    return handler


def _reposition(context: Context, command: Command) -> Result:
    """Heights are above home where the frame says so."""
    north, east, down = math.nan, math.nan, math.nan
    origin, home = context.frame.origin, context.flight.home_ned_m
    if abs(command.lat_deg) <= 90.0 and abs(command.lon_deg) <= 180.0:
        north, east, _ = context.frame.to_ned(Wgs84(command.lat_deg, command.lon_deg, origin.alt_m))
    if abs(command.alt_m) <= ALT_MAX_M:
        down = (home[2] if command.relative_alt and home is not None else origin.alt_m) - command.alt_m
    flags = whole(command.p2, 0)
    if flags is None or not math.isfinite(north):
        return Result.DENIED
    return context.flight.reposition((north, east, down), command.p4, change_mode=bool(flags & 1))


def _set_message_interval(context: Context, command: Command) -> Result:
    message_id, interval_us = whole(command.p1), whole(command.p2)
    if message_id is None or interval_us is None:
        return Result.FAILED
    if message_id in tables.ABSENT_STREAM_IDS:
        return Result.ACCEPTED
    known = message_id not in tables.UNKNOWN_STREAM_IDS
    if known and context.streams.set_interval_us(message_id, interval_us, context.now_us):
        return Result.ACCEPTED
    context.flight.notices.append(Notice(mav.MAV_SEVERITY_INFO, f"No ap_message for mavlink id ({message_id})"))
    return Result.DENIED


def _request_message(context: Context, command: Command) -> Result:
    message_id = whole(command.p1)
    if message_id is None or message_id in tables.UNKNOWN_STREAM_IDS or not context.send(message_id):
        return Result.FAILED
    return Result.ACCEPTED


COMMANDS: dict[int, Handler] = {
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _mode(CopterMode.RTL),
    mav.MAV_CMD_NAV_LAND: _mode(CopterMode.LAND),
    mav.MAV_CMD_NAV_TAKEOFF: _takeoff,
    mav.MAV_CMD_DO_SET_MODE: _set_mode,
    mav.MAV_CMD_DO_CHANGE_SPEED: change_speed,
    mav.MAV_CMD_DO_SET_HOME: set_home,
    mav.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
    mav.MAV_CMD_DO_REPOSITION: _reposition,
    mav.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
    mav.MAV_CMD_RUN_PREARM_CHECKS: prearm_checks,
    mav.MAV_CMD_GET_HOME_POSITION: request_of(mav.MAVLINK_MSG_ID_HOME_POSITION, Result.FAILED),
    mav.MAV_CMD_GET_MESSAGE_INTERVAL: get_message_interval,
    mav.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mav.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: request_of(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION, Result.FAILED),
}
