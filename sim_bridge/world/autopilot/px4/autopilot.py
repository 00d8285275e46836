"""A PX4 autopilot as its MAVLink clients see it. Bytes and times in, bytes and commands out."""

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
from sim_bridge.world.autopilot.battery import BatterySpec
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from sim_bridge.world.autopilot.protocols.channel import Channel
from sim_bridge.world.autopilot.protocols.links import Link, checked_sysid
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.protocols.streams import microseconds
from sim_bridge.world.autopilot.px4 import commands as px4_commands
from sim_bridge.world.autopilot.px4 import tables
from sim_bridge.world.autopilot.px4.flight import READY_S, Px4Flight
from sim_bridge.world.autopilot.setpoint import STOP
from sim_bridge.world.autopilot.status import Firmware
from sim_bridge.world.autopilot.telemetry import Builder, Readings
from sim_bridge.world.autopilot.types import Result, StreamProfile
from sim_bridge.world.autopilot.vehicle import PROFILES, MavlinkAutopilot

FIRST_HEARTBEAT_US: Final = 1_200_000  # recorded, by PX4's own clock: 1.15-1.26 s after boot

# SYS_STATUS as recorded: what is fitted, and its health while booting and afterwards.
SENSORS_PRESENT = 0x300402F
SENSORS_ENABLED = 0x301402F
HEALTH_BOOTING = 0x320883F
HEALTH_RUNNING = 0x320C83F
# Silent from a request for OFFBOARD until the first setpoint or another mode (px4_pymavlink_A and _B, 0.4 s each).
STEERED: dict[int, Builder] = {
    mav.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: telemetry.servo_output_raw,
    mav.MAVLINK_MSG_ID_ATTITUDE_TARGET: telemetry.attitude_target,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: telemetry.position_target_local_ned,
}
FLIGHT_VERSION = 0x011000FF  # 1.16.0 release


class Px4Autopilot(MavlinkAutopilot):
    """The autopilot of vehicle `sysid`. `now_s` everywhere: seconds since its boot, never backwards.

    `links`: which links it has and what each streams unasked. `parameters`: presets by PX4's names.
    `battery`: what is fitted; BAT1_* presets win over it.
    Raises ParameterError for presets that PX4 does not have, ValueError for a sysid outside 1..255.
    """

    TEXT_LINKS = frozenset({Link.GROUND})
    TEXT_END = "\t"
    ACK_BEFORE_ANSWER = False
    FIRMWARE = Firmware(
        capabilities=0xE8FF & ~status.FTP,
        flight_version=FLIGHT_VERSION,
        middleware_version=FLIGHT_VERSION,
        os_version=101854463,
        board_version=1,
        uid_base=0x4954_1000_0000_0000,
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
        fitted = battery or BatterySpec()
        table = ParameterTable(_defaults(checked_sysid(sysid), fitted), parameters)
        self._flight = Px4Flight(airframe, frame, table, _battery_of(table, fitted))
        own: dict[int, Builder] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mav.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mav.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
            mav.MAVLINK_MSG_ID_PROTOCOL_VERSION: status.protocol_version,
            mav.MAVLINK_MSG_ID_PING: telemetry.ping_request,
        }
        super().__init__(
            sysid,
            airframe,
            frame,
            self._flight,
            table,
            builders=own | telemetry.COMMON_BUILDERS | {i: self._when_steered(b) for i, b in STEERED.items()},
            rates_hz={link: tables.STREAM_RATES_HZ[profile] for link, profile in links.items()},
            first_heartbeat_us=FIRST_HEARTBEAT_US,
        )
        self._origin_told: set[Link] = set()
        self._handlers[mav.MAVLINK_MSG_ID_SET_MODE] = self._on_set_mode
        self._handlers[mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED] = self._on_setpoint
        self._handlers[mav.MAVLINK_MSG_ID_ODOMETRY] = self._on_odometry

    def transmit(self, link: Link, now_s: float) -> list[bytes]:
        """All that is due; GPS_GLOBAL_ORIGIN once, as soon as there is one."""
        if link not in self._origin_told and self._flight.home_ned_m is not None:
            self._origin_told.add(link)
            self._send_all(self._channels[link].port, [mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN], microseconds(now_s))
        return super().transmit(link, now_s)

    def _command_result(self, context: px4_commands.Context, command: commands.Command) -> Result:
        return commands.execute(px4_commands.COMMANDS, context, command)

    def _on_set_mode(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        custom = incoming.message.custom_mode
        command = commands.Command(
            mav.MAV_CMD_DO_SET_MODE,
            float(incoming.message.base_mode),
            float(custom >> 16 & 0xFF),
            float(custom >> 24 & 0xFF),
        )
        self._execute(channel, incoming, command, now_s)

    def _on_setpoint(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        del channel
        wanted = setpoint.from_message(
            incoming.message, self._flight.origin_ned_m, self._airframe.state.attitude_rad[2]
        )
        if wanted is None or not wanted.finite:
            self._setpoints_rejected += 1
            if wanted is not None:
                # PX4 brakes, and stays in OFFBOARD: the stream is alive (recorded in px4_offboard_takeoff).
                self._flight.offer_setpoint(STOP, now_s)
            return
        self._setpoints += 1
        self._asked = wanted
        self._flight.offer_setpoint(wanted, now_s)

    def _on_odometry(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Velocity alone, and only where a GNSS that fails makes it count."""
        del channel, now_s
        told = incoming.message
        if not isinstance(self._airframe, FaultyGnss) or not int(self.parameters["EKF2_EV_CTRL"]) & tables.EV_VELOCITY:
            return
        if told.child_frame_id == mav.MAV_FRAME_LOCAL_NED and math.isfinite(told.vx + told.vy + told.vz):
            self._airframe.receive_velocity((told.vx, told.vy))

    # PX4's own telemetry

    def _when_steered(self, builder: Builder) -> Builder:
        return lambda readings: None if self._flight.awaits_first_setpoint else builder(readings)

    def _heartbeat(self, readings: Readings) -> Any:
        del readings
        flight = self._flight
        return mav.MAVLink_heartbeat_message(
            mav.MAV_TYPE_QUADROTOR,
            mav.MAV_AUTOPILOT_PX4,
            tables.base_mode(flight.mode, armed=flight.armed),
            int(flight.mode),
            flight.system_status,
            3,
        )

    def _sys_status(self, readings: Readings) -> Any:
        flight = self._flight
        health = HEALTH_BOOTING if readings.now_us < READY_S * 1e6 else HEALTH_RUNNING
        if flight.ready:
            health |= mav.MAV_SYS_STATUS_PREARM_CHECK
        load = 150  # of the processor, 15 %: as recorded
        return status.sys_status(readings, SENSORS_PRESENT, SENSORS_ENABLED, health, load)

    def _extended_sys_state(self, readings: Readings) -> Any:
        del readings
        return mav.MAVLink_extended_sys_state_message(mav.MAV_VTOL_STATE_UNDEFINED, int(self._flight.landed_state))


def _defaults(sysid: int, fitted: BatterySpec) -> dict[str, int | float]:
    return tables.PARAMETERS | {
        "MAV_SYS_ID": sysid,
        "BAT1_CAPACITY": fitted.capacity_mah,
        "BAT1_N_CELLS": fitted.cells,
        "BAT1_V_CHARGED": fitted.cell_full_v,
        "BAT1_V_EMPTY": fitted.cell_empty_v,
    }


def _battery_of(parameters: ParameterTable, fitted: BatterySpec) -> BatterySpec:
    return replace(
        fitted,
        capacity_mah=parameters["BAT1_CAPACITY"],
        cells=int(parameters["BAT1_N_CELLS"]),
        cell_full_v=parameters["BAT1_V_CHARGED"],
        cell_empty_v=parameters["BAT1_V_EMPTY"],
    )
