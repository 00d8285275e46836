"""A flight in lockstep as topics of ROS 2, while it is flown: those of `export --ros2bag`, diagnostics, the clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from functools import partial
from typing import Any, Final, Protocol

import numpy as np

from companion.core.model.states import FlightState, SwarmPhase
from mission.common.frames import Vec3
from mission.common.problems import printable
from sim_bridge.drive.live.laser_scans import ForeignScans, sectors_of
from sim_bridge.drive.live.zenoh_session import Inlet, ZenohSession
from sim_bridge.judge.export.axes import to_enu
from sim_bridge.judge.export.ros2.log import Ros2Log
from sim_bridge.judge.export.ros2.messages import SCAN, Stamped, VehicleMessages, namespace, stamp
from sim_bridge.judge.observer import Observer
from sim_bridge.judge.tick import Tick
from sim_bridge.world.sensors.lidar import Scan
from sim_bridge.world.sensors.simulated import ModelSensor
from sim_bridge.world.world import World

CLOCK: Final = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
DIAGNOSTICS_S: Final = 1.0  # as REP 107 has it
OBSTACLES: Final = "obstacles"
TEXT_MAX_CHARS: Final = 200


class Flown(Protocol):
    """The part of a fly.Flight that is needed here."""

    observer: Observer

    @property
    def world(self) -> World:
        """The vehicles."""

    @property
    def last(self) -> Tick:
        """The tick that was flown last."""

    @property
    def events(self) -> list[tuple[float, str]]:
        """Events of the flight, for people, with their times."""


class Ros2Topics:
    """Topics of one flight. `publish` is to be called after every tick."""

    def __init__(self, session: ZenohSession, ids: Collection[int], scans_of: Collection[int] = ()) -> None:
        """`scans_of`: the vehicles whose scans others publish."""
        self._session: Final = session
        self._start_us = 0  # Unix time of time 0, as of the telemetry logs
        self._logs = {k: Ros2Log() for k in ids}
        self._make: dict[int, VehicleMessages] = {}
        self._inlets = {k: session.subscribe(f"/{namespace(k)}/scan", SCAN) for k in sorted(scans_of)}
        self._refused: dict[int, str] = {}  # why a vehicle's last scan was
        self._told_s = -DIAGNOSTICS_S
        self._truth: deque[tuple[float, tuple[Vec3, ...]]] = deque(maxlen=3)  # positions (NED m) after the last ticks

    def publish(self, flight: Flown) -> None:
        """All that the last tick had."""
        if not self._truth:
            self._begin(flight)
        now_s = flight.last.time_s
        self._truth.append((now_s, flight.last.pos_ned_m))
        time_ns = (self._start_us + round(now_s * 1e6)) * 1000
        types = self._session.types
        self._session.put(Stamped(time_ns, "/clock", CLOCK, types[CLOCK](stamp(types, time_ns))))
        if now_s - self._told_s >= DIAGNOSTICS_S - 1e-6:
            self._told_s = now_s
            self._session.put(Stamped(time_ns, "/diagnostics", DIAGNOSTICS, self._diagnostics(time_ns, flight.last)))

    def _begin(self, flight: Flown) -> None:
        self._start_us = flight.observer.epoch_us
        self._make = {k: VehicleMessages(k, self._start_us, self._session.types) for k in self._logs}
        flight.observer.tap = self._take_traffic
        if self._inlets:
            self._replace_scans(flight)

    def _take_traffic(self, now_s: float, k: int, data: bytes) -> None:
        """Traffic of a vehicle's links, as its telemetry log has it."""
        log, put, make = self._logs[k], self._session.put, self._make[k]
        log.read_bytes(data, now_s)
        if log.poses:
            poses = log.pose_arrays()
            _, true_ned_m = min(self._truth, key=lambda one: abs(one[0] - now_s))
            true_enu_m = to_enu(np.array([true_ned_m[k - 1]]))
            for message in (*make.odometry(poses), *make.transforms(poses, true_enu_m)):
                put(message)
        for setpoint in log.setpoints:
            put(make.setpoint(*setpoint))
        for sweep in log.sweeps if k not in self._inlets else ():
            put(make.scan(*sweep))
        for reading in log.batteries:
            put(make.battery(*reading))
        log.clear()

    def _diagnostics(self, time_ns: int, tick: Tick) -> Any:
        types = self._session.types
        header = types["std_msgs/msg/Header"](stamp(types, time_ns), "")
        return types[DIAGNOSTICS](header, [self._status(k, tick) for k in self._logs])

    def _status(self, k: int, tick: Tick) -> Any:
        """State of one vehicle: of its last beacon, its autopilot, and what it has run into."""
        types, said = self._session.types, tick.said.get(k)
        kind = types["diagnostic_msgs/msg/DiagnosticStatus"]
        touched, alive = tick.touched[k - 1], k in tick.alive
        values = {
            "phase": "" if said is None else SwarmPhase(said.swarm_phase).name.lower(),
            "leader": "" if said is None else str(said.acting_leader),
            "mode": tick.mode[k - 1],
            "armed": str(tick.armed[k - 1]).lower(),
            "on_ground": str(tick.on_ground[k - 1]).lower(),
            "touched": touched,
        }
        message = "no companion" if not alive else "" if said is None else FlightState(said.flight_state).name.lower()
        level = kind.ERROR if touched or not alive else kind.OK
        pairs = [types["diagnostic_msgs/msg/KeyValue"](key, value) for key, value in values.items()]
        return kind(level, namespace(k), message, namespace(k), pairs)

    def _replace_scans(self, flight: Flown) -> None:
        take: dict[int, Callable[[float], Scan | None]] = {
            k: partial(self._take_scan, k, inlet, flight) for k, inlet in self._inlets.items()
        }
        world = flight.world
        world.sensors = tuple(
            ModelSensor(OBSTACLES, "scans over Zenoh", ForeignScans(sensor, take), by_autopilot=sensor.by_autopilot)
            if sensor.name == OBSTACLES
            else sensor
            for sensor in world.sensors
        )

    def _take_scan(self, k: int, inlet: Inlet, flight: Flown, now_s: float) -> Scan | None:
        data = inlet.take_last()
        if data is None:
            return None
        try:
            message = self._session.deserialize(data, SCAN)
            at = message.header.stamp
            stamped_s = at.sec + at.nanosec / 1e9 - self._start_us / 1e6
            scan = sectors_of(message, f"{namespace(k)}/base_link", now_s, stamped_s)
        except ValueError as error:
            why = printable(str(error), TEXT_MAX_CHARS)
            if self._refused.get(k) != why:
                self._refused[k] = why
                flight.events.append((now_s, f"vehicle {k}: scan refused: {why}"))
            return None
        self._refused.pop(k, None)
        return scan
