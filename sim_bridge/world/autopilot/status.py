"""Status messages of any autopilot: its firmware, its health, its battery."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from companion.mavlink import dialect as mav
from sim_bridge.world.autopilot.battery import Battery
from sim_bridge.world.autopilot.protocols.links import Packed
from sim_bridge.world.autopilot.telemetry import U16_MAX, Readings, clamped

FTP = 0x20  # MAV_PROTOCOL_CAPABILITY_FTP: nothing here answers it, and clients would wait seconds for it
STATUSTEXT_BYTES: Final = 50
_BATTERY_STATUS = mav.MAVLink_battery_status_message.unpacker


@dataclass(frozen=True, slots=True)
class Firmware:
    """AUTOPILOT_VERSION, as recorded."""

    capabilities: int
    flight_version: int
    uid_base: int  # and a vehicle's sysid
    middleware_version: int = 0
    os_version: int = 0
    board_version: int = 0
    flight_custom_version: tuple[int, ...] = (0,) * 8


def protocol_version(r: Readings) -> Any:
    """PROTOCOL_VERSION: MAVLink 2, down to 1."""
    del r
    none = [0] * 8
    return mav.MAVLink_protocol_version_message(200, 100, 200, none, none)


def autopilot_version(firmware: Firmware, sysid: int) -> Any:
    """AUTOPILOT_VERSION of the vehicle `sysid`; its uid is its own."""
    none = [0] * 8
    return mav.MAVLink_autopilot_version_message(
        firmware.capabilities,
        firmware.flight_version,
        firmware.middleware_version,
        firmware.os_version,
        firmware.board_version,
        list(firmware.flight_custom_version),
        none,
        none,
        0,
        0,
        firmware.uid_base + sysid,
        [*b"UNDERSTORY", *[0] * 7, sysid],  # uid2, 18 bytes
    )


def sys_status(r: Readings, present: int, enabled: int, health: int, load: int = 0) -> Any:
    """Bits of MAV_SYS_STATUS_SENSOR; `load` of the processor in 0.1 %."""
    battery = r.battery
    current = clamped(battery.current_a * 100.0, 0, 32767)
    dropped_and_errors = (0, 0, 0, 0, 0, 0)
    return mav.MAVLink_sys_status_message(
        present, enabled, health, load, _battery_mv(battery), current, _battery_percent(battery), *dropped_and_errors
    )


def _battery_percent(battery: Battery) -> int:
    return clamped(battery.remaining * 100.0, 0, 100)


def _battery_mv(battery: Battery) -> int:
    return clamped(battery.voltage_v * 1000.0, 0, U16_MAX - 1)


def battery_status(r: Readings, charge_state: int) -> Packed:
    """BATTERY_STATUS; `charge_state` as MAV_BATTERY_CHARGE_STATE."""
    battery = r.battery
    payload = _BATTERY_STATUS.pack(
        round(battery.consumed_mah),
        -1,  # energy unknown
        32767,  # temperature unknown
        _battery_mv(battery),
        *[U16_MAX] * 9,  # no more cells
        clamped(battery.current_a * 100.0, 0, 32767),
        0,
        1,  # MAV_BATTERY_FUNCTION_ALL
        1,  # MAV_BATTERY_TYPE_LIPO
        _battery_percent(battery),
        0,  # time left unknown
        charge_state,
        *[0] * 6,  # further cells, mode, faults
    )
    return Packed(mav.MAVLINK_MSG_ID_BATTERY_STATUS, payload)


def texts(severity: int, text: str, text_id: int) -> list[Any]:
    """STATUSTEXT, in chunks of 50 bytes under `text_id` where longer."""
    data = text.encode("ascii", errors="replace")
    chunks = [data[at : at + STATUSTEXT_BYTES] for at in range(0, len(data), STATUSTEXT_BYTES)]
    if len(chunks) == 1:
        return [mav.MAVLink_statustext_message(severity, data, 0, 0)]
    if len(chunks[-1]) == STATUSTEXT_BYTES:
        chunks.append(b"")  # a text ends with a chunk that is not full
    return [mav.MAVLink_statustext_message(severity, chunk, text_id, number) for number, chunk in enumerate(chunks)]
