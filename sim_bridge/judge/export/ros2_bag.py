"""A rosbag2 of a flight, without ROS, by the rosbags library.

Axes and frames are those of REP 103 and REP 105: `map` (east-north-up, about the mission's origin) -> `vehicle_K/odom`
(the frame in which K's autopilot estimates its position) -> `vehicle_K/base_link` (front-left-up). odom -> base_link is
the autopilot's estimate, and map -> odom sets it right: together they are where the vehicle was in truth.
"""

from __future__ import annotations

import heapq
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mission import __version__
from sim_bridge.judge.export.axes import to_enu
from sim_bridge.judge.export.flown import Flown
from sim_bridge.judge.export.messages import MAP
from sim_bridge.judge.export.ros2_log import BatteryReading, LaserSweep, PoseArrays, Ros2Log, read_log
from sim_bridge.judge.metrics.arrays import Floats
from sim_bridge.judge.run_folder import RunFolderError

ODOMETRY: Final = "nav_msgs/msg/Odometry"
SCAN: Final = "sensor_msgs/msg/LaserScan"
BATTERY: Final = "sensor_msgs/msg/BatteryState"
TF: Final = "tf2_msgs/msg/TFMessage"
TWIST: Final = "geometry_msgs/msg/TwistStamped"
BAG_VERSION: Final = 9  # of rosbag2's metadata: as Jazzy writes it
TECHNOLOGIES: Final = {1: 3, 2: 4, 3: 2, 4: 1}  # MAV_BATTERY_TYPE -> POWER_SUPPLY_TECHNOLOGY: LiPo, LiFe, Li-ion, NiMH


class Stamped(NamedTuple):
    """One message of a topic. `time_ns`: Unix time."""

    time_ns: int
    topic: str
    kind: str
    body: Any


def write(flight: Flown, folder: Path) -> Counter[str]:
    """Make the bag `folder`, which must not exist; how many messages each topic has.

    RunFolderError: the flight left no telemetry log. OSError as of a file; what goes wrong leaves nothing of the bag.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    stamped = messages(flight, store.types)
    first = next(stamped, None)
    if first is None:
        raise RunFolderError(f"{flight.folder}: has no telemetry log (vehicle-K.tlog): a bag is made of those")
    counts: Counter[str] = Counter()
    writer = Writer(folder, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    about = {"name": flight.title, "seed": str(flight.mission.sim.seed), "understory": __version__}
    for key, value in about.items():
        writer.set_custom_data(key, value)
    connections: dict[str, Connection] = {}
    writer.open()  # makes the folder: from here on it is ours
    try:
        for time_ns, topic, kind, body in chain((first,), stamped):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time_ns, store.serialize_cdr(body, kind))
            counts[topic] += 1
        writer.close()
    except BaseException:
        writer.abort()
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return counts


def messages(flight: Flown, types: Mapping[str, Any]) -> Iterator[Stamped]:
    """All of `flight`, in the order of time. `types`: message classes by name."""
    vehicles = [_Vehicle(flight, vehicle_id, types) for vehicle_id in flight.ids]
    streams = [stream for vehicle in vehicles for stream in vehicle.streams()]
    return heapq.merge(*streams, key=lambda message: message.time_ns)


class _Vehicle:
    """Messages of one vehicle."""

    def __init__(self, flight: Flown, vehicle_id: int, types: Mapping[str, Any]) -> None:
        name = f"vehicle_{vehicle_id}"
        self._log: Ros2Log = read_log(flight.folder / f"vehicle-{vehicle_id}.tlog", flight.start_us)
        self._topic, self._odom, self._base = f"/{name}", f"{name}/odom", f"{name}/base_link"
        self._start_us = flight.start_us
        self._poses: PoseArrays = self._log.pose_arrays()
        true_enu_m = to_enu(flight.recording.pos_ned_m[:, vehicle_id - 1])
        at_s = flight.recording.time_s
        true_now_m = np.column_stack([np.interp(self._poses.time_s, at_s, true_enu_m[:, k]) for k in range(3)])
        self._map_to_odom_m: Floats = true_now_m - self._poses.pos_enu_m
        self._types = types
        self._vector = types["geometry_msgs/msg/Vector3"]
        self._still = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        self._unknown = np.zeros(36)  # a covariance that nobody reported

    def streams(self) -> tuple[Iterator[Stamped], ...]:
        """One of each kind."""
        return self._odometry(), self._transforms(), self._setpoints(), self._scans(), self._batteries()

    def _ns(self, time_s: float) -> int:
        return (self._start_us + round(time_s * 1e6)) * 1000

    def _header(self, time_ns: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        stamp = self._types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
        return self._types["std_msgs/msg/Header"](stamp, frame)

    def _odometry(self) -> Iterator[Stamped]:
        types, poses = self._types, self._poses
        for row, time_s in enumerate(poses.time_s.tolist()):
            pose = types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](*poses.pos_enu_m[row].tolist()), self._quaternion(row)
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

    def _transforms(self) -> Iterator[Stamped]:
        poses = self._poses
        for row, time_s in enumerate(poses.time_s.tolist()):
            time_ns = self._ns(time_s)
            both = [
                self._transform(time_ns, (MAP, self._odom), self._map_to_odom_m[row], self._still),
                self._transform(time_ns, (self._odom, self._base), poses.pos_enu_m[row], self._quaternion(row)),
            ]
            yield Stamped(time_ns, "/tf", TF, self._types[TF](both))

    def _transform(self, time_ns: int, frames: tuple[str, str], moved_m: Floats, turned: Any) -> Any:
        parent, child = frames
        return self._types["geometry_msgs/msg/TransformStamped"](
            self._header(time_ns, parent),
            child,
            self._types["geometry_msgs/msg/Transform"](self._vector(*moved_m.tolist()), turned),
        )

    def _quaternion(self, row: int) -> Any:
        return self._types["geometry_msgs/msg/Quaternion"](*self._poses.quaternions[row].tolist())

    def _setpoints(self) -> Iterator[Stamped]:
        for time_s, velocity in self._log.setpoints:
            time_ns = self._ns(time_s)
            twist = self._types["geometry_msgs/msg/Twist"](self._vector(*velocity), self._vector(0.0, 0.0, 0.0))
            body = self._types[TWIST](self._header(time_ns, self._odom), twist)
            yield Stamped(time_ns, f"{self._topic}/cmd_vel", TWIST, body)

    def _scans(self) -> Iterator[Stamped]:
        for time_s, sweep in self._log.sweeps:
            time_ns = self._ns(time_s)
            yield Stamped(time_ns, f"{self._topic}/scan", SCAN, self._scan(self._header(time_ns, self._base), sweep))

    def _scan(self, header: Any, sweep: LaserSweep) -> Any:
        last_rad = sweep.first_rad + (len(sweep.ranges_m) - 1) * sweep.step_rad
        return self._types[SCAN](
            header,
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

    def _batteries(self) -> Iterator[Stamped]:
        for time_s, reading in self._log.batteries:
            time_ns = self._ns(time_s)
            body = self._battery(self._header(time_ns, self._base), reading)
            yield Stamped(time_ns, f"{self._topic}/battery", BATTERY, body)

    def _battery(self, header: Any, reading: BatteryReading) -> Any:
        nan, none = float("nan"), np.zeros(0, np.float32)
        kind = self._types[BATTERY]
        return kind(
            header,
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
