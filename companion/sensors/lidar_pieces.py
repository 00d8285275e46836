"""SWARM_LIDAR_SCAN of a vehicle's lidars, joined to its own attitude -> LidarScan.

A piece says when each of its rays was measured, by a clock that may be any: its age is how much later it came than the
quickest. How the vehicle stood at its first ray and at its last is taken from the last second's ATTITUDE, between two.
Pieces wait for the tick's ATTITUDE, which may come after them; without a fresh one they are dropped.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Final

from companion.core.model.events import LidarScan
from companion.core.vehicle.obstacle_sensor_monitor import SENSORS_MAX
from companion.mavlink.lidar_scan import LidarPiece, decode_lidar_scan
from companion.sensors.scans import ATTITUDE_FRESH_S, Delay
from mission.common.frames import Vec3

ATTITUDES_MAX: Final = 24  # a second at 20 Hz, and some
WAITING_MAX: Final = 512  # pieces between two ticks, some turns' of a lidar of many layers; beyond, the oldest are lost


class LidarPieces:
    """Of one vehicle's lidars: `attitude` and `piece` as they arrive, `join` in each tick. Times: local clock, s.

    Nothing raises: what makes no sense is counted in `refused`, and changes nothing.
    """

    __slots__ = ("_attitudes", "_delays", "_waiting", "refused", "without_attitude")

    def __init__(self) -> None:
        self.refused = 0  # messages whose content makes no sense, or shows nothing
        self.without_attitude = 0  # pieces dropped since it was not known how the vehicle stood
        self._attitudes: deque[tuple[float, Vec3]] = deque(maxlen=ATTITUDES_MAX)
        self._delays: dict[int, Delay] = {}
        self._waiting: deque[tuple[int, LidarPiece, float]] = deque(
            maxlen=WAITING_MAX
        )  # sensor; when its first ray was

    def attitude(self, m: Any, now_s: float) -> None:
        """ATTITUDE of the vehicle's autopilot."""
        roll, pitch, yaw = m.roll, m.pitch, m.yaw
        if abs(roll) <= math.pi and abs(pitch) <= math.pi and abs(yaw) <= math.tau:  # false for NaN
            self._attitudes.append((now_s, (roll, pitch, yaw)))
        else:
            self.refused += 1

    def piece(self, m: Any, sensor: int, now_s: float) -> None:
        """SWARM_LIDAR_SCAN of component `sensor` of this vehicle."""
        found = decode_lidar_scan(m)
        delay = self._delays.get(sensor)
        if found is None or (delay is None and len(self._delays) >= SENSORS_MAX):
            self.refused += 1
            return
        if delay is None:
            delay = self._delays[sensor] = Delay()
        lasts_s = (len(found.ranges_m) - 1) * found.ray_time_s
        late_s = delay.lateness_s(found.time_us, now_s, lasts_s)
        self._waiting.append((sensor, found, now_s - late_s - lasts_s))

    def join(self, now_s: float) -> list[LidarScan]:
        """Pieces since the last call, oldest first."""
        found: list[LidarScan] = []
        while self._waiting:
            sensor, piece, began_s = self._waiting.popleft()
            first = self._attitude_at(began_s)
            last = self._attitude_at(began_s + (len(piece.ranges_m) - 1) * piece.ray_time_s)
            if first is None or last is None:
                self.without_attitude += 1
            else:
                found.append(_joined(sensor, piece, now_s - began_s, first, last))
        return found

    def _attitude_at(self, time_s: float) -> Vec3 | None:
        """Between the one before and the one after; None: neither is near enough."""
        before: tuple[float, Vec3] | None = None
        after: tuple[float, Vec3] | None = None
        for told in reversed(self._attitudes):
            if told[0] <= time_s:
                before = told
                break
            after = told
        near = [told for told in (before, after) if told is not None and abs(told[0] - time_s) <= ATTITUDE_FRESH_S]
        if len(near) < 2:
            return near[0][1] if near else None
        (before_s, one), (after_s, other) = near
        share = (time_s - before_s) / (after_s - before_s)
        return (
            one[0] + share * math.remainder(other[0] - one[0], math.tau),
            one[1] + share * (other[1] - one[1]),
            one[2] + share * math.remainder(other[2] - one[2], math.tau),
        )


def _joined(sensor: int, piece: LidarPiece, age_s: float, first: Vec3, last: Vec3) -> LidarScan:
    return LidarScan(
        sensor,
        piece.turn,
        piece.ranges_m,
        math.radians(piece.elevation_deg),
        math.remainder(math.radians(piece.first_bearing_deg), math.tau),
        math.radians(piece.bearing_step_deg),
        piece.min_m,
        piece.max_m,
        age_s,
        piece.ray_time_s,
        first,
        last,
    )
