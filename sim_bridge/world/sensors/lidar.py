"""A lidar and its driver: 72 sectors at its rate, with noise and dropouts, and the OBSTACLE_DISTANCE that is sent."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from mission.common.frames import Vec3
from mission.document.model import Lidar as LidarErrors
from mission.document.model import Mission, ScansVia, Sensing
from mission.schema.kinds import SECTORS_SD_M, SensorClass
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.scan import SECTORS, STEP_RAD, Cylinder, nearest_m
from sim_bridge.world.sensors.scene import Scene
from sim_bridge.world.sensors.simulated import SimulatedSensor

MOUNTED_UP_M: Final = 0.25  # on the top plate, above the point that touches the ground
BODY_UP_M: Final = 0.5  # from a vehicle's feet to the top of its lidar, as the others see it
RANGE_MIN_M: Final = 0.2  # an RPLIDAR A2's; what is nearer is told as this
SALT: Final = 0x11DA  # apart from the seeds of placement, wind, radio and estimates
EPSILON_S: Final = 1e-9
UNKNOWN_CM: Final = 0xFFFF  # UINT16_MAX


@dataclass(frozen=True, slots=True)
class Scan:
    """One turn. `ranges_m`: clockwise from ahead, in the airframe's plane; inf: nothing there, nan: not measured."""

    taken_s: float
    ranges_m: tuple[float, ...]
    range_min_m: float
    range_max_m: float


class Lidar:
    """One vehicle's. Its draws depend on `seed` and `vehicle_id` alone: never on what it sees, nor on the others.

    The first turn ends at a time of its own within one period: lidars do not turn in step.
    """

    def __init__(self, scene: Scene, sensing: Sensing, errors: LidarErrors, *, seed: int, vehicle_id: int) -> None:
        self._scene = scene
        self._max_m = sensing.range_m
        self._body_m = sensing.vehicle_radius_m
        self._period_s = 1.0 / sensing.rate_hz
        self._errors = errors
        self._usual_noise_m = SECTORS_SD_M if errors.noise_m is None else errors.noise_m
        self._noise_m, self._delay_s = self._usual_noise_m, errors.delay_s
        self._rng = np.random.default_rng([seed, SALT, vehicle_id])
        self._next_s = self._period_s * self._rng.random()
        self._turns = 0
        self._begin_s = self._next_s
        half_rad = math.radians(sensing.field_of_view_deg) / 2.0
        bearings = [math.fmod(sector * STEP_RAD + math.pi, math.tau) - math.pi for sector in range(SECTORS)]
        self._blind = [abs(bearing) > half_rad + EPSILON_S for bearing in bearings]
        self._under_way: deque[Scan] = deque()

    def set_errors(self, noise_m: float, delay_s: float) -> None:
        """Sets by how much noisier and later scans are than usual."""
        self._noise_m = math.hypot(self._usual_noise_m, noise_m)
        self._delay_s = self._errors.delay_s + delay_s

    def scan(self, state: AirframeState, others_ned_m: Iterable[Vec3], now_s: float) -> Scan | None:
        """The scan that is ready at `now_s`, or None. To be called at every step, in the order of time.

        A turn that ends between two steps is measured at the later one. `others_ned_m`: the other vehicles, wherever.
        """
        if now_s >= self._next_s - EPSILON_S:
            while self._next_s <= now_s + EPSILON_S:  # after a pause the missed turns are missed
                self._turns += 1
                self._next_s = self._begin_s + self._turns * self._period_s
            self._under_way.append(self._measure(state, others_ned_m, now_s))
        if self._under_way and self._under_way[0].taken_s + self._delay_s <= now_s + EPSILON_S:
            return self._under_way.popleft()
        return None

    def _measure(self, state: AirframeState, others_ned_m: Iterable[Vec3], now_s: float) -> Scan:
        north_m, east_m, down_m = state.pos_ned_m
        eye = (north_m, east_m, down_m - MOUNTED_UP_M)
        standing = [*self._scene.around(eye), *bodies(eye, others_ned_m, self._body_m, self._max_m)]
        seen_m = nearest_m(eye, state.attitude_rad, standing, self._scene.ground(eye), self._max_m)
        if self._scene.has_boxes:
            from sim_bridge.world.sensors.box_scan import nearest_box_m  # arrays, which few stands need

            blocks = [(box, self._scene.top_up_m(box)) for box in self._scene.boxes_around(eye)]
            seen_m = np.minimum(seen_m, nearest_box_m(eye, state.attitude_rad, blocks, self._max_m)).tolist()
        return Scan(now_s, self._spoilt(seen_m), RANGE_MIN_M, self._max_m)

    def _spoilt(self, seen_m: Sequence[float]) -> tuple[float, ...]:
        """`seen_m` (72,) as it is told: with noise, without the sectors that were missed or are out of view."""
        draws = self._rng.standard_normal(SECTORS).tolist()
        misses = self._rng.random(SECTORS).tolist()
        told_m = []
        for range_m, draw, miss, blind in zip(seen_m, draws, misses, self._blind, strict=True):
            if blind or miss < self._errors.dropout:
                told_m.append(math.nan)
            elif math.isfinite(range_m):
                told_m.append(min(max(range_m + self._noise_m * draw, RANGE_MIN_M), self._max_m))
            else:
                told_m.append(range_m)
        return tuple(told_m)


class Driver:
    """Driver of a lidar, which sends its scans: a MAVLink sender of its own."""

    def __init__(self, lidar: Lidar, vehicle_id: int) -> None:
        self.lidar = lidar
        self._sender = wire.Sender(vehicle_id, dialect.MAV_COMP_ID_OBSTACLE_AVOIDANCE)

    def frames(
        self, state: AirframeState, others_ned_m: Iterable[Vec3], now_s: float, stamp_s: Callable[[float], float]
    ) -> bytes:
        """As Lidar.scan, as a frame of OBSTACLE_DISTANCE; empty when there is no scan to tell.

        `stamp_s`: simulated time -> by the driver's clock.
        """
        scan = self.lidar.scan(state, others_ned_m, now_s)
        return b"" if scan is None else self._sender.pack(obstacle_distance(scan, stamp_s(scan.taken_s)))


class Lidars(SimulatedSensor):
    """Lidars of all vehicles in one scene."""

    def __init__(self, drivers: Mapping[int, Driver], *, by_autopilot: bool) -> None:
        super().__init__("obstacles", by_autopilot=by_autopilot, is_optical=True)
        self._drivers = drivers

    def set_errors(self, errors: Mapping[int, tuple[float, ...]]) -> None:
        """Noise and delay."""
        for vehicle_id, driver in self._drivers.items():
            driver.lidar.set_errors(*errors.get(vehicle_id, (0.0, 0.0)))

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """OBSTACLE_DISTANCE, or nothing."""
        others = [pos_ned_m for other, pos_ned_m in positions_ned_m.items() if other != vehicle_id]
        return self._drivers[vehicle_id].frames(state, others, now_s, self.stamp_s)


def lidars_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> Lidars | None:
    """In a mission with [sensing] whose sensor tells sectors."""
    sensing, sim = mission.sensing, mission.sim
    if sensing is None or sensing.sensor is not SensorClass.SECTORS:
        return None
    scene = Scene(stand, sensing.range_m)
    drivers = {k: Driver(Lidar(scene, sensing, sim.lidar, seed=sim.seed, vehicle_id=k), k) for k in ids}
    return Lidars(drivers, by_autopilot=sim.lidar.via is ScansVia.AUTOPILOT)


def bodies(eye_ned_m: Vec3, others_ned_m: Iterable[Vec3], radius_m: float, within_m: float) -> list[Cylinder]:
    """The other vehicles that are near enough to be seen, as upright cylinders from their feet to the top."""
    reach_m = within_m + radius_m
    return [
        (north_m, east_m, radius_m, -down_m, BODY_UP_M - down_m)
        for north_m, east_m, down_m in others_ned_m
        if abs(north_m - eye_ned_m[0]) < reach_m and abs(east_m - eye_ned_m[1]) < reach_m
    ]


def obstacle_distance(scan: Scan, stamped_s: float) -> dialect.MAVLink_obstacle_distance_message:
    """OBSTACLE_DISTANCE (330) as drivers send it: centimetres clockwise from ahead.

    max_distance + 1: nothing there; UINT16_MAX: not measured (common.xml). A laser, MAV_FRAME_BODY_FRD, 5 degrees a
    sector in `increment_f`, and rounded in `increment` for receivers that know no other. It speaks as the vehicle's
    component MAV_COMP_ID_OBSTACLE_AVOIDANCE. `stamped_s`: when it was taken, by the driver's clock.
    """
    nothing_cm = round(scan.range_max_m * 100.0) + 1
    step_deg = math.degrees(STEP_RAD)
    return dialect.MAVLink_obstacle_distance_message(
        time_usec=round(stamped_s * 1e6),
        sensor_type=dialect.MAV_DISTANCE_SENSOR_LASER,
        distances=[
            UNKNOWN_CM if math.isnan(range_m) else nothing_cm if math.isinf(range_m) else round(range_m * 100.0)
            for range_m in scan.ranges_m
        ],
        increment=round(step_deg),
        min_distance=round(scan.range_min_m * 100.0),
        max_distance=round(scan.range_max_m * 100.0),
        increment_f=step_deg,
        angle_offset=0.0,
        frame=dialect.MAV_FRAME_BODY_FRD,
    )
