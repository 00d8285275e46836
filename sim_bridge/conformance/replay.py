"""The recorded client against our autopilot model: the same frames at the same times, on JSBSim, full physics."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import replace

from companion.mavlink import dialect as mav
from companion.mavlink.framing.frames import frames
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Personality
from sim_bridge.conformance.recording import AUTOPILOT, Frame, Recording, frame_of
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.autopilot import Link, StreamProfile, make_autopilot
from sim_bridge.world.autopilot.ardupilot import tables as ardupilot_tables
from sim_bridge.world.autopilot.px4 import tables as px4_tables

STEP_S = 0.01  # as `sim-bridge serve`
GRACE_S = 10.0  # flown on after the recording's end: what comes later than recorded is late, not missing
REACTION_S = 0.005  # a client that answers a heartbeat at once still answers after it
PLACE = Wgs84(47.397742, 8.545594, 488.0)
_ASKED = frozenset(
    {mav.MAVLINK_MSG_ID_PARAM_REQUEST_LIST, mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ, mav.MAVLINK_MSG_ID_PARAM_SET}
)
PARAMETERS = {Personality.PX4: px4_tables.PARAMETERS, Personality.ARDUPILOT: ardupilot_tables.PARAMETERS}
# What a flight had been given, where its log does not tell: see tests/recordings/README.md.
PRESETS = {"ap_loss_gcs255": {"FS_GCS_ENABLE": 1.0}, "ap_loss_comp245": {"FS_GCS_ENABLE": 1.0}}


def replay(recording: Recording) -> tuple[Recording, Recording]:
    """The recording, its clock shifted so that the first heartbeats agree, and our model's flight of it.

    The simulators took up to 0.1 s longer or shorter from boot to heartbeat; clients react to heartbeats.
    """
    begins_s = _first_heartbeat_s(_fly(recording, until_s=3.0))
    recording = _shifted(recording, begins_s + REACTION_S - _first_heartbeat_s(recording.heard))
    heard = tuple(_fly(recording, until_s=recording.end_s + GRACE_S))
    return recording, replace(recording, heard=heard)


def _fly(recording: Recording, *, until_s: float) -> Iterator[Frame]:
    known = PARAMETERS[recording.personality]
    frame = LocalFrame(replace(PLACE, alt_m=ground_alt_m(recording)))
    body = JsbsimQuad(frame, (0.0, 0.0, 0.0), 0.0)
    links = {Link.ONBOARD: StreamProfile.ONBOARD}
    presets = {name: value for name, value in told_at_boot(recording).items() if name in known}
    presets |= PRESETS.get(recording.name, {})
    autopilot = make_autopilot(recording.personality, AUTOPILOT[0], body, frame, parameters=presets, links=links)
    sent = 0
    for step in range(math.ceil(until_s / STEP_S)):
        now_s = step * STEP_S
        while sent < len(recording.sent) and recording.sent[sent].at_s <= now_s:
            autopilot.receive(Link.ONBOARD, recording.sent[sent].data, now_s)
            sent += 1
        autopilot.update(now_s)
        body.step(STEP_S)
        for datagram in autopilot.transmit(Link.ONBOARD, now_s):
            for start, end, _ in frames(datagram):
                yield frame_of(datagram[start:end], now_s)


def _first_heartbeat_s(heard: Iterator[Frame] | tuple[Frame, ...]) -> float:
    return next(frame.at_s for frame in heard if frame.id == mav.MAVLINK_MSG_ID_HEARTBEAT)


def _shifted(recording: Recording, by_s: float) -> Recording:
    sent, heard = (
        tuple(replace(frame, at_s=frame.at_s + by_s) for frame in stream)
        for stream in (recording.sent, recording.heard)
    )
    return replace(recording, sent=sent, heard=heard)


def told_at_boot(recording: Recording) -> dict[str, float]:
    """Parameters that the flight had been given: PX4 tells unasked those that are not its defaults."""
    if recording.personality is not Personality.PX4:
        return {}
    asked_s = min((frame.at_s for frame in recording.sent if frame.id in _ASKED), default=math.inf)
    return {
        frame.message.param_id: parameter_value(recording.personality, frame.message)
        for frame in recording.heard
        if frame.id == mav.MAVLINK_MSG_ID_PARAM_VALUE and frame.at_s < asked_s
    }


def parameter_value(personality: Personality, message: mav.MAVLink_param_value_message) -> float:
    """PX4 sends integers bytewise in the float, ArduPilot as the float."""
    value = float(message.param_value)
    if personality is Personality.PX4 and message.param_type != mav.MAV_PARAM_TYPE_REAL32:
        value = float(struct.unpack("<i", struct.pack("<f", value))[0])
    return value


def ground_alt_m(recording: Recording) -> float:
    """Above sea level, as the client last saw it before it asked for a takeoff to an altitude."""
    alt_m = PLACE.alt_m
    asked_s = min((frame.at_s for frame in recording.sent if _takes_off_to_altitude(frame)), default=0.0)
    for frame in recording.heard:
        if frame.id == mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT and frame.at_s < asked_s:
            alt_m = frame.message.alt / 1000.0
    return alt_m


def _takes_off_to_altitude(frame: Frame) -> bool:
    is_command = frame.id == mav.MAVLINK_MSG_ID_COMMAND_LONG
    return is_command and frame.message.command == mav.MAV_CMD_NAV_TAKEOFF and math.isfinite(frame.message.param7)
