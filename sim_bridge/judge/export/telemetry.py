"""Reads a telemetry log of ours to arrays: the log is a file like any other, and may be damaged."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.beacon import MESSAGE_ID
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import find_frame, source
from companion.mavlink.framing.texts import Reader
from mission.common.frames import Vec3
from sim_bridge.judge.metrics.arrays import Floats

AUTOPILOT: Final = dialect.MAV_COMP_ID_AUTOPILOT1
SETPOINT_HELD_S: Final = 0.5  # as autopilots hold one
_STAMP = struct.Struct(">Q")
_WANTED: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
        dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
        dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
    }
)


@dataclass(frozen=True, slots=True)
class Scan:
    """OBSTACLE_DISTANCE: metres, clockwise from `start_rad`, body frame. inf: nothing there, nan: not measured."""

    ranges_m: tuple[float, ...]
    start_rad: float
    step_rad: float


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Of one vehicle. Times in seconds as the recording counts them, rising."""

    fixes: list[tuple[float, float, float, float]] = field(default_factory=list)  # time, lat deg, lon deg, alt m
    attitudes: list[tuple[float, float, float, float]] = field(default_factory=list)  # time, roll, pitch, yaw (rad)
    setpoints: list[tuple[float, Vec3]] = field(default_factory=list)  # NED m/s
    texts: list[tuple[float, int, int, str]] = field(default_factory=list)  # time, component, MAV_SEVERITY, text
    scans: list[tuple[float, Scan]] = field(default_factory=list)
    batteries: list[tuple[float, int]] = field(default_factory=list)  # time, percent left
    beacons_s: list[float] = field(default_factory=list)  # when its companion sent one

    def attitude_rad(self, time_s: Floats) -> Floats:
        """(T, 3) roll, pitch, yaw at `time_s`, between those reported; level and to the north where none is."""
        if not self.attitudes:
            return np.zeros((len(time_s), 3))
        reported = np.array(self.attitudes)
        angles = np.unwrap(reported[:, 1:], axis=0)
        return np.column_stack([np.interp(time_s, reported[:, 0], angles[:, k]) for k in range(3)])

    def setpoints_ned_mps(self, time_s: Floats) -> Floats:
        """(T, 3) the velocity asked for at `time_s`; nan where the last is older than SETPOINT_HELD_S."""
        wanted = np.full((len(time_s), 3), np.nan)
        if self.setpoints:
            asked_s = np.array([at_s for at_s, _ in self.setpoints])
            asked = np.array([velocity for _, velocity in self.setpoints])
            last = np.searchsorted(asked_s, time_s + 1e-6, side="right") - 1
            held = (last >= 0) & (time_s - asked_s[np.maximum(last, 0)] <= SETPOINT_HELD_S)
            wanted[held] = asked[last[held]]
        return wanted


def begins_us(path: Path) -> int:
    """Unix time of the first frame of the log in `path`; 0: there is none."""
    stamp = _log_bytes(path, _STAMP.size)
    return int(_STAMP.unpack(stamp)[0]) if len(stamp) == _STAMP.size else 0


def _log_bytes(path: Path, count: int = -1) -> bytes:
    """The first `count` bytes of a log, or all; empty: there is none, or a named pipe, which would be waited for."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""


def started_us(folder: Path, n: int) -> int:
    """Unix time of time 0 of the flight of n vehicles in `folder`; 0: no log has it."""
    begins = (begins_us(folder / f"vehicle-{k}.tlog") for k in range(1, n + 1))
    return min((begin_us for begin_us in begins if begin_us), default=0)


def frames(path: Path, start_us: int) -> Iterator[tuple[float, int, bytes]]:
    """Seconds, message id and bytes of each frame of the log in `path`, up to where it is damaged; no log has none."""
    data, at = _log_bytes(path), 0
    while at + _STAMP.size < len(data):
        start, end, message_id = find_frame(data, at + _STAMP.size)
        if start != at + _STAMP.size or end > len(data):
            break
        yield (_STAMP.unpack_from(data, at)[0] - start_us) / 1e6, message_id, data[start:end]
        at = end


def read_telemetry(path: Path, start_us: int) -> Telemetry:
    """The log in `path`, up to where it is damaged; empty where there is none. `start_us`: Unix time of time 0."""
    telemetry, texts = Telemetry(), dict[int, Reader]()
    for time_s, message_id, frame in frames(path, start_us):
        if message_id == MESSAGE_ID:
            telemetry.beacons_s.append(time_s)
        elif message_id in _WANTED:
            try:
                message = wire.fields(frame)
            except dialect.MAVError:
                break
            _store_message(telemetry, texts, message_id, message, source(frame, 0)[1], time_s)
    return telemetry


def _store_message(
    telemetry: Telemetry, texts: dict[int, Reader], message_id: int, m: Any, component: int, time_s: float
) -> None:
    match message_id:
        case dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT if component == AUTOPILOT and (m.lat, m.lon) != (0, 0):
            telemetry.fixes.append((time_s, m.lat / 1e7, m.lon / 1e7, m.alt / 1e3))
        case dialect.MAVLINK_MSG_ID_ATTITUDE if math.isfinite(m.roll + m.pitch + m.yaw):
            telemetry.attitudes.append((time_s, m.roll, m.pitch, m.yaw))
        case dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED if math.isfinite(m.vx + m.vy + m.vz):
            telemetry.setpoints.append((time_s, (m.vx, m.vy, m.vz)))
        case dialect.MAVLINK_MSG_ID_STATUSTEXT:
            text = texts.setdefault(component, Reader()).read_text(m)
            if text is not None:
                telemetry.texts.append((time_s, component, m.severity, text.strip()))
        case dialect.MAVLINK_MSG_ID_BATTERY_STATUS if m.battery_remaining >= 0:
            telemetry.batteries.append((time_s, m.battery_remaining))
        case dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE:
            step_deg = m.increment_f or m.increment
            ranges_m = [
                math.nan if cm == 0xFFFF else math.inf if cm > m.max_distance else cm / 100.0 for cm in m.distances
            ]
            scan = Scan(tuple(ranges_m), math.radians(m.angle_offset), math.radians(step_deg))
            telemetry.scans.append((time_s, scan))
