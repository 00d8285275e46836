"""sensor_msgs/LaserScan of others as the sectors of a vehicle's obstacle sensor, in place of the simulated ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.common.frames import Vec3
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import Scan, obstacle_distance
from sim_bridge.world.sensors.scan import SECTORS, STEP_RAD
from sim_bridge.world.sensors.simulated import SimulatedSensor

BEAMS_MAX: Final = 100_000
OLDEST_S: Final = 1.0  # what is stamped as older, or later than now, counts as measured now


def sectors_of(message: Any, frame: str, now_s: float, stamped_s: float) -> Scan:
    """A LaserScan in `frame` (front-left-up). ValueError names field and value of one that makes no sense."""
    if message.header.frame_id != frame:
        raise ValueError(f"header.frame_id = {message.header.frame_id!r}: must be {frame!r}")
    for field in ("angle_min", "angle_increment", "range_min", "range_max"):
        if not math.isfinite(getattr(message, field)):
            raise ValueError(f"{field} = {getattr(message, field)}: must be finite")
    if message.angle_increment == 0.0:
        raise ValueError("angle_increment = 0: must not be 0")
    if not 0.0 <= message.range_min < message.range_max <= 600.0:
        raise ValueError(f"range_min, range_max = {message.range_min}, {message.range_max}: must rise, within 0 to 600")
    if not 0 < len(message.ranges) <= BEAMS_MAX:
        raise ValueError(f"ranges: {len(message.ranges)} of them: must be 1 to {BEAMS_MAX}")
    nearest = [math.nan] * SECTORS
    for beam, range_m in enumerate(message.ranges.tolist()):
        if math.isnan(range_m):
            continue
        told_m = math.inf if range_m > message.range_max else max(range_m, message.range_min)  # as REP 117 has them
        at = round(-(message.angle_min + beam * message.angle_increment) / STEP_RAD) % SECTORS
        if not nearest[at] <= told_m:
            nearest[at] = told_m
    taken_s = stamped_s if now_s - OLDEST_S <= stamped_s <= now_s else now_s
    return Scan(taken_s, tuple(nearest), float(message.range_min), float(message.range_max))


class ForeignScans:
    """An obstacle sensor of all vehicles of which some are told by others: a model, as SensorModel has it."""

    is_optical = True

    def __init__(self, ours: SimulatedSensor, take: Mapping[int, Callable[[float], Scan | None]]) -> None:
        """`ours`: which simulates the rest. `take`: of each of the vehicles, the scan that has come by a time."""
        self._ours = ours
        self._take = take
        self._drivers = {k: wire.Sender(k, dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE) for k in take}

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """OBSTACLE_DISTANCE, or nothing."""
        if vehicle_id not in self._take:
            return self._ours.frames(vehicle_id, state, positions_ned_m, now_s)
        scan = self._take[vehicle_id](now_s)
        return b"" if scan is None else self._drivers[vehicle_id].pack(obstacle_distance(scan, scan.taken_s))
