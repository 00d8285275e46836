"""ArduCopter as its MAVLink clients see it: quiet until asked, GUIDED, parameters by value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import Incoming
from mission.common.frames import LocalFrame
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.autopilot import commands, setpoint, status, telemetry
from sim_bridge.world.autopilot.ardupilot import commands as ardupilot_commands
from sim_bridge.world.autopilot.ardupilot import tables
from sim_bridge.world.autopilot.ardupilot.flight import CopterFlight
from sim_bridge.world.autopilot.ardupilot.tables import CopterMode
from sim_bridge.world.autopilot.battery import BatterySpec
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.protocols.channel import Channel
from sim_bridge.world.autopilot.protocols.links import Link, checked_sysid
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.protocols.streams import microseconds
from sim_bridge.world.autopilot.status import Firmware
from sim_bridge.world.autopilot.telemetry import Builder, Readings
from sim_bridge.world.autopilot.types import Result, Satellites, StreamProfile
from sim_bridge.world.autopilot.vehicle import PROFILES, MavlinkAutopilot

VTOL_STATE_MC: Final = 3
UNKNOWN_U16: Final = 65535
BATTERY = BatterySpec(capacity_mah=3300.0, cells=3, cell_full_v=4.2, cell_empty_v=3.4)  # 12.6 V full, as recorded


class ArduCopterAutopilot(MavlinkAutopilot):
    """The autopilot of vehicle `sysid`. `now_s` everywhere: seconds since its boot, never backwards.

    `links`: which links it has. `parameters`: presets by ArduPilot's names. `battery`: what is fitted.
    Raises ParameterError for presets that ArduCopter does not have, ValueError for a sysid outside 1..255.
    """

    TEXT_LINKS = frozenset(Link)
    ACK_BEFORE_ANSWER = True
    FIRMWARE = Firmware(
        capabilities=64495 & ~status.FTP,
        flight_version=0x04070000,  # 4.7.0 dev
        flight_custom_version=(57, 48, 55, 48, 48, 57, 55, 55),
        uid_base=0x4152_4455_0000_0000,
    )

    def __init__(
        self,
        sysid: int,
        airframe: Airframe,
        frame: LocalFrame,
        *,
        parameters: Mapping[str, float] | None = None,
        links: Mapping[Link, StreamProfile] = PROFILES,
        battery: BatterySpec | None = None,
    ) -> None:
        fitted = battery or BATTERY
        defaults = tables.PARAMETERS | {
            "MAV_SYSID": checked_sysid(sysid),
            "BATT_CAPACITY": round(fitted.capacity_mah),
        }
        table = ParameterTable(defaults, parameters, types=tables.PARAMETER_TYPES, by_value=True)
        self._flight = CopterFlight(airframe, frame, table, replace(fitted, capacity_mah=table["BATT_CAPACITY"]))
        own: dict[int, Builder] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mav.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mav.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
        }
        silent_at_first: dict[int, Builder] = {
            mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._gps_global_origin,
            mav.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
            mav.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw_int,
            mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position_int,
            mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position_ned,
        }
        super().__init__(
            sysid,
            airframe,
            frame,
            self._flight,
            table,
            builders=own | telemetry.COMMON_BUILDERS | silent_at_first,
            rates_hz={link: tables.STREAM_RATES_HZ[profile] for link, profile in links.items()},
            first_heartbeat_us=microseconds(tables.FIRST_HEARTBEAT_S),
            streams_from_us=microseconds(tables.INITIALISED_S),
        )
        self._handlers[mav.MAVLINK_MSG_ID_SET_MODE] = self._on_set_mode
        self._handlers[mav.MAVLINK_MSG_ID_REQUEST_DATA_STREAM] = self._on_data_stream
        self._handlers[mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED] = self._on_setpoint
        self._shown_mode = dict.fromkeys(self._channels, CopterMode.STABILIZE)
        self._homes_told = dict.fromkeys(self._channels, 0)

    def lose_satellites(self) -> None:
        """As any autopilot. By optical flow the EKF knows a position relative to where it began, none absolute."""
        super().lose_satellites()
        self._builders[mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT] = self._ekf_status_relative

    def take_satellites(self, satellites: Satellites) -> None:
        """As any autopilot, from its first fix on; and EKF_STATUS_REPORT says whether a position is absolute."""
        super().take_satellites(satellites)
        told = self._builders[mav.MAVLINK_MSG_ID_GPS_RAW_INT]
        self._builders[mav.MAVLINK_MSG_ID_GPS_RAW_INT] = lambda r: (
            told(r) if r.now_us >= tables.GPS_FIX_S * 1e6 else self._gps_raw_int(r)
        )
        self._builders[mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT] = lambda r: (
            self._ekf_status(r) if satellites.uses else self._ekf_status_relative(r)
        )

    def transmit(self, link: Link, now_s: float) -> list[bytes]:
        """As any autopilot; a mode change is told at once, and so is a new home."""
        channel, flight = self._channels[link], self._flight
        if flight.mode is not self._shown_mode[link] and now_s >= tables.FIRST_HEARTBEAT_S:
            self._shown_mode[link] = flight.mode
            self._send_all(channel.port, [mav.MAVLINK_MSG_ID_HEARTBEAT], microseconds(now_s))
        if flight.homes_set > self._homes_told[link]:
            self._homes_told[link] = flight.homes_set
            told = [mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mav.MAVLINK_MSG_ID_HOME_POSITION]
            self._send_all(channel.port, told, microseconds(now_s))
        return super().transmit(link, now_s)

    def _command_result(self, context: ardupilot_commands.Context, command: commands.Command) -> Result:
        return commands.execute(ardupilot_commands.COMMANDS, context, command)

    def _take_fence(self, fence: Fence) -> None:
        super()._take_fence(fence)
        self.parameters.set("FENCE_TOTAL", len(self._plans.items))

    # Messages that come in

    def _on_set_mode(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """The older message: acknowledged by its message id."""
        message = incoming.message
        del now_s
        custom = message.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        result = self._flight.set_mode(message.custom_mode) if custom else Result.DENIED
        channel.port.send(
            mav.MAVLink_command_ack_message(
                mav.MAVLINK_MSG_ID_SET_MODE, int(result), 0, 0, incoming.system, incoming.component
            )
        )

    def _on_heartbeat(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Takes a ground station as told by its system id, not by its type."""
        del channel
        self._flight.hear_gcs(incoming.system, now_s)

    def _on_data_stream(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Groups of streams at once, as MAVProxy asks for them; not acknowledged."""
        message = incoming.message
        rate_hz = min(message.req_message_rate, tables.DATA_STREAM_MAX_HZ) if message.start_stop else 0
        interval_us = round(1e6 / rate_hz) if rate_hz else -1
        asked = message.req_stream_id
        groups = tables.DATA_STREAMS if asked == tables.ALL_DATA_STREAMS else {asked}
        for group in groups:
            for message_id in tables.DATA_STREAMS.get(group, ()):
                channel.streams.set_interval_us(message_id, interval_us, microseconds(now_s))

    def _on_setpoint(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Drops what is not finite: the one before it goes on until GUID_TIMEOUT."""
        del channel
        wanted = setpoint.from_message(
            incoming.message, self._flight.origin_ned_m, self._airframe.state.attitude_rad[2]
        )
        if wanted is None or not wanted.finite:
            self._setpoints_rejected += 1
            return
        self._setpoints += 1
        self._asked = wanted
        self._flight.offer_setpoint(wanted, now_s)

    # ArduCopter's own telemetry

    def _heartbeat(self, readings: Readings) -> Any:
        flight = self._flight
        booting = readings.now_us <= tables.RC_SWITCH_S * 1e6
        return mav.MAVLink_heartbeat_message(
            mav.MAV_TYPE_QUADROTOR,
            mav.MAV_AUTOPILOT_ARDUPILOTMEGA,
            tables.base_mode(flight.mode, armed=flight.armed, booting=booting),
            int(flight.mode),
            flight.system_status,
            3,
        )

    def _sys_status(self, readings: Readings) -> Any:
        flight, now_s = self._flight, readings.now_us / 1e6
        gps = tables.GPS_BIT if now_s >= tables.GPS_FIX_S else 0
        in_use = gps | (tables.AHRS_BIT if now_s >= tables.AHRS_S else 0)
        if flight.mode in tables.NEEDS_POSITION or flight.mode is CopterMode.LAND:
            in_use |= tables.POSITION_CONTROL_BITS
        logging = tables.LOGGING_BIT if flight.armed or now_s < tables.LOGGING_STOPS_S else 0
        health = tables.HEALTH | in_use | (mav.MAV_SYS_STATUS_PREARM_CHECK if flight.prearm_ok else 0)
        return status.sys_status(
            readings, tables.SENSORS_PRESENT | gps, tables.SENSORS_ENABLED | in_use | logging, health
        )

    def _extended_sys_state(self, readings: Readings) -> Any:
        del readings
        return mav.MAVLink_extended_sys_state_message(VTOL_STATE_MC, int(self._flight.landed_state))

    def _ekf_status(self, readings: Readings) -> Any:
        flags = tables.ekf_flags(readings.now_us / 1e6)
        return mav.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    # What it sends only once it knows it

    def _ekf_status_relative(self, readings: Readings) -> Any:
        message = self._ekf_status(readings)
        absolute = mav.EKF_POS_HORIZ_ABS | mav.EKF_PRED_POS_HORIZ_ABS
        if message.flags & absolute:
            message.flags = message.flags & ~absolute | mav.EKF_POS_HORIZ_REL | mav.EKF_PRED_POS_HORIZ_REL
        return message

    def _gps_global_origin(self, readings: Readings) -> Any:
        return telemetry.gps_global_origin(readings) if readings.home_ned_m is not None else None

    def _home_position(self, readings: Readings) -> Any:
        """Its quaternion is NaN."""
        message = telemetry.home_position(readings)
        if message is not None:
            message.q = [math.nan] * 4
        return message

    def _gps_raw_int(self, readings: Readings) -> Any:
        if readings.now_us >= tables.GPS_FIX_S * 1e6:
            message = telemetry.gps_raw_int(readings)
            message.fix_type = 6  # GPS_FIX_TYPE_RTK_FIXED, as recorded
            return message
        return mav.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, UNKNOWN_U16, UNKNOWN_U16, 0, 0, 0)

    def _global_position_int(self, readings: Readings) -> Any:
        """All zeros before the GPS has a fix."""
        message = telemetry.global_position_int(readings)
        if readings.now_us < tables.GPS_FIX_S * 1e6:
            message.lat = message.lon = message.alt = message.relative_alt = 0
        return message

    def _local_position_ned(self, readings: Readings) -> Any:
        return telemetry.local_position_ned(readings) if self._flight.position_known else None
