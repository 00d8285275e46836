"""The sensors that there are: command line, endpoint, runner, preflight, doctor and log loop over this table.

Those of installed packages are loaded where a mission or an option names one, before anything flies.
"""

from __future__ import annotations

from typing import Final

from companion.mavlink.sensor_source import SensorSource
from companion.mavlink.streams import fastest_hz
from companion.sensors import installed
from companion.sensors.obstacle_sensor import ObstacleSensor
from companion.sensors.payload import PayloadSensors
from companion.sensors.range_radio import RangeRadio
from companion.sensors.raw_lidar import RawLidar
from mission.common.entry_points import EntryPointError
from mission.common.problems import MissionError, Problem, shown
from mission.document.model import Mission

# To add one: its class beside these, and a line here (CONTRIBUTING.md, Worked examples).
SENSORS: Final[dict[str, type[SensorSource]]] = {
    kind.NAME: kind for kind in (ObstacleSensor, RawLidar, RangeRadio, PayloadSensors)
}


def kinds_of(mission: Mission) -> dict[str, type[SensorSource]]:
    """Kinds of sensor that vehicles of this mission fly by. MissionError: one of `sensors` is not to be had."""
    flown = {name: kind for name, kind in SENSORS.items() if kind.is_flown(mission)}
    for name in mission.sensors:
        flown[name] = kind = _named(name, mission)
        if not kind.is_flown(mission):
            raise _refused(mission, name, f"{kind.TITLE}: the mission {kind.UNUSED}")
        for other in flown.values():
            shared = [kind.MESSAGES[id_] for id_ in kind.MESSAGES if id_ in other.MESSAGES and other is not kind]
            if shared:
                raise _refused(mission, name, f"{shared[0]}: is read by {other.NAME} in this mission")
    return flown


def kind_of(name: str) -> type[SensorSource]:
    """By its name: ours, or an installed package's. EntryPointError: there is none, or it is no sensor."""
    return SENSORS[name] if name in SENSORS else installed.load_sensor(name)


def sensors_of(mission: Mission) -> list[SensorSource]:
    """Sensors that one vehicle of this mission flies by, anew."""
    return [kind.of(mission) for kind in kinds_of(mission).values()]


def autopilot_hz(mission: Mission) -> dict[int, float]:
    """Messages that these need of the own autopilot -> rate."""
    return fastest_hz(*[kind.AUTOPILOT_HZ for kind in kinds_of(mission).values()])


def _named(name: str, mission: Mission) -> type[SensorSource]:
    if name in SENSORS:
        raise _refused(mission, name, "is flown by without being named: [sensing], [ranging] or [[payload]] says so")
    try:
        return installed.load_sensor(name)
    except EntryPointError as error:
        raise _refused(mission, name, str(error)) from None


def _refused(mission: Mission, name: str, why: str) -> MissionError:
    return MissionError([Problem(mission.name or "mission", None, "sensors", shown([name]), why)])
