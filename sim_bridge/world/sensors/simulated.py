"""The contract of a simulated sensor: one class for those of all vehicles, with their drivers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Final

from mission.common.entry_points import TITLE_MAX_CHARS
from mission.common.exit_codes import EXIT_BAD_FILE
from mission.common.frames import Vec3
from mission.common.problems import printable
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.state import AirframeState


def stamp_simulated(now_s: float) -> float:
    """A driver's clock in lockstep: simulated time."""
    return now_s


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
        self.stamp_s: Callable[[float], float] = stamp_simulated

    def set_clock(self, stamp_s: Callable[[float], float]) -> None:
        """Sets what the drivers stamp by: simulated time -> their own clock, which never goes back, s."""
        self.stamp_s = stamp_s

    def set_errors(self, errors: Mapping[int, tuple[float, ...]]) -> None:  # noqa: B027 - a sensor may have none
        """Sets by how much more those of these vehicles are wrong, by id; the others as the mission says."""

    @abstractmethod
    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """Frames that this vehicle's driver sends at `now_s`, or none. To be called each step, in the order of time.

        `state`: the vehicle's; `positions_ned_m`: of all vehicles by id.
        """


class ModelSensor(SimulatedSensor):
    """A model of an installed package, or of whoever is no part of the world, as the world drives its own sensors."""

    def __init__(self, name: str, title: str, model: Any, *, by_autopilot: bool = False) -> None:
        """`title`: of its errors."""
        super().__init__(name, by_autopilot=by_autopilot, is_optical=bool(getattr(model, "is_optical", False)))
        self._title: Final = title
        self._frames: Final[Callable[..., object]] = model.frames

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """As the model has it, by its driver's clock. StartError: an exception of its own, or no bytes."""
        try:
            data = self._frames(vehicle_id, state, positions_ned_m, self.stamp_s(now_s))
        except Exception as error:
            raise refuse_sensor(f"{self._title}: frames: {type(error).__name__}: {error}") from error
        if not isinstance(data, bytes):
            raise refuse_sensor(f"{self._title}: frames returned {data!r}: must be bytes")
        return data


def refuse_sensor(text: str) -> StartError:
    """The error that ends the program for a sensor that cannot be simulated."""
    return StartError(f"sensor {printable(text, TITLE_MAX_CHARS)}", EXIT_BAD_FILE)
