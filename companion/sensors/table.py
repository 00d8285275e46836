"""The sensors that there are: command line, endpoint, runner, preflight, doctor and log loop over this table."""

from __future__ import annotations

from typing import Final

from companion.mavlink.sensor_source import SensorSource
from companion.sensors.obstacle_sensor import ObstacleSensor
from companion.sensors.range_radio import RangeRadio
from companion.sensors.raw_lidar import RawLidar
from mission.document.model import Mission

# To add one: its class beside these, and a line here (CONTRIBUTING.md, Worked examples).
SENSORS: Final[dict[str, type[SensorSource]]] = {kind.NAME: kind for kind in (ObstacleSensor, RawLidar, RangeRadio)}


def sensors_of(mission: Mission) -> list[SensorSource]:
    """Sensors that one vehicle of this mission flies by, anew."""
    return [kind.of(mission) for kind in SENSORS.values() if kind.is_flown(mission)]


def autopilot_hz(mission: Mission) -> dict[int, float]:
    """Messages that these need of the own autopilot -> rate."""
    return {id_: hz for kind in SENSORS.values() if kind.is_flown(mission) for id_, hz in kind.AUTOPILOT_HZ.items()}
