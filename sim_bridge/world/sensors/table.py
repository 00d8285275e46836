"""The simulated sensors that there are. World, lockstep, server and external flights loop over them."""

from __future__ import annotations

from collections.abc import Sequence

from mission.document.model import Mission
from mission.schema.kinds import SensorClass
from mission.stand.stand import Stand
from sim_bridge.world.sensors.installed import installed_sensors
from sim_bridge.world.sensors.lidar import lidars_of
from sim_bridge.world.sensors.ranging import range_radios_of
from sim_bridge.world.sensors.simulated import SimulatedSensor


def simulated_sensors(mission: Mission, stand: Stand, ids: Sequence[int]) -> tuple[SimulatedSensor, ...]:
    """Sensors that the vehicles `ids` of this mission carry."""
    made = [make(mission, stand, ids) for make in (lidars_of, _raw_lidars_of, range_radios_of, _payload_models_of)]
    ours = [sensor for sensor in made if sensor is not None]
    return (*ours, *installed_sensors(mission, stand, ids))


def _raw_lidars_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> SimulatedSensor | None:
    """Lidars that tell every ray; what casts them, with arrays, is loaded only then."""
    if mission.sensing is None or mission.sensing.sensor is SensorClass.SECTORS:
        return None
    from sim_bridge.world.sensors.raw_lidar import raw_lidars_of

    return raw_lidars_of(mission, stand, ids)


def _payload_models_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> SimulatedSensor | None:
    """Other sensors; what knows how dark it is below crowns, with arrays, is loaded only then."""
    if not mission.payload:
        return None
    from sim_bridge.world.sensors.payload.drivers import payload_models_of

    return payload_models_of(mission, stand, ids)


def link_name(mission: Mission) -> str:
    """The sensor on whose link (`--sensor NAME=URL`) all drivers of a vehicle send; empty: none needs a link."""
    sensors = simulated_sensors(mission, Stand(), ())
    return next((sensor.name for sensor in sensors if not sensor.by_autopilot), "")
