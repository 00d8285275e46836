"""The contract of a simulated sensor: one class for those of all vehicles, with their drivers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from mission.common.frames import Vec3
from sim_bridge.world.airframe.state import AirframeState


class SimulatedSensor(ABC):
    """One kind of sensor of all vehicles. `sim_bridge.world.sensors.table` lists those that a mission has."""

    def __init__(self, name: str, *, by_autopilot: bool = False, is_optical: bool = False) -> None:
        """`name`: of the companion's sensor that it stands for, in companion.sensors.table.

        `by_autopilot`: its messages come by way of the autopilot, and on no link of its own. `is_optical`: it needs to
        know how its vehicle stands, and a blind vehicle's tells nothing.
        """
        self.name = name
        self.by_autopilot = by_autopilot
        self.is_optical = is_optical

    def set_errors(self, errors: Mapping[int, tuple[float, ...]]) -> None:  # noqa: B027 - a sensor may have none
        """Sets by how much more those of these vehicles are wrong, by id; the others as the mission says."""

    @abstractmethod
    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """Frames that this vehicle's driver sends at `now_s`, or none. To be called each step, in the order of time.

        `state`: the vehicle's; `positions_ned_m`: of all vehicles by id.
        """
