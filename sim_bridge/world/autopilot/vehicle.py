"""Any autopilot as a MAVLink client sees it. Bytes and times in, bytes and commands out.

A personality adds its tables, its commands and its own telemetry: see px4 and ardupilot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import Incoming
from mission.common.frames import LocalFrame, Vec3
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.autopilot import commands, status, telemetry
from sim_bridge.world.autopilot.estimates.gnss_faults import FaultyGnss
from sim_bridge.world.autopilot.fence import Fence
from sim_bridge.world.autopilot.gnss_telemetry import failing_builders
from sim_bridge.world.autopilot.protocols.channel import Channel, continue_parameters, set_up_signing
from sim_bridge.world.autopilot.protocols.links import (
    AUTOPILOT_COMPONENT,
    NO_TARGET,
    Link,
    LinkCounts,
    Packed,
    Port,
    target_of,
)
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.protocols.plans import Plans
from sim_bridge.world.autopilot.protocols.recorder import Recorder
from sim_bridge.world.autopilot.protocols.streams import StreamTable, microseconds
from sim_bridge.world.autopilot.setpoint import Setpoint
from sim_bridge.world.autopilot.status import Firmware
from sim_bridge.world.autopilot.telemetry import Builder, Readings
from sim_bridge.world.autopilot.types import FlightLogic, Notice, Result, Satellites, Snapshot, StreamProfile

# ArduCopter's crash check waits as long; PX4's failure detector has this angle (FD_FAIL_R, FD_FAIL_P), and leaves the
# rest to a pilot's kill switch, which nobody has here
CRASHED_RAD: Final = math.radians(60.0)
CRASHED_S: Final = 2.0
_TIMESYNC = mav.MAVLink_timesync_message.unpacker
_COMPANION_NEWS = frozenset(  # what a companion says to all and a ground station should hear
    {mav.MAVLINK_MSG_ID_HEARTBEAT, mav.MAVLINK_MSG_ID_STATUSTEXT, mav.MAVLINK_MSG_ID_COMMAND_ACK}
)

PROFILES: Mapping[Link, StreamProfile] = {Link.ONBOARD: StreamProfile.ONBOARD, Link.GROUND: StreamProfile.GROUND}


MessageHandler = Callable[[Channel, Incoming, float], None]


class MavlinkAutopilot:
    """All that the personalities share. `now_s` everywhere: seconds since its boot, never backwards."""

    # What a personality says of itself
    TEXT_LINKS: frozenset[Link]  # where its STATUSTEXTs go
    TEXT_END = ""  # what ends each of them
    ACK_BEFORE_ANSWER: bool  # of a message asked for: the acknowledgement comes first
    FIRMWARE: Firmware

    def __init__(
        self,
        sysid: int,
        airframe: Airframe,
        frame: LocalFrame,
        flight: FlightLogic,
        parameters: ParameterTable,
        *,
        builders: Mapping[int, Builder],
        rates_hz: Mapping[Link, Mapping[int, float]],
        first_heartbeat_us: int,
        streams_from_us: int = 0,
    ) -> None:
        """`builders`: its own, before those common to all; `streams_from_us`: all but HEARTBEAT.

        ValueError for a sysid outside 1..255.
        """
        self.sysid = sysid
        self.parameters = parameters
        self._airframe = airframe
        self._frame = frame
        self._logic = flight
        self._builders = dict(builders)
        if isinstance(airframe, FaultyGnss):
            self._builders |= failing_builders(airframe, builders)
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
        first_us = dict.fromkeys(builders, streams_from_us) | {mav.MAVLINK_MSG_ID_HEARTBEAT: first_heartbeat_us}
        self._channels = {
            link: Channel(link, Port(sysid), StreamTable(self._builders, rates, first_us))
            for link, rates in rates_hz.items()
        }
        self._handlers: dict[int, MessageHandler] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            mav.MAVLINK_MSG_ID_PING: self._on_ping,
            mav.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            mav.MAVLINK_MSG_ID_COMMAND_LONG: self._on_command_long,
            mav.MAVLINK_MSG_ID_COMMAND_INT: self._on_command_int,
            mav.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._on_param_list,
            mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._on_param_read,
            mav.MAVLINK_MSG_ID_PARAM_SET: self._on_param_set,
            mav.MAVLINK_MSG_ID_SETUP_SIGNING: self._on_setup_signing,
        }
        self._plans = Plans(frame, self._take_fence)
        self._handlers |= dict.fromkeys(self._plans.message_ids, self._on_plan)
        self._has_satellites = True
        self._setpoints = 0
        self._setpoints_rejected = 0
        self._asked: Setpoint | None = None  # the last that was accepted
        self._upright_s = 0.0  # when it was last, or not armed
        self._text_id = 0
        self._recorder: Recorder | None = None

    def lose_satellites(self) -> None:
        """From its boot on it has none: it says nothing of where on Earth it is, and GPS_RAW_INT says: no fix."""
        self._builders |= telemetry.NO_SATELLITES
        self._has_satellites = False

    def take_satellites(self, satellites: Satellites) -> None:
        """From its boot on: it tells of these, and whether its estimator goes by them."""
        self._builders[mav.MAVLINK_MSG_ID_GPS_RAW_INT] = lambda r: telemetry.gps_raw_int_of(r, satellites)
        self._builders[mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS] = lambda r: telemetry.estimator_status_of(r, satellites)

    # The interface: see types.Autopilot

    def receive(self, link: Link, data: bytes, now_s: float) -> None:
        """A datagram from a client. Whatever is in it, nothing raises but an unknown link (KeyError)."""
        channel = self._channels[link]
        for incoming in channel.port.parse_datagram(data):
            if incoming.system == self.sysid and incoming.component == AUTOPILOT_COMPONENT:
                continue  # our own, come back
            system, component = target_of(incoming)
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
        flight = self._logic
        flight.update(now_s)
        roll_rad, pitch_rad, _ = flight.state.attitude_rad
        if not flight.armed or (abs(roll_rad) < CRASHED_RAD and abs(pitch_rad) < CRASHED_RAD):
            self._upright_s = now_s
        elif now_s - self._upright_s >= CRASHED_S:
            flight.notices.append(Notice(mav.MAV_SEVERITY_CRITICAL, "Crash: Disarming"))
            flight.disarm(force=True)

    def transmit(self, link: Link, now_s: float) -> list[bytes]:
        """All that is due on `link`, as datagrams of whole frames; answers first, then streams."""
        channel = self._channels[link]
        now_us = microseconds(now_s)
        self._plans.retry(now_s)
        if channel.next_parameter is not None:
            continue_parameters(channel, self.parameters)
        if self._logic.notices and link in self.TEXT_LINKS:
            self._send_notices()
        due = channel.streams.due(now_us)
        if due:
            self._send_all(channel.port, due, now_us)
        return channel.port.drain()

    def record(self, now_s: float) -> bytes:
        """Frames that a recorder on the vehicle hears besides the onboard link. To be asked at every step, or never."""
        if self._recorder is None:
            self._recorder = Recorder(self.sysid, self._builders, self._channels[Link.ONBOARD].streams)
        if self._logic.notices and Link.ONBOARD not in self.TEXT_LINKS:
            self._send_notices()
        now_us = microseconds(now_s)
        due = self._recorder.due(now_us)
        if due:
            self._send_all(self._recorder.port, due, now_us)
        return b"".join(self._recorder.port.drain())

    def timesync_request(self, now_s: float) -> bytes:
        """A TIMESYNC request on the onboard link, for what drives the clock in lockstep."""
        now_ns = microseconds(now_s) * 1000
        return self._channels[Link.ONBOARD].port.pack(Packed(mav.MAVLINK_MSG_ID_TIMESYNC, _TIMESYNC.pack(0, now_ns)))

    def counts(self, link: Link) -> LinkCounts:
        """Counters of `link`."""
        return self._channels[link].port.counts

    @property
    def armed(self) -> bool:
        """The rotors may turn."""
        return self._logic.armed

    @property
    def mode(self) -> str:
        """The personality's own name of the flight mode."""
        return self._logic.mode.name

    @property
    def asked_ned_mps(self) -> Vec3 | None:
        """The velocity that it was asked to fly last, along its own north; None: none, or not on every axis."""
        asked = self._asked
        if asked is None:
            return None
        north, east, down = asked.vel_ned_mps
        return None if north is None or east is None or down is None else (north, east, down)

    @property
    def snapshot(self) -> Snapshot:
        """Measurements by the bridge."""
        flight = self._logic
        return Snapshot(
            mode=flight.mode.name,
            armed=flight.armed,
            landed=flight.landed_state,
            failsafe=flight.failsafe,
            battery_remaining=flight.battery.remaining,
            setpoints=self._setpoints,
            setpoints_rejected=self._setpoints_rejected,
        )

    # What a personality must say

    def _command_result(self, context: commands.Context[Any], command: commands.Command) -> Result:
        raise NotImplementedError

    # Forwarding and sending

    def _forward(self, link: Link, incoming: Incoming) -> None:
        channel = self._channels.get(link)
        if channel:
            channel.port.forward(incoming.frame)

    def _send_all(self, port: Port, message_ids: Iterable[int], now_us: int) -> None:
        readings = self._update_readings(now_us)
        for message_id in message_ids:
            message = self._builders[message_id](readings)
            if message is not None:
                port.send(message)

    def _update_readings(self, now_us: int) -> Readings:
        readings, flight = self._readings, self._logic
        readings.now_us = now_us
        readings.state = self._airframe.state
        readings.origin_ned_m = flight.origin_ned_m
        readings.home_ned_m = flight.home_ned_m
        readings.home_yaw_rad = flight.home_yaw_rad
        readings.home_at_us = microseconds(flight.home_at_s)
        readings.armed = flight.armed
        readings.command_ned_mps = flight.command_ned_mps
        readings.command_yaw_rad = flight.command_yaw_rad
        return readings

    def _send_notices(self) -> None:
        notices = self._logic.notices
        while notices:
            notice = notices.popleft()
            if not self._has_satellites and "GPS" in notice.text:
                continue
            text = notice.text + self.TEXT_END
            if len(text) > status.STATUSTEXT_BYTES:
                self._text_id = self._text_id % 0xFFFF + 1
            for message in status.texts(notice.severity, text, self._text_id):
                for link, channel in self._channels.items():
                    if link in self.TEXT_LINKS:
                        channel.port.send(message)
                if self._recorder is not None and Link.ONBOARD not in self.TEXT_LINKS:
                    self._recorder.port.send(message)

    # Messages that come in

    def _on_heartbeat(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        del channel
        if incoming.message.type == mav.MAV_TYPE_GCS:
            self._logic.hear_gcs(incoming.system, now_s)

    def _on_ping(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        del now_s
        ping = incoming.message
        if ping.target_system == NO_TARGET:  # a request; the rest are answers
            channel.port.send(mav.MAVLink_ping_message(ping.time_usec, ping.seq, incoming.system, incoming.component))

    def _on_timesync(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        if incoming.message.tc1 == 0:
            now_ns = microseconds(now_s) * 1000
            channel.port.send(mav.MAVLink_timesync_message(now_ns, incoming.message.ts1))

    def _on_command_long(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        self._execute(channel, incoming, commands.from_long(incoming.message), now_s)

    def _on_command_int(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        self._execute(channel, incoming, commands.from_int(incoming.message), now_s)

    def _execute(self, channel: Channel, incoming: Incoming, command: commands.Command, now_s: float) -> None:
        """Do it, and acknowledge it to the one that asked."""
        now_us = microseconds(now_s)
        answers: list[Any] = []

        def send(message_id: int) -> bool:
            builder = self._builders.get(message_id)
            if builder is None:
                return False
            message = builder(self._update_readings(now_us))
            if message is not None:
                answers.append(message)
            return True

        def send_interval(message_id: int, interval_us: int) -> None:
            channel.port.send(mav.MAVLink_message_interval_message(message_id, interval_us))

        context = commands.Context(
            flight=self._logic,
            frame=self._frame,
            streams=channel.streams,
            send=send,
            send_interval=send_interval,
            now_s=now_s,
            now_us=now_us,
        )
        result = self._command_result(context, command)
        ack = mav.MAVLink_command_ack_message(command.id, int(result), 0, 0, incoming.system, incoming.component)
        for message in [ack, *answers] if self.ACK_BEFORE_ANSWER else [*answers, ack]:
            channel.port.send(message)

    # Telemetry that differs in figures only

    def _battery_status(self, readings: Readings) -> Any:
        return status.battery_status(readings, int(self._logic.battery_level))

    def _autopilot_version(self, readings: Readings) -> Any:
        del readings
        return status.autopilot_version(self.FIRMWARE, self.sysid)

    def _on_setup_signing(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Not acknowledged; one that comes without the key, where there is one, does not get here."""
        del channel, now_s
        set_up_signing(self._channels.values(), incoming.message)

    # Parameters

    def _on_param_list(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        del incoming, now_s
        channel.next_parameter = 0

    def _on_param_read(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """Silent about a parameter that there is not."""
        del now_s
        index = incoming.message.param_index
        names = self.parameters.names
        name = incoming.message.param_id if index < 0 else "".join(names[index : index + 1])
        if name in self.parameters:
            channel.port.send(self.parameters.message(name, in_list=index >= 0))

    def _on_param_set(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        """The answer is the value after it, changed or not; on every link, as others want to know."""
        del channel, now_s
        message = incoming.message
        name = message.param_id
        if name not in self.parameters:
            return
        self.parameters.set_from_wire(name, message.param_value, message.param_type)
        for each in self._channels.values():
            each.port.send(self.parameters.message(name, in_list=False))

    # Plans

    def _take_fence(self, fence: Fence) -> None:
        self._logic.fence = fence

    def _on_plan(self, channel: Channel, incoming: Incoming, now_s: float) -> None:
        self._plans.receive(channel.port, incoming, now_s)
