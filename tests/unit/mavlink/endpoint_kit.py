"""One endpoint, placed, and messages for its links."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from tests.unit.core.core_kit import mission

ME = 3
TICK_S = 0.05
COMPANION, AUTOPILOT, STATION = 191, 1, 190
HOME = dialect.MAVLink_home_position_message(470_000_000, 80_000_000, 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
TIMESYNC = dialect.MAVLINK_MSG_ID_TIMESYNC


def packed(*messages: Any, system: int = ME, component: int = AUTOPILOT) -> bytes:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    return b"".join(m.pack(mav) for m in messages)


def position(north_m: float = 1.0, boot_ms: int = 1000) -> Any:
    return dialect.MAVLink_local_position_ned_message(boot_ms, north_m, 0.0, -8.0, 0.0, 0.0, 0.0)


def heartbeat(custom_mode: int = 4 << 16 | 3 << 24, *, make: int = 12, vehicle: int = 2) -> Any:
    return dialect.MAVLink_heartbeat_message(vehicle, make, 0x81, custom_mode, 4, 3)


def command(number: int, *, system: int = ME, component: int = COMPANION) -> Any:
    return dialect.MAVLink_command_long_message(system, component, number, 0, 0, 0, 0, 0, 0, 0, 0)


def endpoint(**tables: Any) -> Endpoint:
    return Endpoint(mission(**tables), ME)


def placed(**tables: Any) -> Endpoint:
    """One that knows where it is."""
    one = endpoint(**tables)
    one.from_autopilot(packed(HOME, position(), heartbeat()), 10.0)
    return one


def read(data: bytes) -> list[Any]:
    """As a ground station would."""
    return ardupilotmega.MAVLink(None).parse_buffer(data) or []


def ids(data: bytes) -> list[str]:
    return [m.get_type() for m in read(data)]


FLOWING = (
    position(),
    dialect.MAVLink_extended_sys_state_message(0, 1),
    dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 42, 0, 0, 0, 0, 0, 0),
    dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 80, 80, 0, 0, 12, 0, 900, 900, 0, 0),
)
