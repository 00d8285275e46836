"""PX4's answers to MAV_CMD: one function a command, one table of all."""

from __future__ import annotations

import math

from companion.mavlink import dialect as mav
from mission.common.frames import Wgs84
from sim_bridge.world.autopilot import commands
from sim_bridge.world.autopilot.commands import (
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
from sim_bridge.world.autopilot.px4 import tables
from sim_bridge.world.autopilot.px4.flight import Px4Flight
from sim_bridge.world.autopilot.px4.tables import Px4Mode
from sim_bridge.world.autopilot.types import Result

Context = commands.Context[Px4Flight]
Handler = commands.Handler[Px4Flight]


def _set_mode(context: Context, command: Command) -> Result:
    base, main, sub = whole(command.p1), whole(command.p2), whole(command.p3, 0)
    if base is None or main is None or sub is None or not base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return Result.TEMPORARILY_REJECTED
    try:
        mode = Px4Mode(main << 16 | (sub << 24 if main == tables.MAIN_AUTO else 0))
    except ValueError:
        return Result.TEMPORARILY_REJECTED
    return context.flight.set_mode(mode, context.now_s)


def _takeoff(context: Context, command: Command) -> Result:
    """The place is ignored: up from where the vehicle stands."""
    return context.flight.takeoff(_alt_amsl_m(context, command))


def _land(context: Context, command: Command) -> Result:
    """Here: PX4's NAV_LAND outside a mission ignores the place."""
    del command
    return context.flight.set_mode(Px4Mode.LAND, context.now_s)


def _return(context: Context, command: Command) -> Result:
    del command
    return context.flight.set_mode(Px4Mode.RTL, context.now_s)


def _reposition(context: Context, command: Command) -> Result:
    nan = math.nan
    north = east = nan
    alt_m = _alt_amsl_m(context, command)
    origin_alt_m = context.frame.origin.alt_m
    if math.isfinite(command.lat_deg) and math.isfinite(command.lon_deg):
        if abs(command.lat_deg) > 90.0 or abs(command.lon_deg) > 180.0:
            return Result.DENIED
        point = Wgs84(command.lat_deg, command.lon_deg, origin_alt_m)
        north, east, _ = context.frame.to_ned(point)
    flags = whole(command.p2, 0)
    if flags is None:
        return Result.DENIED
    result = context.flight.reposition((north, east, origin_alt_m - alt_m), command.p4, change_mode=bool(flags & 1))
    if result is Result.ACCEPTED and command.p1 > 0.0:
        context.flight.change_speed(command.p1)
    return result


def _set_message_interval(context: Context, command: Command) -> Result:
    message_id, interval_us = whole(command.p1), whole(command.p2)
    if message_id is None or interval_us is None:
        return Result.FAILED
    known = context.streams.set_interval_us(message_id, interval_us, context.now_us)
    return Result.ACCEPTED if known or message_id in tables.ABSENT_STREAM_IDS else Result.FAILED


def _request_message(context: Context, command: Command) -> Result:
    message_id = whole(command.p1)
    return Result.ACCEPTED if message_id is not None and context.send(message_id) else Result.DENIED


def _alt_amsl_m(context: Context, command: Command) -> float:
    """The command's altitude above sea level; NaN as given."""
    home = context.flight.home_ned_m
    if command.relative_alt and home is not None:
        return command.alt_m + context.frame.origin.alt_m - home[2]
    return command.alt_m


COMMANDS: dict[int, Handler] = {
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
    mav.MAV_CMD_NAV_LAND: _land,
    mav.MAV_CMD_NAV_TAKEOFF: _takeoff,
    mav.MAV_CMD_DO_SET_MODE: _set_mode,
    mav.MAV_CMD_DO_CHANGE_SPEED: change_speed,
    mav.MAV_CMD_DO_SET_HOME: set_home,
    mav.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
    mav.MAV_CMD_DO_REPOSITION: _reposition,
    mav.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
    mav.MAV_CMD_RUN_PREARM_CHECKS: prearm_checks,
    mav.MAV_CMD_GET_HOME_POSITION: request_of(mav.MAVLINK_MSG_ID_HOME_POSITION, Result.DENIED),
    mav.MAV_CMD_GET_MESSAGE_INTERVAL: get_message_interval,
    mav.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mav.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mav.MAV_CMD_REQUEST_PROTOCOL_VERSION: request_of(mav.MAVLINK_MSG_ID_PROTOCOL_VERSION, Result.DENIED),
    mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: request_of(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION, Result.DENIED),
}
