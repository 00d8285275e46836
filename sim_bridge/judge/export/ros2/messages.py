"""The ROS 2 messages of one vehicle: topics, types and frames (REP 103 and 105), alike in a bag and live."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from mission.common.frames import Vec3
from sim_bridge.judge.export.messages import MAP
from sim_bridge.judge.export.ros2.log import BatteryReading, LaserSweep, PoseArrays
from sim_bridge.judge.metrics.arrays import Floats

ODOMETRY: Final = "nav_msgs/msg/Odometry"
SCAN: Final = "sensor_msgs/msg/LaserScan"
BATTERY: Final = "sensor_msgs/msg/BatteryState"
TF: Final = "tf2_msgs/msg/TFMessage"
TWIST: Final = "geometry_msgs/msg/TwistStamped"
TF_TOPIC: Final = "/tf"
TECHNOLOGIES: Final = {1: 3, 2: 4, 3: 2, 4: 1}  # MAV_BATTERY_TYPE -> POWER_SUPPLY_TECHNOLOGY: LiPo, LiFe, Li-ion, NiMH


class Stamped(NamedTuple):
    """One message of a topic. `time_ns`: Unix time."""

    time_ns: int
    topic: str
    kind: str
    body: Any


def namespace(vehicle_id: int) -> str:
    """Namespace of a vehicle's topics, without a slash; its frames begin with it."""
    return f"vehicle_{vehicle_id}"


class VehicleMessages:
    """Makes the messages of one vehicle. Times in seconds since the flight began."""

    def __init__(self, vehicle_id: int, start_us: int, types: Mapping[str, Any]) -> None:
        """`start_us`: Unix time of time 0. `types`: message classes by name."""
        name = namespace(vehicle_id)
        self._topic, self._odom, self._base = f"/{name}", f"{name}/odom", f"{name}/base_link"
        self._start_us = start_us
        self._types = types
        self._vector = types["geometry_msgs/msg/Vector3"]
        self._still = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        self._unknown = np.zeros(36)  # a covariance that nobody reported

    def odometry(self, poses: PoseArrays) -> Iterator[Stamped]:
        """As the autopilot estimated itself."""
        types = self._types
        for row, time_s in enumerate(poses.time_s.tolist()):
            pose = types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](*poses.pos_enu_m[row].tolist()), self._quaternion(poses, row)
            )
            twist = types["geometry_msgs/msg/Twist"](
                self._vector(*poses.vel_flu_mps[row].tolist()), self._vector(*poses.rates_flu_radps[row].tolist())
            )
            time_ns = self._ns(time_s)
            body = types[ODOMETRY](
                self._header(time_ns, self._odom),
                self._base,
                types["geometry_msgs/msg/PoseWithCovariance"](pose, self._unknown),
                types["geometry_msgs/msg/TwistWithCovariance"](twist, self._unknown),
            )
            yield Stamped(time_ns, f"{self._topic}/odom", ODOMETRY, body)

    def transforms(self, poses: PoseArrays, true_enu_m: Floats) -> Iterator[Stamped]:
        """map -> odom, and odom -> base_link. `true_enu_m`: (T, 3) the vehicle's true positions."""
        map_to_odom_m = true_enu_m - poses.pos_enu_m
        for row, time_s in enumerate(poses.time_s.tolist()):
            time_ns = self._ns(time_s)
            both = [
                self._transform(time_ns, (MAP, self._odom), map_to_odom_m[row], self._still),
                self._transform(time_ns, (self._odom, self._base), poses.pos_enu_m[row], self._quaternion(poses, row)),
            ]
            yield Stamped(time_ns, TF_TOPIC, TF, self._types[TF](both))

    def setpoint(self, time_s: float, vel_enu_mps: Vec3) -> Stamped:
        """The companion's velocity setpoint."""
        time_ns = self._ns(time_s)
        twist = self._types["geometry_msgs/msg/Twist"](self._vector(*vel_enu_mps), self._vector(0.0, 0.0, 0.0))
        return Stamped(
            time_ns, f"{self._topic}/cmd_vel", TWIST, self._types[TWIST](self._header(time_ns, self._odom), twist)
        )

    def scan(self, time_s: float, sweep: LaserSweep) -> Stamped:
        """A scan of its obstacle sensor."""
        time_ns = self._ns(time_s)
        last_rad = sweep.first_rad + (len(sweep.ranges_m) - 1) * sweep.step_rad
        body = self._types[SCAN](
            self._header(time_ns, self._base),
            sweep.first_rad,
            last_rad,
            sweep.step_rad,
            0.0,  # OBSTACLE_DISTANCE has one time for all sectors
            0.0,
            sweep.min_m,
            sweep.max_m,
            sweep.ranges_m.astype(np.float32),
            np.zeros(0, np.float32),
        )
        return Stamped(time_ns, f"{self._topic}/scan", SCAN, body)

    def battery(self, time_s: float, reading: BatteryReading) -> Stamped:
        """As the autopilot reported it."""
        time_ns = self._ns(time_s)
        nan, none = float("nan"), np.zeros(0, np.float32)
        kind = self._types[BATTERY]
        body = kind(
            self._header(time_ns, self._base),
            reading.voltage_v,
            reading.temperature_degc,
            reading.current_a,
            nan,  # charge and capacities are not reported
            nan,
            nan,
            reading.share,
            kind.POWER_SUPPLY_STATUS_DISCHARGING if reading.current_a < 0.0 else kind.POWER_SUPPLY_STATUS_UNKNOWN,
            kind.POWER_SUPPLY_HEALTH_UNKNOWN,
            TECHNOLOGIES.get(reading.technology, kind.POWER_SUPPLY_TECHNOLOGY_UNKNOWN),
            True,
            none,
            none,
            reading.location,
            "",
        )
        return Stamped(time_ns, f"{self._topic}/battery", BATTERY, body)

    def _ns(self, time_s: float) -> int:
        return (self._start_us + round(time_s * 1e6)) * 1000

    def _header(self, time_ns: int, frame: str) -> Any:
        return self._types["std_msgs/msg/Header"](stamp(self._types, time_ns), frame)

    def _transform(self, time_ns: int, frames: tuple[str, str], moved_m: Floats, turned: Any) -> Any:
        parent, child = frames
        return self._types["geometry_msgs/msg/TransformStamped"](
            self._header(time_ns, parent),
            child,
            self._types["geometry_msgs/msg/Transform"](self._vector(*moved_m.tolist()), turned),
        )

    def _quaternion(self, poses: PoseArrays, row: int) -> Any:
        return self._types["geometry_msgs/msg/Quaternion"](*poses.quaternions[row].tolist())


def stamp(types: Mapping[str, Any], time_ns: int) -> Any:
    """builtin_interfaces/Time of a Unix time."""
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
