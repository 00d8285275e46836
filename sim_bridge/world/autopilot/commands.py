"""MAV_CMD, as any personality hears it: the wire's two forms, and the commands that all answer alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Wgs84
from sim_bridge.world.autopilot.protocols.streams import StreamTable
from sim_bridge.world.autopilot.types import Result

FORCE_MAGIC: Final = 21196.0  # COMPONENT_ARM_DISARM param2
# of a home or a target: ArduPilot's altitudes are int32 centimetres, messages have millimetres
ALT_MAX_M: Final = 83_000.0
INT32_MAX = 2**31 - 1  # "not given" in COMMAND_INT's x and y
_RELATIVE_FRAMES = frozenset({mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
FlightT = TypeVar("FlightT")


@dataclass(frozen=True, slots=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT: p1..p4, a place in degrees, an altitude in m. NaN: not given."""

    id: int
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    lat_deg: float = 0.0
    lon_deg: float = 0.0
    alt_m: float = 0.0
    relative_alt: bool = False  # to home, rather than above sea level


def from_long(message: Any) -> Command:
    """COMMAND_LONG."""
    return Command(
        message.command,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.param5,
        message.param6,
        message.param7,
    )


def from_int(message: Any) -> Command:
    """COMMAND_INT: its x and y are 1e-7 degrees, INT32_MAX for none (NaN here)."""
    return Command(
        message.command,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        math.nan if message.x == INT32_MAX else message.x / 1e7,
        math.nan if message.y == INT32_MAX else message.y / 1e7,
        message.z,
        message.frame in _RELATIVE_FRAMES,
    )


@dataclass(frozen=True, slots=True)
class Context(Generic[FlightT]):
    """Context that a command acts on. `send` queues one message on the asker's link; False: no such message."""

    flight: FlightT
    frame: LocalFrame
    streams: StreamTable
    send: Callable[[int], bool]
    send_interval: Callable[[int, int], None]
    now_s: float
    now_us: int


Handler = Callable[[Context[FlightT], Command], Result]


def execute(handlers: Mapping[int, Handler[FlightT]], context: Context[FlightT], command: Command) -> Result:
    """Unknown commands are UNSUPPORTED."""
    handler = handlers.get(command.id)
    return handler(context, command) if handler else Result.UNSUPPORTED


def whole(value: float, default: int | None = None) -> int | None:
    """A parameter that means an integer; `default` for NaN; None for what is no int32."""
    if math.isnan(value):
        return default
    return int(value) if abs(value) < 2.0**31 else None


def arm_disarm(context: Context[Any], command: Command) -> Result:
    """COMPONENT_ARM_DISARM."""
    force = command.p2 == FORCE_MAGIC
    result = Result.UNSUPPORTED
    if command.p1 == 1.0:
        result = context.flight.arm(context.now_s, force=force)
    elif command.p1 == 0.0:
        result = context.flight.disarm(force=force)
    return result


def change_speed(context: Context[Any], command: Command) -> Result:
    """DO_CHANGE_SPEED."""
    result: Result = context.flight.change_speed(command.p2)
    return result


def set_home(context: Context[Any], command: Command) -> Result:
    """DO_SET_HOME: here, or at a place on Earth."""
    pos_ned_m = None
    if command.p1 != 1.0:
        position = (command.lat_deg, command.lon_deg, command.alt_m)
        inside = abs(position[0]) <= 90.0 and abs(position[1]) <= 180.0 and abs(position[2]) <= ALT_MAX_M
        if not inside:  # nor NaN
            return Result.DENIED
        pos_ned_m = context.frame.to_ned(Wgs84(*position))
    result: Result = context.flight.set_home(pos_ned_m, context.now_s)
    return result


def terminate(context: Context[Any], command: Command) -> Result:
    """DO_FLIGHTTERMINATION."""
    result: Result = context.flight.terminate() if command.p1 > 0.5 else Result.ACCEPTED
    return result


def prearm_checks(context: Context[Any], command: Command) -> Result:
    """RUN_PREARM_CHECKS."""
    del command
    return Result.TEMPORARILY_REJECTED if context.flight.armed else Result.ACCEPTED


def get_message_interval(context: Context[Any], command: Command) -> Result:
    """MESSAGE_INTERVAL, then the acknowledgement."""
    message_id = whole(command.p1)
    if message_id is None or not 0 <= message_id <= 0xFFFF:
        return Result.FAILED
    context.send_interval(message_id, context.streams.interval_us(message_id))
    return Result.ACCEPTED


def request_of(message_id: int, refusal: Result) -> Callable[[Context[Any], Command], Result]:
    """The older commands that ask for one certain message."""

    def handler(context: Context[Any], command: Command) -> Result:
        del command
        return Result.ACCEPTED if context.send(message_id) else refusal

    return handler
