"""Simulated sensors of installed packages: entry points of the group `understory.simulated_sensors`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

from mission.common.entry_points import TITLE_MAX_CHARS, EntryPointError, find_installed
from mission.common.exit_codes import EXIT_BAD_FILE
from mission.common.frames import Vec3
from mission.common.problems import printable
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.simulated import SimulatedSensor

GROUP: Final = "understory.simulated_sensors"


class SensorModel(Protocol):
    """One kind of sensor of all vehicles, with their drivers: what a model's entry point makes.

    The entry point bears the name of the companion's sensor (`understory.sensors`) and names a function of mission,
    stand and the vehicles' ids. A model may have `is_optical = True`: then a vehicle that is blind sends nothing.
    """

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """MAVLink frames that this vehicle's driver sends at `now_s`, or none. Called at each step, in order of time.

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
        """As the model has it. StartError for an exception of its own, and for what are no bytes."""
        try:
            data = self._frames(vehicle_id, state, positions_ned_m, now_s)
        except Exception as error:
            raise _error(f"{self._title}: frames: {type(error).__name__}: {error}") from error
        if not isinstance(data, bytes):
            raise _error(f"{self._title}: frames returned {data!r}: must be bytes")
        return data


def installed_sensors(mission: Mission, stand: Stand, ids: Sequence[int]) -> list[SimulatedSensor]:
    """Models of the sensors that the mission names. StartError: one has no model, or none that can be used."""
    return [_model_of(name, mission, stand, ids) for name in mission.sensors]


def _model_of(name: str, mission: Mission, stand: Stand, ids: Sequence[int]) -> SimulatedSensor:
    try:
        found = find_installed(GROUP, name)
        if found is None:
            raise EntryPointError(
                f"{name}: no installed package simulates it: there is no entry point {GROUP} of that name"
            )
        make = found.load()
    except EntryPointError as error:
        raise _error(str(error)) from None
    try:
        model = make(mission, stand, tuple(ids))
    except Exception as error:
        raise _error(f"{found.title}: {type(error).__name__}: {error}") from error
    arguments = list(inspect.signature(SensorModel.frames).parameters)[1:]
    wanted = f"frames({', '.join(arguments)})"
    frames = getattr(model, "frames", None)
    if not callable(frames):
        raise _error(f"{found.title}: made {model!r}, which has no {wanted}")
    try:
        inspect.signature(frames).bind(*arguments)
    except TypeError:
        raise _error(f"{found.title}: frames{inspect.signature(frames)}: must take {wanted}") from None
    return ModelSensor(found.name, found.title, model)


def _error(text: str) -> StartError:
    return StartError(f"sensor {printable(text, TITLE_MAX_CHARS)}", EXIT_BAD_FILE)
