"""Simulated sensors of installed packages: entry points of the group `understory.simulated_sensors`."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from mission.common.entry_points import EntryPointError, find_installed
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.simulated import ModelSensor, SimulatedSensor, refuse_sensor

GROUP: Final = "understory.simulated_sensors"


class SensorModel(Protocol):
    """One kind of sensor of all vehicles, with their drivers: what a model's entry point makes.

    The entry point bears the name of the companion's sensor (`understory.sensors`) and names a function of mission,
    stand and the vehicles' ids. A model may have `is_optical = True`: then a vehicle that is blind sends nothing.
    """

    def frames(self, vehicle_id: int, state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float) -> bytes:
        """MAVLink frames that this vehicle's driver sends at `now_s`, or none. Called at each step, in order of time.

        `state`: the vehicle's; `positions_ned_m`: of all vehicles by id. `now_s`: by the driver's clock, simulated time
        in lockstep; where a world is served, wall time, which goes on when that falls behind.
        """


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
        raise refuse_sensor(str(error)) from None
    try:
        model = make(mission, stand, tuple(ids))
    except Exception as error:
        raise refuse_sensor(f"{found.title}: {type(error).__name__}: {error}") from error
    arguments = list(inspect.signature(SensorModel.frames).parameters)[1:]
    wanted = f"frames({', '.join(arguments)})"
    frames = getattr(model, "frames", None)
    if not callable(frames):
        raise refuse_sensor(f"{found.title}: made {model!r}, which has no {wanted}")
    try:
        inspect.signature(frames).bind(*arguments)
    except TypeError:
        raise refuse_sensor(f"{found.title}: frames{inspect.signature(frames)}: must take {wanted}") from None
    return ModelSensor(found.name, found.title, model)
