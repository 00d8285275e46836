"""OBSTACLE_DISTANCE of a vehicle's obstacle sensors, joined to its own attitude -> ObstacleScan.

Where drivers differ, the safe side is taken, and MAVLink's text before any autopilot's reading of it. A distance below
the sensor's least, 0 among them, is an obstacle at that least distance. UINT16_MAX is unknown, what is above the
greatest is free. Sectors beyond a full turn are padding. A scan with no sector measured shows nothing, and is no scan.

How a scan's plane stood must be known to place what it saw: without a fresh ATTITUDE it is dropped, also where its
sectors count from north, since they are as tilted as any. Scans wait for the tick's ATTITUDE, which may come after.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

from companion.core.model.events import ObstacleScan
from companion.core.vehicle.obstacle_sensor_monitor import SENSORS_MAX
from companion.mavlink import dialect

ATTITUDE_HZ: Final = 20.0  # once a tick
ATTITUDE_FRESH_S: Final = 0.15  # three of them; a vehicle turns by 7 degrees at 45 degrees/s
WAITING_MAX: Final = 16  # scans between two ticks; beyond, the oldest are lost
DRIFT: Final = 1e-3  # of the least delay: crystals drift by 2e-4
UNKNOWN_CM: Final = 0xFFFF
STEP_MIN_DEG: Final = 0.01  # no sensor is finer
NORTH_ALIGNED = frozenset({dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_LOCAL_NED})


@dataclass(slots=True)
class Reading:
    """A scan without its attitude."""

    sensor: int
    ranges_m: tuple[float, ...]
    start_deg: float
    step_deg: float
    min_m: float
    max_m: float
    from_north: bool
    late_s: float
    arrived_s: float


class Scans:
    """Of one vehicle's sensors: `attitude` and `scan` as they arrive, `join` in each tick. Times: local clock, s.

    Nothing raises: what makes no sense is counted in `refused`, and changes nothing.
    """

    __slots__ = ("_attitude_rad", "_attitude_s", "_delays", "_waiting", "refused", "without_attitude")

    def __init__(self) -> None:
        self.refused = 0  # messages whose content makes no sense, or shows nothing
        self.without_attitude = 0  # scans dropped since it was not known how the vehicle stood
        self._attitude_rad = (0.0, 0.0, 0.0)
        self._attitude_s = -1e9
        self._delays: dict[int, Delay] = {}
        self._waiting: deque[Reading] = deque(maxlen=WAITING_MAX)

    def attitude(self, m: Any, now_s: float) -> None:
        """ATTITUDE of the vehicle's autopilot."""
        roll, pitch, yaw = m.roll, m.pitch, m.yaw
        if abs(roll) <= math.pi and abs(pitch) <= math.pi and abs(yaw) <= math.tau:  # false for NaN
            self._attitude_rad, self._attitude_s = (roll, pitch, yaw), now_s
        else:
            self.refused += 1

    def scan(self, m: Any, sensor: int, now_s: float) -> None:
        """OBSTACLE_DISTANCE of component `sensor` of this vehicle."""
        found = decoded(m, sensor, now_s)
        delay = self._delays.get(sensor)
        if found is None or (delay is None and len(self._delays) >= SENSORS_MAX):
            self.refused += 1
            return
        if delay is None:
            delay = self._delays[sensor] = Delay()
        found.late_s = delay.lateness_s(m.time_usec, now_s)
        self._waiting.append(found)

    def join(self, now_s: float) -> list[ObstacleScan]:
        """Scans since the last call, oldest first."""
        if not self._waiting:
            return []
        waiting = list(self._waiting)
        self._waiting.clear()
        if now_s - self._attitude_s > ATTITUDE_FRESH_S:
            self.without_attitude += len(waiting)
            return []
        return [self._joined(scan, now_s) for scan in waiting]

    def _joined(self, scan: Reading, now_s: float) -> ObstacleScan:
        roll, pitch, yaw = self._attitude_rad
        start_rad = math.radians(scan.start_deg) - (yaw if scan.from_north else 0.0)
        return ObstacleScan(
            scan.sensor,
            scan.ranges_m,
            math.remainder(start_rad, math.tau),
            math.radians(scan.step_deg),
            scan.min_m,
            scan.max_m,
            roll,
            pitch,
            yaw,
            now_s - scan.arrived_s + scan.late_s,
        )


def decoded(m: Any, sensor: int, now_s: float) -> Reading | None:
    """OBSTACLE_DISTANCE as it stands there; None: it makes no sense, or shows nothing."""
    from_north = m.frame in NORTH_ALIGNED
    if not from_north and m.frame != dialect.MAV_FRAME_BODY_FRD:
        return None
    step_deg: float = m.increment_f if m.increment_f != 0.0 else float(m.increment)  # NaN is not 0, and refused below
    start_deg: float = m.angle_offset
    near_cm: int = m.min_distance
    far_cm: int = m.max_distance
    if not (STEP_MIN_DEG <= abs(step_deg) <= 360.0 and abs(start_deg) <= 360.0 and near_cm <= far_cm and far_cm > 0):
        return None
    count = min(len(m.distances), int(360.0 / abs(step_deg) + 0.001))
    ranges_m = tuple([_range_m(cm, near_cm, far_cm) for cm in m.distances[:count]])
    if all([math.isnan(range_m) for range_m in ranges_m]):
        return None
    if step_deg < 0.0:  # counter-clockwise
        start_deg, step_deg, ranges_m = start_deg + (count - 1) * step_deg, -step_deg, ranges_m[::-1]
    return Reading(sensor, ranges_m, start_deg, step_deg, near_cm / 100.0, far_cm / 100.0, from_north, 0.0, now_s)


def _range_m(cm: int, near_cm: int, far_cm: int) -> float:
    if cm == UNKNOWN_CM:
        return math.nan
    if cm > far_cm:
        return math.inf
    return (cm if cm > near_cm else near_cm) / 100.0


class Delay:
    """Delay of one sensor's scans, above the least that was seen: a backlog on their way shows, a constant delay
    does not.

    Its clock may be any, and may be set: what came over one way cannot overtake, so a time that goes back is a clock
    that was set. One of 0 is none. A scan that is sent again and again keeps its time, and grows old.
    """

    __slots__ = ("_heard_s", "_least_s", "_time_us")

    def __init__(self) -> None:
        self._time_us = 0
        self._heard_s = 0.0
        self._least_s = 0.0

    def lateness_s(self, time_us: int, now_s: float, lasts_s: float = 0.0) -> float:
        """Seconds that this scan is later than the quickest. `lasts_s`: from its time until all of it was measured."""
        offset_s = now_s - time_us / 1e6 - lasts_s
        known = 0 < self._time_us <= time_us
        least_s = self._least_s + DRIFT * (now_s - self._heard_s)
        self._least_s = min(least_s, offset_s) if known else offset_s
        self._time_us, self._heard_s = time_us, now_s
        return offset_s - self._least_s if known else 0.0
