"""Reads a telemetry log for ROS: poses as the autopilot estimated them, velocity setpoints, scans, battery."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.framing.frames import find_frame, source
from companion.sensors.scans import Reading, decoded
from mission.common.frames import Vec3
from sim_bridge.judge.export.axes import quaternions_enu, to_enu, to_flu
from sim_bridge.judge.export.telemetry import AUTOPILOT, frames
from sim_bridge.judge.metrics.arrays import Floats

_OWN: Final = frozenset(  # of the autopilot itself: a companion may send the like
    {
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
    }
)
_WANTED: Final = _OWN | {
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
}
_NO_CELL_MV: Final = 0xFFFF
_NO_TEMPERATURE_CDEGC: Final = 32767
_FULL_TURN_DEG: Final = 359.5  # sectors that leave less open go round


@dataclass(frozen=True, slots=True)
class LaserSweep:
    """OBSTACLE_DISTANCE in the order of ROS: counter-clockwise from `first_rad`, front-left-up. As REP 117: inf nothing
    there, nan not measured."""

    first_rad: float
    step_rad: float
    min_m: float
    max_m: float
    ranges_m: Floats


@dataclass(frozen=True, slots=True)
class BatteryReading:
    """BATTERY_STATUS; nan: not reported."""

    voltage_v: float
    current_a: float  # negative while it discharges, as ROS has it
    temperature_degc: float
    share: float  # left, 0 ... 1
    location: str
    technology: int  # MAV_BATTERY_TYPE


@dataclass(slots=True)
class Ros2Log:
    """Of one vehicle. Times in seconds as the recording counts them, in the order of the log."""

    poses: list[tuple[float, ...]] = field(default_factory=list)  # see the properties
    setpoints: list[tuple[float, Vec3]] = field(default_factory=list)  # ENU m/s
    sweeps: list[tuple[float, LaserSweep]] = field(default_factory=list)
    batteries: list[tuple[float, BatteryReading]] = field(default_factory=list)
    _attitude: tuple[float, ...] | None = None  # the last that was reported, with its rates

    def store_message(self, message_id: int, m: Any, time_s: float) -> None:
        """One message of the log."""
        match message_id:
            case dialect.MAVLINK_MSG_ID_ATTITUDE:
                attitude = (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
                if all(map(math.isfinite, attitude)):
                    self._attitude = attitude
            case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED if self._attitude is not None:
                moved = (m.x, m.y, m.z, m.vx, m.vy, m.vz)
                if all(map(math.isfinite, moved)):
                    self.poses.append((time_s, *moved, *self._attitude))
            case dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED if math.isfinite(m.vx + m.vy + m.vz):
                self.setpoints.append((time_s, (m.vy, m.vx, -m.vz)))
            case dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE:
                reading = decoded(m, 0, time_s)
                if reading is not None and (self._attitude is not None or not reading.from_north):
                    yaw_rad = self._attitude[2] if self._attitude is not None and reading.from_north else 0.0
                    self.sweeps.append((time_s, laser_sweep(reading, yaw_rad)))
            case dialect.MAVLINK_MSG_ID_BATTERY_STATUS:
                self.batteries.append((time_s, _battery(m)))

    def read_bytes(self, data: bytes, time_s: float) -> None:
        """Frames that went over a link at `time_s`, up to what is none."""
        at = 0
        while at < len(data):
            start, at, message_id = find_frame(data, at)
            if at > len(data) or not self.read_frame(message_id, data[start:at], time_s):
                return

    def read_frame(self, message_id: int, frame: bytes, time_s: float) -> bool:
        """One frame; False: it is damaged."""
        if message_id in _WANTED and (message_id not in _OWN or source(frame, 0)[1] == AUTOPILOT):
            try:
                self.store_message(message_id, wire.fields(frame), time_s)
            except dialect.MAVError:
                return False
        return True

    def clear(self) -> None:
        """Forget what was read, but for how the vehicle stands."""
        for kept in (self.poses, self.setpoints, self.sweeps, self.batteries):
            kept.clear()

    def pose_arrays(self) -> PoseArrays:
        """All poses, in the axes of ROS."""
        rows = np.array(self.poses).reshape(-1, 13)
        quaternions = quaternions_enu(rows[:, 7:10])
        return PoseArrays(
            rows[:, 0],
            to_enu(rows[:, 1:4]),
            quaternions,
            to_flu(to_enu(rows[:, 4:7]), quaternions),
            rows[:, 10:13] * np.array([1.0, -1.0, -1.0]),
        )


@dataclass(frozen=True, slots=True)
class PoseArrays:
    """(T,) or (T, k) of one vehicle, as its autopilot estimated itself."""

    time_s: Floats
    pos_enu_m: Floats  # about the origin of the autopilot's own frame
    quaternions: Floats  # x, y, z, w: front-left-up in ENU
    vel_flu_mps: Floats
    rates_flu_radps: Floats


def read_log(path: Path, start_us: int) -> Ros2Log:
    """The log in `path`, up to where it is damaged; empty where there is none. `start_us`: Unix time of time 0."""
    log = Ros2Log()
    for time_s, message_id, frame in frames(path, start_us):
        if not log.read_frame(message_id, frame, time_s):
            break
    return log


def laser_sweep(reading: Reading, yaw_rad: float) -> LaserSweep:
    """Clockwise sectors, turned round; a full turn of them begins behind. `yaw_rad`: own, of sectors from north."""
    count = len(reading.ranges_m)
    step_rad = math.radians(reading.step_deg)
    first_rad = yaw_rad - math.radians(reading.start_deg) - (count - 1) * step_rad
    ranges_m = np.array(reading.ranges_m[::-1])
    if count * reading.step_deg >= _FULL_TURN_DEG:
        behind = math.ceil((-math.pi - first_rad) / step_rad - 1e-9)  # sectors until half a turn to the right
        first_rad += behind * step_rad
        ranges_m = np.roll(ranges_m, -behind)
    return LaserSweep(first_rad, step_rad, reading.min_m, reading.max_m, ranges_m)


def _battery(m: Any) -> BatteryReading:
    cells_mv = [mv for mv in m.voltages if mv != _NO_CELL_MV]
    return BatteryReading(
        sum(cells_mv) / 1000.0 if cells_mv else math.nan,
        -m.current_battery / 100.0 if m.current_battery >= 0 else math.nan,
        m.temperature / 100.0 if m.temperature != _NO_TEMPERATURE_CDEGC else math.nan,
        m.battery_remaining / 100.0 if m.battery_remaining >= 0 else math.nan,
        str(m.id),
        m.type,
    )
