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
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mission import __version__
from sim_bridge.judge.export.axes import to_enu
from sim_bridge.judge.export.flown import Flown
from sim_bridge.judge.export.ros2.log import PoseArrays, Ros2Log, read_log
from sim_bridge.judge.export.ros2.messages import Stamped, VehicleMessages
from sim_bridge.judge.run_folder import RunFolderError

BAG_VERSION: Final = 9  # of rosbag2's metadata: as Jazzy writes it


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
        self._log: Ros2Log = read_log(flight.folder / f"vehicle-{vehicle_id}.tlog", flight.start_us)
        self._make = VehicleMessages(vehicle_id, flight.start_us, types)
        self._poses: PoseArrays = self._log.pose_arrays()
        true_enu_m = to_enu(flight.recording.pos_ned_m[:, vehicle_id - 1])
        at_s = flight.recording.time_s
        self._true_enu_m = np.column_stack([np.interp(self._poses.time_s, at_s, true_enu_m[:, k]) for k in range(3)])

    def streams(self) -> tuple[Iterator[Stamped], ...]:
        """One of each kind."""
        make, log = self._make, self._log
        return (
            make.odometry(self._poses),
            make.transforms(self._poses, self._true_enu_m),
            (make.setpoint(*one) for one in log.setpoints),
            (make.scan(*one) for one in log.sweeps),
            (make.battery(*one) for one in log.batteries),
        )
