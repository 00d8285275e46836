"""A PX4 autopilot as its MAVLink clients see it. Bytes and times in, bytes and commands out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from companion.mavlink import dialect as mav
from mission.frames import LocalFrame
from sim_bridge.airframe.base import Airframe
from sim_bridge.autopilot import px4_commands as commands
from sim_bridge.autopilot import px4_tables as tables
from sim_bridge.autopilot import telemetry
from sim_bridge.autopilot.battery import BatterySpec
from sim_bridge.autopilot.links import AUTOPILOT_COMPONENT, Incoming, Link, LinkCounts, Port
from sim_bridge.autopilot.parameters import ParameterTable
from sim_bridge.autopilot.px4_flight import READY_S, LandedState, Notice, Px4Flight
from sim_bridge.autopilot.px4_navigator import STOP, Setpoint
from sim_bridge.autopilot.px4_tables import Failsafe, StreamProfile
from sim_bridge.autopilot.streams import StreamTable
from sim_bridge.autopilot.telemetry import Builder, Readings

FIRST_HEARTBEAT_US = 1_500_000  # recorded: 1.3-1.7 s after boot
PARAMETERS_PER_TRANSMIT = 16  # PX4 spreads a list out; so do we
STATUSTEXT_BYTES = 50

# SYS_STATUS as recorded: what is fitted, and its health while booting and afterwards.
SENSORS_PRESENT = 0x300402F
SENSORS_ENABLED = 0x301402F
HEALTH_BOOTING = 0x320883F
HEALTH_RUNNING = 0x320C83F
# AUTOPILOT_VERSION as recorded.
CAPABILITIES = 0xE8FF & ~0x20  # without FTP, which nothing here answers: clients wait seconds for it
FLIGHT_VERSION = 0x011000FF  # 1.16.0 release
OS_VERSION = 101854463
UID_BASE = 0x4954_1000_0000_0000

NO_TARGET = 0  # system or component 0: everybody
_HAS_SYSTEM = frozenset(i for i, m in mav.mavlink_map.items() if "target_system" in m.fieldnames)
_HAS_COMPONENT = frozenset(i for i, m in mav.mavlink_map.items() if "target_component" in m.fieldnames)
_COMPANION_NEWS = frozenset(  # what a companion says to all and a ground station should hear
    {mav.MAVLINK_MSG_ID_HEARTBEAT, mav.MAVLINK_MSG_ID_STATUSTEXT, mav.MAVLINK_MSG_ID_COMMAND_ACK}
)

PROFILES: Mapping[Link, StreamProfile] = {
    Link.ONBOARD: StreamProfile.ONBOARD,
    Link.GROUND: StreamProfile.GROUND,
}


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What the bridge measures."""

    mode: str  # Px4Mode's name
    armed: bool
    landed: LandedState
    failsafe: Failsafe | None
    battery_remaining: float  # 0..1
    setpoints: int  # accepted, since boot
    setpoints_rejected: int  # not finite, or of a kind that PX4 does not take


@dataclass(slots=True)
class _Channel:
    port: Port
    streams: StreamTable
    next_parameter: int | None = None  # of a PARAM_REQUEST_LIST under way


class Px4Autopilot:
    """The autopilot of vehicle `sysid`. `now_s` everywhere: seconds since its boot, never backwards.

    `links`: which links it has and what each streams unasked. `parameters`: presets by PX4's names.
    `battery`: what is fitted; BAT1_* presets win over it.
    Raises ParameterError for presets that PX4 does not have, ValueError for a sysid outside 1..255.
    """

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
        if not 1 <= sysid <= 255:
            raise ValueError(f"sysid = {sysid}: must be 1..255")
        self.sysid = sysid
        fitted = battery or BatterySpec()
        self.parameters = ParameterTable(_defaults(sysid, fitted), parameters)
        self._airframe = airframe
        self._flight = Px4Flight(airframe, frame, self.parameters, _battery_of(self.parameters, fitted))
        self._frame = frame
        flight = self._flight
        self._readings = Readings(
            now_us=0,
            state=flight.state,
            frame=frame,
            origin_ned_m=flight.origin_ned_m,
            home_ned_m=None,
            home_yaw_rad=0.0,
            home_at_us=0,
            battery=flight.battery,
            armed=False,
            command_ned_mps=flight.command_ned_mps,
            command_yaw_rad=flight.command_yaw_rad,
        )
        self._builders: dict[int, Builder] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mav.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mav.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
            mav.MAVLINK_MSG_ID_PROTOCOL_VERSION: _protocol_version,
            **telemetry.COMMON_BUILDERS,
        }
        first_us = {mav.MAVLINK_MSG_ID_HEARTBEAT: FIRST_HEARTBEAT_US}
        self._channels = {
            link: _Channel(Port(sysid), StreamTable(self._builders, tables.STREAM_RATES_HZ[profile], first_us))
            for link, profile in links.items()
        }
        self._handlers: dict[int, Callable[[_Channel, Incoming, float], None]] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            mav.MAVLINK_MSG_ID_PING: self._on_ping,
            mav.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            mav.MAVLINK_MSG_ID_SET_MODE: self._on_set_mode,
            mav.MAVLINK_MSG_ID_COMMAND_LONG: self._on_command_long,
            mav.MAVLINK_MSG_ID_COMMAND_INT: self._on_command_int,
            mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._on_setpoint,
            mav.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._on_param_list,
            mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._on_param_read,
            mav.MAVLINK_MSG_ID_PARAM_SET: self._on_param_set,
            mav.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._on_mission_list,
            mav.MAVLINK_MSG_ID_MISSION_COUNT: self._on_mission_upload,
            mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._on_mission_clear,
        }
        self._setpoints = 0
        self._setpoints_rejected = 0
        self._text_id = 0

    # The interface

    def receive(self, link: Link, data: bytes, now_s: float) -> None:
        """A datagram from a client. Whatever is in it, nothing raises but an unknown link (KeyError)."""
        channel = self._channels[link]
        for incoming in channel.port.read(data):
            if incoming.system == self.sysid and incoming.component == AUTOPILOT_COMPONENT:
                continue  # our own, come back
            system, component = _target(incoming)
            ours = system in (NO_TARGET, self.sysid)
            if ours and component in (NO_TARGET, AUTOPILOT_COMPONENT):
                handler = self._handlers.get(incoming.message_id)
                if handler:
                    handler(channel, incoming, now_s)
            if link is Link.GROUND:
                if ours and component != AUTOPILOT_COMPONENT:
                    self._forward(Link.ONBOARD, incoming)
            elif incoming.message_id in _COMPANION_NEWS or not ours:
                self._forward(Link.GROUND, incoming)

    def update(self, now_s: float) -> None:
        """Once per step of the bridge, before `airframe.step`."""
        self._flight.update(now_s)

    def transmit(self, link: Link, now_s: float) -> list[bytes]:
        """All that is due on `link`, as datagrams of whole frames; answers first, then streams."""
        channel = self._channels[link]
        now_us = _microseconds(now_s)
        if channel.next_parameter is not None:
            self._continue_param_list(channel)
        if link is Link.GROUND and self._flight.notices:
            self._send_notices(channel)
        due = channel.streams.due(now_us)
        if due:
            readings = self._read(now_us)
            for message_id in due:
                message = self._builders[message_id](readings)
                if message is not None:
                    channel.port.send(message)
        return channel.port.drain()

    def timesync_request(self, now_s: float) -> bytes:
        """A TIMESYNC request on the onboard link, for whoever drives the clock in lockstep."""
        now_ns = _microseconds(now_s) * 1000
        return self._channels[Link.ONBOARD].port.pack(mav.MAVLink_timesync_message(0, now_ns))

    def counts(self, link: Link) -> LinkCounts:
        """What `link` has seen."""
        return self._channels[link].port.counts

    @property
    def snapshot(self) -> Snapshot:
        flight = self._flight
        return Snapshot(
            mode=flight.mode.name,
            armed=flight.armed,
            landed=flight.landed_state,
            failsafe=flight.failsafe,
            battery_remaining=flight.battery.remaining,
            setpoints=self._setpoints,
            setpoints_rejected=self._setpoints_rejected,
        )

    # Forwarding and sending

    def _forward(self, link: Link, incoming: Incoming) -> None:
        channel = self._channels.get(link)
        if channel:
            channel.port.forward(incoming.frame)

    def _read(self, now_us: int) -> Readings:
        readings, flight = self._readings, self._flight
        readings.now_us = now_us
        readings.state = self._airframe.state
        readings.home_ned_m = flight.home_ned_m
        readings.home_yaw_rad = flight.home_yaw_rad
        readings.home_at_us = _microseconds(flight.home_at_s)
        readings.armed = flight.armed
        readings.command_ned_mps = flight.command_ned_mps
        readings.command_yaw_rad = flight.command_yaw_rad
        return readings

    def _send_notices(self, channel: _Channel) -> None:
        notices = self._flight.notices
        while notices:
            for message in self._texts(notices.popleft()):
                channel.port.send(message)

    def _texts(self, notice: Notice) -> list[Any]:
        """STATUSTEXT, in chunks of 50 bytes where longer; the trailing tab is PX4's."""
        text = (notice.text + "\t").encode("ascii", errors="replace")
        chunks = [text[at : at + STATUSTEXT_BYTES] for at in range(0, len(text), STATUSTEXT_BYTES)]
        if len(chunks) == 1:
            return [mav.MAVLink_statustext_message(notice.severity, text, 0, 0)]
        if len(chunks[-1]) == STATUSTEXT_BYTES:
            chunks.append(b"")  # a text ends with a chunk that is not full
        self._text_id = self._text_id % 0xFFFF + 1
        return [
            mav.MAVLink_statustext_message(notice.severity, chunk, self._text_id, number)
            for number, chunk in enumerate(chunks)
        ]

    # Messages that come in

    def _on_heartbeat(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del channel
        if incoming.message.type == mav.MAV_TYPE_GCS:
            self._flight.hear_gcs(now_s)

    def _on_ping(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del now_s
        ping = incoming.message
        if ping.target_system == NO_TARGET:  # a request; the rest are answers
            channel.port.send(mav.MAVLink_ping_message(ping.time_usec, ping.seq, incoming.system, incoming.component))

    def _on_timesync(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        if incoming.message.tc1 == 0:
            now_ns = _microseconds(now_s) * 1000
            channel.port.send(mav.MAVLink_timesync_message(now_ns, incoming.message.ts1))

    def _on_set_mode(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        custom = incoming.message.custom_mode
        command = commands.Command(
            mav.MAV_CMD_DO_SET_MODE,
            float(incoming.message.base_mode),
            float(custom >> 16 & 0xFF),
            float(custom >> 24 & 0xFF),
        )
        self._execute(channel, incoming, command, now_s)

    def _on_command_long(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        self._execute(channel, incoming, commands.from_long(incoming.message), now_s)

    def _on_command_int(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        self._execute(channel, incoming, commands.from_int(incoming.message), now_s)

    def _execute(self, channel: _Channel, incoming: Incoming, command: commands.Command, now_s: float) -> None:
        """Do it and acknowledge it to whoever asked, after what it has sent."""

        def send(message_id: int) -> bool:
            builder = self._builders.get(message_id)
            if builder is None:
                return False
            message = builder(self._read(_microseconds(now_s)))
            if message is not None:
                channel.port.send(message)
            return True

        def send_interval(message_id: int, interval_us: int) -> None:
            channel.port.send(mav.MAVLink_message_interval_message(message_id, interval_us))

        context = commands.Context(
            flight=self._flight,
            frame=self._frame,
            streams=channel.streams,
            send=send,
            send_interval=send_interval,
            now_s=now_s,
            now_us=_microseconds(now_s),
        )
        result = commands.execute(context, command)
        channel.port.send(
            mav.MAVLink_command_ack_message(command.id, int(result), 0, 0, incoming.system, incoming.component)
        )

    def _on_setpoint(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del channel
        message = incoming.message
        mask = message.type_mask
        if message.coordinate_frame != mav.MAV_FRAME_LOCAL_NED:
            self._setpoints_rejected += 1
            return
        origin = self._flight.origin_ned_m
        north, east, down = (
            None if mask & 1 else message.x + origin[0],
            None if mask & 2 else message.y + origin[1],
            None if mask & 4 else message.z + origin[2],
        )
        velocity = (
            None if mask & 8 else message.vx,
            None if mask & 16 else message.vy,
            None if mask & 32 else message.vz,
        )
        position = (north, east, down)
        if any(p is None and v is None for p, v in zip(position, velocity, strict=True)):
            self._setpoints_rejected += 1  # an axis without a wish: accelerations are not flown here
            return
        yaw = None if mask & mav.POSITION_TARGET_TYPEMASK_YAW_IGNORE else message.yaw
        rate = 0.0 if mask & mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else message.yaw_rate
        if not all(value is None or math.isfinite(value) for value in (*position, *velocity, yaw, rate)):
            # PX4 brakes, and stays in OFFBOARD: the stream is alive (recorded in px4_offboard_takeoff).
            self._setpoints_rejected += 1
            self._flight.offer_setpoint(STOP, now_s)
            return
        self._setpoints += 1
        self._flight.offer_setpoint(Setpoint(position, velocity, yaw, rate), now_s)

    def _on_param_list(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del incoming, now_s
        channel.next_parameter = 0

    def _continue_param_list(self, channel: _Channel) -> None:
        first = channel.next_parameter or 0
        names = self.parameters.names[first : first + PARAMETERS_PER_TRANSMIT]
        for name in names:
            channel.port.send(self.parameters.message(name))
        after = first + len(names)
        channel.next_parameter = after if after < len(self.parameters.names) else None

    def _on_param_read(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        """Silent about a parameter that PX4 does not have."""
        del now_s
        index = incoming.message.param_index
        names = self.parameters.names
        name = incoming.message.param_id if index < 0 else "".join(names[index : index + 1])
        if name in self.parameters:
            channel.port.send(self.parameters.message(name))

    def _on_param_set(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        """The answer is the value after it, changed or not; on every link, as others want to know."""
        del channel, now_s
        message = incoming.message
        name = message.param_id
        if name not in self.parameters:
            return
        self.parameters.set_from_wire(name, message.param_value, message.param_type)
        for each in self._channels.values():
            each.port.send(self.parameters.message(name))

    def _on_mission_list(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del now_s
        channel.port.send(
            mav.MAVLink_mission_count_message(incoming.system, incoming.component, 0, incoming.message.mission_type)
        )

    def _on_mission_upload(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        """Nothing here flies missions. Uploading an empty one is the same as clearing."""
        del now_s
        empty = incoming.message.count == 0
        self._ack_mission(channel, incoming, mav.MAV_MISSION_ACCEPTED if empty else mav.MAV_MISSION_UNSUPPORTED)

    def _on_mission_clear(self, channel: _Channel, incoming: Incoming, now_s: float) -> None:
        del now_s
        self._ack_mission(channel, incoming, mav.MAV_MISSION_ACCEPTED)

    def _ack_mission(self, channel: _Channel, incoming: Incoming, result: int) -> None:
        channel.port.send(
            mav.MAVLink_mission_ack_message(incoming.system, incoming.component, result, incoming.message.mission_type)
        )

    # PX4's own telemetry

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
        battery = readings.battery
        return mav.MAVLink_sys_status_message(
            SENSORS_PRESENT,
            SENSORS_ENABLED,
            health,
            150,  # load of the processor, 15 %: as recorded
            telemetry.battery_mv(battery),
            round(min(battery.current_a * 100.0, 32767.0)),
            telemetry.battery_percent(battery),
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def _battery_status(self, readings: Readings) -> Any:
        return telemetry.battery_status(readings, int(self._flight.battery_level))

    def _extended_sys_state(self, readings: Readings) -> Any:
        del readings
        return mav.MAVLink_extended_sys_state_message(mav.MAV_VTOL_STATE_UNDEFINED, int(self._flight.landed_state))

    def _autopilot_version(self, readings: Readings) -> Any:
        del readings
        none = [0] * 8
        uid2 = [*b"UNDERSTORY", *[0] * 7, self.sysid]  # 18 bytes
        return mav.MAVLink_autopilot_version_message(
            CAPABILITIES,
            FLIGHT_VERSION,
            FLIGHT_VERSION,
            OS_VERSION,
            1,
            none,
            none,
            none,
            0,
            0,
            UID_BASE + self.sysid,
            uid2,
        )


def _protocol_version(readings: Readings) -> Any:
    del readings
    none = [0] * 8
    return mav.MAVLink_protocol_version_message(200, 100, 200, none, none)


def _microseconds(seconds: float) -> int:
    return round(seconds * 1e6)


def _target(incoming: Incoming) -> tuple[int, int]:
    """System and component that a message is for; 0: everybody."""
    message, message_id = incoming.message, incoming.message_id
    return (
        message.target_system if message_id in _HAS_SYSTEM else NO_TARGET,
        message.target_component if message_id in _HAS_COMPONENT else NO_TARGET,
    )


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
